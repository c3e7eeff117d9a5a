"""Fifteen numbers of the kind that the paper's cleaning looks at.

These are pixel counts and ratios of black, white and grey, the number of holes by the Euler number, and the
grey-white neighbours. Here areas are in m2 and lengths in m, so that maps of different resolution compare. The floor is
the free space without the spikes that stray beams clear through walls, and areas are counted within its convex hull.

Convention: maps have the values of ROS map_server (0, 205, 254).
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray
from slamgym.metrics.maps import CROSS, crop_to_known

PAPER_FEATURES = (
    "free_area",  # [m2] white cells within the hull
    "occupied_area",  # [m2] black cells within the hull
    "unknown_area",  # [m2] grey cells within the hull
    "free_share",  # of the hull; the three shares add up to 1
    "occupied_share",
    "unknown_share",
    "occupied_per_free",
    "unknown_per_free",
    "islands",  # holes of the floor: pillars, furniture, pieces of wall
    "pockets",  # holes of floor and walls: enclosed unknown regions
    "wall_parts",  # separate parts of the occupied space for each 10 m2 of free space
    "frontier",  # [m] grey-white neighbours: sides that a cell of the floor and an unknown one share
    "frontier_share",  # of all sides between the floor and the rest
    "open_frontier",  # [m] the part of the frontier that the robot has room to drive through
    "widest_frontier",  # [m] the longest connected piece of that part
)
"""Names of the features, in their order."""

FRONTIER_CLEARANCE = 0.2
"""A frontier cell counts as open if no wall is nearer [m]: the radius of the circle that holds a TurtleBot3
Waffle Pi is 0.22 m, and the walls of a map are smeared by a cell."""

SPIKE_WIDTH = 0.2
"""Free space narrower than this is no floor [m]: a stray beam clears a spike through the wall."""


def paper_features(cells: ByteArray, resolution: float) -> FloatArray:
    """Measure a map.

    Args:
        cells: (rows, cols) 0 occupied, 205 unknown, 254 free.
        resolution: [m/px].

    Returns:
        Values in the order of :data:`PAPER_FEATURES`, shape (15,); all 0 for a map without any known cell.
    """
    if (cells == UNKNOWN).all():
        return np.zeros(len(PAPER_FEATURES))
    margin = round(SPIKE_WIDTH / resolution)
    cropped = crop_to_known(cells, margin + 1)
    free, occupied, unknown = cropped == FREE, cropped == OCCUPIED, cropped == UNKNOWN
    floor = without_spikes(free, resolution)
    if not floor.any():
        floor = free
    hull = inside_hull(floor if floor.any() else ~unknown, margin)
    cell_area = resolution * resolution
    free_area, occupied_area, unknown_area = (
        float(np.count_nonzero(mask & hull)) * cell_area for mask in (free, occupied, unknown)
    )
    hull_area = float(np.count_nonzero(hull)) * cell_area
    floor_area = max(free_area, cell_area)
    frontier = shared_sides(floor, unknown)
    borders = shared_sides(floor, ~floor)
    open_cells, widest = open_frontier(floor, occupied, unknown, resolution)
    areas = np.array([free_area, occupied_area, unknown_area])
    return np.array(
        [
            *areas,
            *(areas / hull_area),
            *(areas[1:] / floor_area),
            count_holes(floor),
            count_holes(floor | occupied),
            10.0 * count_parts(occupied) / floor_area,
            frontier * resolution,
            frontier / max(borders, 1),
            open_cells * resolution,
            widest * resolution,
        ],
        dtype=np.float64,
    )


def without_spikes(free: BoolArray, resolution: float) -> BoolArray:
    """The free space without what is narrower than :data:`SPIKE_WIDTH` (a morphological opening)."""
    side = 2 * round(0.5 * SPIKE_WIDTH / resolution) + 1
    opened = cv2.morphologyEx(
        free.astype(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8)
    )
    return np.asarray(opened, dtype=np.bool_)


def inside_hull(mask: BoolArray, margin_px: int) -> BoolArray:
    """Cells in or on the convex hull of a mask's cell centres, after the mask grew by a margin.

    Counted row by row in whole numbers, so that a flip or a quarter turn of the mask does just the same to
    the result.

    Args:
        mask: (rows, cols), with at least one true cell.
        margin_px: How far it grows, along rows and columns.
    """
    side = 2 * margin_px + 1
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    rows = np.flatnonzero(grown.any(axis=1))
    leftmost = grown[rows].argmax(axis=1)
    rightmost = grown.shape[1] - 1 - grown[rows, ::-1].argmax(axis=1)
    ends = np.column_stack([np.concatenate([leftmost, rightmost]), np.concatenate([rows, rows])])
    hull = cv2.convexHull(ends.astype(np.int32)).reshape(-1, 2).astype(np.int64)
    first = np.full(grown.shape[0], grown.shape[1], dtype=np.int64)
    last = np.full(grown.shape[0], -1, dtype=np.int64)
    for (x, y), (end_x, end_y) in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        first[y], last[y] = min(first[y], x), max(last[y], x)
        rise = abs(end_y - y)
        if rise == 0:
            continue
        span = np.arange(min(y, end_y), max(y, end_y) + 1)
        crossing = x * rise + np.abs(span - y) * (
            end_x - x
        )  # of the edge with each row, times rise
        first[span] = np.minimum(first[span], -(-crossing // rise))
        last[span] = np.maximum(last[span], crossing // rise)
    column = np.arange(grown.shape[1])
    return (column >= first[:, None]) & (column <= last[:, None])


def shared_sides(first: BoolArray, second: BoolArray) -> int:
    """Number of cell sides with a cell of the one mask here and one of the other there."""
    across = (first[:, 1:] & second[:, :-1]).sum() + (first[:, :-1] & second[:, 1:]).sum()
    down = (first[1:] & second[:-1]).sum() + (first[:-1] & second[1:]).sum()
    return int(across + down)


def count_parts(mask: BoolArray) -> int:
    """Number of 8-connected parts."""
    return int(cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0]) - 1


def euler_number(mask: BoolArray) -> int:
    """Number of the 8-connected parts less that of their holes, from the squares of 2 by 2 cells alone.

    Gray, Local properties of binary images in two dimensions, IEEE Trans. Computers 1971: a quarter of the squares with
    one cell, less those with three, less twice those with two that touch at a corner.
    """
    cells = np.pad(mask, 1).astype(np.int8)
    above, below = cells[:-1], cells[1:]
    count = above[:, :-1] + above[:, 1:] + below[:, :-1] + below[:, 1:]
    is_diagonal = (count == 2) & (above[:, :-1] == below[:, 1:])
    ones, threes, diagonals = (
        int(np.count_nonzero(kind)) for kind in (count == 1, count == 3, is_diagonal)
    )
    return (ones - threes - 2 * diagonals) // 4


def count_holes(mask: BoolArray) -> int:
    """Number of holes of the 8-connected parts, by the Euler number."""
    return count_parts(mask) - euler_number(mask)


def open_frontier(
    floor: BoolArray, occupied: BoolArray, unknown: BoolArray, resolution: float
) -> tuple[int, int]:
    """The frontier that a robot could drive through.

    Its cells are the unknown ones next to free space, at least :data:`FRONTIER_CLEARANCE` away from every wall. The
    same test in the middle of a doorway and along a wall with pin holes distinguishes an unseen room from noise.

    Args:
        floor: (rows, cols) free cells, without spikes.
        occupied: (rows, cols).
        unknown: (rows, cols).
        resolution: [m/px].

    Returns:
        Number of the cells, and of those in the largest 8-connected piece.
    """
    frontier = (cv2.dilate(floor.astype(np.uint8), CROSS) > 0) & unknown
    if occupied.any():
        away = cv2.distanceTransform(
            (~occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
        )
        frontier &= away.astype(np.float64) * resolution >= FRONTIER_CLEARANCE
    if not frontier.any():
        return 0, 0
    _, _, stats, _ = cv2.connectedComponentsWithStats(frontier.astype(np.uint8), connectivity=8)
    sizes = stats[1:, cv2.CC_STAT_AREA]
    return int(sizes.sum()), int(sizes.max())
