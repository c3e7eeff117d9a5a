"""Things that the map doesn't show: obstacles that stop the robot, and open space from which no beam returns.

A map is cleared along a beam without return only as far as the returns next to it vouch for it, because behind a
window or a dark wall there is nothing to see either. A robot that stands in a doorway sees both posts and, of a hall
larger than its scanner's range, nothing else: the map doesn't grow, however often it goes there.
"""

import math

import numpy as np

from slamgym.core.geometry import compose, transform_points, unit_vectors
from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    IntArray,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.costmap import LETHAL_COST, Costmap, cells_inside

_MEMORY = 10.0
"""Obstacles that only the scan showed are kept for so long [s]: people walk on."""
_HALF_WIDTH = 0.5
"""Assumed half width of an obstacle that the robot couldn't pass [m]: a door leaf or pane is about 1 m wide."""
_TOUCHED = 0.4
"""Distance from the body of a robot that gave up within which an obstacle is taken to have stopped it [m]."""

_REACH = 1.0
"""So far from the sensor space without a return is taken for free, if it must be [m]."""
_GAP = math.radians(90.0)
"""Windows and dark walls are no wider than this, seen from where a robot goes [rad] (as in drawing the map)."""
_EMPTY = 0.97
"""Share of the beams in the gap without return: some are strays."""
_UNMAPPED = 0.5
"""Share of the gap, up to the reach, that the map must not know."""
_APART = 0.15
"""Points nearer to a wall of the map than this are taken for that wall [m]: the pose errs by as much."""

_SPECK = 0.02
"""Somebody who walks leaves patches of no more than this in the map [m2]: legs are as wide as two or three cells."""


def mark_obstacles(grid: OccupancyGrid, points: FloatArray, apart: float = _APART) -> OccupancyGrid:
    """Copy a map with points seen just now, e.g. on a person, entered as occupied.

    Points nearer than ``apart`` [m] to a wall of the map are taken for that wall and left out, so that small
    errors of the pose don't thicken walls and close doors.

    Args:
        grid: The map.
        points: Points in the frame of the map, shape (N, 2) [m].
        apart: Smallest distance from what the map knows [m].
    """
    cells = grid.cells.copy()
    if len(points):
        new = unmapped_points(grid, points, apart)
        x = new[:, 0]
        y = new[:, 1]
        row, col = grid.frame.to_cell(x, y)
        cells[row, col] = OCCUPIED
    return OccupancyGrid(cells, grid.frame)


def unmapped_points(grid: OccupancyGrid, points: FloatArray, apart: float = _APART) -> FloatArray:
    """The points (N, 2) [m] that lie on a map and farther than ``apart`` [m] from its walls."""
    row, col, inside = cells_inside(grid.frame, points)
    is_apart = _stand_apart(grid.cells, row, col, grid.frame.resolution, apart)
    inner = points[inside]
    return inner[is_apart]


class MapCorrections:
    """Things that the map doesn't show: obstacles for some seconds or for the rest of the exploration, and open space.

    Points are in the frame of the map [m].

    Args:
        spacing: Distance between points that close a passage [m].
    """

    def __init__(self, spacing: float) -> None:
        self._offsets = np.arange(-_HALF_WIDTH, _HALF_WIDTH, spacing)
        self._seen: list[tuple[float, Pose2D, FloatArray]] = []  # when, from where, points (N, 2)
        self._failed: list[FloatArray] = []  # places (2,) where the robot didn't get through
        self._closing = np.zeros((0, 2))  # points across passages
        self._kept = np.zeros((0, 2))  # points
        self._open_space: list[FloatArray] = []  # points taken for free
        self._freest: OccupancyGrid | None = None  # cells that any map so far showed free are free

    def note_seen(self, points: FloatArray, pose: Pose2D, time: float) -> None:
        """Keep what the scan shows, points (N, 2), for a while."""
        if len(points):
            self._seen.append((time, pose, points))

    def note_impassable(self, centre: FloatArray, along: FloatArray) -> bool:
        """Note that the robot didn't get through a place (2,) in a direction (2,); returns True if it is closed now.

        It is from the second time on; narrow doors get another try.
        """
        width = 2.0 * _HALF_WIDTH
        again = any(math.dist(centre, place) < width for place in self._failed)
        self._failed.append(centre)
        if again:
            x, y = along
            across = np.array([-y, x])
            barrier = centre + self._offsets[:, None] * across
            self._closing = np.vstack([self._closing, barrier])
        return again

    def note_open_space(self, points: FloatArray) -> None:
        """Take what the map doesn't know at some points for free, shape (N, 2)."""
        self._open_space.append(points)

    def note_map(self, grid: OccupancyGrid) -> None:
        """Remember where a published map is free."""
        before = self._freest
        if before is not None and before.frame == grid.frame:
            # In place: free is the largest value.
            np.maximum(before.cells, grid.cells, out=before.cells)
            return
        cells = grid.cells.copy()
        self._freest = OccupancyGrid(cells, grid.frame)
        if before is not None:
            rows, cols = np.nonzero(before.cells == FREE)
            places = before.frame.to_points(rows, cols)
            row, col, _ = cells_inside(grid.frame, places)
            self._freest.cells[row, col] = FREE

    def without_specks(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Copy a map without specks where an older one was free, which legs of somebody who walked there leave."""
        import cv2

        assert self._freest is not None, "there was a map"
        frame = self._freest.frame
        occupied = grid.cells == OCCUPIED
        image = occupied.view(np.uint8)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
        areas = stats[:, cv2.CC_STAT_AREA] * frame.resolution**2
        is_speck = areas <= _SPECK
        rows, cols = np.nonzero(is_speck[labels])
        points = grid.frame.to_points(rows, cols)
        row, col, inside = cells_inside(frame, points)
        was_free = self._freest.cells[row, col] == FREE
        points = points[inside]
        return free_at(points[was_free], grid, OCCUPIED)

    def free(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Copy a map with the open space entered, if there is some."""
        for points in self._open_space:
            grid = free_at(points, grid, UNKNOWN)
        return grid

    def keep_around(
        self, pose: Pose2D, radius: float, costmap: Costmap, grid: OccupancyGrid
    ) -> None:
        """Keep the obstacles near the robot for good, even if map and scan show them no more.

        For where it gave a goal up. A pane of glass returns only the beams that meet it at right angles. So it comes
        and goes in the map, and reaches farther across the line of sight than the scan shows.

        Args:
            pose: The robot.
            radius: The robot's [m].
            costmap: Map and obstacles as they are now.
            grid: The map alone.
        """
        frame = costmap.frame
        rows, cols = np.nonzero(costmap.costs == LETHAL_COST)
        found = [frame.to_points(rows, cols)]
        for _, seen_from, seen in self._seen:
            unmapped = unmapped_points(grid, seen)
            widened = self._across_sight(unmapped, seen_from)
            found.append(widened)
        points = np.vstack(found)
        x, y = points.T
        distances = np.hypot(x - pose.x, y - pose.y)
        near = points[distances < radius + _TOUCHED]
        # One point for each cell, its centre, so that coming again adds next to nothing.
        near_x, near_y = near.T
        near_rows, near_cols = frame.to_cell(near_x, near_y)
        near_cells = np.column_stack([near_rows, near_cols])
        cells = np.unique(near_cells, axis=0)
        centres = frame.to_points(cells[:, 0], cells[:, 1])
        kept = np.vstack([self._kept, centres])
        self._kept = np.unique(kept, axis=0)

    def _across_sight(self, points: FloatArray, seen_from: Pose2D) -> FloatArray:
        """Points (N, 2) [m] and more across the line of sight to each, shape (M, 2) [m]."""
        place = np.array(seen_from[:2])
        sight = points - place
        x, y = sight.T
        distances = np.hypot(x, y)
        lengths = np.maximum(distances, 1e-3)
        normals = sight[:, ::-1] * (-1.0, 1.0)
        across = normals / lengths[:, None]
        widened = points + self._offsets[:, None, None] * across
        return widened.reshape(-1, 2)

    def forget_kept(self) -> None:
        """Forget the obstacles that were kept for good: somebody may have stood there."""
        self._kept = np.zeros((0, 2))

    def mark(self, grid: OccupancyGrid, time: float) -> OccupancyGrid:
        """Copy a map with the obstacles entered; forgets what was seen too long ago."""
        self._seen = [seen for seen in self._seen if time - seen[0] < _MEMORY]
        if self._seen:
            seen = np.vstack([points for _, _, points in self._seen])
            grid = mark_obstacles(grid, seen)
        if len(self._closing):
            grid = mark_obstacles(grid, self._closing)
        if len(self._kept):
            grid = mark_obstacles(grid, self._kept, apart=0.0)
        return grid


def find_open_space(
    pose: Pose2D, ranges: Float32Array, geometry: LaserGeometry
) -> FloatArray | None:
    """Points in the widest direction in which a scan met nothing, shape (N, 2), map frame [m]; None if there is none.

    Args:
        pose: Where the scan was taken.
        ranges: The scan, shape (num_beams,) [m]; no return is the largest range or inf.
        geometry: The scanner.
    """
    width = math.ceil(_GAP / geometry.angle_increment)
    empty = ranges >= np.float32(geometry.range_max)
    if width > len(ranges) or np.count_nonzero(empty) < _EMPTY * width:
        return None
    weights = np.ones(width) / width
    shares = np.convolve(empty, weights, mode="valid")
    best = np.flatnonzero(shares >= shares.max() - 1e-9)
    if shares[best[0]] < _EMPTY:
        return None
    first = int(best[len(best) // 2])  # the middle of all such gaps
    of_gap = empty[first : first + width]
    beams = first + np.flatnonzero(of_gap)
    directions = unit_vectors(geometry.angles[beams])
    lengths = np.arange(0.0, _REACH, 0.02)
    points = lengths[:, None, None] * directions
    sensor = compose(pose, geometry.mount)
    return transform_points(sensor, points.reshape(-1, 2))


def is_unmapped(points: FloatArray, grid: OccupancyGrid) -> bool:
    """True if most of some open space, points (N, 2) [m], is unknown in a map."""
    row, col, _ = cells_inside(grid.frame, points)
    is_known = grid.cells[row, col] != UNKNOWN
    known = int(np.count_nonzero(is_known))
    return known <= (1.0 - _UNMAPPED) * len(points)


def free_at(points: FloatArray, grid: OccupancyGrid, value: int) -> OccupancyGrid:
    """Copy a map with those cells at some points (N, 2) [m] free that have a value."""
    row, col, _ = cells_inside(grid.frame, points)
    has_value = grid.cells[row, col] == value
    cells = grid.cells.copy()
    cells[row[has_value], col[has_value]] = FREE
    return OccupancyGrid(cells, grid.frame)


@kernel
def _stand_apart(
    cells: ByteArray, rows: IntArray, cols: IntArray, resolution: float, apart: float
) -> BoolArray:
    """Mask of those cells that are farther than ``apart`` from every occupied one, shape (N,).

    Args:
        cells: ROS map values, shape (H, W).
        rows: Of the cells asked about, shape (N,).
        cols: The same.
        resolution: Cell size [m].
        apart: Between the centres of two cells [m].
    """
    height, width = cells.shape
    half = int(apart / resolution) + 1
    is_apart = np.ones(len(rows), np.bool_)
    for i in range(len(rows)):
        middle_row = rows[i]
        middle_col = cols[i]
        top = max(0, middle_row - half)
        bottom = min(height, middle_row + half + 1)
        left = max(0, middle_col - half)
        right = min(width, middle_col + half + 1)
        for row in range(top, bottom):
            for col in range(left, right):
                if cells[row, col] == OCCUPIED:
                    squared = np.float32((row - middle_row) ** 2 + (col - middle_col) ** 2)
                    # In single precision, as distance fields are.
                    if not np.sqrt(squared) * np.float32(resolution) > np.float32(apart):
                        is_apart[i] = False
    return is_apart
