"""Find the direction of most walls of a SLAM map, and turn the map so that they lie along the axes; flip maps.

Walls of a building are mostly at right angles, so directions are taken modulo 90 degrees. Seen along a wall's
own direction all its cells fall into one bin of the projection, seen from elsewhere they spread: the angle is
the one at which the projections onto two perpendicular axes are sharpest (sum of squared counts). Gradient
directions would be cheaper, but the staircase of a wall that is turned by a few degrees pulls them to 0.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, UNKNOWN, BoolArray, ByteArray, Float32Array, FloatArray

MAX_POINTS = 3000
"""Of the outline that are looked at."""
COARSE_BIN_PX, FINE_BIN_PX = 2.0, 1.0
COARSE_STEP_DEG, FINE_STEP_DEG, FINE_RANGE_DEG = 1.0, 0.15, 1.5
MIN_TURN_DEG = 0.3
"""About the error of the angle itself."""
MAX_DRIFT_DEG = 8.0
"""A simulated map is turned by drift, which is small; a larger angle is a building with oblique walls."""
TOP = 0.95
"""What counts as the top of the sharpness, in shares of its maximum."""


def dominant_angle_deg(cells: ByteArray) -> float:
    """Angle by which most walls are turned against the image's axes.

    Args:
        cells: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free.

    Returns:
        In [-45, 45) degrees, positive counter-clockwise as seen on the screen; 0 for a map without free space.
    """
    points = _outline_points(cells == FREE)
    if len(points) < 8:
        return 0.0
    angles = np.arange(-45.0, 45.0, COARSE_STEP_DEG)
    # Where two are equally sharp, the one nearer to the axes: a round room isn't turned.
    angles = angles[np.argsort(np.abs(angles), kind="stable")]
    best = angles[int(np.argmax([_sharpness(points, angle, COARSE_BIN_PX) for angle in angles]))]
    angles = best + np.arange(-FINE_RANGE_DEG, FINE_RANGE_DEG + 0.01, FINE_STEP_DEG)
    scores = np.array([_sharpness(points, angle, FINE_BIN_PX) for angle in angles])
    # The top is flat: its middle is the direction.
    weights = np.clip(scores - TOP * scores.max(), 0.0, None)
    return float((float(angles @ weights / weights.sum()) + 45.0) % 90.0 - 45.0)


def angle_to_undo_deg(cells: ByteArray) -> float:
    """The same, but 0 if it is too small to be worth a resampling."""
    angle = dominant_angle_deg(cells)
    return angle if abs(angle) >= MIN_TURN_DEG else 0.0


def _outline_points(free: BoolArray) -> FloatArray:
    """Cells of free space beside what isn't: (N, 2), x to the right and y upwards, about their mean."""
    inner = cv2.erode(free.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
    rows, cols = np.nonzero(free & (inner == 0))
    points = np.stack([cols, -rows], axis=1).astype(np.float64)
    if len(points) > MAX_POINTS:
        points = points[np.linspace(0, len(points) - 1, MAX_POINTS).astype(np.int64)]
    return points - points.mean(axis=0) if len(points) else points


def _sharpness(points: FloatArray, angle_deg: float, bin_px: float) -> float:
    """Sum of the squared counts of the projections along and across a direction."""
    angle = math.radians(angle_deg)
    along = points[:, 0] * math.cos(angle) + points[:, 1] * math.sin(angle)
    across = points[:, 1] * math.cos(angle) - points[:, 0] * math.sin(angle)
    total = 0.0
    for values in (along, across):
        places = (values - values.min()) / bin_px
        bins = places.astype(np.int64)
        # Each point is shared by the two nearest bins, so that the sum is smooth in the angle.
        share = places - bins
        size = int(bins.max()) + 2
        counts = np.bincount(bins, 1.0 - share, size) + np.bincount(bins + 1, share, size)
        total += float(counts @ counts)
    return total


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
