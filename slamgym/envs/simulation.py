"""One episode of a robot in a building: actions, truth, sensors and belief, stepped together, and its log."""

from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces

from slamgym.cad import FloorPlan
from slamgym.core.errors import ActionError
from slamgym.core.geometry import between, compose, inverse, part_of
from slamgym.core.types import (
    AT_REST,
    UNKNOWN,
    Float32Array,
    FloatArray,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
    Twist2D,
)
from slamgym.envs.config import ExploreConfig
from slamgym.envs.plan_cache import PreparedPlan, Streams
from slamgym.interop import read_ros_map
from slamgym.sim import Lidar, Motion, WheelOdometry, World
from slamgym.slam import make_mapper
from slamgym.slam.columns import Columns
from slamgym.slam.deskew import deskewed_at_last_beam

EXPECTED_ACTIONS = {
    "normalized": "two numbers in [-1, 1], shares of the highest speed and of the highest turning rate",
    "physical": "two numbers, the speed [m/s] and the turning rate [rad/s]",
    "discrete": "0 (ahead), 1 (turn left) or 2 (turn right)",
}
"""Description of each setting's actions, for the error about other ones."""


class Actions:
    """The actions that the settings name.

    Attributes:
        space: Their space.
    """

    def __init__(self, config: ExploreConfig) -> None:
        linear = config.robot.max_linear
        angular = config.robot.max_angular
        self._kind = config.actions
        self._scale = (linear, angular) if config.actions == "normalized" else (1.0, 1.0)
        self._commands: dict[int, Twist2D] = {}
        self.space: spaces.Space[Any]
        if config.actions == "discrete":
            self._commands = {
                0: Twist2D(linear, 0.0),
                1: Twist2D(0.0, angular),
                2: Twist2D(0.0, -angular),
            }
            self.space = spaces.Discrete(len(self._commands))
        else:
            high = (np.array([linear, angular]) / self._scale).astype(np.float32)
            self.space = spaces.Box(-high, high, dtype=np.float32)

    def to_command(self, action: Any) -> Twist2D:
        """The velocity that an action asks for; the world cuts off what exceeds the robot's limits.

        Raises:
            ActionError: If it is of another kind than the actions of the space.
        """
        try:
            if self._commands:
                return self._commands[int(action)]
            linear, angular = action
            return Twist2D(float(linear) * self._scale[0], float(angular) * self._scale[1])
        except (TypeError, ValueError, KeyError):
            raise ActionError(action, EXPECTED_ACTIONS[self._kind]) from None

    def to_commands(self, actions: Any) -> FloatArray:
        """The velocities that the actions of many robots ask for, shape (N, 2).

        Raises:
            ActionError: If they are of another kind than the actions of the space.
        """
        try:
            if self._commands:
                return np.array([self._commands[int(action)] for action in actions])
            shares: FloatArray = np.asarray(actions, dtype=np.float64).reshape(len(actions), 2)
            return shares * self._scale
        except (TypeError, ValueError, KeyError):
            raise ActionError(actions, EXPECTED_ACTIONS[self._kind]) from None


class SimulatedRobot:
    """A robot in a building: driven, and seen by its own sensors.

    Convention: the map frame has its origin at the start position and the world's axes; the robot starts
    there with its true heading, as if read from a compass.

    Args:
        prepared: The building.
        start: Where the robot stands at first, world frame.
        config: The settings.
        lidar: The scanner.
        streams: Sources of randomness.

    Attributes:
        world: The robot in its building.
        radius: Of the circle that holds the robot [m].
        steps: So far.
        start: Start pose, world frame.
        world_from_map: The map frame in the world.
        scan: The newest scan.
        true_ranges: Without errors, from the robot's pose alone, shape (num_beams,) [m].
        odometry_pose: Integrated wheel odometry; starts in the map frame.
        velocity: As measured by the wheel odometry.
        path_length: True path length so far [m].
        collisions: How often the robot came into contact with something.

    Raises:
        ConfigError: If the start leaves no room for the robot.
    """

    def __init__(
        self,
        prepared: PreparedPlan,
        start: Pose2D,
        config: ExploreConfig,
        lidar: Lidar,
        streams: Streams,
    ) -> None:
        self.world = World(
            prepared.plan, config.robot, clutter=prepared.clutter, surfaces=prepared.surfaces
        )
        self.world.reset(start)
        self._lidar = lidar
        self._streams = streams
        self._odometry = WheelOdometry(config.odometry, config.robot, streams.odometry)
        self._dt = config.control_step
        self.radius = config.robot.radius
        self.steps = 0
        self.start = start
        self.world_from_map = Pose2D(start.x, start.y, 0.0)
        self.odometry_pose = Pose2D(0.0, 0.0, start.theta)
        self._odometry.reset(self.odometry_pose)
        self.velocity = Twist2D(0.0, 0.0)
        self.path_length = 0.0
        self.collisions = 0
        self._in_contact = False
        self._sense(AT_REST, AT_REST)

    @property
    def time(self) -> float:
        """Robot time [s]."""
        return self.steps * self._dt

    @property
    def true_pose(self) -> Pose2D:
        """World frame."""
        return self.world.pose

    @property
    def true_map_pose(self) -> Pose2D:
        """The true pose, expressed in the map frame."""
        x, y, theta = self.world.pose
        return Pose2D(x - self.start.x, y - self.start.y, theta)

    @property
    def true_scan_pose(self) -> Pose2D:
        """The true pose at the newest scan's stamp, world frame."""
        return _before(self.world.pose, self._swept)

    @property
    def scan_odometry(self) -> Pose2D:
        """The odometry at the newest scan's stamp."""
        return _before(self.odometry_pose, self.scan.motion)

    def step(self, command: Twist2D) -> Motion:
        """Drive for one control step towards a velocity, then scan."""
        dt = self._dt
        motion = self.world.step(command, dt)
        before = self.odometry_pose
        self.odometry_pose = self._odometry.update(motion, self._streams.odometry)
        moved = between(before, self.odometry_pose)
        self.velocity = Twist2D(moved.x / dt, moved.theta / dt)
        self.steps += 1
        self.path_length += motion.distance
        self.collisions += motion.contact and not self._in_contact
        self._in_contact = motion.contact
        self._sense(motion.increment, moved)
        return motion

    def _sense(self, driven: Pose2D, moved: Pose2D) -> None:
        """Scan from where the robot stands or has just ``driven``; ``moved``: the same by its odometry."""
        world = self.world
        speed = Twist2D(driven.x / self._dt, driven.theta / self._dt)
        sighting = self._lidar.look(world.pose, world.segments(), speed)
        self.true_ranges = sighting.ranges
        if len(sighting.sensors) > 1:
            self.true_ranges = self._lidar.true_ranges(world.pose, world.segments())
        # Speeds are the same all the step long, so its last part is as its first.
        sweep = self._lidar.config.sweep
        share = sweep / self._dt
        self._swept = part_of(driven, share) if share else AT_REST
        by_odometry = part_of(moved, share) if share else AT_REST
        rng = self._streams.lidar
        self.scan: LaserScan = self._lidar.measure(
            sighting, rng, self.time - sweep, world.surfaces, by_odometry
        )


def _before(pose: Pose2D, motion: Pose2D) -> Pose2D:
    """Where a motion to a pose began."""
    return pose if motion == AT_REST else compose(pose, inverse(motion))


class Simulation(SimulatedRobot):
    """The episode of a robot that maps.

    Args and frames as :class:`SimulatedRobot`.

    Attributes:
        mapper: SLAM.
        believed_pose: What SLAM believes, map frame; by odometry since the newest scan's first beam.
        is_new_scan_processed: Whether SLAM processed the newest scan, i.e. whether the map may have changed.
    """

    def __init__(
        self,
        prepared: PreparedPlan,
        start: Pose2D,
        config: ExploreConfig,
        lidar: Lidar,
        streams: Streams,
    ) -> None:
        initial = Pose2D(0.0, 0.0, start.theta)
        finished = finished_map(prepared.plan, start, config)
        self.mapper = make_mapper(config.slam, lidar.geometry, initial, streams.slam, finished)
        self._believes_truth = config.slam.mode == "ground_truth"
        super().__init__(prepared, start, config, lidar, streams)

    @property
    def ranges(self) -> Float32Array:
        """The newest scan as seen from where the robot is now, (num_beams,) [m]; infinite where it saw nothing."""
        if self.scan.motion == AT_REST:
            return self.scan.ranges
        ranges = deskewed_at_last_beam(self.scan).ranges
        return np.where(np.isnan(ranges), np.float32(np.inf), ranges)

    def _sense(self, driven: Pose2D, moved: Pose2D) -> None:
        """Scan, and let SLAM take it in."""
        super()._sense(driven, moved)
        scan = self.scan
        odometry = self.scan_odometry
        if self._believes_truth:
            scan = replace(scan, motion=self._swept)
            odometry = _before(self.true_map_pose, self._swept)
        self.is_new_scan_processed = self.mapper.update(odometry, scan)
        pose = self.mapper.pose
        self.believed_pose = pose if scan.motion == AT_REST else compose(pose, scan.motion)


def finished_map(plan: FloorPlan, start: Pose2D, config: ExploreConfig) -> OccupancyGrid | None:
    """The finished map that a robot is given to localise on, in the map frame; None where the settings ask for none.

    Args:
        plan: The building.
        start: Where the robot stands at first, world frame.
        config: Names the map's file, if it isn't the plan as a drawing.

    Raises:
        InputFileError: If the map's file can't be read.
    """
    if config.slam.mode != "map":
        return None
    if config.finished_map is None:
        return plan.raster(config.slam.resolution, offset=(start.x, start.y), outside=UNKNOWN)
    grid = read_ros_map(config.finished_map)
    frame = grid.frame._replace(
        origin_x=grid.frame.origin_x - start.x, origin_y=grid.frame.origin_y - start.y
    )
    return OccupancyGrid(grid.cells, frame)


class EpisodeLog(Columns):
    """Truth, odometry, estimate and ranges over time: a row for each scan, at its stamp.

    The first entry is the scan of the robot at rest at its start. The arrays handed out are read-only views
    of what is recorded so far.

    Args:
        num_beams: Beams of a scan.
    """

    def __init__(self, num_beams: int) -> None:
        super().__init__(
            {"ranges": np.float32},
            stamps=(),
            true_poses=(3,),
            odometry=(3,),
            estimates=(3,),
            motions=(3,),
            ranges=(num_beams,),
        )

    def __getitem__(self, name: str) -> Any:
        """An array's rows."""
        view = super().__getitem__(name)
        view.flags.writeable = False
        return view

    @property
    def stamps(self) -> FloatArray:
        """Times of the scans' first beams since the start of the episode, shape (N,) [s]."""
        return np.asarray(self["stamps"])

    @property
    def true_poses(self) -> FloatArray:
        """True poses in the world frame, shape (N, 3) [m, m, rad]."""
        return np.asarray(self["true_poses"])

    @property
    def odometry(self) -> FloatArray:
        """Poses by wheel odometry alone, shape (N, 3) [m, m, rad]; they begin in the map frame."""
        return np.asarray(self["odometry"])

    @property
    def estimates(self) -> FloatArray:
        """Poses that SLAM believed at the time, shape (N, 3) [m, m, rad], map frame.

        They are those of the observations: later corrections of the path, which ``mapper.trajectory()`` has,
        are not in it.
        """
        return np.asarray(self["estimates"])

    @property
    def motions(self) -> FloatArray:
        """Motions from each scan's first beam to its last by wheel odometry, shape (N, 3) [m, m, rad]."""
        return np.asarray(self["motions"])

    @property
    def ranges(self) -> Float32Array:
        """Measured ranges as REP 117 has them, shape (N, num_beams) [m]."""
        return np.asarray(self["ranges"])

    def true_trajectory(self, start: Pose2D) -> Trajectory:
        """The true path in the map frame.

        Convention: ``start`` is the pose in the world at which the episode began; its position is the origin
        of the map frame, whose axes are the world's.
        """
        return Trajectory(self.stamps.copy(), self.true_poses - np.array([start.x, start.y, 0.0]))
