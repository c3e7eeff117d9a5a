"""The inner loop of the alignment: how well does a moved image agree with another?"""

import math
from typing import Any

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array


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
    centre_x, centre_y = 0.5 * (cols - 1) + pivot_x * size, 0.5 * (rows - 1) + pivot_y * size
    # Each target pixel looks up where it came from: the inverse of Similarity.matrix.
    cos, sin = math.cos(angle) * math.exp(-log_scale), math.sin(angle) * math.exp(-log_scale)
    flat, width, one = image.ravel(), np.uint32(cols + 2), np.uint32(1)
    total = 0.0
    for row in range(rows):
        dx, dy = -centre_x - shift_x * size, row - centre_y - shift_y * size
        # Where column 0 comes from, in pixels of the image with its border.
        x0 = cos * dx - sin * dy + centre_x + 1.0
        y0 = sin * dx + cos * dy + centre_y + 1.0
        first_x, last_x = _columns_inside(x0, cos, cols + 1.0, cols)
        first_y, last_y = _columns_inside(y0, sin, rows + 1.0, cols)
        first, last = max(first_x, first_y), min(last_x, last_y)
        error: Any = np.float32(0.0)
        for col in range(min(first, cols)):
            error += target[row, col] * target[row, col]
        for col in range(first, last + 1):
            x, y = np.float32(x0 + cos * col), np.float32(y0 + sin * col)
            # Unsigned, so that no index is checked for counting from the end.
            left, top = np.uint32(x), np.uint32(y)
            wx, wy = x - np.float32(left), y - np.float32(top)
            at = top * width + left
            a, b, c, d = flat[at], flat[at + one], flat[at + width], flat[at + width + one]
            upper, lower = a + wx * (b - a), c + wx * (d - c)
            difference = upper + wy * (lower - upper) - target[row, col]
            error += difference * difference
        for col in range(max(last + 1, min(first, cols)), cols):
            error += target[row, col] * target[row, col]
        total += error
    return total / (rows * cols)


@kernel
def _columns_inside(start: float, step: float, end: float, cols: int) -> tuple[int, int]:
    """The first and last column whose place ``start + step * column`` lies in (0, end)."""
    # A little inside, so that rounding to single precision never leads beyond the border.
    low, high = 1e-3, end - 1e-3
    if abs(step) < 1e-9:
        return (0, cols - 1) if low <= start <= high else (0, -1)
    a, b = (low - start) / step, (high - start) / step
    first, last = math.ceil(min(a, b)), math.floor(max(a, b))
    # Clipped before they are made whole numbers: a slow step leads far.
    return int(min(max(first, 0.0), cols)), int(max(min(last, cols - 1.0), -1.0))
