"""Densify, invert and apply a displacement field.

Convention (all of this module): a field has shape (2, H, W) in metres, component 0 = x (right), 1 = y (up),
true minus measured. A *forward* field f lies on true cells: what stands at p is measured at p - f(p). An
*inverse* field d lies on output (measured) cells and the warp samples ``out(q) = in(q + d(q))``; the two are
tied by ``d(q) = f(q + d(q))``. In cells, ``drow = -d_y / r`` (rows grow downwards) and ``dcol = d_x / r``; so
a constant d of +3 cells in x moves a wall 3 cells to the left.
"""

import cv2
import numpy as np

from slamgym.core.types import BoolArray, ByteArray, Float32Array


def densify(field: Float32Array, known: BoolArray, sigma_px: float) -> Float32Array:
    """Fill a field from its known cells: the nearest known value, then a Gaussian.

    Args:
        field: (2, H, W) values, read where ``known``.
        known: (H, W).
        sigma_px: Width of the Gaussian [cells]; 0 leaves it out.

    Returns:
        (2, H, W) float32; 0 everywhere if nothing is known.
    """
    if not known.any():
        return np.zeros_like(field)
    filled = field
    if not known.all():
        _, labels = cv2.distanceTransformWithLabels(
            (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        # Labels number the known cells; look up which cell each label names.
        of_label = np.zeros((len(field), int(labels.max()) + 1), dtype=np.float32)
        of_label[:, labels[known]] = field[:, known]
        filled = of_label[:, labels]
    if sigma_px <= 0.0:
        return filled.astype(np.float32)
    return np.stack([cv2.GaussianBlur(c, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE) for c in filled])


def invert(forward: Float32Array, resolution: float, iterations: int = 6) -> Float32Array:
    """Carry a dense field from true to output cells by the fixed point d(q) = f(q + d(q)).

    Args:
        forward: (2, H, W) [m] on true cells.
        resolution: [m/cell].
        iterations: Each one shrinks the error by the field's slope (of the order of the heading error).

    Returns:
        (2, H, W) float32 [m] on output cells.
    """
    d = forward
    for _ in range(iterations):
        cols, rows = _sample_positions(d, resolution)
        d = np.stack(
            [cv2.remap(c, cols, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for c in forward]
        )
    return d


def warp(cells: ByteArray, inverse: Float32Array, resolution: float, outside: int) -> ByteArray:
    """Pull a picture through an inverse field: ``out(q) = in(q + d(q))``, nearest cell.

    Args:
        cells: (H, W) uint8.
        inverse: (2, H, W) [m] on output cells.
        resolution: [m/cell].
        outside: Value of what is pulled from beyond the border.
    """
    cols, rows = _sample_positions(inverse, resolution)
    warped: ByteArray = cv2.remap(
        cells, cols, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=outside
    )
    return warped


def _sample_positions(field: Float32Array, resolution: float) -> tuple[Float32Array, Float32Array]:
    """Continuous (col, row) of q + d(q) for every cell q."""
    height, width = field.shape[1:]
    cols = np.arange(width, dtype=np.float32)[None, :] + field[0] / np.float32(resolution)
    rows = np.arange(height, dtype=np.float32)[:, None] - field[1] / np.float32(resolution)
    return cols.astype(np.float32), rows.astype(np.float32)
