"""Five numbers that show from a SLAM map alone how much floor may be missing from it.

A map is incomplete if a robot could drive on where it ends. So discs of three sizes stand on the floor wherever they
fit on free cells, and spread from there through everything that isn't occupied: the unknown cells that they come to
soon are ground that was left out. A pin hole in a wall lets none of them through, a doorway all, the gaps between
the feet of a chair the smallest. Besides count the size of the floor and the widest way out of the map.

Convention: maps have the values of ROS map_server (0, 205, 254). No feature changes when a map is flipped, turned by 90
degrees or given a wider margin; maps of cells below 3 cm are first coarsened to about :data:`_CELL`, where that may
move walls by a fine cell.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray
from slamgym.metrics.maps import CROSS, crop_to_known

FEATURES = (
    "floor",  # [m2] the largest part of the free space where the smallest disc's centre can be
    "ahead_20",  # [m2] unknown cells that the centre of a disc of 0.2 m comes to within AHEAD of where it fits
    "ahead_30",  # [m2] the same for 0.3 m
    "ahead_40",  # [m2] the same for 0.4 m
    "way_out",  # [m] radius of the largest disc that can leave the map
)
"""Names of the features, in their order."""

RADII = (0.2, 0.3, 0.4)
"""Discs [m]: a TurtleBot3 has a radius of 0.22 m, a doorway a half width of 0.35 to 0.5 m."""
AHEAD = 1.5
"""How far the discs drive on [m]: of 0.3 to 3 m the best on explorations of all recipes."""
WAYS_OUT = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
"""Discs that try to leave the map [m]."""
_CELL = 0.05
"""Cells of finer maps are joined to about this size [m]."""
_SQUARE = np.ones((3, 3), np.uint8)


def completeness_features(cells: ByteArray, resolution: float) -> FloatArray:
    """Measure a map.

    Args:
        cells: (rows, cols) 0 occupied, 205 unknown, 254 free.
        resolution: [m/px].

    Returns:
        Values in the order of :data:`FEATURES`, shape (5,); all 0 for a map without any free cell.
    """
    if not (cells == FREE).any():
        return np.zeros(len(FEATURES))
    cells, resolution = _coarsened(cells, resolution)
    steps = round(AHEAD / resolution)
    cells = crop_to_known(cells, steps + 2)
    unknown = cells == UNKNOWN
    fits_known = _distance_within(cells == FREE) * resolution
    fits = _distance_within(cells != OCCUPIED) * resolution
    floors = [_largest_part(fits_known >= radius) for radius in RADII]
    areas = [_area(floors[0], resolution)]
    for radius, floor in zip(RADII, floors, strict=True):
        ahead = _spread(floor, fits >= radius, steps) & unknown
        areas.append(_area(ahead, resolution))
    ways_out = [radius for radius in WAYS_OUT if _leads_out(floors[0], fits >= radius)]
    return np.array([*areas, max(ways_out, default=0.0)])


def _area(mask: BoolArray, resolution: float) -> float:
    return float(np.count_nonzero(mask)) * resolution**2


def _coarsened(cells: ByteArray, resolution: float) -> tuple[ByteArray, float]:
    """A map with cells of about 5 cm: occupied if one of the finer cells is, else free if at least half of them are."""
    factor = max(1, round(_CELL / resolution))
    if factor == 1:
        return cells, resolution
    padding = [(0, -size % factor) for size in cells.shape]
    padded = np.pad(cells, padding, constant_values=UNKNOWN)
    height, width = padded.shape
    blocks = padded.reshape(height // factor, factor, width // factor, factor)
    is_occupied = (blocks == OCCUPIED).any(axis=(1, 3))
    is_free = (blocks == FREE).mean(axis=(1, 3)) >= 0.5
    coarse = np.where(is_free, FREE, UNKNOWN)
    coarse[is_occupied] = OCCUPIED
    return coarse.astype(np.uint8), resolution * factor


def _distance_within(mask: BoolArray) -> FloatArray:
    """Distance of each cell to the nearest one outside a mask [cells], from the whole number that its square is."""
    distance = cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(distance, dtype=np.float64)))


def _largest_part(mask: BoolArray) -> BoolArray:
    """The largest 8-connected part of a mask; all of them if several are."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    sizes = stats[:, cv2.CC_STAT_AREA]
    sizes[0] = 0
    return mask & (sizes == sizes.max())[labels]


def _spread(start: BoolArray, passable: BoolArray, steps: int) -> BoolArray:
    """Cells that some steps lead to through passable ones, in turn to four and to eight neighbours: an octagon."""
    reached = start.view(np.uint8)
    ground = passable.view(np.uint8)
    for step in range(steps):
        neighbours = _SQUARE if step % 2 else CROSS
        reached = cv2.dilate(reached, neighbours) & ground
    return reached.view(np.bool_)


def _leads_out(start: BoolArray, passable: BoolArray) -> bool:
    """True if passable cells connect the start with the border."""
    _, labels = cv2.connectedComponents(passable.view(np.uint8), connectivity=8)
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    started = labels[start & passable]
    return bool(np.isin(started, border).any())
