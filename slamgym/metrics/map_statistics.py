"""Numbers that describe how a SLAM map looks, for comparing sets of maps.

All take maps with the values of ROS map_server (0, 205, 254), row 0 at the top.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray, IntArray
from slamgym.metrics.map_error import wall_faces
from slamgym.metrics.maps import distance_to

_PATTERN_VALUES = (OCCUPIED, UNKNOWN, FREE)
_NEAR_WALL = 0.6  # [m] occupied cells farther from every CAD wall are stray, not displaced
_LAGS = (0.25, 1.0, 2.5)  # [m] of the spatial correlation of wall displacements


def map_statistics(cells: ByteArray, resolution: float) -> dict[str, float]:
    """Statistics of one map alone.

    Args:
        cells: (H, W).
        resolution: [m/px].

    Returns:
        Name to value: shares of the known bounding box, wall thickness, holes, blobs, open borders, tilt,
        and how often each 2 x 2 pattern of cells occurs.
    """
    cells = _cropped(cells)
    occupied, free, unknown = cells == OCCUPIED, cells == FREE, cells == UNKNOWN
    statistics = {
        "share_unknown": float(unknown.mean()),
        "share_occupied": float(occupied.mean()),
        "share_free": float(free.mean()),
        "occupied_per_free": float(occupied.sum() / max(free.sum(), 1)),
        "wall_thickness_px": wall_thickness(occupied),
        "tilt_deg": wall_tilt(occupied),
    }
    area = max(float(free.sum()) * resolution**2, 1e-9) / 100.0
    sizes = _blob_sizes(occupied)
    statistics["blobs_per_100m2"] = len(sizes) / area
    statistics["specks_per_100m2"] = float((sizes <= 3).sum()) / area
    statistics["holes_per_100m2"] = len(_blob_sizes(~free)) / area
    statistics["unknown_holes_per_100m2"] = len(_blob_sizes(unknown)) / area
    statistics["open_border"] = open_border(free, unknown)
    statistics |= _run_lengths(occupied)
    return statistics | _patterns(cells)


def displacement_statistics(
    cells: ByteArray, cad_occupied: BoolArray, resolution: float, rng: np.random.Generator
) -> dict[str, float]:
    """Statistics of where the walls of a map lie against those of the CAD map.

    Args:
        cells: (H, W) the map.
        cad_occupied: (H, W) cells that are not free in the CAD map, on the same frame.
        resolution: [m/px].
        rng: Picks pairs of wall cells for the spatial correlation.

    Returns:
        Quantiles of the distance [m] from a map's wall cell to the nearest face of a CAD wall, its share of
        stray cells, the share of the CAD faces that the map misses, and the correlation of the signed
        distance (positive outside the free space) at some lags.
    """
    faces = wall_faces(~cad_occupied)
    to_face = distance_to(faces) * resolution
    signed = np.where(cad_occupied, to_face, -to_face)
    rows, cols = np.nonzero(cells == OCCUPIED)
    if len(rows) < 10 or not faces.any():
        return dict.fromkeys(_displacement_names(), 0.0)
    away = to_face[rows, cols]
    near = away < _NEAR_WALL
    to_map = distance_to(cells == OCCUPIED) * resolution
    values = [float(v) for v in np.percentile(away[near], (50, 90, 95))] if near.any() else [0.0] * 3
    values += [float((~near).mean()), float((to_map[faces] > 0.3).mean())]
    values += _correlations(rows[near], cols[near], signed, resolution, rng)
    return dict(zip(_displacement_names(), values, strict=True))


def _displacement_names() -> list[str]:
    names = [f"displacement_p{q}_m" for q in (50, 90, 95)] + ["stray_share", "missed_share"]
    return names + [f"displacement_correlation_{lag:g}m" for lag in _LAGS]


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
    weight = np.hypot(gx, gy)
    return float(np.degrees(np.angle((weight * phase).sum())) / 4.0)


def open_border(free: BoolArray, unknown: BoolArray) -> float:
    """Share of the free space's border that meets unknown space instead of a wall."""
    grown = cv2.dilate(free.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > 0
    border = grown & ~free
    return float((border & unknown).sum() / max(border.sum(), 1))


def _cropped(cells: ByteArray) -> ByteArray:
    """The map without the unknown margin, but one cell of it."""
    known = cells != UNKNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        return cells
    return np.pad(cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1], 1, constant_values=UNKNOWN)


def _blob_sizes(mask: BoolArray) -> FloatArray:
    """Sizes [px] of the 8-connected parts of a mask."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.asarray(stats[1:, cv2.CC_STAT_AREA], dtype=np.float64)


def _run_lengths(occupied: BoolArray) -> dict[str, float]:
    """Share of wall runs of 1, 2, 3 and more cells, along rows and columns together."""
    lengths = []
    for picture in (occupied, occupied.T):
        edges = np.diff(np.pad(picture, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        starts, ends = np.nonzero(edges == 1)[1], np.nonzero(edges == -1)[1]
        lengths.append(ends - starts)
    run = np.concatenate(lengths)
    total = max(len(run), 1)
    names = {"run_1": run == 1, "run_2": run == 2, "run_3": run == 3, "run_4_to_6": (run >= 4) & (run <= 6)}
    return {name: float(hit.sum() / total) for name, hit in names.items()}


def _patterns(cells: ByteArray) -> dict[str, float]:
    """Share of each 2 x 2 pattern among the patterns that are not uniform."""
    level = np.zeros(cells.shape, dtype=np.int64)
    for i, value in enumerate(_PATTERN_VALUES):
        level[cells == value] = i
    code = level[:-1, :-1] + 3 * level[:-1, 1:] + 9 * level[1:, :-1] + 27 * level[1:, 1:]
    counts = np.bincount(code.ravel(), minlength=81).astype(np.float64)
    counts[[0, 40, 80]] = 0.0
    shares = counts / max(counts.sum(), 1.0)
    return {f"pattern_{i:02d}": float(share) for i, share in enumerate(shares) if i not in (0, 40, 80)}


def _correlations(
    rows: IntArray, cols: IntArray, signed: FloatArray, resolution: float, rng: np.random.Generator
) -> list[float]:
    """Correlation of the signed displacement of pairs of wall cells at each lag."""
    values = signed[rows, cols]
    points = resolution * np.column_stack([rows, cols])
    pairs = rng.integers(0, len(rows), (20_000, 2))
    gap = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    correlations = []
    for lag in _LAGS:
        a, b = pairs[np.abs(gap - lag) < 0.3 * lag].T
        spread = values[a].std() * values[b].std() if len(a) > 20 else 0.0
        covariance = ((values[a] - values.mean()) * (values[b] - values.mean())).mean() if len(a) else 0.0
        correlations.append(float(covariance / spread) if spread > 0.0 else 0.0)
    return correlations
