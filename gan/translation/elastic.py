"""The cheapest translator from a CAD map to something like a SLAM map: bend it by a smooth random field."""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array

CORRELATION_LENGTH = 1.0
"""Standard deviation of the smoothing of the field [m]."""
DISPLACEMENT = 0.15
"""Standard deviation of each component of the field [m]: about that of walls in simulated maps."""


def bend_with_field(
    cad: ByteArray, metres_per_px: float, rng: np.random.Generator
) -> tuple[ByteArray, Float32Array]:
    """Deform a CAD map elastically (Simard, Steinkraus, Platt 2003) and draw it with the values of a SLAM map.

    Args:
        cad: CAD map, shape (H, W): 0 walls and outside, 254 inside.
        metres_per_px: Scale [m].
        rng: Draws the field.

    Returns:
        Cells, shape (H, W): 0 on the faces of walls, 205 behind them, 254 free; and the field, shape (2, H, W), x and y
        (up) [m]: out(q) = in(q + d(q)).
    """
    field = _random_field(cad.shape, metres_per_px, rng)
    cells = _pulled(_faces(cad), field, UNKNOWN)
    upwards = np.array([metres_per_px, -metres_per_px], dtype=np.float32)
    return cells, field * upwards[:, None, None]


def _faces(cad: ByteArray) -> ByteArray:
    """The values of a SLAM map that shows every wall's face."""
    free = (cad > 127).astype(np.uint8)
    neighbours = np.ones((3, 3), np.uint8)
    grown = cv2.dilate(free, neighbours)
    is_face = grown > free
    cells = np.full(cad.shape, UNKNOWN, np.uint8)
    cells[free > 0] = FREE
    cells[is_face] = OCCUPIED
    return cells


def drifted(cad: ByteArray, metres_per_px: float, rng: np.random.Generator) -> ByteArray:
    """A CAD map as drift would bend it: what a translator without a noise input is given to draw many maps of one.

    Args:
        cad: CAD map, shape (H, W): 0 walls and outside, 254 inside.
        metres_per_px: Scale [m].
        rng: Draws the field.

    Returns:
        Shape (H, W), the same values.
    """
    field = _random_field(cad.shape, metres_per_px, rng)
    return _pulled(cad, field, OCCUPIED)


def _random_field(
    shape: tuple[int, ...], metres_per_px: float, rng: np.random.Generator
) -> Float32Array:
    """Smoothed noise (2, H, W) [px]: columns, rows."""
    noise = rng.standard_normal((2, *shape)).astype(np.float32)
    sigma = CORRELATION_LENGTH / metres_per_px
    field = np.stack([cv2.GaussianBlur(component, (0, 0), sigma) for component in noise])
    deviation = max(float(field.std()), 1e-9)
    displacement_px = np.float32(DISPLACEMENT / metres_per_px)
    scale = displacement_px / deviation
    return np.asarray(field * scale, dtype=np.float32)


def _pulled(cells: ByteArray, field: Float32Array, fill: int) -> ByteArray:
    rows, cols = np.indices(cells.shape, dtype=np.float32)
    from_cols = cols + field[0]
    from_rows = rows + field[1]
    bent = cv2.remap(cells, from_cols, from_rows, cv2.INTER_NEAREST, borderValue=float(fill))
    return np.asarray(bent, dtype=np.uint8)
