"""The drive back to where an exploration began."""

import math

import numpy as np

from slamgym.core.types import Float32Array, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.frontiers import Point
from slamgym.planning.navigator import Goal, GoalStatus, Navigator
from slamgym.ros2.trials import FIRST_PAUSE, MOST_TRIES


class WayBack:
    """The drive back to a place; a drive that fails is tried again.

    Attributes:
        navigator: Drives, or plans what another navigation drives.
        result: In words, once it is over.
    """

    def __init__(self, context: ExplorerContext, start: Pose2D, radius: float) -> None:
        self.result = ""
        self._context = context
        self._start = start
        self._radius = radius
        self._tries = 0
        self._again_at = -math.inf  # [s]
        self._grid: OccupancyGrid | None = None
        self._begin()

    def _begin(self) -> None:
        self._grid = None
        self.navigator = Navigator(self._context)
        self.navigator.inscribed_radius = self._radius

    def step(self, grid: OccupancyGrid, pose: Pose2D, ranges: Float32Array, time: float) -> Twist2D:
        """Velocity for the next control step."""
        navigator = self.navigator
        if grid is not self._grid:
            self._grid = grid
            navigator.update_map(grid, pose, time)
        if navigator.status is GoalStatus.IDLE and time >= self._again_at:
            start = self._start
            ahead = start.x + math.cos(start.theta), start.y + math.sin(start.theta)
            x, y = self._nearest()
            navigator.set_goal(Goal(x, y, look_at=ahead), pose, time)
        twist = navigator.step(pose, ranges, time)
        if navigator.status is GoalStatus.SUCCEEDED:
            apart = math.dist(pose[:2], self._start[:2])
            self.result = "at the start"
            if apart >= 1.0:
                self.result = f"{apart:.1f} m from the start, the nearest place"
        elif navigator.status is GoalStatus.ABORTED:
            self._again_at = time + FIRST_PAUSE * 2.0**self._tries
            self._tries += 1
            self._begin()
            if self._tries > 2 * MOST_TRIES:  # longer than for other places: the way there is known
                self.result = "the start could not be reached"
        return twist

    def _nearest(self) -> Point:
        """The place nearest to the start where the robot can get to: corrections of the map move its walls."""
        costmap = self.navigator.costmap
        space = self.navigator.reachable
        if costmap is None or space is None:
            return self._start[:2]
        frame = costmap.frame
        rows, cols = np.divmod(space.order[: space.num_centre], frame.width_px)
        places = frame.to_points(rows, cols)
        right, up = (places - self._start[:2]).T
        nearest = np.argmin(np.hypot(right, up))
        x, y = places[nearest].tolist()
        return x, y
