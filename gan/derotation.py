"""Find the direction of most walls of a SLAM map, and turn the map so that they lie along the axes.

Walls of a building are mostly at right angles, so directions are taken modulo 90 degrees. The angle is where a
histogram of the directions of the grey gradient, weighted by its strength, peaks: long straight walls fill one bin,
everything else spreads.
"""

import math

import cv2
import numpy as np

from slamgym.types import UNKNOWN, ByteArray, Float32Array

BINS = 360
"""Of a quarter degree over the 90 degrees."""
SMOOTHING_DEG = 1.0
"""Standard deviation of the kernel over the histogram: drift within a map spreads its walls by this much."""
BLUR_PX = 1.5
"""Of the free space before the gradient is taken, so that the staircase of an oblique wall has its true slope."""


def dominant_angle_deg(cells: ByteArray) -> float:
    """Angle by which most walls are turned against the image's axes.

    Args:
        cells: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free.

    Returns:
        In [-45, 45) degrees, positive counter-clockwise as seen on the screen; 0 for a map without any edge.
    """
    # Unknown behind a wall and the wall itself count alike: what matters is where free space ends.
    image = cv2.GaussianBlur((cells > UNKNOWN).astype(np.float32), (0, 0), BLUR_PX)
    along_x = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3)
    along_y = -cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3)  # upwards
    strength = np.hypot(along_x, along_y)
    strong = strength > 0.25 * max(float(strength.max()), 1e-6)
    if not strong.any() or float(strength.max()) < 1e-3:
        return 0.0
    angles = np.degrees(np.arctan2(along_y[strong], along_x[strong])) % 90.0
    bins = (angles * (BINS / 90.0)).astype(np.int64) % BINS
    histogram = np.bincount(bins, weights=strength[strong], minlength=BINS)
    smooth = _smooth_around(histogram, SMOOTHING_DEG * BINS / 90.0)
    peak = int(np.argmax(smooth))
    angle = (peak + 0.5 + _vertex(smooth, peak)) * 90.0 / BINS
    return float((angle + 45.0) % 90.0 - 45.0)


def turned(cells: ByteArray, angle_deg: float, fill: int = UNKNOWN) -> ByteArray:
    """Turn a map counter-clockwise about its centre, same shape, nearest cell.

    Args:
        cells: (H, W) uint8.
        angle_deg: [deg]
        fill: Value of what comes from beyond the border.
    """
    if angle_deg == 0.0:
        return cells
    return np.asarray(
        cv2.warpAffine(
            cells,
            rotation_matrix(cells.shape, angle_deg),
            (cells.shape[1], cells.shape[0]),
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=fill,
        ),
        dtype=np.uint8,
    )


def turned_probability(image: Float32Array, angle_deg: float) -> Float32Array:
    """The same for values in [0, 1], interpolated, with 0 from beyond the border."""
    if angle_deg == 0.0:
        return image
    return np.asarray(
        cv2.warpAffine(
            image,
            rotation_matrix(image.shape, angle_deg),
            (image.shape[1], image.shape[0]),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        ),
        dtype=np.float32,
    )


def rotation_matrix(shape: tuple[int, ...], angle_deg: float) -> np.ndarray:
    """The 2 x 3 matrix for cv2.warpAffine that turns about the centre of the pixel grid."""
    centre = (0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1))
    return np.asarray(cv2.getRotationMatrix2D(centre, angle_deg, 1.0))


def padded_for_turning(cells: ByteArray, angle_deg: float, fill: int = UNKNOWN) -> ByteArray:
    """Add an even border so that turning by this angle cuts nothing off."""
    rows, cols = cells.shape
    angle = math.radians(angle_deg)
    cos, sin = abs(math.cos(angle)), abs(math.sin(angle))
    above = max(0, math.ceil(0.5 * (rows * cos + cols * sin - rows)))
    beside = max(0, math.ceil(0.5 * (cols * cos + rows * sin - cols)))
    return np.pad(cells, ((above, above), (beside, beside)), constant_values=fill)


def _smooth_around(histogram: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian smoothing on the circle."""
    reach = math.ceil(3.0 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    around = np.concatenate([histogram[-reach:], histogram, histogram[:reach]])
    return np.convolve(around, kernel / kernel.sum(), mode="valid")


def _vertex(values: np.ndarray, peak: int) -> float:
    """Where the parabola through a peak and its neighbours has its top, in bins from the peak."""
    left, middle, right = values[peak - 1], values[peak], values[(peak + 1) % len(values)]
    curvature = left - 2.0 * middle + right
    return float(0.5 * (left - right) / curvature) if curvature < 0.0 else 0.0
