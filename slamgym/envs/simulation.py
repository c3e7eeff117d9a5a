"""One robot's episode: its actions, views of it in a fleet, and its log."""

import math
import operator
from typing import Any

import numpy as np
from gymnasium import spaces

from slamgym.core.errors import ActionError
from slamgym.core.types import Float32Array, FloatArray, OccupancyGrid, Pose2D, Trajectory, Twist2D
from slamgym.envs.batch.beliefs import Beliefs
from slamgym.envs.batch.robot import SimulatedRobot, before
from slamgym.envs.config import ExploreConfig
from slamgym.slam import Mapper
from slamgym.slam.columns import Columns
from slamgym.viz.exploration import Scene, SceneFigures

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

    def to_command(self, action: Any) -> FloatArray:
        """The velocity that one robot's action asks for, shape (1, 2); see :meth:`to_commands`.

        Raises:
            ActionError: If it is of another kind than the actions of the space, or not a number.
        """
        try:
            return self.to_commands([action])
        except ActionError:
            raise ActionError(action, EXPECTED_ACTIONS[self._kind]) from None

    def to_commands(self, actions: Any) -> FloatArray:
        """The velocities that the actions of many robots ask for, shape (N, 2) [m/s, rad/s].

        Raises:
            ActionError: If they are of another kind than the actions of the space, or not numbers.
        """
        try:
            if self._commands:
                return np.array([self._commands[operator.index(action)] for action in actions])
            shares: FloatArray = np.asarray(actions, dtype=np.float64).reshape(len(actions), 2)
        except (TypeError, ValueError, KeyError):
            raise ActionError(actions, EXPECTED_ACTIONS[self._kind]) from None
        if np.isnan(shares).any():
            raise ActionError(actions, EXPECTED_ACTIONS[self._kind])
        return shares * self._scale


class Simulation(SimulatedRobot):
    """A view of one robot of a fleet that maps; see :class:`SimulatedRobot`."""

    def __init__(self, beliefs: Beliefs, index: int = 0) -> None:
        super().__init__(beliefs.fleet, index)
        self._beliefs = beliefs

    @property
    def mapper(self) -> Mapper:
        """SLAM."""
        return self._beliefs.mapper(self._index)

    @property
    def believed_pose(self) -> Pose2D:
        """What SLAM believes, map frame; by odometry since the newest scan's first beam."""
        return self._pose(self._beliefs.maps.believed)

    @property
    def ranges(self) -> Float32Array:
        """The newest scan as seen from where the robot is now, (num_beams,) [m]; infinite where it saw nothing."""
        ranges: Float32Array = self._beliefs.ranges[self._index].copy()
        return ranges

    def scene(self, log: "EpisodeLog") -> Scene:
        """Contents of a picture of the episode, all in the world frame.

        Args:
            log: The paths so far.
        """
        prepared = self._fleet.each[self._index].prepared
        world = self.world
        start = self.start
        belief = self.believed_pose
        truth = self.true_pose
        placed = Pose2D(belief.x + start.x, belief.y + start.y, belief.theta)
        grid = self.mapper.occupancy_grid()
        frame = grid.frame._replace(
            origin_x=grid.frame.origin_x + start.x, origin_y=grid.frame.origin_y + start.y
        )
        num_fixed = len(prepared.plan.segments()) + len(prepared.clutter.segments())
        coverage = self.coverage
        return Scene(
            plan=prepared.plan,
            furniture=world.building.furniture(),
            moving=world.segments()[num_fixed:],
            robot_radius=self.radius,
            true_pose=truth,
            believed_pose=placed,
            scan=self.scan,
            true_ranges=self.true_ranges,
            grid=OccupancyGrid(grid.cells, frame),
            seen=coverage.seen,
            seen_frame=coverage.frame,
            true_path=log.true_poses[:, :2],
            believed_path=log.estimates[:, :2] + [start.x, start.y],
            figures=SceneFigures(
                time=self.time,
                coverage=coverage.share,
                path_length=self.path_length,
                pose_error=math.hypot(placed.x - truth.x, placed.y - truth.y),
                contacts=self.collisions,
            ),
        )


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

    def note(self, now: Simulation) -> None:
        """Add the newest scan of a robot."""
        scan = now.scan
        self.append(
            stamps=scan.stamp,
            true_poses=now.true_scan_pose,
            odometry=before(now.odometry_pose, scan.motion),
            estimates=now.mapper.pose,
            motions=scan.motion,
            ranges=scan.ranges,
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
