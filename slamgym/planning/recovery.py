"""Recovery behaviours of an exploration: what is tried before it ends because no frontier is left.

In this order, one thing at a time: a look around at the very beginning, a relaxed footprint for passages that the
map draws too narrow, a step into open space that the map doesn't show, and another look at ways that somebody may have
closed.
"""

import enum
import math
from typing import NamedTuple

import numpy as np

from slamgym.core.types import Float32Array, FloatArray, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.costmap import INSCRIBED_COST, Costmap, cells_inside, make_costmap
from slamgym.planning.frontiers import (
    Point,
    Reachable,
    find_frontiers,
    fits_through,
    frontier_cells,
)
from slamgym.planning.grid_path import plan_path
from slamgym.planning.navigator import PLAN_TOLERANCE, Goal, Navigator
from slamgym.planning.unmapped import find_open_space, is_unmapped

LOOK_AROUND_BEFORE = 30.0
"""Only so soon after the beginning a look around is worth its time [s]: later the robot has turned anyway."""
RELAXED_FOOTPRINTS = (0.85, 0.6)
"""Shares of the robot's radius that doors may have room for in the end: maps draw walls too thick."""
_SAME_PLACE = 0.7
"""Places nearer to one another than this show the same [m]."""
_LOOKS_AGAIN = 3
"""A way that somebody may block is looked at so often, a map apart: who walks is out of a door by then."""


class ClosedWay(NamedTuple):
    """A way on that somebody may block."""

    place: Point
    """Where to stand: the last place on the way there [m]."""
    look_at: Point
    """Middle of the frontier [m]."""


class _LookAround(enum.Enum):
    """State of the look around at the beginning."""

    AHEAD = "ahead"
    TURNING = "turning"
    DONE = "done"


class RecoveryBehaviours:
    """One exploration's recovery behaviours; :meth:`start` comes first.

    Attributes:
        round: 0 at first; counts the relaxed footprints tried.
        is_looking: True while somebody may have closed a way on.
    """

    def __init__(self) -> None:
        self.round = 0
        self.is_looking = False
        self._began_at = math.inf
        self._look_around = _LookAround.AHEAD
        self._turn_left = 0.0  # of a look around [rad]
        self._last_theta = 0.0  # in a look around [rad]
        self._looked_from: list[Point] = []
        self._entered: list[Point] = []

    @property
    def is_turning(self) -> bool:
        """True while a look around is in progress."""
        return self._look_around is _LookAround.TURNING

    def start(self, navigator: Navigator) -> None:
        """Go on with a fresh navigation stack, as on a map that was corrected: what was tried counts as tried."""
        self._navigator = navigator
        self._open_space: list[FloatArray] = []  # points, where a frontier was given up
        if self.round > 0:
            navigator.inscribed_radius *= RELAXED_FOOTPRINTS[self.round - 1]

    def note_time(self, time: float) -> None:
        """Note the time of a control step: the first one is the beginning."""
        self._began_at = min(self._began_at, time)
        if self.is_turning and time - self._began_at >= 2.0 * LOOK_AROUND_BEFORE:
            self._look_around = _LookAround.DONE  # the wheels don't turn

    def turn(self, pose: Pose2D) -> Twist2D:
        """Velocity for the next control step of a look around."""
        self._turn_left -= abs(math.remainder(pose.theta - self._last_theta, 2.0 * math.pi))
        self._last_theta = pose.theta
        if self._turn_left <= 0.0:
            self._look_around = _LookAround.DONE
        return Twist2D(0.0, self._navigator.follower.fastest_turn)

    def attempt(self, grid: OccupancyGrid, pose: Pose2D, time: float) -> bool:
        """Begin what is to be tried next; returns False if everything was tried.

        Args:
            grid: The newest map.
            pose: The believed pose.
            time: Now [s].
        """
        is_early = time - self._began_at < LOOK_AROUND_BEFORE
        if is_early and self._look_around is _LookAround.AHEAD:
            self._begin_look_around(pose, time)
            return True
        if self.round < len(RELAXED_FOOTPRINTS):
            radius = RELAXED_FOOTPRINTS[self.round] * self._navigator.context.robot_radius
            self.round += 1
            self._navigator.set_inscribed_radius(radius, pose, time)
            return True
        return self._enter_open_space(grid, pose, time) or self.look_again(pose, time)

    def _begin_look_around(self, pose: Pose2D, time: float) -> None:
        """Begin a full turn; where another navigation drives, half of one."""
        if self._navigator.context.drives:
            self._look_around = _LookAround.TURNING
            self._turn_left = 2.0 * math.pi
            self._last_theta = pose.theta
            return
        self._look_around = _LookAround.DONE
        x_behind = pose.x - math.cos(pose.theta)
        y_behind = pose.y - math.sin(pose.theta)
        goal = Goal(pose.x, pose.y, look_at=(x_behind, y_behind))
        self._navigator.set_goal(goal, pose, time)

    def look_again(self, pose: Pose2D, time: float) -> bool:
        """Go and look at the nearest way that specks of the map closed, some times; False if none is left."""
        navigator = self._navigator
        costmap = navigator.costmap
        space = navigator.reachable
        radius = navigator.context.robot_radius
        if costmap is None or space is None:
            return False
        grid = navigator.corrections.without_specks(navigator.map_alone(pose))
        opened = make_costmap(grid, costmap.config, costmap)
        ways = closed_ways(costmap, space, opened, pose, radius)
        ways = [way for way in ways if not self._is_known(way)]
        self.is_looking = bool(ways)
        if ways:
            nearest = min(ways, key=lambda way: math.dist(way.place, pose[:2]))
            self._looked_from.append(nearest.place)
            navigator.corrections.forget_kept()
            navigator.set_goal(Goal(*nearest.place, look_at=nearest.look_at), pose, time)
        return self.is_looking

    def _is_known(self, way: ClosedWay) -> bool:
        """True if the robot has looked at a way from the same place often enough."""
        times = sum(math.dist(way.place, other) <= _SAME_PLACE for other in self._looked_from)
        return times >= _LOOKS_AGAIN

    def note_given_up(self, pose: Pose2D, ranges: Float32Array) -> None:
        """Note the scan where a frontier was given up, reached or not: there may be open space."""
        points = find_open_space(pose, ranges, self._navigator.context.geometry)
        if points is not None:
            self._open_space.append(points)

    def has_open_space(self, grid: OccupancyGrid) -> bool:
        """True if open space that was noted isn't on the map, and hasn't been entered."""
        return any(is_unmapped(points, grid) for points in self._open_space)

    def _enter_open_space(self, grid: OccupancyGrid, pose: Pose2D, time: float) -> bool:
        """Take the next open space that isn't on the map for free; False if there is none left."""
        while self._open_space:
            points = self._open_space.pop()
            x, y = points.mean(axis=0).tolist()
            if _is_new((x, y), self._entered) and is_unmapped(points, grid):
                self._entered.append((x, y))
                self._navigator.enter_open_space(points, pose, time)
                return True
        return False


def _is_new(place: Point, known: list[Point]) -> bool:
    """True if a place isn't the same as one of those known."""
    return all(math.dist(place, other) > _SAME_PLACE for other in known)


def closed_ways(
    costmap: Costmap, reachable: Reachable, opened: Costmap, pose: Pose2D, radius: float
) -> list[ClosedWay]:
    """Ways to frontiers that the robot fits through and gets to on a map that is more open alone.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        opened: The other one, of the same frame.
        pose: The robot.
        radius: The robot's [m].
    """
    known = frontier_cells(costmap.costs, reachable.mask)
    ways = []
    for frontier in find_frontiers(opened, pose, 2.0 * radius):
        rows, cols = frontier.cells.T
        is_hidden = ~known[rows, cols]
        hidden = np.count_nonzero(is_hidden) * costmap.frame.resolution
        if hidden < 2.0 * radius or not fits_through(opened, frontier, radius):
            continue
        path = plan_path(opened, pose, frontier.middle, PLAN_TOLERANCE)
        if path is None:
            continue
        row, col, _ = cells_inside(costmap.frame, path)
        is_closed = costmap.costs[row, col] >= INSCRIBED_COST
        closed_at = int(np.argmax(is_closed))
        x, y = path[max(0, closed_at - 1)].tolist()
        ways.append(ClosedWay((x, y), frontier.middle))
    return ways
