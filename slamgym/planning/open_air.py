"""Open air: directions in which a scan met nothing and the map shows nothing, as in a doorway before a large hall.

A map is cleared along a beam without return only as far as the returns beside it vouch for it, because behind a pane
or a dark wall there is nothing to see either. A robot that stands in a doorway sees both posts and, of a hall larger
than its scanner's range, nothing else: the map doesn't grow, however often it goes there.
"""

import math

import numpy as np

from slamgym.core.geometry import compose, transform_points
from slamgym.core.types import (
    FREE,
    UNKNOWN,
    Float32Array,
    FloatArray,
    IntArray,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)

_REACH = 1.0
"""So far from the sensor air without a return is taken for free, if it must be [m]."""
_GAP = math.radians(90.0)
"""Windows and dark walls are no wider than this, seen from where a robot goes [rad] (as in drawing the map)."""
_EMPTY = 0.97
"""Share of the beams in the gap without return: some are strays."""
_UNDRAWN = 0.5
"""Share of the gap, up to the reach, that the map must not know."""


def find_open_air(pose: Pose2D, ranges: Float32Array, geometry: LaserGeometry) -> FloatArray | None:
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
    shares = np.convolve(empty, np.ones(width) / width, mode="valid")
    best = np.flatnonzero(shares >= shares.max() - 1e-9)
    if shares[best[0]] < _EMPTY:
        return None
    first = int(best[len(best) // 2])  # the middle of all such gaps
    beams = np.flatnonzero(empty[first : first + width]) + first
    angles = geometry.angles[beams]
    lengths = np.arange(0.0, _REACH, 0.02)
    points = lengths[:, None, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return transform_points(compose(pose, geometry.mount), points.reshape(-1, 2))


def is_undrawn(points: FloatArray, grid: OccupancyGrid) -> bool:
    """Whether a map leaves most of some open air unknown."""
    row, col = _inside(points, grid)
    return bool(np.count_nonzero(grid.cells[row, col] != UNKNOWN) <= (1.0 - _UNDRAWN) * len(points))


def clear_open_air(points: FloatArray, grid: OccupancyGrid) -> OccupancyGrid:
    """Copy a map with the unknown cells at some points free."""
    row, col = _inside(points, grid)
    cells = grid.cells.copy()
    unknown = cells[row, col] == UNKNOWN
    cells[row[unknown], col[unknown]] = FREE
    return OccupancyGrid(cells, grid.frame)


def _inside(points: FloatArray, grid: OccupancyGrid) -> tuple[IntArray, IntArray]:
    """Rows and columns of the points that lie on a map."""
    row, col = grid.frame.to_cell(points[:, 0], points[:, 1])
    height, width = grid.cells.shape
    inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    return row[inside], col[inside]
