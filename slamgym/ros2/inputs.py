"""Maps and scans from outside as an exploration takes them."""

import math

import numpy as np

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Float32Array,
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

    row, col = grid.frame.to_cell(*np.array(area).T)
    inside = np.zeros(grid.frame.shape, np.uint8)
    cv2.fillPoly(inside, [np.column_stack([col, row]).astype(np.int32)], 1)
    beside = cv2.dilate((grid.cells == FREE).view(np.uint8), np.ones((3, 3), np.uint8))
    closed = (grid.cells == UNKNOWN) & (inside == 0) & (beside > 0)
    return OccupancyGrid(np.where(closed, np.uint8(OCCUPIED), grid.cells), grid.frame)


def knows_place(grid: OccupancyGrid, pose: Pose2D, radius: float) -> bool:
    """True if a map shows free space where a robot of a radius [m] stands."""
    row, col = grid.frame.to_cell(pose.x, pose.y)
    half = math.ceil(radius / grid.frame.resolution)
    around = grid.cells[max(0, row - half) : row + half + 1, max(0, col - half) : col + half + 1]
    return bool((around == FREE).any())


def usable_scan(scan: LaserScan | None) -> LaserScan | None:
    """The scan with its beams counter-clockwise, as many as it has; None if it says nothing."""
    if scan is None or not len(scan.ranges):
        return None
    count, ranges, geometry = len(scan.ranges), scan.ranges, scan.geometry
    step, reach = geometry.angle_increment, geometry.range_max
    if (
        not all(map(math.isfinite, (geometry.angle_min, step, reach)))
        or step == 0.0
        or reach <= 0.0
    ):
        return None
    if step < 0.0:
        ranges, first = ranges[::-1], geometry.angle_min + step * (count - 1)
        geometry = geometry._replace(angle_min=first, angle_increment=-step)
    return LaserScan(scan.stamp, np.asarray(ranges, np.float32), geometry._replace(num_beams=count))


def fit_ranges(scan: LaserScan | None, geometry: LaserGeometry) -> Float32Array:
    """Ranges on the beams of a scanner, shape (num_beams,) [m], of any usable scan; none where there is no scan.

    No return is the largest range. What is too near, erroneous, or not measured there is 0.
    """
    if scan is None:
        return np.zeros(0, np.float32)
    ranges, theirs = scan.ranges, scan.geometry
    if theirs[:3] != geometry[:3]:
        index = np.rint(
            (geometry.angles - theirs.angle_min) % (2.0 * math.pi) / theirs.angle_increment
        )
        index = index.astype(np.int64) % max(1, round(2.0 * math.pi / theirs.angle_increment))
        measured = index < len(ranges)
        ranges = np.where(measured, np.append(ranges, 0.0)[np.where(measured, index, -1)], 0.0)
    usable = ranges >= np.float32(geometry.range_min)
    return np.where(usable, np.minimum(ranges, geometry.range_max), 0.0).astype(np.float32)
