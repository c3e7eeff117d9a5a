"""Make, densify, invert and apply a displacement field.

Convention (all of this module): a field has shape (2, H, W) in metres, component 0 = x (right), 1 = y (up),
true minus measured. A *forward* field f lies on true cells: what stands at p is measured at p - f(p). An
*inverse* field d lies on output (measured) cells and the warp samples ``out(q) = in(q + d(q))``; the two are
tied by ``d(q) = f(q + d(q))``. In cells, ``drow = -d_y / r`` (rows grow downwards) and ``dcol = d_x / r``; so
a constant d of +3 cells in x moves a wall 3 cells to the left.
"""

import cv2
import numpy as np

from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray
from slamgym.parametric.visibility import Visibility

_INVERSIONS = 6
"""Fixed-point iterations: each one shrinks the error by the field's slope (of the order of the heading error)."""


def displacements(
    true_poses: FloatArray, believed_poses: FloatArray, visibility: Visibility
) -> Float32Array:
    """The proprioceptive field d_O over every seen cell, placed by the first scan that saw it, like a landmark.

    A scan displaces what it draws by a rigid motion: p' = that + R(thetahat - theta)(p - t).

    Args:
        true_poses: (T, 3).
        believed_poses: (T, 3).
        visibility: Which scan saw what.

    Returns:
        (2, H, W) float32 [m], a forward field; 0 in cells that no scan saw.
    """
    frame = visibility.frame
    seen = visibility.seen
    # Relative to the middle of the map, which keeps the numbers small.
    min_x, min_y, max_x, max_y = frame.bounds
    middle = np.array([0.5 * (min_x + max_x), 0.5 * (min_y + max_y)])
    turn = believed_poses[:, 2] - true_poses[:, 2]
    cos = np.cos(turn)
    sin = np.sin(turn)
    x, y = (middle - true_poses[:, :2]).T
    shift_x = believed_poses[:, 0] + cos * x - sin * y - middle[0]
    shift_y = believed_poses[:, 1] + sin * x + cos * y - middle[1]
    motion = np.column_stack([cos - 1.0, sin, shift_x, shift_y])
    less_cos, sin, shift_x, shift_y = motion[visibility.cells.first[seen]].T
    x, y = (frame.to_points(*np.nonzero(seen)) - middle).T
    field = np.zeros((2, *frame.shape), dtype=np.float32)
    field[0, seen] = -(less_cos * x - sin * y + shift_x)
    field[1, seen] = -(sin * x + less_cos * y + shift_y)
    return field


def densify(field: Float32Array, known: BoolArray, sigma_px: float) -> Float32Array:
    """Fill a field from its known cells: the nearest known value, then a Gaussian.

    Args:
        field: (2, H, W) values, read where ``known``.
        known: (H, W).
        sigma_px: Width of the Gaussian [cells]; 0 omits it.

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
    smooth = [
        cv2.GaussianBlur(component, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
        for component in filled
    ]
    return np.stack(smooth)


def enlarged(field: Float32Array, shape: tuple[int, int]) -> Float32Array:
    """Interpolate a field (2, H, W) [m] for a grid of the same extent and another shape."""
    height, width = shape
    components = [
        cv2.resize(component, (width, height), interpolation=cv2.INTER_LINEAR)
        for component in field
    ]
    return np.stack(components)


def invert(forward: Float32Array, resolution: float) -> Float32Array:
    """Carry a dense field from true to output cells by the fixed point d(q) = f(q + d(q)).

    Args:
        forward: (2, H, W) [m] on true cells.
        resolution: [m/cell].

    Returns:
        (2, H, W) float32 [m] on output cells.
    """
    inverse = forward
    for _ in range(_INVERSIONS):
        cols, rows = _sample_positions(inverse, resolution)
        sampled = [
            cv2.remap(component, cols, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for component in forward
        ]
        inverse = np.stack(sampled)
    return inverse


def warp(cells: ByteArray, inverse: Float32Array, resolution: float, outside: int) -> ByteArray:
    """Pull a picture through an inverse field: ``out(q) = in(q + d(q))``, nearest cell.

    Args:
        cells: (H, W) uint8.
        inverse: (2, H, W) [m] on output cells.
        resolution: [m/cell].
        outside: Value of what is pulled from beyond the border.
    """
    cols, rows = _sample_positions(inverse, resolution)
    return cv2.remap(
        cells, cols, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=outside
    )


def _sample_positions(field: Float32Array, resolution: float) -> tuple[Float32Array, Float32Array]:
    """Continuous (col, row) of q + d(q) for every cell q."""
    x, y = field
    height, width = x.shape
    cell = np.float32(resolution)
    own_cols = np.arange(width, dtype=np.float32)[None, :]
    own_rows = np.arange(height, dtype=np.float32)[:, None]
    cols = own_cols + x / cell
    rows = own_rows - y / cell
    return cols.astype(np.float32), rows.astype(np.float32)
