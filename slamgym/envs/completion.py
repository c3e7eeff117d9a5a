"""When an exploration is complete, by the robot's map alone."""

import numpy as np

from slamgym.core.types import FREE, UNKNOWN, FloatArray, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs.config import ExploreConfig
from slamgym.planning import (
    CostmapConfig,
    crop_known,
    find_frontiers,
    free_body,
    make_costmap,
    reachable_space,
)
from slamgym.planning.frontiers import fits_through
from slamgym.planning.promise import Promise, is_kept

_TRUSTED = 15
"""A frontier is trusted for so many checks, half a minute: the map may be corrected, and no way lead there any more."""

SMALLEST_FRONTIER = 0.35
"""Shorter frontiers don't keep an episode going [m]: half a frontier of Explore Lite's launch file is still worth a
visit, the pinholes that noise causes in walls are not."""


class CompletionDetector:
    """Looks for reachable frontiers, and skips the search while the last one found is still there.

    A full search costs about a millisecond. Its furthest frontier is remembered; as long as most of that
    frontier is still unknown next to free space, something is left to explore and no search is needed.

    Args:
        robot_radius: [m].
        min_size: Shorter frontiers don't count [m].
        promise: Enough has been seen when the map keeps it; by default when no frontier is left. It was calibrated
            on the exploration loop, which also knows where the robot tried in vain.
    """

    def __init__(self, robot_radius: float, min_size: float, promise: Promise | None = None) -> None:
        self._promise = promise
        self._radius = robot_radius
        # Only what is lethal to the robot matters here: no cost beyond its body.
        self._costs = CostmapConfig(inscribed_radius=robot_radius, inflation_radius=robot_radius)
        self._min_size = min_size
        self._remembered: FloatArray = np.zeros((0, 2))  # centres of the frontier's cells, map frame [m]
        self._trusted = 0  # for so many checks

    @classmethod
    def of(cls, config: ExploreConfig) -> "CompletionDetector":
        """The detector that the settings of an environment ask for."""
        return cls(config.robot.radius, SMALLEST_FRONTIER, config.promise)

    def is_explored(self, grid: OccupancyGrid, pose: Pose2D) -> bool:
        """True if the map shows no frontier that the robot could reach.

        A map on which the robot finds no place for itself doesn't count as explored.

        Args:
            grid: The map.
            pose: The believed pose.
        """
        self._trusted -= 1
        if self._trusted > 0 and self._is_still_there(grid):
            return False
        self._trusted = 0
        grid = free_body(_with_border(crop_known(grid, pose)), pose, self._radius)
        costmap = make_costmap(grid, self._costs)
        space = reachable_space(costmap, pose)
        if space is None:
            return False
        frontiers = find_frontiers(costmap, pose, self._min_size, reachable=space)
        if self._promise is not None:
            known_area = len(space.order) * grid.frame.resolution**2
            ways_on = [one for one in frontiers if fits_through(costmap, one, self._radius)]
            return is_kept(self._promise, ways_on, known_area)
        if frontiers:
            self._remembered, self._trusted = grid.frame.to_points(*frontiers[-1].cells.T), _TRUSTED
        return not frontiers

    def _is_still_there(self, grid: OccupancyGrid) -> bool:
        """True if enough of the remembered frontier is still unknown next to free space."""
        cells = np.pad(grid.cells, 2, constant_values=UNKNOWN)
        places = np.column_stack(grid.frame.to_cell(*self._remembered.T)) + 2
        row, col = np.clip(places, 1, np.array(cells.shape) - 2).T
        beside = cells[row - 1, col], cells[row + 1, col], cells[row, col - 1], cells[row, col + 1]
        left = np.count_nonzero((cells[row, col] == UNKNOWN) & (np.array(beside) == FREE).any(axis=0))
        return bool(left * grid.frame.resolution >= self._min_size - 1e-6 and left >= 0.5 * len(places))


def _with_border(grid: OccupancyGrid) -> OccupancyGrid:
    """A map with one unknown cell more on every side: a tight map may end in free cells."""
    cells, (size, x, y, height, width) = np.pad(grid.cells, 1, constant_values=UNKNOWN), grid.frame
    return OccupancyGrid(cells, GridFrame(size, x - size, y - size, height + 2, width + 2))
