"""When an exploration is complete, by the robot's map alone."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FREE, UNKNOWN, ByteArray, FloatArray, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs.config import ExploreConfig
from slamgym.planning import (
    CostmapConfig,
    crop_known,
    find_frontiers,
    free_body,
    make_costmap,
    reachable_space,
)
from slamgym.planning.promise import Promise, is_kept
from slamgym.planning.remaining import measure_remains

SMALLEST_FRONTIER = 0.35
"""Shorter frontiers don't keep an episode going [m]: half a frontier of Explore Lite's launch file is still worth a
visit, the pinholes that noise causes in walls are not."""


@kernel
def open_cells_left(
    cells: ByteArray, points: FloatArray, corner: tuple[float, float], resolution: float
) -> int:
    """Number of those points that lie on unknown cells next to free ones.

    Args:
        cells: ROS map values, shape (H, W); unknown beyond.
        points: Shape (N, 2) [m].
        corner: Where the map begins [m].
        resolution: Cell size [m].
    """
    height, width = cells.shape
    count = 0
    for i in range(len(points)):
        row = height - 1 - int(np.floor((points[i, 1] - corner[1]) / resolution))
        col = int(np.floor((points[i, 0] - corner[0]) / resolution))
        if 0 <= row < height and 0 <= col < width and cells[row, col] != UNKNOWN:
            continue
        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            r, c = row + down, col + right
            if 0 <= r < height and 0 <= c < width and cells[r, c] == FREE:
                count += 1
                break
    return count


class CompletionDetector:
    """Looks for reachable frontiers, and skips the search while the last one found is still there.

    A full search costs about a millisecond. Its furthest frontier is remembered; as long as most of that
    frontier is still unknown next to free space, something is left to explore and no search is needed.

    Args:
        robot_radius: [m].
        min_size: Shorter frontiers don't count [m].
        range_max: The scanner's [m].
        promise: Enough has been seen when the map keeps it; by default when no frontier is left. It was calibrated
            on the exploration loop, which also knows where the robot tried in vain.
    """

    def __init__(
        self, robot_radius: float, min_size: float, range_max: float = 3.5, promise: Promise | None = None
    ) -> None:
        self._range_max, self._promise = range_max, promise
        self._radius = robot_radius
        # Only what is lethal to the robot matters here: no cost beyond its body.
        self._costs = CostmapConfig(inscribed_radius=robot_radius, inflation_radius=robot_radius)
        self._min_size = min_size
        self._remembered: FloatArray | None = None  # cell centres (N, 2), map frame [m]

    @classmethod
    def of(cls, config: ExploreConfig) -> "CompletionDetector":
        """The detector that the settings of an environment ask for."""
        return cls(config.robot.radius, SMALLEST_FRONTIER, config.lidar.range_max, config.promise)

    def is_explored(self, grid: OccupancyGrid, pose: Pose2D) -> bool:
        """True if the map shows no frontier that the robot could reach.

        A map on which the robot finds no place for itself doesn't count as explored.

        Args:
            grid: The map.
            pose: The believed pose.
        """
        if self._remembered is not None and self._is_still_there(grid, self._remembered):
            return False
        self._remembered = None
        grid = free_body(_with_border(crop_known(grid, pose)), pose, self._radius)
        costmap = make_costmap(grid, self._costs)
        space = reachable_space(costmap, pose)
        if space is None:
            return False
        frontiers = find_frontiers(costmap, pose, self._min_size, reachable=space)
        if self._promise is not None:
            offered = [frontier.middle for frontier in frontiers]
            remains = measure_remains(grid, pose, self._radius, self._range_max, offered)
            return is_kept(self._promise, remains)
        if frontiers:
            self._remembered = grid.frame.to_points(*frontiers[-1].cells.T)
        return not frontiers

    def _is_still_there(self, grid: OccupancyGrid, points: FloatArray) -> bool:
        """True if enough of a frontier is still unknown next to free space."""
        resolution, corner = grid.frame.resolution, (grid.frame.origin_x, grid.frame.origin_y)
        left = open_cells_left(grid.cells, points, corner, resolution)
        return bool(left * resolution >= self._min_size - 1e-6 and left >= 0.5 * len(points))


def _with_border(grid: OccupancyGrid) -> OccupancyGrid:
    """A map with one unknown cell more on every side: a tight map may end in free cells."""
    cells, (size, x, y, height, width) = np.pad(grid.cells, 1, constant_values=UNKNOWN), grid.frame
    return OccupancyGrid(cells, GridFrame(size, x - size, y - size, height + 2, width + 2))
