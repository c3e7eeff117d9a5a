"""Whether anything is left to explore, by the robot's map alone."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FREE, UNKNOWN, ByteArray, FloatArray, OccupancyGrid, Pose2D
from slamgym.planning import CostmapConfig, Frontier, find_frontiers, free_body, make_costmap, reachable_space
from slamgym.planning.promise import Promise, is_kept
from slamgym.planning.remaining import measure_remains


@kernel
def open_cells_left(
    cells: ByteArray, points: FloatArray, left: float, bottom: float, resolution: float
) -> int:
    """How many of some points lie on unknown cells beside free ones.

    Args:
        cells: ROS map values, shape (H, W); unknown beyond.
        points: Shape (N, 2) [m].
        left: Where the map begins [m].
        bottom: The same upwards [m].
        resolution: Cell size [m].
    """
    height, width = cells.shape
    count = 0
    for i in range(len(points)):
        row = height - 1 - int(np.floor((points[i, 1] - bottom) / resolution))
        col = int(np.floor((points[i, 0] - left) / resolution))
        if 0 <= row < height and 0 <= col < width and cells[row, col] != UNKNOWN:
            continue
        beside_free = False
        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            r, c = row + down, col + right
            if 0 <= r < height and 0 <= c < width and cells[r, c] == FREE:
                beside_free = True
        count += int(beside_free)
    return count


class CompletionDetector:
    """Looks for reachable frontiers, and skips the search while the last one found is still there.

    A full search costs about a millisecond. Its furthest frontier is remembered; as long as most of that
    frontier is still unknown beside free space, something is left to explore and no search is needed.

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

    def is_explored(self, grid: OccupancyGrid, pose: Pose2D) -> bool:
        """Whether the map shows no frontier that the robot could reach.

        A map on which the robot finds no place for itself doesn't count as explored.

        Args:
            grid: The map.
            pose: The believed pose.
        """
        return not self.is_last_one_left(grid) and not self.finds_one(grid, pose)

    def is_last_one_left(self, grid: OccupancyGrid) -> bool:
        """Whether the frontier that was found last is still there."""
        known = None if self._promise else self._remembered
        return known is not None and self._is_still_there(grid, known)

    def finds_one(self, grid: OccupancyGrid, pose: Pose2D) -> bool:
        """Search, whatever was found before; as if there were one where the robot finds no place for itself."""
        grid = free_body(_with_border(grid), pose, self._radius)
        costmap = make_costmap(grid, self._costs)
        space = reachable_space(costmap, pose)
        if space is None:
            self._remembered = None
            return True
        frontiers = find_frontiers(costmap, pose, self._min_size, reachable=space)
        if self._promise is not None:
            offered = [frontier.middle for frontier in frontiers]
            remains = measure_remains(grid, pose, self._radius, self._range_max, offered)
            return not is_kept(self._promise, remains)
        self._remembered = _centres(frontiers[-1], grid) if frontiers else None
        return bool(frontiers)

    def _is_still_there(self, grid: OccupancyGrid, points: FloatArray) -> bool:
        """Whether enough of a frontier is still unknown beside free space."""
        frame = grid.frame
        left = open_cells_left(grid.cells, points, frame.origin_x, frame.origin_y, frame.resolution)
        return bool(left * frame.resolution >= self._min_size - 1e-6 and left >= 0.5 * len(points))


def _with_border(grid: OccupancyGrid) -> OccupancyGrid:
    """A map with one unknown cell more on every side: a tight map may end in free cells."""
    frame = grid.frame
    cells = np.pad(grid.cells, 1, constant_values=UNKNOWN)
    return OccupancyGrid(
        cells,
        type(frame)(
            frame.resolution,
            frame.origin_x - frame.resolution,
            frame.origin_y - frame.resolution,
            frame.height_px + 2,
            frame.width_px + 2,
        ),
    )


def _centres(frontier: Frontier, grid: OccupancyGrid) -> FloatArray:
    return np.column_stack(grid.frame.to_point(frontier.cells[:, 0], frontier.cells[:, 1]))
