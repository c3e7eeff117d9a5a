"""Views of one robot of a fleet."""

import numpy as np

from slamgym.core.geometry import compose, inverse, part_of
from slamgym.core.types import AT_REST, FloatArray, LaserScan, Pose2D, Twist2D
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.coverage import Coverage
from slamgym.sim import World


class SimulatedRobot:
    """A view of one robot of a fleet: driven, and seen by its own sensors.

    Convention: the map frame has its origin at the start position and the world's axes; the robot starts
    there with its true heading, as if read from a compass.

    Args:
        fleet: Robots that have begun.
        index: Which one.
    """

    def __init__(self, fleet: Fleet, index: int = 0) -> None:
        self._fleet = fleet
        self._index = index
        self._ids = np.array([index])

    def step(self, command: Twist2D) -> None:
        """Drive for one control step towards a velocity, then scan; nobody maps."""
        targets = np.tile(command, (len(self._fleet), 1))
        self._fleet.drive(self._ids, self._fleet.within_limits(targets))
        self._fleet.look(self._ids)

    def _pose(self, table: FloatArray) -> Pose2D:
        return Pose2D(*table[self._index].tolist())

    @property
    def world(self) -> World:
        """The robot in its building."""
        return self._fleet.each[self._index].world

    @property
    def radius(self) -> float:
        """Of the circle that holds the robot [m]."""
        return self._fleet.config.robot.radius

    @property
    def steps(self) -> int:
        """Steps so far."""
        return int(self._fleet.robots.steps[self._index])

    @property
    def time(self) -> float:
        """Robot time [s]."""
        return self.steps * self._fleet.config.control_step

    @property
    def start(self) -> Pose2D:
        """Start pose, world frame."""
        return self._pose(self._fleet.robots.start)

    @property
    def world_from_map(self) -> Pose2D:
        """The map frame in the world."""
        return Pose2D(self.start.x, self.start.y, 0.0)

    @property
    def true_pose(self) -> Pose2D:
        """World frame."""
        return self._pose(self._fleet.robots.pose)

    @property
    def true_map_pose(self) -> Pose2D:
        """The true pose, expressed in the map frame."""
        x, y, theta = self.true_pose
        start = self.start
        return Pose2D(x - start.x, y - start.y, theta)

    @property
    def odometry_pose(self) -> Pose2D:
        """Integrated wheel odometry; starts in the map frame."""
        return self._pose(self._fleet.robots.odometry)

    @property
    def velocity(self) -> Twist2D:
        """As measured by the wheel odometry."""
        return Twist2D(*self._fleet.robots.velocity[self._index].tolist())

    @property
    def path_length(self) -> float:
        """True path length so far [m]."""
        return float(self._fleet.robots.path[self._index])

    @property
    def collisions(self) -> int:
        """How often the robot came into contact with something."""
        return int(self._fleet.robots.collisions[self._index])

    @property
    def coverage(self) -> Coverage:
        """The floor that was truly seen."""
        return self._fleet.coverage(self._index)

    @property
    def true_ranges(self) -> FloatArray:
        """Ranges without errors, from the robot's pose alone, shape (num_beams,) [m]."""
        ranges: FloatArray = self._fleet.scans.true[self._index].copy()
        return ranges

    @property
    def scan(self) -> LaserScan:
        """The newest scan; its motion is that of the odometry."""
        lidar = self._fleet.lidar
        stamp = self.time - lidar.config.scan_time
        ranges = self._fleet.scans.ranges[self._index].copy()
        return LaserScan(stamp, ranges, lidar.geometry, self._in_scan(self._fleet.robots.moved))

    @property
    def swept(self) -> Pose2D:
        """True motion while the newest scan was taken."""
        return self._in_scan(self._fleet.robots.driven)

    @property
    def true_scan_pose(self) -> Pose2D:
        """The true pose at the newest scan's stamp, world frame."""
        return before(self.true_pose, self.swept)

    def _in_scan(self, motions: FloatArray) -> Pose2D:
        """The part of a step's motion that fell into the scan: its end, at the same speeds."""
        config = self._fleet.config
        if not config.lidar.scan_time:
            return AT_REST
        return part_of(self._pose(motions), config.lidar.scan_time / config.control_step)


def before(pose: Pose2D, motion: Pose2D) -> Pose2D:
    """Where a motion to a pose began."""
    return pose if motion == AT_REST else compose(pose, inverse(motion))
