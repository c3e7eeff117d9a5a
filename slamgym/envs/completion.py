"""When an exploration is complete, by the robot's map alone."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs.config import ExploreConfig
from slamgym.planning import (
    CostmapConfig,
    crop_known,
    find_frontiers,
    free_body,
    make_costmap,
    reachable_space,
)
from slamgym.planning.costmap import INSCRIBED_COST, NO_INFORMATION, Costmap, touched_cells
from slamgym.planning.frontiers import fits_through, frontier_runs
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

    def __init__(
        self, robot_radius: float, min_size: float, promise: Promise | None = None
    ) -> None:
        self._promise = promise
        self._radius = robot_radius
        # Only what is lethal to the robot matters here: no cost beyond its body.
        self._costs = CostmapConfig(inscribed_radius=robot_radius, inflation_radius=robot_radius)
        self._min_size = min_size
        # Centres of the frontier's cells, map frame [m].
        self._remembered: FloatArray = np.zeros((0, 2))
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
        if self._promise is not None:
            return self._is_promise_kept(self._promise, grid, pose)
        costmap = self._body_costs(grid)
        space = reachable_space(costmap, pose)
        if space is None:
            return False
        runs = frontier_runs(costmap, space, self._min_size)
        if not runs:
            return True
        rows, cols = runs[-1].T
        self._remembered = grid.frame.to_points(rows, cols)
        self._trusted = _TRUSTED
        return False

    def distance_to_frontier(self, grid: OccupancyGrid, pose: Pose2D) -> float:
        """From a pose to the nearest frontier that the robot can reach, as the crow flies [m]; infinite without one."""
        grid = free_body(_with_border(crop_known(grid, pose)), pose, self._radius)
        frontiers = find_frontiers(self._body_costs(grid), pose, self._min_size)
        return min((one.min_distance for one in frontiers), default=math.inf)

    def _is_promise_kept(self, promise: Promise, grid: OccupancyGrid, pose: Pose2D) -> bool:
        """True if what the map shows of ways on keeps the promise."""
        costmap = make_costmap(grid, self._costs)
        space = reachable_space(costmap, pose)
        if space is None:
            return False
        frontiers = find_frontiers(costmap, pose, self._min_size, reachable=space)
        ways_on = [one for one in frontiers if fits_through(costmap, one, self._radius)]
        return is_kept(promise, ways_on, grid.known_area)

    def _is_still_there(self, grid: OccupancyGrid) -> bool:
        """True if enough of the remembered frontier is still unknown next to free space."""
        frame = grid.frame
        points = self._remembered
        place = frame.resolution, frame.origin_x, frame.origin_y
        left = _count_edges(grid.cells, points, place)
        is_long_enough = left * frame.resolution >= self._min_size - 1e-6
        return bool(is_long_enough and left >= 0.5 * len(points))

    def _body_costs(self, grid: OccupancyGrid) -> Costmap:
        """The costs that :func:`make_costmap` would find, without its distances: by a disc about each occupied cell."""
        cells = grid.cells
        touched = touched_cells(cells, (self._radius + 1e-9) / grid.frame.resolution)
        costs = touched * np.uint8(INSCRIBED_COST) + (cells == OCCUPIED)
        costs[cells == UNKNOWN] = NO_INFORMATION
        return Costmap(costs, np.empty((0, 0), np.float32), grid.frame, cells, self._costs)


@kernel
def _count_edges(cells: ByteArray, points: FloatArray, place: tuple[float, float, float]) -> int:
    """How many cells at points, shape (N, 2) [m], are unknown next to free space; ``place`` is the frame's."""
    rows, cols = cells.shape
    size, origin_x, origin_y = place
    count = 0
    for k in range(len(points)):
        col = math.floor((points[k, 0] - origin_x) / size)
        row = rows - 1 - math.floor((points[k, 1] - origin_y) / size)
        col = min(max(col, -1), cols)
        row = min(max(row, -1), rows)
        if 0 <= row < rows and 0 <= col < cols and cells[row, col] != UNKNOWN:
            continue
        for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
            if 0 <= r < rows and 0 <= c < cols and cells[r, c] == FREE:
                count += 1
                break
    return count


def _with_border(grid: OccupancyGrid) -> OccupancyGrid:
    """A map with one unknown cell more on every side: a tight map may end in free cells."""
    size, x, y, height, width = grid.frame
    frame = GridFrame(size, x - size, y - size, height + 2, width + 2)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    cells[1:-1, 1:-1] = grid.cells
    return OccupancyGrid(cells, frame)
