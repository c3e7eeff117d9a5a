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
_STUCK_TIME = 4.0
"""Without moving for so long the robot recovers [s]; a half turn on the spot takes less."""
_STUCK_DISTANCE = 0.1
"""Moving less than this is standing still [m], which errors of the pose may be; turning on the spot is moving."""
_BARRIER_GAP = 0.1
"""Assumed distance from the robot's body to an obstacle that it couldn't pass [m]."""
_SEEN_NEAR = 1.5
"""The costmap takes over what the scan shows within this distance [m]: what matters for the next seconds."""
_BACK_UP, _BACK_UP_SPEED = 0.2, 0.1
"""Distance [m] and speed [m/s] of the backward recovery: less than a body, for the scanner doesn't look there."""
_RECOVERIES = ("back up", "turn", "back up")
"""Recoveries from one place, one after the other, before a goal is given up."""


class NavigatorConfig(Settings, section="navigator"):
    """Settings of the navigation stack."""

    progress_time: float = 25.0
    """Without coming nearer along the path for so long the robot recovers, moving or not [s]."""
    follower: FollowerConfig = field(default_factory=FollowerConfig)
    """Path following."""


@dataclass
class _Leg:
    """The robot's progress towards goals since it last stood without one."""

    anchor: Pose2D  # where it last moved
    anchor_at: float  # [s]
    recovered_from: Pose2D  # where the first of the recoveries began
    progress_at: float  # when it last came nearer [s]
    planned_at: float = -math.inf  # [s]
    best_remaining: float = math.inf  # the shortest path left since the goal was set [m]
    arrived: bool = False
    outcome: bool | None = None  # what another navigation said: whether it is reached
    recoveries: int = 0  # since the last progress
    recovery: str = ""  # the one in progress
    recovery_from: Pose2D = Pose2D(0.0, 0.0, 0.0)
    recovery_at: float = 0.0  # [s]


@lru_cache(maxsize=16)
def _inflation(radius: float) -> CostmapConfig:
    """Inflation of obstacles for a robot of some radius [m].

    Paths keep within sight of walls, which a scanner of short range needs to localise the robot.
    """
    return CostmapConfig(
        radius, max(CostmapConfig().inflation_radius, radius), coastal_distance=1.5
    )


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
        self._leg = _Leg(Pose2D(0.0, 0.0, 0.0), 0.0, Pose2D(0.0, 0.0, 0.0), 0.0)

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
        along = beyond[0] / np.hypot(*beyond[0])
        if self.corrections.note_impassable(pose[:2] + reach * along, along):
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
            self._leg = _Leg(pose, time, pose, time)
        self.goal, self.status, self.reason = goal, GoalStatus.ACTIVE, ""
        self._leg.arrived, self._leg.outcome = False, None
        self._leg.best_remaining, self._leg.progress_at = math.inf, time
        self._plan(pose, time)

    def cancel(self) -> None:
        """Drop the goal."""
        self.goal, self.status = None, GoalStatus.IDLE

    def end(self, reached: bool) -> None:
        """Take over from another navigation that drives how it ended; the next :meth:`step` says so."""
        self._leg.outcome = reached

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
        if self._leg.recovery:
            command = self._continue_recovery(pose, time)
            if command is not None:
                return command
            self._plan(pose, time)
        elif self._is_stuck(pose, time):
            self._begin_recovery(pose, obstacles, time)
        if self._leg.arrived or self.follower.remaining(pose) < _GOAL_TOLERANCE:
            return self._finish(pose)
        command = self.follower.step(costmap, pose, obstacles)
        self._mind_deviation(pose, obstacles, time)
        return command

    def _watch(self, pose: Pose2D, time: float) -> None:
        """End a goal that another navigation drives to, also if it doesn't say so but stands for long."""
        self._note_moving(pose, time)
        stands = time - self._leg.anchor_at
        is_there = stands > _STUCK_TIME and math.dist(self.follower.path[-1], pose[:2]) < _DEVIATION
        if self._leg.outcome or (self._leg.outcome is None and is_there):
            self.status = GoalStatus.SUCCEEDED
        elif self._leg.outcome is False or stands > self.config.progress_time:
            self._abort("given up by the navigation")

    def _finish(self, pose: Pose2D) -> Twist2D:
        """Turn towards what the goal wants looked at, then report success."""
        self._leg.arrived = True
        if self.goal is not None and self.goal.look_at is not None:
            turn = self.follower.turn_towards(pose, *self.goal.look_at)
            if turn is not None:
                return turn
        if self.is_active:
            self.status = GoalStatus.SUCCEEDED
        return STOP

    def _mind_deviation(self, pose: Pose2D, obstacles: FloatArray, time: float) -> None:
        """Plan again when the robot is off its path or the scan blocks it."""
        if time - self._leg.planned_at < _REPLAN_INTERVAL:
            return
        ahead = self.follower.ahead
        off = math.hypot(ahead[0, 0] - pose.x, ahead[0, 1] - pose.y) if len(ahead) else 0.0
        if self.follower.blocked:
            self._remember(obstacles, pose, time)
            self._rebuild(pose, time)
            # A path round what blocks the robot, if there is one; else it waits for it to go away.
            self._plan(pose, time, keep_old=True)
        elif off > _DEVIATION:
            self._plan(pose, time)

    def _plan(self, pose: Pose2D, time: float, keep_old: bool = False) -> None:
        """Plan a path to the goal; without one, give up (or keep the old path)."""
        self._leg.planned_at = time
        if self.costmap is None or self.goal is None:
            self._abort("no map")
            return
        path = plan_path(
            self.costmap, pose, (self.goal.x, self.goal.y), PLAN_TOLERANCE, self.reachable
        )
        if path is not None:
            self.follower.set_path(path)
        elif not keep_old:
            self._abort("unreachable")

    def _abort(self, reason: str) -> None:
        self.status, self.reason = GoalStatus.ABORTED, reason

    def _rebuild(self, pose: Pose2D, time: float) -> None:
        """Costmap from the map, what the scan showed lately, and the robot's own body."""
        if self._grid is None:
            return
        grid = free_body(self.corrections.mark(self._grid, time), pose, self.context.robot_radius)
        self.costmap = make_costmap(grid, _inflation(self.inscribed_radius), self.costmap)
        self._searched_from = pose

    def _remember(self, obstacles: FloatArray, pose: Pose2D, time: float) -> None:
        """Keep what the scan shows near the robot for the costmap."""
        near = obstacles[(obstacles**2).sum(axis=1) < _SEEN_NEAR**2]
        self.corrections.note_seen(transform_points(pose, near), pose, time)

    # Recovery: wait for none, plan round what the scan shows, back up, turn; then give up.

    def _note_moving(self, pose: Pose2D, time: float) -> None:
        """Note where the robot last moved."""
        leg = self._leg
        turned = abs(wrap_angle(pose.theta - leg.anchor.theta))
        if _apart(pose, leg.anchor) > _STUCK_DISTANCE or turned > 0.3:
            leg.anchor, leg.anchor_at = pose, time

    def _is_stuck(self, pose: Pose2D, time: float) -> bool:
        """True if the robot has stood still, or not come nearer, for too long."""
        leg = self._leg
        self._note_moving(pose, time)
        remaining = self.follower.remaining(pose)
        if remaining < leg.best_remaining - _STUCK_DISTANCE:
            leg.best_remaining, leg.progress_at = remaining, time
            if _apart(pose, leg.recovered_from) > 0.5:
                leg.recoveries, leg.recovered_from = 0, pose
        return (
            time - leg.anchor_at > _STUCK_TIME or time - leg.progress_at > self.config.progress_time
        )

    def _begin_recovery(self, pose: Pose2D, obstacles: FloatArray, time: float) -> None:
        """Start the next recovery, or give the goal up after the last one."""
        leg = self._leg
        if leg.recoveries == 0:
            leg.recovered_from = pose
        leg.anchor, leg.anchor_at, leg.progress_at = pose, time, time
        leg.best_remaining = math.inf
        leg.recovery_from, leg.recovery_at = pose, time
        self._remember(obstacles, pose, time)
        self._rebuild(pose, time)
        if leg.recoveries == len(_RECOVERIES):
            self._abort("stuck")
        else:
            leg.recovery = _RECOVERIES[leg.recoveries]
            leg.recoveries += 1

    def _continue_recovery(self, pose: Pose2D, time: float) -> Twist2D | None:
        """Velocity of the recovery in progress; None when it is over."""
        leg = self._leg
        begin, elapsed = leg.recovery_from, time - leg.recovery_at
        leg.anchor, leg.anchor_at = pose, time
        if leg.recovery == "back up" and elapsed < 2.0 * _BACK_UP / _BACK_UP_SPEED:
            if _apart(pose, begin) < _BACK_UP and self._is_free_behind(pose):
                return Twist2D(-_BACK_UP_SPEED, 0.0)
        elif (
            leg.recovery == "turn"
            and elapsed < 4.0
            and abs(wrap_angle(pose.theta - begin.theta)) < 0.5 * math.pi
        ):
            return Twist2D(0.0, self.follower.fastest_turn)
        leg.recovery = ""
        return None

    def _is_free_behind(self, pose: Pose2D) -> bool:
        """True if the map shows nothing just behind the robot, which a scanner that looks ahead can't see."""
        if self.costmap is None:
            return False
        distance = self.context.robot_radius + 0.05
        headings = [pose.theta + math.pi + angle for angle in (-0.5, 0.0, 0.5)]
        behind = [
            (pose.x + distance * math.cos(one), pose.y + distance * math.sin(one))
            for one in headings
        ]
        row, col, _ = cells_inside(self.costmap.frame, np.array(behind))
        return not (self.costmap.costs[row, col] == LETHAL_COST).any()


def _apart(first: Pose2D, second: Pose2D) -> float:
    """Distance of two positions [m]."""
    return math.hypot(first.x - second.x, first.y - second.y)
