"""Mean squared error of two map images after the best similarity transform (the aligned MSE of Table I).

The error of a SLAM map against the CAD drawing depends on how the two are laid over each other. Feature
matching finds a poor alignment on such images; here the transform is searched directly, coarse to fine:
rotations are scanned on small blurred images, the most promising are refined by Powell's method (1964), and
the best of those once more on sharper images. `benchmarks/gan/gan_alignment.py` measures how often that finds the
best transform there is.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray
from slamgym.metrics.maps import squared_error


@kernel
def moved_error(
    image: Float32Array,
    target: Float32Array,
    pivot_x: float,
    pivot_y: float,
    shift_x: float,
    shift_y: float,
    angle: float,
    log_scale: float,
) -> float:
    """Mean squared difference of ``target`` and ``image`` after a similarity, without drawing the moved image.

    Args:
        image: Shape (rows + 2, cols + 2): a border of 1 px, which must be 0, around the image proper.
            Bilinear in between, 0 outside.
        target: Shape (rows, cols).
        pivot_x: The point that the image is turned and scaled about, from its middle, as the shift: share of
            the larger side.
        pivot_y: Downwards.
        shift_x: Where the pivot moves.
        shift_y: Downwards.
        angle: Counter-clockwise on the screen [rad].
        log_scale: Natural logarithm of the scale.
    """
    rows, cols = target.shape
    size = max(rows, cols)
    centre_x = 0.5 * (cols - 1) + pivot_x * size
    centre_y = 0.5 * (rows - 1) + pivot_y * size
    # Each target pixel looks up where it came from: the inverse of Similarity.matrix.
    shrink = math.exp(-log_scale)
    cos = math.cos(angle) * shrink
    sin = math.sin(angle) * shrink
    flat = image.ravel()
    width = np.uint32(cols + 2)
    one = np.uint32(1)
    total = 0.0
    for row in range(rows):
        dx = -centre_x - shift_x * size
        dy = row - centre_y - shift_y * size
        # Where column 0 comes from, in pixels of the image with its border.
        x0 = cos * dx - sin * dy + centre_x + 1.0
        y0 = sin * dx + cos * dy + centre_y + 1.0
        first_x, last_x = _columns_inside(x0, cos, cols + 1.0, cols)
        first_y, last_y = _columns_inside(y0, sin, rows + 1.0, cols)
        first = max(first_x, first_y)
        last = min(last_x, last_y)
        error: Any = np.float32(0.0)
        for col in range(min(first, cols)):
            error += target[row, col] * target[row, col]
        for col in range(first, last + 1):
            x = np.float32(x0 + cos * col)
            y = np.float32(y0 + sin * col)
            # Unsigned, so that no index is checked for counting from the end.
            left = np.uint32(x)
            top = np.uint32(y)
            right_share = x - np.float32(left)
            low_share = y - np.float32(top)
            at = top * width + left
            below = at + width
            upper_left = flat[at]
            lower_left = flat[below]
            upper = upper_left + right_share * (flat[at + one] - upper_left)
            lower = lower_left + right_share * (flat[below + one] - lower_left)
            difference = upper + low_share * (lower - upper) - target[row, col]
            error += difference * difference
        for col in range(max(last + 1, min(first, cols)), cols):
            error += target[row, col] * target[row, col]
        total += error
    return total / (rows * cols)


@kernel
def _columns_inside(start: float, step: float, end: float, cols: int) -> tuple[int, int]:
    """The first and last column whose place ``start + step * column`` lies in (0, end)."""
    # A little inside, so that rounding to single precision never leads beyond the border.
    low = 1e-3
    high = end - 1e-3
    if abs(step) < 1e-9:
        return (0, cols - 1) if low <= start <= high else (0, -1)
    at_low = (low - start) / step
    at_high = (high - start) / step
    first = math.ceil(min(at_low, at_high))
    last = math.floor(max(at_low, at_high))
    # Clipped before they are made whole numbers: a slow step leads far.
    first_inside = min(max(first, 0.0), cols)
    last_inside = max(min(last, cols - 1.0), -1.0)
    return int(first_inside), int(last_inside)


START_ANGLES = 24
"""Rotations that are tried on the coarse images."""
COARSE_STARTS = 3
"""Rotations that are refined on the coarse images, in addition to the identity."""
FINE_STARTS = 2
"""Largest number of those that are refined on the fine images."""
RIVAL = 1.5
"""A second start is refined on the fine images only if its coarse error is below this times the best one's."""
FIRST_STEPS = (0.02, 0.02, 0.05, 0.03)
"""First steps of Powell's line searches: shift, shift, angle [rad], log_scale."""
MAX_START_LOG_SCALE = 0.3
"""Largest logarithm of the scale at which the search starts, either way."""
MAX_LOG_SCALE = 0.7
"""Largest logarithm of the scale, either way."""
MAX_SHIFT = 1.0
"""Largest shift [share of the larger side]."""


class Similarity(NamedTuple):
    """A turn, scale and shift of an image about its centre; shift in shares of the larger side."""

    shift_x: float
    shift_y: float
    angle: float  # [rad], counter-clockwise on the screen
    log_scale: float

    def matrix(self, rows: int, cols: int) -> FloatArray:
        """The 2 x 3 matrix for cv2.warpAffine on an image of this shape."""
        scale = math.exp(self.log_scale)
        cos = scale * math.cos(self.angle)
        sin = scale * math.sin(self.angle)
        centre_x = 0.5 * (cols - 1)
        centre_y = 0.5 * (rows - 1)
        size = max(rows, cols)
        moved_x = centre_x + self.shift_x * size
        moved_y = centre_y + self.shift_y * size
        x = moved_x - cos * centre_x - sin * centre_y
        y = moved_y + sin * centre_x - cos * centre_y
        x_row = [cos, sin, x]
        y_row = [-sin, cos, y]
        return np.array([x_row, y_row])


IDENTITY = Similarity(0.0, 0.0, 0.0, 0.0)


class Reduction(NamedTuple):
    """How images are reduced for a stage of the search."""

    side_px: int
    """Larger side [px]."""
    blur_px: float
    """Standard deviation of the blur [px of the reduced image]."""


COARSE = Reduction(64, 2.0)
"""Of the first stage, in which rotations are scanned."""
FINE = Reduction(128, 1.0)
"""Of the second stage."""
RIGID_FINE = Reduction(256, 0.7)
"""Of a third stage for rigid motions alone: walls must match within centimetres."""


@dataclass(frozen=True)
class AlignedError:
    """Mean squared error before and after alignment."""

    mse: float
    """After the best similarity; never more than ``unaligned``."""
    unaligned: float
    similarity: Similarity
    """Brings the image onto the target."""


def aligned_error(image: FloatArray, target: FloatArray, scaling: bool = True) -> AlignedError:
    """Mean squared error of ``image`` against ``target`` after the best similarity transform of ``image``.

    The better of aligned and unaligned counts, so that the search can only help.

    Args:
        image: Values in [0, 1], shape (rows, cols), e.g. :func:`slamgym.metrics.free_space` of a map.
        target: Same shape.
        scaling: Whether the image may be scaled, as in the paper's protocol; without it the motion is rigid, and a
            drawing whose rooms are too small can't be enlarged until they fit.

    Raises:
        ValueError: If the shapes differ.
    """
    unaligned = squared_error(image, target)
    best = IDENTITY
    best_error = unaligned
    if np.any(image) and np.any(target) and unaligned > 0.0:
        for found in search_similarities(image, target, scaling=scaling):
            error = squared_error(apply_similarity(image, found), target)
            if error < best_error:
                best = found
                best_error = error
    return AlignedError(best_error, unaligned, best)


def search_similarities(
    image: FloatArray,
    target: FloatArray,
    start_angles: int = START_ANGLES,
    coarse_starts: int = COARSE_STARTS,
    fine_starts: int = FINE_STARTS,
    scaling: bool = True,
) -> list[Similarity]:
    """Similarities that may bring ``image`` onto ``target``, found from several starts.

    Args:
        image: Values in [0, 1], shape (rows, cols), not all 0.
        target: Same shape, not all 0.
        start_angles: Rotations that are tried.
        coarse_starts: How many of them are refined on coarse images; the identity always is.
        fine_starts: How many of the results are refined on fine images.
        scaling: Whether the image may be scaled; rigid motions are refined once more, on finer images.

    Returns:
        ``fine_starts`` similarities at most, the one with the least error on blurred images first.
    """
    coarse = _reduce(image, COARSE)
    coarse_target = _reduce(target, COARSE)
    # Turned and scaled about the middle of what is drawn, the parameters hardly depend on each other.
    pivot = _centroid(coarse)
    shift = _centroid(coarse_target) - pivot
    padded = np.pad(coarse, 1)
    search = _Search(padded, coarse_target, pivot, scaling)
    log_scale = 0.0
    if scaling:
        log_scale = _start_log_scale(coarse, coarse_target)
    starts = []
    for turn in range(start_angles):
        angle = 2.0 * math.pi * turn / start_angles
        start = np.array([*shift, angle, log_scale])
        starts.append(start)
    starts.sort(key=search.error)
    # The identity is always refined: maps are mostly nearly aligned already.
    identity = np.zeros(4)
    chosen = [identity, *starts[:coarse_starts]]
    refined = [search.refine(start, 1e-2) for start in chosen]
    refined.sort(key=search.error)
    worst = RIVAL * search.error(refined[0])
    distinct = _distinct(refined)
    promising = [values for values in distinct if search.error(values) <= worst]
    found = promising[:fine_starts]
    levels = [FINE] if scaling else [FINE, RIGID_FINE]
    for level in levels:
        finer = _reduce(image, level)
        finer_target = _reduce(target, level)
        padded = np.pad(finer, 1)
        search = _Search(padded, finer_target, pivot, scaling)
        found = [search.refine(start, 1e-3) for start in found]
    found.sort(key=search.error)
    return [search.similarity(values) for values in found]


def _start_log_scale(image: Float32Array, target: Float32Array) -> float:
    """Logarithm of the scale at which as much is drawn in both, within bounds."""
    drawn = float(image.sum())
    wanted = float(target.sum())
    log_scale = 0.5 * math.log(wanted / drawn)
    at_least = max(log_scale, -MAX_START_LOG_SCALE)
    return min(at_least, MAX_START_LOG_SCALE)


def apply_similarity(image: FloatArray, similarity: Similarity) -> FloatArray:
    """Warp an image, filling with 0 from outside; same shape."""
    rows, cols = image.shape
    warped = cv2.warpAffine(
        np.asarray(image, dtype=np.float32),
        similarity.matrix(rows, cols),
        (cols, rows),
        flags=cv2.INTER_LINEAR,
    )
    return np.clip(warped, 0.0, 1.0).astype(np.float64)


def _reduce(image: FloatArray, level: Reduction) -> Float32Array:
    """Shrink to the level's size, never enlarge, and blur."""
    rows, cols = image.shape
    longer = max(rows, cols)
    factor = min(1.0, level.side_px / longer)
    width = round(cols * factor)
    height = round(rows * factor)
    size = (max(1, width), max(1, height))
    exact = np.asarray(image, dtype=np.float32)
    small = cv2.resize(exact, size, interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(small, (0, 0), level.blur_px, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, dtype=np.float32)


@dataclass(frozen=True)
class _Search:
    """Two reduced images, and the error over the four parameters: shift of the pivot, angle, log_scale."""

    image: Float32Array  # (rows + 2, cols + 2), with a border of 0
    target: Float32Array  # (rows, cols)
    pivot: FloatArray  # (2,) from the image's middle, shares of the larger side
    scaling: bool = True

    def error(self, values: FloatArray) -> float:
        """Mean squared error after the motion; 1 beyond the bounds."""
        shift_x, shift_y, angle, log_scale = values
        farthest = max(abs(shift_x), abs(shift_y))
        if farthest > MAX_SHIFT:
            return 1.0
        if abs(log_scale) > MAX_LOG_SCALE:
            return 1.0
        x, y = self.pivot
        error = moved_error(self.image, self.target, x, y, shift_x, shift_y, angle, log_scale)
        return float(error)

    def refine(self, start: FloatArray, tolerance: float) -> FloatArray:
        """The parameters that Powell's method finds from a start."""
        free = 4 if self.scaling else 3

        fixed = start[free:]

        def error(values: FloatArray) -> float:
            parameters = np.concatenate([values, fixed])
            return self.error(parameters)

        options: Any = {
            "direc": np.diag(FIRST_STEPS[:free]),
            "xtol": tolerance,
            "ftol": tolerance,
            "maxfev": 400,
        }
        result = minimize(error, start[:free], method="Powell", options=options)
        return np.concatenate([result.x, fixed])

    def similarity(self, values: FloatArray) -> Similarity:
        """The same motion about the image's middle."""
        shift_x, shift_y, angle, log_scale = (float(value) for value in values)
        turn = Similarity(0.0, 0.0, angle, log_scale).matrix(1, 1)[:, :2]
        moved_x, moved_y = (self.pivot - turn @ self.pivot).tolist()
        return Similarity(
            shift_x=moved_x + shift_x,
            shift_y=moved_y + shift_y,
            angle=float(wrap_angle(angle)),
            log_scale=log_scale,
        )


def _distinct(found: list[FloatArray]) -> list[FloatArray]:
    """Drop what lies near a better one: several starts lead to the same minimum."""
    kept: list[FloatArray] = []
    for values in found:
        if not any(_is_near(values, other) for other in kept):
            kept.append(values)
    return kept


def _is_near(values: FloatArray, other: FloatArray) -> bool:
    """True if two motions hardly differ."""
    shift_x, shift_y, angle, log_scale = (values - other).tolist()
    shift = math.hypot(shift_x, shift_y)
    turn = float(wrap_angle(angle))
    same_angle = abs(turn) < 0.05
    same_scale = abs(log_scale) < 0.05
    return same_angle and same_scale and shift < 0.02


def _centroid(image: Float32Array) -> FloatArray:
    """(x, y) of what is drawn, from the image's middle, in shares of the larger side."""
    rows, cols = image.shape
    row, col = np.indices(image.shape)
    total = float(image.sum())
    weighted_x = image * col
    weighted_y = image * row
    x = float(weighted_x.sum()) / total
    y = float(weighted_y.sum()) / total
    right = x - 0.5 * (cols - 1)
    down = y - 0.5 * (rows - 1)
    from_middle = np.array([right, down])
    return from_middle / max(rows, cols)
