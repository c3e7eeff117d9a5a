"""The direction in which most walls of a map run, and turning maps by it.

It is found by long straight walls, not by the outline of what stands about.

The border between free and occupied cells is split into straight pieces; their lengths are counted by direction,
modulo 90 degrees, since walls of a building are mostly at right angles. What counts is long and straight: clutter is
short, and rays that leave through a window border on the unknown, not on a wall.
"""

import itertools
import math
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.geometry import runs_of
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
)

TOLERANCE_PX = 1.5
"""A straight piece strays by at most this from the border's cells."""
SHORTEST_PX = 10.0
"""Shorter pieces say nothing about the walls: the steps of a raster, furniture."""
REACH_PX = 3
"""A wall's cells lie within this of the border of the free space; some programs leave a rim of unknown between."""
SPREAD_DEG = 1.5
"""Standard deviation of a piece's direction."""
PEAK_DEG = 4.0
"""Pieces within this of a peak decide on its place."""
APART_DEG = 10.0
"""A second peak lies at least so far from the first."""
SECOND_PEAK = 0.7
"""A second peak of at least this share of the first makes the direction doubtful."""
_STEP_DEG = 0.5
"""Between two directions whose support is compared."""
MIN_TURN_DEG = 0.3
"""About the error of the angle itself."""
MAX_DRIFT_DEG = 8.0
"""A simulated map is turned by drift, which is small; a larger angle is a building with oblique walls."""


class WallDirection(NamedTuple):
    """The direction of most walls."""

    angle_deg: float
    """In [-45, 45), counter-clockwise from the x axis."""
    support: float
    """Length of the straight pieces along it and across it, in the unit of the pieces."""
    rival_deg: float
    """The second best direction."""
    rival_share: float
    """Its support, as a share of the best one's."""

    @property
    def is_doubtful(self) -> bool:
        """True if there is no straight wall, or a second direction that is supported nearly as well."""
        return self.support <= 0.0 or self.rival_share >= SECOND_PEAK


NO_DIRECTION = WallDirection(0.0, 0.0, 0.0, 0.0)


def find_wall_direction(cells: ByteArray) -> WallDirection:
    """The direction of most walls of a map, against the image's axes, counter-clockwise as seen on the screen.

    Args:
        cells: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free.
    """
    pieces = wall_pieces(cells == FREE, cells == OCCUPIED)
    return main_direction(pieces, SHORTEST_PX)


def wall_pieces(free: BoolArray, occupied: BoolArray) -> FloatArray:
    """Straight pieces of the outlines of walls and of the free space next to them.

    Args:
        free: (H, W).
        occupied: (H, W).

    Returns:
        (N, 2): differences of their ends [px], x to the right and y upwards.
    """
    side = 2 * REACH_PX + 1
    around = np.ones((side, side), np.uint8)
    walls = occupied.astype(np.uint8)
    near = cv2.dilate(walls, around) > 0
    found = [np.empty((0, 2))]
    for mask in (free, occupied):  # walls that no free cell touches have separate outlines
        # Looking up which outline a hole is in, as RETR_CCOMP does, takes minutes where holes touch at their corners.
        image = mask.astype(np.uint8)
        outlines, _ = cv2.findContours(image, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            points = outline[:, 0, :]
            if len(points) < SHORTEST_PX:
                continue
            cols, rows = points.T
            is_near = near[rows, cols]
            runs = _runs(points, is_near)
            found += [_fitted(run) for run in runs]
    return np.vstack(found)


def main_direction(pieces: FloatArray, shortest: float) -> WallDirection:
    """The direction, modulo 90 degrees, along which the most length of straight pieces runs.

    Args:
        pieces: (N, 2), differences of their ends.
        shortest: Shortest length of the pieces that count; what is longer counts with its length beyond this.
    """
    x, y = pieces.T
    lengths = np.hypot(x, y)
    is_long = lengths > shortest
    long_pieces = pieces[is_long]
    lengths = lengths[is_long]
    if len(long_pieces) == 0:
        return NO_DIRECTION
    weights = lengths - shortest
    x, y = long_pieces.T
    angles = np.degrees(np.arctan2(y, x))
    bins = np.arange(-45.0, 45.0, _STEP_DEG)
    scores = _supports(bins, angles, weights)
    # Where two are as good, the one nearer to the axes.
    order = np.argsort(np.abs(bins), kind="stable")
    ordered_scores = np.round(scores[order], 9)
    first_best = np.argmax(ordered_scores)
    best = bins[order[first_best]]
    from_best = _difference(angles, best)
    near = np.abs(from_best) <= PEAK_DEG
    # A long piece's direction is as exact as it is long.
    exact = weights[near] * lengths[near]
    missing = from_best[near]
    mean_missing = exact @ missing / exact.sum()
    angle = best + float(mean_missing)
    from_angle = _difference(bins, angle)
    elsewhere = np.abs(from_angle) >= APART_DEG
    rival_scores = np.where(elsewhere, scores, -1.0)
    rival = np.argmax(rival_scores)
    support = scores.max()
    return WallDirection(
        angle_deg=float(_difference(angle, 0.0)),
        support=float(support),
        rival_deg=float(bins[rival]),
        rival_share=float(scores[rival] / support),
    )


def _supports(bins: FloatArray, angles: FloatArray, weights: FloatArray) -> FloatArray:
    """How much weight lies near each direction."""
    columns = bins[:, None]
    apart = _difference(columns, angles[None])
    nearness = np.exp(-0.5 * (apart / SPREAD_DEG) ** 2)
    return nearness @ weights


def _difference(angle: FloatArray | float, other: FloatArray | float) -> FloatArray:
    """The difference of directions modulo 90 degrees, in [-45, 45)."""
    difference = np.asarray(angle) - other
    return (difference + 45.0) % 90.0 - 45.0


def _runs(points: np.ndarray, kept: BoolArray) -> list[np.ndarray]:
    """The stretches of a closed outline along which all points are kept."""
    if kept.all():
        closed = np.vstack([points, points[:1]])
        return [closed]
    first = int(np.argmin(kept))
    points = np.roll(points, -first, axis=0)
    kept = np.roll(kept, -first)
    runs = []
    for start, end in runs_of(kept):
        if end - start >= SHORTEST_PX:
            runs.append(points[start:end])
    return runs


def _fitted(run: np.ndarray) -> FloatArray:
    """Straight pieces of a stretch of an outline, each along the line that fits its cells best."""
    line = run.astype(np.int32)
    corners = cv2.approxPolyDP(line, TOLERANCE_PX, False)[:, 0, :]
    places: dict[tuple[int, int], int] = {}
    for index, (x, y) in enumerate(run.tolist()):
        places.setdefault((x, y), index)
    found = []
    for start, end in itertools.pairwise(corners.tolist()):
        x0, y0 = start
        x1, y1 = end
        right = x1 - x0
        up = y0 - y1
        length = math.hypot(right, up)
        if length < SHORTEST_PX:
            continue
        first = places[x0, y0]
        last = places[x1, y1]
        if last - first < 2:
            found.append((right, up))
            continue
        cells = run[first : last + 1]
        angle = _angle(cells.astype(np.float64))
        fitted_right = length * math.cos(angle)
        fitted_up = -length * math.sin(angle)
        found.append((fitted_right, fitted_up))
    pieces = np.array(found, dtype=np.float64)
    return pieces.reshape(-1, 2)


def _angle(points: FloatArray) -> float:
    """Direction of the line that fits points (N, 2) best [rad]."""
    from_middle = points - points.mean(axis=0)
    x, y = from_middle.T
    mixed = float(x @ y)
    difference = float(x @ x - y @ y)
    return 0.5 * math.atan2(2.0 * mixed, difference)


def angle_to_undo_deg(cells: ByteArray) -> float:
    """Angle by which most walls are turned against the image's axes; 0 if it is too small to be worth a resampling.

    Args:
        cells: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free.

    Returns:
        In [-45, 45) degrees, positive counter-clockwise as seen on the screen.
    """
    angle = find_wall_direction(cells).angle_deg
    return angle if abs(angle) >= MIN_TURN_DEG else 0.0


def turned(cells: ByteArray, angle_deg: float, fill: int = UNKNOWN) -> ByteArray:
    """Turn a map counter-clockwise about its centre, same shape, nearest cell.

    Args:
        cells: (H, W) uint8.
        angle_deg: [deg]
        fill: Value of what comes from beyond the border.
    """
    if angle_deg == 0.0:
        return cells
    turned = _turn(cells, angle_deg, cv2.INTER_NEAREST, fill)
    return np.asarray(turned)


def turned_probability(image: Float32Array, angle_deg: float) -> Float32Array:
    """The same for values in [0, 1], interpolated, with 0 from beyond the border."""
    if angle_deg == 0.0:
        return image
    # Cubic: between two pixels, linear interpolation would lift a wall one pixel thick to a half.
    turned = _turn(image, angle_deg, cv2.INTER_CUBIC, 0.0)
    clipped = np.clip(turned, 0.0, 1.0)
    return clipped.astype(np.float32)


def flipped(image: np.ndarray, symmetry: int) -> np.ndarray:
    """One of the eight symmetries of the square: ``symmetry % 4`` quarter turns, then a mirror for 4 to 7."""
    turned = np.rot90(image, symmetry % 4)
    return np.fliplr(turned) if symmetry >= 4 else turned


def padded_for_turning(cells: ByteArray, angle_deg: float, fill: int = UNKNOWN) -> ByteArray:
    """Add an even border so that turning by this angle cuts nothing off."""
    rows, cols = cells.shape
    angle = math.radians(angle_deg)
    cos = abs(math.cos(angle))
    sin = abs(math.sin(angle))
    higher = rows * cos + cols * sin - rows
    wider = cols * cos + rows * sin - cols
    above = max(0, math.ceil(0.5 * higher))
    beside = max(0, math.ceil(0.5 * wider))
    above_and_below = (above, above)
    left_and_right = (beside, beside)
    border = (above_and_below, left_and_right)
    return np.pad(cells, border, constant_values=fill)


def _turn(image: np.ndarray, angle_deg: float, method: int, fill: float) -> np.ndarray:
    rows, cols = image.shape
    centre_x = 0.5 * (cols - 1)
    centre_y = 0.5 * (rows - 1)
    centre = (centre_x, centre_y)
    matrix = cv2.getRotationMatrix2D(centre, angle_deg, 1.0)
    return transformed(image, matrix, fill, method)


def transformed(
    image: np.ndarray, matrix: np.ndarray, fill: float = UNKNOWN, method: int = cv2.INTER_NEAREST
) -> np.ndarray:
    """An image after a motion, same shape.

    Args:
        image: (H, W).
        matrix: (2, 3), of (col, row).
        fill: Value of what comes from beyond the border.
        method: OpenCV's interpolation.
    """
    rows, cols = image.shape[:2]
    size = (cols, rows)
    return cv2.warpAffine(
        image, matrix, size, flags=method, borderMode=cv2.BORDER_CONSTANT, borderValue=fill
    )
