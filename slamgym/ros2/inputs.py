"""Maps and scans from outside as an exploration takes them."""

import math

import numpy as np

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Float32Array,
    FloatArray,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.frontiers import Point


def fence(grid: OccupancyGrid, area: tuple[Point, ...]) -> OccupancyGrid:
    """Close a map where free space leaves a polygon, corners in the map frame [m]: what is unknown there is a wall."""
    if not area:
        return grid
    import cv2

    x, y = np.array(area).T
    row, col = grid.frame.to_cell(x, y)
    corners = np.column_stack([col, row]).astype(np.int32)
    inside = np.zeros(grid.frame.shape, np.uint8)
    cv2.fillPoly(inside, [corners], 1)
    free = (grid.cells == FREE).view(np.uint8)
    neighbours = np.ones((3, 3), np.uint8)
    beside = cv2.dilate(free, neighbours)
    closed = (grid.cells == UNKNOWN) & (inside == 0) & (beside > 0)
    cells = grid.cells.copy()
    cells[closed] = OCCUPIED
    return OccupancyGrid(cells, grid.frame)


def knows_place(grid: OccupancyGrid, pose: Pose2D, radius: float) -> bool:
    """True if a map shows free space where a robot of a radius [m] stands."""
    row, col = grid.frame.to_cell(pose.x, pose.y)
    half = math.ceil(radius / grid.frame.resolution)
    rows = slice(max(0, row - half), row + half + 1)
    cols = slice(max(0, col - half), col + half + 1)
    around = grid.cells[rows, cols]
    return bool((around == FREE).any())


def usable_scan(scan: LaserScan | None) -> LaserScan | None:
    """The scan with its beams counter-clockwise, as many as it has; None if it says nothing."""
    if scan is None or not len(scan.ranges):
        return None
    ranges = np.asarray(scan.ranges, np.float32)
    geometry = scan.geometry._replace(num_beams=len(ranges))
    first = geometry.angle_min
    step = geometry.angle_increment
    reach = geometry.range_max
    if not all(map(math.isfinite, (first, step, reach))):
        return None
    if step == 0.0 or reach <= 0.0:
        return None
    if step < 0.0:
        last = first + step * (len(ranges) - 1)
        ranges = ranges[::-1]
        geometry = geometry._replace(angle_min=last, angle_increment=-step)
    return LaserScan(scan.stamp, ranges, geometry)


def fit_ranges(scan: LaserScan | None, geometry: LaserGeometry) -> Float32Array:
    """Ranges on the beams of a scanner, shape (num_beams,) [m], of any usable scan; none where there is no scan.

    No return is the largest range. What is too near, erroneous, or not measured there is 0.
    """
    if scan is None:
        return np.zeros(0, np.float32)
    ranges = scan.ranges
    if scan.geometry[:3] != geometry[:3]:
        ranges = _resampled(scan, geometry.angles)
    usable = ranges >= np.float32(geometry.range_min)
    limited = np.minimum(ranges, geometry.range_max)
    return np.where(usable, limited, 0.0).astype(np.float32)


def _resampled(scan: LaserScan, angles: FloatArray) -> Float32Array:
    """Ranges of the beams nearest to these angles [rad]; 0 where there is none."""
    step = scan.geometry.angle_increment
    turned = (angles - scan.geometry.angle_min) % (2.0 * math.pi)
    beams_a_turn = max(1, round(2.0 * math.pi / step))
    index = np.rint(turned / step).astype(np.int64) % beams_a_turn
    measured = index < len(scan.ranges)
    ranges = np.zeros(len(angles), np.float32)
    ranges[measured] = scan.ranges[index[measured]]
    return ranges
