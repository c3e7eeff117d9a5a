"""Numbers that describe how a SLAM map looks, for comparing sets of maps.

All take maps with the values of ROS map_server (0, 205, 254), row 0 at the top; maps are compared at one cell size.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray
from slamgym.metrics.maps import CROSS, crop_to_known, distance_to, resample_slam

LOOK_CELL = 0.05
"""Cell size at which maps are compared [m]: the usual one of GMapping and cartographer."""
COARSEST_CELL = 0.06
"""Maps of larger cells are not compared: finer cells can't bring back what they never held [m]."""
_MIN_OCCUPIED = 0.2
"""A wall one cell thick, drawn at 1 or 2 cm, stays closed wherever it lies on the coarser grid."""
_MARGIN_CELLS = 2
"""Margin round the floor: both rows of a wall that SLAM has drawn twice."""
_SPECK_CELLS = 3
"""Most cells of a speck or a dot."""
_RAY_CELLS = 6
"""Shortest thin part of the free space that counts as a ray."""
_NEIGHBOURHOOD = 2.0
"""Standard deviation of the structure tensor's neighbourhood [cells]."""
_STRAIGHT = 0.5
"""Coherence below which a wall cell is part of a corner or clutter."""
_SQUARE = np.ones((3, 3), np.uint8)
"""A cell and its eight neighbours."""
_UNIFORM = (0, 40, 80)
"""Codes of the 2 x 2 patterns of one value."""

LOOK_NAMES = {
    "open_border": "open border (share)",
    "free_fragments_per_100m2": "free fragments / 100 m²",
    "blobs_per_100m2": "blobs / 100 m²",
    "share_unknown": "unknown (share)",
    "share_occupied": "occupied (share)",
    "blob_median_px": "median blob (cells)",
    "run_1": "wall runs of 1 cell (share)",
    "run_2": "wall runs of 2 cells (share)",
    "run_3": "wall runs of 3 cells (share)",
    "run_4_plus": "wall runs of 4 cells and more (share)",
    "wall_thickness_px": "wall thickness (cells)",
    "thin_free_share": "free cells in strips 1-2 cells wide (share)",
    "rays_per_100m2": "single rays / 100 m²",
    "open_run_m": "mean length of an open border (m)",
    "checkerboard_share": "checkerboard of free and unknown (share of 2 x 2 blocks)",
    "specks_in_free_share": "specks in free space (share)",
    "dots_in_unknown_per_100m2": "dots beyond walls / 100 m²",
    "wall_coherence": "straightness of walls (0-1)",
    "bent_share": "corners and clutter (share of wall cells)",
    "axis_alignment": "walls along two main directions (0-1)",
    "free_area_m2": "free area (m²)",
    "long_side_m": "long side (m)",
    "share_free": "free (share of the box)",
}
"""The statistics that a person reads, in this order, in words."""


def at_look_cell(cells: ByteArray, resolution: float) -> ByteArray:
    """A map at the common cell size; a thin wall stays closed.

    Args:
        cells: (H, W).
        resolution: [m/cell], at most :data:`COARSEST_CELL`.
    """
    difference = abs(resolution - LOOK_CELL)
    if difference < 0.02 * LOOK_CELL:
        return cells
    height, width = cells.shape
    rows = round(height * resolution / LOOK_CELL)
    cols = round(width * resolution / LOOK_CELL)
    shape = (max(1, rows), max(1, cols))
    return resample_slam(cells, shape, _MIN_OCCUPIED)


def cut_to_floor(cells: ByteArray) -> ByteArray:
    """The part of a map around its largest connected free space (4-neighbours), with two cells of margin.

    Without free space it is empty.
    """
    free = cells == FREE
    image = free.astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=4)
    if len(stats) < 2:
        return cells[:0, :0]
    areas = stats[1:, cv2.CC_STAT_AREA]
    largest = 1 + int(np.argmax(areas))
    left, top, width, height, _ = stats[largest]
    first_row = max(top - _MARGIN_CELLS, 0)
    first_col = max(left - _MARGIN_CELLS, 0)
    bottom = top + height + _MARGIN_CELLS
    right = left + width + _MARGIN_CELLS
    return cells[first_row:bottom, first_col:right]


def look_statistics(cells: ByteArray) -> dict[str, float]:
    """Statistics of how a map looks.

    Args:
        cells: (H, W) at :data:`LOOK_CELL`, cut by :func:`cut_to_floor`.

    Returns:
        Name to value: shares of the picture, wall thickness, holes, blobs, open borders, tilt, rays, straightness, and
        how often each 2 x 2 pattern of cells occurs.
    """
    occupied = cells == OCCUPIED
    free = cells == FREE
    unknown = cells == UNKNOWN
    free_cells = float(free.sum())
    area = max(free_cells * LOOK_CELL**2, 1e-9)
    hundreds = area / 100.0
    sizes = _sizes(occupied)
    in_free = _sizes(~free)
    specks_in_free = in_free[in_free <= _SPECK_CELLS]
    # With unknown cells around it: what borders floor at the end of the picture counts in the patterns.
    framed = crop_to_known(cells, 1)
    holes = _sizes(framed != FREE)
    unknown_holes = _sizes(framed == UNKNOWN)
    runs = _run_lengths(occupied)
    short_runs = runs["run_1"] + runs["run_2"] + runs["run_3"]
    return {
        "share_unknown": float(unknown.mean()),
        "share_occupied": float(occupied.mean()),
        "share_free": float(free.mean()),
        "occupied_per_free": _ratio(occupied, free),
        "wall_thickness_px": wall_thickness(occupied),
        "tilt_deg": wall_tilt(framed == OCCUPIED),
        "blobs_per_100m2": len(sizes) / hundreds,
        "specks_per_100m2": float((sizes <= _SPECK_CELLS).sum()) / hundreds,
        "holes_per_100m2": len(holes) / hundreds,
        "unknown_holes_per_100m2": len(unknown_holes) / hundreds,
        "open_border": open_border(free, unknown),
        **runs,
        **_patterns(framed),
        "run_4_plus": max(0.0, 1.0 - short_runs),
        "free_fragments_per_100m2": 100.0 * free_fragments(free) / area,
        "blob_median_px": float(np.median(sizes)) if len(sizes) else 0.0,
        **_ray_statistics(free, unknown, area),
        "specks_in_free_share": float(specks_in_free.sum()) / max(free_cells, 1.0),
        "dots_in_unknown_per_100m2": 100.0 * _dots(occupied, unknown) / area,
        **_straightness(occupied),
        "free_area_m2": area,
        "long_side_m": max(cells.shape) * LOOK_CELL,
    }


def wall_thickness(occupied: BoolArray) -> float:
    """Mean thickness of walls [px]: four times the mean distance from a wall cell to its wall's edge, less 1.

    A wall of one cell has the distance 1/2 from its centre to either edge, one of two cells likewise; a
    thicker one grows by 1/4 px per px.
    """
    if not occupied.any():
        return 0.0
    padded = np.pad(occupied, 1)
    inside = distance_to(~padded)[padded] - 0.5
    return float(4.0 * inside.mean() - 1.0)


def wall_tilt(occupied: BoolArray) -> float:
    """By how much the walls' main direction is off the axes [deg], between -45 and 45."""
    image = occupied.astype(np.float32)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.5)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    # Directions count modulo 90 degrees: average the fourth power of the gradient's phase.
    direction = np.arctan2(-gy, gx)
    angle = direction.astype(np.float64)
    phase = np.exp(4j * angle)
    fourth_power = np.hypot(gx, gy) * phase
    mean_phase = np.angle(fourth_power.sum())
    return float(np.degrees(mean_phase) / 4.0)


def open_border(free: BoolArray, unknown: BoolArray) -> float:
    """Share of the free space's border that meets unknown space instead of a wall."""
    image = free.astype(np.uint8)
    widened = cv2.dilate(image, CROSS)
    border = (widened > 0) & ~free
    is_open = border & unknown
    return _ratio(is_open, border)


def _ratio(some: BoolArray, others: BoolArray) -> float:
    """How many cells there are of some for each of others, or for one where there are none."""
    count = some.sum()
    of = max(others.sum(), 1)
    return float(count / of)


def free_fragments(free: BoolArray) -> int:
    """Number of connected parts (4-neighbours) of the free space, without the largest."""
    image = free.astype(np.uint8)
    count, _ = cv2.connectedComponents(image, connectivity=4)
    return max(count - 2, 0)


def _sizes(mask: BoolArray) -> FloatArray:
    """Sizes [px] of the 8-connected parts of a mask."""
    image = mask.astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    return np.asarray(areas, dtype=np.float64)


def _run_lengths(occupied: BoolArray) -> dict[str, float]:
    """Share of wall runs of 1, 2, 3 and more cells, along rows and columns together."""
    lengths = []
    for picture in (occupied, occupied.T):
        padded = np.pad(picture, ((0, 0), (1, 1)))
        signed = padded.astype(np.int8)
        edges = np.diff(signed, axis=1)
        _, starts = np.nonzero(edges == 1)
        _, ends = np.nonzero(edges == -1)
        lengths.append(ends - starts)
    run = np.concatenate(lengths)
    every_run = np.ones(len(run), np.bool_)
    is_4_to_6 = (run >= 4) & (run <= 6)
    return {
        "run_1": _ratio(run == 1, every_run),
        "run_2": _ratio(run == 2, every_run),
        "run_3": _ratio(run == 3, every_run),
        "run_4_to_6": _ratio(is_4_to_6, every_run),
    }


def _patterns(cells: ByteArray) -> dict[str, float]:
    """Share of each 2 x 2 pattern among the patterns that are not uniform."""
    not_free = np.where(cells == UNKNOWN, 1, 0)
    level = np.where(cells == FREE, 2, not_free)
    left = level[:, :-1]
    right = level[:, 1:]
    pair = left + 3 * right
    above = pair[:-1]
    below = pair[1:]
    codes = above + 9 * below
    occurrences = np.bincount(codes.ravel(), minlength=81)
    counts = occurrences.astype(np.float64)
    counts[list(_UNIFORM)] = 0.0
    shares = counts / max(counts.sum(), 1.0)
    patterns = {}
    for code, share in enumerate(shares.tolist()):
        if code not in _UNIFORM:
            patterns[f"pattern_{code:02d}"] = share
    return patterns


def _ray_statistics(free: BoolArray, unknown: BoolArray, area: float) -> dict[str, float]:
    """Beams that were drawn alone: thin strips of free space, open borders, and checkerboards of free and unknown."""
    image = free.astype(np.uint8)
    wide = cv2.morphologyEx(image, cv2.MORPH_OPEN, _SQUARE)
    thin = free & (wide == 0)
    rays = _count_of_rays(thin)
    widened = cv2.dilate(image, CROSS)
    open_border = (widened > 0) & unknown
    open_runs = _sizes(open_border)
    mean_run = float(open_runs.mean()) if len(open_runs) else 0.0
    top_left = free[:-1, :-1]
    top_right = free[:-1, 1:]
    bottom_left = free[1:, :-1]
    bottom_right = free[1:, 1:]
    top_alike = top_left == top_right
    falling_alike = top_left == bottom_right
    rising_alike = top_right == bottom_left
    diagonals_alike = falling_alike & rising_alike
    is_uniform = top_alike & diagonals_alike
    crossed = diagonals_alike & ~top_alike
    return {
        "thin_free_share": _ratio(thin, free),
        "rays_per_100m2": 100.0 * float(rays) / area,
        "open_run_m": LOOK_CELL * mean_run,
        "checkerboard_share": _ratio(crossed, ~is_uniform),
    }


def _count_of_rays(thin: BoolArray) -> int:
    """Number of long parts among thin free space that fill no more than their diagonal."""
    image = thin.astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    parts = stats[1:]
    width = parts[:, cv2.CC_STAT_WIDTH]
    height = parts[:, cv2.CC_STAT_HEIGHT]
    length = np.maximum(width, height)
    is_long = length >= _RAY_CELLS
    is_narrow = parts[:, cv2.CC_STAT_AREA] <= 2 * length
    is_ray = is_long & is_narrow
    return int(is_ray.sum())


def _dots(occupied: BoolArray, unknown: BoolArray) -> int:
    """Blobs of at most three occupied cells with more unknown than free neighbours: ends of stray beams."""
    image = occupied.astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    is_unknown = unknown.astype(np.float32)
    near = cv2.filter2D(is_unknown, -1, _SQUARE / 8.0, borderType=cv2.BORDER_REPLICATE)
    of_cell = labels.ravel()
    count = np.bincount(of_cell, minlength=len(stats))
    unknown_near = np.bincount(of_cell, near.ravel(), len(stats))
    share = unknown_near / np.maximum(count, 1)
    is_small = stats[:, cv2.CC_STAT_AREA] <= _SPECK_CELLS
    is_dot = is_small & (share > 0.5)
    is_dot[0] = False  # the background of the labelling
    return int(is_dot.sum())


def _straightness(occupied: BoolArray) -> dict[str, float]:
    """Coherence of the structure tensor at wall cells (Bigün and Granlund 1987), and how the walls are directed."""
    if not occupied.any():
        return {"wall_coherence": 0.0, "bent_share": 0.0, "axis_alignment": 0.0}
    image = occupied.astype(np.float32)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    coherence = _coherence(gx, gy)
    of_walls = coherence[occupied]
    is_bent = of_walls < _STRAIGHT
    return {
        "wall_coherence": float(of_walls.mean()),
        "bent_share": float(is_bent.mean()),
        "axis_alignment": _axis_alignment(gx, gy),
    }


def _coherence(gx: np.ndarray, gy: np.ndarray) -> np.ndarray:
    """How much the gradients around each cell are along one line: 0 not at all, 1 all."""
    xx = _neighbourhood(gx * gx)
    yy = _neighbourhood(gy * gy)
    xy = _neighbourhood(gx * gy)
    difference = np.hypot(xx - yy, 2.0 * xy)
    both = np.maximum(xx + yy, 1e-9)
    return difference / both


def _neighbourhood(product: np.ndarray) -> np.ndarray:
    """The weighted mean around each cell."""
    return cv2.GaussianBlur(product, (0, 0), _NEIGHBOURHOOD)


def _axis_alignment(gx: np.ndarray, gy: np.ndarray) -> float:
    """How much all gradients are along two lines at right angles: 0 not at all, 1 all."""
    # Directions count modulo 90 degrees, as walls of one building stand square to each other.
    direction = np.arctan2(gy, gx)
    angle = direction.astype(np.float64)
    strength = np.hypot(gx, gy)
    weight = strength.astype(np.float64)
    weighted = weight * np.exp(4j * angle)
    in_common = abs(weighted.sum())
    total = max(weight.sum(), 1e-9)
    return float(in_common / total)
