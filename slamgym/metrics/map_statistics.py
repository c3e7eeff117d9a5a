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
_MARGIN_CELLS = 2  # both rows of a wall that SLAM has drawn twice
_SPECK_CELLS = 3
_RAY_CELLS = 6  # shortest thin part of the free space that counts as a ray
_NEIGHBOURHOOD = 2.0  # [cells] of the structure tensor, standard deviation
_STRAIGHT = 0.5  # coherence below which a wall cell is part of a corner or clutter
_SQUARE = np.ones((3, 3), np.uint8)
_UNIFORM = (0, 40, 80)  # codes of the 2 x 2 patterns of one value

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
    if abs(resolution - LOOK_CELL) < 0.02 * LOOK_CELL:
        return cells
    rows, cols = (max(1, round(n * resolution / LOOK_CELL)) for n in cells.shape)
    return resample_slam(cells, (rows, cols), _MIN_OCCUPIED)


def cut_to_floor(cells: ByteArray) -> ByteArray:
    """The part of a map around its largest connected free space (4-neighbours), with two cells of margin.

    Without free space it is empty.
    """
    _, _, stats, _ = cv2.connectedComponentsWithStats(
        (cells == FREE).astype(np.uint8), connectivity=4
    )
    if len(stats) < 2:
        return cells[:0, :0]
    left, top, width, height, _ = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))]
    m = _MARGIN_CELLS
    return cells[max(top - m, 0) : top + height + m, max(left - m, 0) : left + width + m]


def look_statistics(cells: ByteArray) -> dict[str, float]:
    """Statistics of how a map looks.

    Args:
        cells: (H, W) at :data:`LOOK_CELL`, cut by :func:`cut_to_floor`.

    Returns:
        Name to value: shares of the picture, wall thickness, holes, blobs, open borders, tilt, rays, straightness, and
        how often each 2 x 2 pattern of cells occurs.
    """
    occupied, free, unknown = cells == OCCUPIED, cells == FREE, cells == UNKNOWN
    area = max(float(free.sum()) * LOOK_CELL**2, 1e-9)
    sizes, specks = _sizes(occupied), _sizes(~free)
    # With unknown cells around it: what borders floor at the end of the picture counts in the patterns.
    framed = crop_to_known(cells, 1)
    runs = _run_lengths(occupied)
    return {
        "share_unknown": float(unknown.mean()),
        "share_occupied": float(occupied.mean()),
        "share_free": float(free.mean()),
        "occupied_per_free": float(occupied.sum() / max(free.sum(), 1)),
        "wall_thickness_px": wall_thickness(occupied),
        "tilt_deg": wall_tilt(framed == OCCUPIED),
        "blobs_per_100m2": len(sizes) / (area / 100.0),
        "specks_per_100m2": float((sizes <= _SPECK_CELLS).sum()) / (area / 100.0),
        "holes_per_100m2": len(_sizes(framed != FREE)) / (area / 100.0),
        "unknown_holes_per_100m2": len(_sizes(framed == UNKNOWN)) / (area / 100.0),
        "open_border": open_border(free, unknown),
        **runs,
        **_patterns(framed),
        "run_4_plus": max(0.0, 1.0 - sum(runs[f"run_{n}"] for n in (1, 2, 3))),
        "free_fragments_per_100m2": 100.0 * free_fragments(free) / area,
        "blob_median_px": float(np.median(sizes)) if len(sizes) else 0.0,
        **_ray_statistics(free, unknown, area),
        "specks_in_free_share": float(specks[specks <= _SPECK_CELLS].sum())
        / max(float(free.sum()), 1.0),
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
    smooth = cv2.GaussianBlur(occupied.astype(np.float32), (0, 0), 1.5)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    # Directions count modulo 90 degrees: average the fourth power of the gradient's phase.
    phase = np.exp(4j * np.arctan2(-gy, gx).astype(np.float64))
    return float(np.degrees(np.angle((np.hypot(gx, gy) * phase).sum())) / 4.0)


def open_border(free: BoolArray, unknown: BoolArray) -> float:
    """Share of the free space's border that meets unknown space instead of a wall."""
    border = (cv2.dilate(free.astype(np.uint8), CROSS) > 0) & ~free
    return float((border & unknown).sum() / max(border.sum(), 1))


def free_fragments(free: BoolArray) -> int:
    """Number of connected parts (4-neighbours) of the free space, without the largest."""
    return max(cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[0] - 2, 0)


def _sizes(mask: BoolArray) -> FloatArray:
    """Sizes [px] of the 8-connected parts of a mask."""
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)[2]
    return np.asarray(stats[1:, cv2.CC_STAT_AREA], dtype=np.float64)


def _run_lengths(occupied: BoolArray) -> dict[str, float]:
    """Share of wall runs of 1, 2, 3 and more cells, along rows and columns together."""
    lengths = []
    for picture in (occupied, occupied.T):
        edges = np.diff(np.pad(picture, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        lengths.append(np.nonzero(edges == -1)[1] - np.nonzero(edges == 1)[1])
    run = np.concatenate(lengths)
    names = {
        "run_1": run == 1,
        "run_2": run == 2,
        "run_3": run == 3,
        "run_4_to_6": (run >= 4) & (run <= 6),
    }
    return {name: float(hit.sum() / max(len(run), 1)) for name, hit in names.items()}


def _patterns(cells: ByteArray) -> dict[str, float]:
    """Share of each 2 x 2 pattern among the patterns that are not uniform."""
    level = np.where(cells == FREE, 2, np.where(cells == UNKNOWN, 1, 0))
    code = level[:-1, :-1] + 3 * level[:-1, 1:] + 9 * level[1:, :-1] + 27 * level[1:, 1:]
    counts = np.bincount(code.ravel(), minlength=81).astype(np.float64)
    counts[list(_UNIFORM)] = 0.0
    shares = counts / max(counts.sum(), 1.0)
    return {f"pattern_{i:02d}": float(share) for i, share in enumerate(shares) if i not in _UNIFORM}


def _ray_statistics(free: BoolArray, unknown: BoolArray, area: float) -> dict[str, float]:
    """Beams that were drawn alone: thin strips of free space, their open ends, and checkerboards of them."""
    image = free.astype(np.uint8)
    thin = free & (cv2.morphologyEx(image, cv2.MORPH_OPEN, _SQUARE) == 0)
    stats = cv2.connectedComponentsWithStats(thin.astype(np.uint8), connectivity=8)[2][1:]
    length = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    rays = (length >= _RAY_CELLS) & (stats[:, cv2.CC_STAT_AREA] <= 2 * length)
    open_runs = _sizes((cv2.dilate(image, CROSS) > 0) & unknown)
    a, b, c, d = free[:-1, :-1], free[:-1, 1:], free[1:, :-1], free[1:, 1:]
    crossed = (a == d) & (b == c) & (a != b)
    mixed = ~((a == b) & (a == c) & (a == d))
    return {
        "thin_free_share": float(thin.sum() / max(free.sum(), 1)),
        "rays_per_100m2": 100.0 * float(rays.sum()) / area,
        "open_run_m": LOOK_CELL * float(open_runs.mean()) if len(open_runs) else 0.0,
        "checkerboard_share": float(crossed.sum() / max(mixed.sum(), 1)),
    }


def _dots(occupied: BoolArray, unknown: BoolArray) -> int:
    """Blobs of at most three occupied cells with more unknown than free neighbours: ends of stray beams."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        occupied.astype(np.uint8), connectivity=8
    )
    near = cv2.filter2D(
        unknown.astype(np.float32), -1, _SQUARE / 8.0, borderType=cv2.BORDER_REPLICATE
    )
    count = np.bincount(labels.ravel(), minlength=len(stats))
    share = np.bincount(labels.ravel(), near.ravel(), len(stats)) / np.maximum(count, 1)
    return int(((stats[1:, cv2.CC_STAT_AREA] <= _SPECK_CELLS) & (share[1:] > 0.5)).sum())


def _straightness(occupied: BoolArray) -> dict[str, float]:
    """Coherence of the structure tensor at wall cells (Bigün and Granlund 1987), and how the walls are directed."""
    if not occupied.any():
        return {"wall_coherence": 0.0, "bent_share": 0.0, "axis_alignment": 0.0}
    image = cv2.GaussianBlur(occupied.astype(np.float32), (0, 0), 1.0)
    gx, gy = (
        cv2.Sobel(image, cv2.CV_32F, x, 1 - x, borderType=cv2.BORDER_REPLICATE) for x in (1, 0)
    )
    xx, yy, xy = (
        cv2.GaussianBlur(part, (0, 0), _NEIGHBOURHOOD) for part in (gx * gx, gy * gy, gx * gy)
    )
    coherence = (np.hypot(xx - yy, 2.0 * xy) / np.maximum(xx + yy, 1e-9))[occupied]
    # Directions count modulo 90 degrees, as walls of one building stand square to each other.
    turns = np.exp(4j * np.arctan2(gy, gx).astype(np.float64))
    weight = np.hypot(gx, gy).astype(np.float64)
    return {
        "wall_coherence": float(coherence.mean()),
        "bent_share": float((coherence < _STRAIGHT).mean()),
        "axis_alignment": float(abs((weight * turns).sum()) / max(weight.sum(), 1e-9)),
    }
