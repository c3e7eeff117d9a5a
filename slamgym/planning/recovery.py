"""Recovery behaviours of an exploration: what is tried before it ends because no frontier is left.

In this order, one thing at a time: a look around at the very beginning, a relaxed footprint for passages that the
map draws too narrow, a look at rooms that the map has closed, and a step into open air that the map doesn't show.
"""

import math
from collections.abc import Sequence
from enum import Enum

from slamgym.core.types import Float32Array, FloatArray, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.frontiers import Point, occluded_views
from slamgym.planning.navigator import Goal, Navigator
from slamgym.planning.open_air import find_open_air, is_undrawn

_SAME_PLACE = 0.7
"""Places nearer to one another than this show the same of a closed room [m]."""


class Recovery(Enum):
    """What :meth:`RecoveryBehaviours.attempt` chose."""

    LOOK_AROUND = "look_around"
    """The robot turns once round on the spot; :meth:`RecoveryBehaviours.turn` drives."""
    RELAXED_FOOTPRINT = "relaxed_footprint"
    """The navigation stack takes the robot for narrower than it is from now on."""
    CLOSED_ROOM = "closed_room"
    """The navigation stack drives to a place from which a closed room can be looked at."""
    OPEN_AIR = "open_air"
    """The navigation stack takes a metre of air in which a scan met nothing for free from now on."""
    NOTHING = "nothing"
    """Everything was tried."""


class RecoveryBehaviours:
    """One exploration's recovery behaviours.

    Args:
        context: What the environment says about the robot and its map.
        navigator: Navigation stack of the exploration.
        look_around_before: Only so soon after the beginning a look around is worth its time [s]; 0 for never.
        relaxed_footprints: Shares of the robot's radius to try one after the other, in ``round`` 1, 2, ...
        closed_room_looks: Closed rooms are looked at from so many places at most.

    Attributes:
        round: 0 at first; counts the relaxed footprints tried.
    """

    def __init__(
        self,
        context: ExplorerContext,
        navigator: Navigator,
        look_around_before: float,
        relaxed_footprints: Sequence[float],
        closed_room_looks: int,
    ) -> None:
        self.round = 0
        self._context = context
        self._navigator = navigator
        self._look_around_before = look_around_before
        self._footprints = relaxed_footprints
        self._closed_room_looks = closed_room_looks
        self._began_at = math.inf
        self._has_looked_around = look_around_before <= 0.0  # a look that is never worth it counts as done
        self._turn_left, self._last_theta = 0.0, 0.0  # of a look around [rad]
        self._looked_from: list[Point] = []
        self._open_air: list[FloatArray] = []  # points, where a frontier was given up
        self._entered: list[Point] = []

    @property
    def is_turning(self) -> bool:
        """Whether a look around is in progress."""
        return self._turn_left > 0.0

    def note_time(self, time: float) -> None:
        """Note the time of a control step, if looks around are wanted: the first one is the beginning."""
        self._began_at = min(self._began_at, time)

    def turn(self, pose: Pose2D) -> Twist2D:
        """Velocity for the next control step of a look around."""
        self._turn_left -= abs(math.remainder(pose.theta - self._last_theta, 2.0 * math.pi))
        self._last_theta = pose.theta
        rate = self._navigator.config.follower.turn_rate
        return Twist2D(0.0, min(rate, self._context.max_angular))

    def attempt(self, grid: OccupancyGrid, pose: Pose2D, time: float) -> Recovery:
        """Begin what is to be tried next.

        Args:
            grid: The newest map.
            pose: The believed pose.
            time: Now [s].
        """
        if time - self._began_at < self._look_around_before and not self._has_looked_around:
            self._has_looked_around = True
            self._turn_left, self._last_theta = 2.0 * math.pi, pose.theta
            return Recovery.LOOK_AROUND
        if self.round < len(self._footprints):
            radius = self._footprints[self.round] * self._context.robot_radius
            self.round += 1
            self._navigator.set_inscribed_radius(radius, pose, time)
            return Recovery.RELAXED_FOOTPRINT
        if self._visit_closed_room(pose, time):
            return Recovery.CLOSED_ROOM
        return Recovery.OPEN_AIR if self._enter_open_air(grid, pose, time) else Recovery.NOTHING

    def note_given_up(self, pose: Pose2D, ranges: Float32Array) -> None:
        """Note the scan where a frontier was given up, reached or not: there may be open air."""
        points = find_open_air(pose, ranges, self._context.geometry)
        if points is not None:
            self._open_air.append(points)

    def has_open_air(self, grid: OccupancyGrid) -> bool:
        """Whether open air that was noted isn't on the map, and hasn't been entered."""
        return any(is_undrawn(points, grid) for points in self._open_air)

    def _enter_open_air(self, grid: OccupancyGrid, pose: Pose2D, time: float) -> bool:
        """Take the next open air that isn't on the map for free; False if there is none left."""
        while self._open_air:
            points = self._open_air.pop()
            middle = points.mean(axis=0)
            place = (float(middle[0]), float(middle[1]))
            is_new = all(math.dist(place, entered) > _SAME_PLACE for entered in self._entered)
            if is_new and is_undrawn(points, grid):
                self._entered.append(place)
                self._navigator.enter_open_air(points, pose, time)
                return True
        return False

    def _visit_closed_room(self, pose: Pose2D, time: float) -> bool:
        """Go and look at a room that the map cuts off, from each side once; False if there is none left."""
        costmap, space = self._navigator.costmap, self._navigator.reachable
        if costmap is None or space is None or len(self._looked_from) >= self._closed_room_looks:
            return False
        views = [
            view
            for view in occluded_views(costmap, space)
            if all(math.dist(view[0], seen) > _SAME_PLACE for seen in self._looked_from)
        ]
        if not views:
            return False
        place, looked_at = min(views, key=lambda view: math.dist(view[0], pose[:2]))
        self._looked_from.append(place)
        self._navigator.set_goal(Goal(*place, look_at=looked_at), pose, time)
        return True
