"""Mean squared error of two map images after the best similarity transform (the aligned MSE of Table I).

The error of a SLAM map against the CAD drawing depends on how the two are laid over each other. Feature
matching finds a poor alignment on such images; here the transform is searched directly: rotations are scanned
on small blurred images, the best few are refined by Powell's method on sharper ones.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize

from slamgym.metrics.maps import squared_error
from slamgym.types import Float32Array, FloatArray

SEARCH_SIZE_PX = 128
"""Larger side of the images during the search; the final error is taken at full size."""
START_ANGLES = 24
REFINED_STARTS = 4
COARSE_BLUR_PX, FINE_BLUR_PX = 4.0, 1.0


class Similarity(NamedTuple):
    """A turn, scale and shift of an image about its centre; shift in shares of the larger side."""

    shift_x: float
    shift_y: float
    angle: float  # [rad], counter-clockwise on the screen
    log_scale: float

    def matrix(self, rows: int, cols: int) -> FloatArray:
        """The 2 x 3 matrix for cv2.warpAffine on an image of this shape."""
        scale = math.exp(self.log_scale)
        cos, sin = scale * math.cos(self.angle), scale * math.sin(self.angle)
        centre_x, centre_y = 0.5 * (cols - 1), 0.5 * (rows - 1)
        size = max(rows, cols)
        return np.array(
            [
                [cos, sin, centre_x + self.shift_x * size - cos * centre_x - sin * centre_y],
                [-sin, cos, centre_y + self.shift_y * size + sin * centre_x - cos * centre_y],
            ]
        )


@dataclass(frozen=True)
class AlignedError:
    """Mean squared error before and after alignment."""

    mse: float
    """After the best similarity; never more than ``unaligned``."""
    unaligned: float
    similarity: Similarity
    """Brings the image onto the target."""


def aligned_error(image: FloatArray, target: FloatArray) -> AlignedError:
    """Mean squared error of ``image`` against ``target`` after the best similarity transform of ``image``.

    Args:
        image: Values in [0, 1], shape (rows, cols), e.g. :func:`slamgym.metrics.free_space` of a map.
        target: Same shape.

    Raises:
        ValueError: If the shapes differ.
    """
    identity = Similarity(0.0, 0.0, 0.0, 0.0)
    unaligned = squared_error(image, target)
    best, best_error = identity, unaligned
    small, small_target = _shrink(image), _shrink(target)
    if small.any() and small_target.any():
        for start in _starts(small, small_target):
            found = _refine(start, small, small_target)
            error = squared_error(apply_similarity(image, found), target)
            if error < best_error:
                best, best_error = found, error
    return AlignedError(best_error, unaligned, best)


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


def _shrink(image: FloatArray) -> Float32Array:
    rows, cols = image.shape
    factor = min(1.0, SEARCH_SIZE_PX / max(rows, cols))
    size = (max(1, round(cols * factor)), max(1, round(rows * factor)))
    return np.asarray(
        cv2.resize(np.asarray(image, dtype=np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32
    )


def _starts(image: Float32Array, target: Float32Array) -> list[Similarity]:
    """The most promising rotations, with the shift and scale that the centroids and areas suggest."""
    rows, cols = image.shape
    size = max(rows, cols)
    blurred, blurred_target = _blur(image, COARSE_BLUR_PX), _blur(target, COARSE_BLUR_PX)
    centroid, target_centroid = _centroid(image), _centroid(target)
    log_scale = 0.5 * math.log(float(target.sum()) / float(image.sum()))
    log_scale = min(max(log_scale, -0.3), 0.3)
    candidates = [Similarity(0.0, 0.0, 0.0, 0.0)]
    for turn in range(START_ANGLES):
        turned = Similarity(0.0, 0.0, 2.0 * math.pi * turn / START_ANGLES, log_scale)
        moved = turned.matrix(rows, cols) @ np.array([*centroid, 1.0])
        shift = (target_centroid - moved) / size
        candidates.append(turned._replace(shift_x=float(shift[0]), shift_y=float(shift[1])))
    candidates.sort(key=lambda start: _cost(np.array(start), blurred, blurred_target))
    # The identity is always refined: maps are mostly nearly aligned already.
    return list(dict.fromkeys([Similarity(0.0, 0.0, 0.0, 0.0), *candidates[:REFINED_STARTS]]))


def _refine(start: Similarity, image: Float32Array, target: Float32Array) -> Similarity:
    values = np.array(start)
    for blur_px in (COARSE_BLUR_PX, FINE_BLUR_PX):
        steps = np.diag([0.02, 0.02, 0.05, 0.03]) * (blur_px / COARSE_BLUR_PX)
        result = minimize(
            _cost,
            values,
            args=(_blur(image, blur_px), _blur(target, blur_px)),
            method="Powell",
            options={"direc": steps, "xtol": 1e-3, "ftol": 1e-4, "maxfev": 400},
        )
        values = result.x
    return Similarity(*(float(value) for value in values))


def _cost(values: FloatArray, image: Float32Array, target: Float32Array) -> float:
    similarity = Similarity(*values)
    if abs(similarity.log_scale) > 0.7 or max(abs(similarity.shift_x), abs(similarity.shift_y)) > 1.0:
        return 1.0
    rows, cols = image.shape
    warped = cv2.warpAffine(image, similarity.matrix(rows, cols), (cols, rows), flags=cv2.INTER_LINEAR)
    return float(np.mean((warped - target) ** 2))


def _blur(image: Float32Array, sigma_px: float) -> Float32Array:
    return np.asarray(
        cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT), dtype=np.float32
    )


def _centroid(image: Float32Array) -> FloatArray:
    """(x, y) in pixels."""
    row, col = np.indices(image.shape)
    total = float(image.sum())
    return np.array([(image * col).sum() / total, (image * row).sum() / total])
