"""Navigation stack: a goal on the map becomes a velocity for each control step.

It plans on the map as last published, follows the path, replans when the map blocks it or the robot leaves
it, and recovers when the robot is stuck. Whether the robot moves is read from its estimated pose,
never from its commands. A goal that can't be reached aborts at once.
"""

import enum
import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from slamgym.core.config import Settings
from slamgym.core.geometry import transform_points, wrap_angle
from slamgym.core.types import Float32Array, FloatArray, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import (
    LETHAL_COST,
    Costmap,
    CostmapConfig,
    cells_inside,
    crop_known,
    free_body,
    make_costmap,
)
from slamgym.planning.frontiers import Point, Reachable, reachable_space
from slamgym.planning.goal_progress import STUCK_TIME, GoalProgress, apart
from slamgym.planning.grid_path import PathLengths, path_is_free, plan_path
from slamgym.planning.path_follower import FollowerConfig, PathFollower
from slamgym.planning.unmapped import MapCorrections

STOP = Twist2D(0.0, 0.0)


class GoalStatus(enum.Enum):
    """Status of a goal."""

    IDLE = "no goal"
    ACTIVE = "driving"
    SUCCEEDED = "reached"
    ABORTED = "given up"


@dataclass(frozen=True)
class Goal:
    """Where to go, in the map frame [m]."""

    x: float
    y: float
    look_at: Point | None = None  # once there, turn towards this point


_GOAL_TOLERANCE = 0.15
"""A goal is reached within this distance [m]: three cells of the map."""
PLAN_TOLERANCE = 0.6
"""A goal in unknown or inflated space is replaced by a place this near to it [m]: twice the body and a margin."""
_REPLAN_INTERVAL = 1.0
"""Shortest time between two plans to the same goal [s] (move_base plans at 1 Hz)."""
_DEVIATION = 0.4
"""Farther than this from the path the robot plans again [m]: a pursued point is 0.5 m ahead."""
_BARRIER_GAP = 0.1
"""Assumed distance from the robot's body to an obstacle that it couldn't pass [m]."""
_SEEN_NEAR = 1.5
"""The costmap takes over what the scan shows within this distance [m]: what matters for the next seconds."""
_BACK_UP = 0.2
"""Distance of the backward recovery [m]: less than a body, for the scanner doesn't look there."""
_BACK_UP_SPEED = 0.1
"""Speed of the backward recovery [m/s]."""
_TURN_TIME = 4.0
"""Longest duration of the recovery by a turn [s]."""
_RECOVERIES = ("back up", "turn", "back up")
"""Recoveries from one place, one after the other, before a goal is given up."""

_TIGHT_RECOVERIES = 1
"""The same where the footprint is smaller than the robot: in two rooms parted by posts, whose gaps are as wide as the
robot, 0.3 m, five explorations took 323 s and two contacts with one, 485 s and five contacts with three."""


class NavigatorConfig(Settings, section="navigator"):
    """Settings of the navigation stack."""

    progress_time: float = 25.0
    """Without coming nearer along the path for so long the robot recovers, moving or not [s]."""
    follower: FollowerConfig = field(default_factory=FollowerConfig)
    """Path following."""


@lru_cache(maxsize=16)
def _inflation(radius: float) -> CostmapConfig:
    """Inflation of obstacles for a robot of some radius [m].

    Paths keep within sight of walls, which a scanner of short range needs to localise the robot.
    """
    inflation_radius = max(CostmapConfig().inflation_radius, radius)
    return CostmapConfig(radius, inflation_radius, coastal_distance=1.5)


class Navigator:
    """Drives a robot to goals on the map that it believes in.

    Use: :meth:`update_map` whenever a map is published, :meth:`set_goal`, then :meth:`step` once per control
    step until :attr:`status` is no longer ``ACTIVE``.
    """

    def __init__(self, context: ExplorerContext, config: NavigatorConfig | None = None) -> None:
        self.context = context
        self.config = config or NavigatorConfig()
        self.follower = PathFollower(context, self.config.follower)
        self.status = GoalStatus.IDLE
        self.reason = ""  # why the last goal was given up
        self.goal: Goal | None = None
        self.inscribed_radius = context.robot_radius
        self.costmap: Costmap | None = None
        self.lengths = PathLengths()
        self._reachable: Reachable | None = None
        # Where to search the reachable space from, until that was done.
        self._searched_from: Pose2D | None = None
        self._grid: OccupancyGrid | None = None
        self._published: OccupancyGrid | None = None  # the newest map as it came
        self.corrections = MapCorrections(0.5 * context.frame.resolution)
        self._progress = GoalProgress.begin(Pose2D(0.0, 0.0, 0.0), 0.0)

    @property
    def reachable(self) -> Reachable | None:
        """Where the robot could get to when the costmap was made; None without a map, or if it was walled in."""
        # Searched when first asked for, which only decisions and plans do.
        if self.costmap is not None and self._searched_from is not None:
            self._reachable = reachable_space(self.costmap, self._searched_from)
            self._searched_from = None
        return self._reachable

    @property
    def is_active(self) -> bool:
        """True while the robot drives to a goal."""
        return self.status is GoalStatus.ACTIVE

    def update_map(self, grid: OccupancyGrid, pose: Pose2D, time: float) -> None:
        """Take over a newly published map.

        Args:
            grid: The map, however large its unknown part.
            pose: The robot's estimated pose in the frame of the map.
            time: Now [s].
        """
        self._published = grid
        self.corrections.note_map(grid)
        self._grid = crop_known(self.corrections.free(grid), pose)
        self._rebuild(pose, time)
        if self.is_active and self.costmap is not None:
            ahead = self.follower.ahead
            if len(ahead) and not path_is_free(self.costmap, ahead):
                self._plan(pose, time)

    def map_alone(self, pose: Pose2D) -> OccupancyGrid:
        """The costmap's part of the map, without obstacles that only scans showed or that were noted."""
        assert self._grid is not None, "there is a costmap"
        return free_body(self._grid, pose, self.context.robot_radius)

    def enter_open_space(self, points: FloatArray, pose: Pose2D, time: float) -> None:
        """Take what the map doesn't know at some points for free, shape (N, 2) [m]; the scan still stops the robot."""
        self.corrections.note_open_space(points)
        if self._published is not None:
            self.update_map(self._published, pose, time)

    def block_ahead(self, pose: Pose2D, time: float) -> None:
        """Note that the robot didn't get through just ahead on its path; from the second time on, it is closed.

        For what stops the body and not the beams, such as glass; narrow doors get another try.
        """
        ahead = self.follower.ahead - np.array(pose[:2])
        reach = self.inscribed_radius + _BARRIER_GAP
        beyond = ahead[np.hypot(*ahead.T) > reach]
        if len(beyond) == 0:
            return
        nearest = beyond[0]
        along = nearest / np.hypot(*nearest)
        barrier = pose[:2] + reach * along
        if self.corrections.note_impassable(barrier, along):
            self._rebuild(pose, time)

    def keep_obstacles(self, pose: Pose2D, time: float) -> None:
        """Keep the obstacles just around the robot, where it gave a goal up, even if map and scan show them no more."""
        if self.costmap is not None and self._grid is not None:
            self.corrections.keep_around(pose, self.context.robot_radius, self.costmap, self._grid)
            self._rebuild(pose, time)

    def set_inscribed_radius(self, radius: float, pose: Pose2D, time: float) -> None:
        """Plan as if the robot had another radius [m], e.g. to try doors that the map draws too narrow."""
        self.inscribed_radius = radius
        self._rebuild(pose, time)

    def set_goal(self, goal: Goal, pose: Pose2D, time: float) -> None:
        """Go somewhere. Sets :attr:`status` to ``ABORTED`` at once if no path leads there."""
        if not self.is_active:
            self._progress = GoalProgress.begin(pose, time)
        self.goal = goal
        self.status = GoalStatus.ACTIVE
        self.reason = ""
        self._progress.begin_goal(time)
        self._plan(pose, time)

    def cancel(self) -> None:
        """Drop the goal."""
        self.goal = None
        self.status = GoalStatus.IDLE

    def end(self, reached: bool) -> None:
        """Take over from another navigation that drives how it ended; the next :meth:`step` says so."""
        self._progress.outcome = reached

    def step(self, pose: Pose2D, ranges: Float32Array, time: float) -> Twist2D:
        """Velocity for the next control step; updates :attr:`status`.

        Args:
            pose: The robot's estimated pose in the frame of the map.
            ranges: Scan, shape (num_beams,) [m]; no return is the largest range or inf.
            time: Now [s].
        """
        if not self.is_active or self.costmap is None:
            return STOP
        if not self.context.drives:
            self._watch(pose, time)
            return STOP
        command = self._drive(self.costmap, pose, self.follower.points(ranges), time)
        return command if self.is_active else STOP

    def _drive(self, costmap: Costmap, pose: Pose2D, obstacles: FloatArray, time: float) -> Twist2D:
        """Velocity towards the goal, if it isn't given up meanwhile."""
        if self._progress.recovery:
            command = self._continue_recovery(pose, time)
            if command is not None:
                return command
            self._plan(pose, time)
        elif self._is_stuck(pose, time):
            self._begin_recovery(pose, obstacles, time)
        if self._progress.arrived or self.follower.remaining(pose) < _GOAL_TOLERANCE:
            return self._finish(pose)
        command = self.follower.step(costmap, pose, obstacles)
        self._mind_deviation(pose, obstacles, time)
        return command

    def _watch(self, pose: Pose2D, time: float) -> None:
        """End a goal that another navigation drives to, also if it doesn't say so but stands for long."""
        progress = self._progress
        progress.note_pose(pose, time)
        stands = time - progress.moved_at
        is_reached = progress.outcome
        if is_reached is None and stands > STUCK_TIME:
            left = math.dist(self.follower.path[-1], pose[:2])
            if left < _DEVIATION:
                is_reached = True
        if is_reached:
            self.status = GoalStatus.SUCCEEDED
        elif is_reached is False or stands > self.config.progress_time:
            self._abort("given up by the navigation")

    def _finish(self, pose: Pose2D) -> Twist2D:
        """Turn towards what the goal wants looked at, then report success."""
        self._progress.arrived = True
        if self.goal is not None and self.goal.look_at is not None:
            turn = self.follower.turn_towards(pose, *self.goal.look_at)
            if turn is not None:
                return turn
        if self.is_active:
            self.status = GoalStatus.SUCCEEDED
        return STOP

    def _mind_deviation(self, pose: Pose2D, obstacles: FloatArray, time: float) -> None:
        """Plan again when the robot is off its path or the scan blocks it."""
        if time - self._progress.planned_at < _REPLAN_INTERVAL:
            return
        ahead = self.follower.ahead
        off = 0.0
        if len(ahead):
            x, y = ahead[0]
            off = math.hypot(x - pose.x, y - pose.y)
        if self.follower.blocked:
            self._remember(obstacles, pose, time)
            self._rebuild(pose, time)
            # A path round what blocks the robot, if there is one; else it waits for it to go away.
            self._plan(pose, time, keep_old=True)
        elif off > _DEVIATION:
            self._plan(pose, time)

    def _plan(self, pose: Pose2D, time: float, keep_old: bool = False) -> None:
        """Plan a path to the goal; without one, give up (or keep the old path)."""
        self._progress.planned_at = time
        if self.costmap is None or self.goal is None:
            self._abort("no map")
            return
        goal = (self.goal.x, self.goal.y)
        path = plan_path(self.costmap, pose, goal, PLAN_TOLERANCE, self.reachable)
        if path is not None:
            self.follower.set_path(path)
        elif not keep_old:
            self._abort("unreachable")

    def _abort(self, reason: str) -> None:
        self.status = GoalStatus.ABORTED
        self.reason = reason

    def _rebuild(self, pose: Pose2D, time: float) -> None:
        """Costmap from the map, what the scan showed lately, and the robot's own body."""
        if self._grid is None:
            return
        marked = self.corrections.mark(self._grid, time)
        grid = free_body(marked, pose, self.context.robot_radius)
        inflation = _inflation(self.inscribed_radius)
        self.costmap = make_costmap(grid, inflation, self.costmap)
        self._searched_from = pose

    def _remember(self, obstacles: FloatArray, pose: Pose2D, time: float) -> None:
        """Keep what the scan shows near the robot for the costmap."""
        squared = (obstacles**2).sum(axis=1)
        near = obstacles[squared < _SEEN_NEAR**2]
        points = transform_points(pose, near)
        self.corrections.note_seen(points, pose, time)

    # Recovery: wait for none, plan round what the scan shows, back up, turn; then give up.

    def _is_stuck(self, pose: Pose2D, time: float) -> bool:
        """True if the robot has stood still, or not come nearer, for too long."""
        self._progress.note_pose(pose, time)
        self._progress.note_remaining(self.follower.remaining(pose), pose, time)
        return self._progress.is_stuck(time, self.config.progress_time)

    def _begin_recovery(self, pose: Pose2D, obstacles: FloatArray, time: float) -> None:
        """Start the next recovery, or give the goal up after the last one."""
        progress = self._progress
        progress.begin_recovery(pose, time)
        self._remember(obstacles, pose, time)
        self._rebuild(pose, time)
        is_tight = self.inscribed_radius < self.context.robot_radius
        if progress.recoveries == (_TIGHT_RECOVERIES if is_tight else len(_RECOVERIES)):
            self._abort("stuck")
        else:
            progress.recovery = _RECOVERIES[progress.recoveries]
            progress.recoveries += 1

    def _continue_recovery(self, pose: Pose2D, time: float) -> Twist2D | None:
        """Velocity of the recovery in progress; None when it is over."""
        progress = self._progress
        begin = progress.recovery_from
        elapsed = time - progress.recovery_at
        progress.moved_to = pose
        progress.moved_at = time
        if progress.recovery == "back up" and elapsed < 2.0 * _BACK_UP / _BACK_UP_SPEED:
            if apart(pose, begin) < _BACK_UP and self._is_free_behind(pose):
                return Twist2D(-_BACK_UP_SPEED, 0.0)
        elif progress.recovery == "turn" and elapsed < _TURN_TIME:
            turned = abs(wrap_angle(pose.theta - begin.theta))
            if turned < 0.5 * math.pi:
                return Twist2D(0.0, self.follower.fastest_turn)
        progress.recovery = ""
        return None

    def _is_free_behind(self, pose: Pose2D) -> bool:
        """True if the map shows nothing just behind the robot, which a scanner that looks ahead can't see."""
        if self.costmap is None:
            return False
        distance = self.context.robot_radius + 0.05
        behind = []
        for aside in (-0.5, 0.0, 0.5):
            heading = pose.theta + math.pi + aside
            x = pose.x + distance * math.cos(heading)
            y = pose.y + distance * math.sin(heading)
            behind.append((x, y))
        points = np.array(behind)
        row, col, _ = cells_inside(self.costmap.frame, points)
        is_occupied = self.costmap.costs[row, col] == LETHAL_COST
        return not is_occupied.any()
