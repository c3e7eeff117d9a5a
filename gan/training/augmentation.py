"""Changes to training pairs: motions of both images, and damage to the SLAM map that real robots do.

Real maps have more unknown, gaps in walls and salt noise than clean simulation, and a quarter of them are turned.
Every change of one sample comes from a generator of its own, so it doesn't depend on the rest of the batch.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, Float32Array
from slamgym.gan.config import AugmentConfig
from slamgym.gan.data import window_corner
from slamgym.metrics.wall_direction import flipped, transformed

DAMAGE_PROBABILITY = 0.35
"""Of each kind of damage: clean maps shall stay common."""
BLOB_CELLS = 24
"""Blobs come from noise on a grid of this many cells a side."""
WOBBLE_CELLS = 6
CUT_RANGE = (0.1, 0.45)
"""Distance of a cut from the image's centre, in sides."""


def augment(
    cad: ByteArray,
    slam: ByteArray,
    config: AugmentConfig,
    rng: np.random.Generator,
    damage: bool = True,
    side: int = 0,
) -> tuple[ByteArray, ByteArray]:
    """Change one pair.

    Args:
        cad: (S, S).
        slam: (S, S).
        config: What to change and how much.
        rng: Source of the draws.
        damage: Whether the SLAM map may be turned, distorted and damaged (it is the input).
        side: Of the result, if the images are larger [px]; 0 leaves their size.

    Returns:
        The pair; the inputs are left as they are.
    """
    is_resampled = config.resampled >= 1.0 or rng.random() < config.resampled
    if config.windows and side and side < cad.shape[0]:
        cad, slam = cut_window(cad, slam, min(cad.shape[0], round(1.42 * side)), rng)
    both = (
        _joint_motion(cad.shape[0], config, rng) if is_resampled else _whole_shift(cad.shape[0], config, rng)
    )
    own = both
    if damage and is_resampled and config.turn_deg > 0.0:
        own = _about_centre(cad.shape[0], rng.normal(0.0, config.turn_deg), 1.0, (0.0, 0.0)) @ both
    cad = _moved(cad, both, cv2.INTER_LINEAR, OCCUPIED)
    if damage and config.wobble_px > 0.0 and rng.random() < DAMAGE_PROBABILITY:
        slam = _wobbled(slam, own, rng.uniform(0.0, config.wobble_px), rng)
    else:
        slam = _moved(slam, own, cv2.INTER_NEAREST, UNKNOWN)
    if damage:
        slam = _damaged(slam, config, rng)
    if side and side < cad.shape[0]:
        start = (cad.shape[0] - side) // 2
        cad, slam = (image[start : start + side, start : start + side] for image in (cad, slam))
    if config.flips:
        symmetry = int(rng.integers(8))
        cad, slam = flipped(cad, symmetry), flipped(slam, symmetry)
    return np.ascontiguousarray(cad), np.ascontiguousarray(slam)


def _joint_motion(side: int, config: AugmentConfig, rng: np.random.Generator) -> np.ndarray:
    """A zoom, shift and turn as a 3 x 3 matrix on (col, row)."""
    angle = rng.uniform(-45.0, 45.0) if config.rotated > 0.0 and rng.random() < config.rotated else 0.0
    if config.zoom == 0.0 and config.shift == 0.0 and angle == 0.0:
        return np.eye(3)
    zoom = math.exp(rng.uniform(-1.0, 1.0) * math.log1p(config.zoom))
    shift = rng.uniform(-config.shift, config.shift, 2) * side
    return _about_centre(side, angle, zoom, (float(shift[0]), float(shift[1])))


def cut_window(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """A window of both images about a random place of what the SLAM map shows."""
    known = np.flatnonzero(slam != UNKNOWN)
    at = int(known[rng.integers(known.size)]) if known.size else slam.size // 2
    row, col = window_corner(slam, side, divmod(at, slam.shape[1]))
    window = slice(row, row + side), slice(col, col + side)
    return cad[window], slam[window]


def _whole_shift(side: int, config: AugmentConfig, rng: np.random.Generator) -> np.ndarray:
    """A shift by whole pixels as a 3 x 3 matrix on (col, row)."""
    motion = np.eye(3)
    motion[:2, 2] = np.rint(rng.uniform(-config.shift, config.shift, 2) * side)
    return motion


def _about_centre(side: int, angle_deg: float, zoom: float, shift: tuple[float, float]) -> np.ndarray:
    centre = 0.5 * (side - 1)
    matrix = np.vstack([cv2.getRotationMatrix2D((centre, centre), angle_deg, zoom), [0.0, 0.0, 1.0]])
    matrix[:2, 2] += shift
    return matrix


def _moved(image: ByteArray, motion: np.ndarray, method: int, fill: int) -> ByteArray:
    if np.array_equal(motion, np.eye(3)):
        return image
    return np.asarray(transformed(image, motion[:2], fill, method), dtype=np.uint8)


def _wobbled(
    image: ByteArray, motion: np.ndarray, amplitude_px: float, rng: np.random.Generator
) -> ByteArray:
    """Move, and distort smoothly by vectors of the given standard deviation."""
    side = image.shape[0]
    coarse = rng.normal(0.0, amplitude_px, (WOBBLE_CELLS, WOBBLE_CELLS, 2)).astype(np.float32)
    field = cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
    back = np.linalg.inv(motion)
    cols, rows = np.meshgrid(np.arange(side, dtype=np.float32), np.arange(side, dtype=np.float32))
    from_cols = (back[0, 0] * cols + back[0, 1] * rows + back[0, 2] + field[..., 0]).astype(np.float32)
    from_rows = (back[1, 0] * cols + back[1, 1] * rows + back[1, 2] + field[..., 1]).astype(np.float32)
    warped = cv2.remap(image, from_cols, from_rows, cv2.INTER_NEAREST, borderValue=UNKNOWN)
    return np.asarray(warped, dtype=np.uint8)


def _damaged(slam: ByteArray, config: AugmentConfig, rng: np.random.Generator) -> ByteArray:
    damaged = slam.copy()
    side = slam.shape[0]
    if config.wall_dropout > 0.0 and rng.random() < DAMAGE_PROBABILITY:
        gaps = (damaged == OCCUPIED) & _blobs(side, rng.uniform(0.0, config.wall_dropout), rng)
        damaged[gaps] = FREE if rng.random() < 0.3 else UNKNOWN
    if config.unknown > 0.0 and rng.random() < DAMAGE_PROBABILITY:
        damaged[_blobs(side, rng.uniform(0.0, config.unknown), rng)] = UNKNOWN
    if config.occlusion > 0.0 and rng.random() < config.occlusion:
        damaged[_half_plane(side, rng)] = UNKNOWN
    if config.salt_noise > 0.0 and rng.random() < DAMAGE_PROBABILITY:
        count = int(rng.uniform(0.0, config.salt_noise) * side * side)
        rows, cols = rng.integers(0, side, (2, count))
        # Mostly stray hits; a few holes and rays.
        damaged[rows, cols] = rng.choice([OCCUPIED, OCCUPIED, FREE, UNKNOWN], count)
    return damaged


def _blobs(side: int, share: float, rng: np.random.Generator) -> BoolArray:
    """Random smooth blobs that cover about this share of the square."""
    noise = rng.random((BLOB_CELLS, BLOB_CELLS), dtype=np.float32)
    smooth: Float32Array = np.asarray(cv2.GaussianBlur(noise, (0, 0), 0.8), dtype=np.float32)
    level = float(np.quantile(smooth, 1.0 - share))
    blobs: BoolArray = cv2.resize(smooth, (side, side), interpolation=cv2.INTER_LINEAR) > level
    return blobs


def _half_plane(side: int, rng: np.random.Generator) -> BoolArray:
    """All beyond a random line."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    distance = rng.uniform(*CUT_RANGE) * side
    offsets = np.arange(side, dtype=np.float32) - 0.5 * (side - 1)
    return math.cos(angle) * offsets[None, :] + math.sin(angle) * offsets[:, None] > distance
