"""Turn a SLAM map so that its walls lie along the axes, and turn what comes of it back; flip maps."""

import math

import cv2
import numpy as np

from slamgym.core.types import UNKNOWN, ByteArray, Float32Array
from slamgym.gan.translation.wall_direction import find_wall_direction

MIN_TURN_DEG = 0.3
"""About the error of the angle itself."""
MAX_DRIFT_DEG = 8.0
"""A simulated map is turned by drift, which is small; a larger angle is a building with oblique walls."""


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
    return cells if angle_deg == 0.0 else np.asarray(_turn(cells, angle_deg, cv2.INTER_NEAREST, fill))


def turned_probability(image: Float32Array, angle_deg: float) -> Float32Array:
    """The same for values in [0, 1], interpolated, with 0 from beyond the border."""
    if angle_deg == 0.0:
        return image
    # Cubic: between two pixels, linear interpolation would lift a wall one pixel thick to a half.
    return np.clip(_turn(image, angle_deg, cv2.INTER_CUBIC, 0.0), 0.0, 1.0).astype(np.float32)


def flipped(image: np.ndarray, symmetry: int) -> np.ndarray:
    """One of the eight symmetries of the square: ``symmetry % 4`` quarter turns, then a mirror for 4 to 7."""
    turned = np.rot90(image, symmetry % 4)
    return np.fliplr(turned) if symmetry >= 4 else turned


def unflipped(image: np.ndarray, symmetry: int) -> np.ndarray:
    """Undo :func:`flipped`."""
    mirrored = np.fliplr(image) if symmetry >= 4 else image
    return np.rot90(mirrored, -(symmetry % 4))


def padded_for_turning(cells: ByteArray, angle_deg: float, fill: int = UNKNOWN) -> ByteArray:
    """Add an even border so that turning by this angle cuts nothing off."""
    rows, cols = cells.shape
    angle = math.radians(angle_deg)
    cos, sin = abs(math.cos(angle)), abs(math.sin(angle))
    above = max(0, math.ceil(0.5 * (rows * cos + cols * sin - rows)))
    beside = max(0, math.ceil(0.5 * (cols * cos + rows * sin - cols)))
    return np.pad(cells, ((above, above), (beside, beside)), constant_values=fill)


def _turn(image: np.ndarray, angle_deg: float, method: int, fill: float) -> np.ndarray:
    rows, cols = image.shape
    matrix = cv2.getRotationMatrix2D((0.5 * (cols - 1), 0.5 * (rows - 1)), angle_deg, 1.0)
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
    size = (image.shape[1], image.shape[0])
    return cv2.warpAffine(image, matrix, size, flags=method, borderMode=cv2.BORDER_CONSTANT, borderValue=fill)
