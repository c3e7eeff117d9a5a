"""Which pairs come next, and how they are changed: a stream that can be stored and taken up again.

Changes are motions of both images, and damage to the SLAM map that real robots do: real maps have more unknown, gaps
in walls and salt noise than clean simulation, and a quarter of them are turned. Every change of one sample comes from a
separate generator, so it doesn't depend on the rest of the batch.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, Float32Array, IntArray
from slamgym.gan.config import AugmentConfig, TranslatorTrainingConfig
from slamgym.gan.data import PairSet, window_corner
from slamgym.gan.translation.finishing import limited_to_explored
from slamgym.metrics.wall_direction import flipped, transformed

ZOOM, SHIFT = 0.15, 0.06
"""Images are enlarged by up to the first share, or shrunk by it; all but windows are shifted by up to the second share
of the side."""
RESAMPLED = 0.5
"""Share of the samples that are zoomed, turned and shifted by fractions of a pixel, which moves walls by half a pixel
at random; the others are shifted by whole pixels, as maps in use lie on their own grid."""
MAX_REDRAWS = 20
"""Attempts to find an unassociated target that differs from the associated one."""
ROOM_TO_TURN = 1.42
"""Windows are cut larger by this, so that a turn about their middle takes nothing from beyond them."""
ROTATED = 0.3
"""Share of the windows that are turned by any angle."""
DAMAGE_PROBABILITY = 0.35
"""Probability of each kind of damage: clean maps shall stay common."""
TURN_DEG = 0.5
"""Standard deviation of a turn of the SLAM map [deg]; the published code turns it by up to 3."""
WOBBLE_PX = 1.0
"""Largest amplitude of a smooth random distortion of the SLAM map [px]: more drift than the data has."""
WALL_DROPOUT, UNKNOWN_BLOBS, SALT_NOISE = 0.2, 0.08, 0.004
"""Largest shares of the walls that are erased in blobs, of the image that becomes unknown in blobs, and of the pixels
that become occupied or free at random."""
OCCLUSION = 0.1
"""Probability that a half-plane of the SLAM map was never seen."""
BLOB_CELLS, WOBBLE_CELLS = 24, 6
"""Blobs and distortions come from noise on grids of this many cells a side."""
CUT_RANGE = (0.1, 0.45)
"""Distance of a cut from the image's centre, in sides."""


@dataclass(frozen=True)
class Batch:
    """Changed pairs, ready to be encoded."""

    cad: ByteArray  # (B, S, S)
    slam: ByteArray  # (B, S, S)
    other_cad: ByteArray | None = None  # (B, S, S) CAD maps of other places, if they were asked for
    other_slam: ByteArray | None = None  # (B, S, S) SLAM maps of other places


class BatchSampler:
    """Draws batches: every pair once per pass, in an order that changes from pass to pass."""

    def __init__(self, pairs: PairSet, config: TranslatorTrainingConfig, rng: np.random.Generator) -> None:
        """Prepare the stream that a training draws from.

        Args:
            pairs: What to draw from.
            config: Of the training.
            rng: Source of the order and of all changes.
        """
        self._pairs, self._config, self._rng = pairs, config.augment, rng
        # A SLAM map that is the input may be damaged, and its target ends where it does; as a target it stays.
        self._damage = config.translator.direction == "slam2cad"
        self._margin = config.translator.explored_margin if self._damage else 0.0
        self._side = config.translator.input_size
        self._others = config.loss.adversarial > 0.0
        self._order: IntArray = rng.permutation(len(pairs)).astype(np.int64)
        self._position = 0

    def draw(self, count: int) -> Batch:
        """The next batch of this many pairs."""
        samples = [self._sample(self._next()) for _ in range(count)]
        return Batch(*(np.stack(part) for part in zip(*samples, strict=True)))

    def state(self) -> dict[str, Any]:
        """Where the stream stands, as JSON values."""
        return {
            "rng": self._rng.bit_generator.state,
            "order": self._order.tolist(),
            "position": self._position,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue where :meth:`state` was taken."""
        self._rng.bit_generator.state = state["rng"]
        self._order = np.asarray(state["order"], dtype=np.int64)
        self._position = int(state["position"])

    def _next(self) -> int:
        if self._position == len(self._order):
            self._order = self._rng.permutation(len(self._pairs)).astype(np.int64)
            self._position = 0
        self._position += 1
        return int(self._order[self._position - 1])

    def _sample(self, index: int) -> tuple[ByteArray, ...]:
        """CAD and SLAM map of a pair, changed, and of another one if others are wanted."""
        # A generator per sample, so that what one sample draws doesn't shift the others' draws.
        if not self._others:
            return self._changed(index, np.random.default_rng(self._rng.integers(0, 2**63)))
        other = self._other(index)
        own, others = (np.random.default_rng(seed) for seed in self._rng.integers(0, 2**63, 2))
        # Unassociated targets go through the same transform, or the discriminator could recognise them by it.
        return *self._changed(index, own), *self._changed(other, others)

    def _changed(self, index: int, rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
        pairs = self._pairs
        cad, slam = augment(pairs.cad[index], pairs.slam[index], self._config, rng, self._damage, self._side)
        if self._margin > 0.0:
            # The zoom changes the scale by a few per cent, which the margin needn't know.
            cad = limited_to_explored(cad, slam, pairs.scale(index), self._margin)
        return cad, slam

    def _other(self, index: int) -> int:
        other = index
        for _ in range(MAX_REDRAWS):
            other = int(self._rng.integers(len(self._pairs)))
            if other != index and not np.array_equal(self._pairs.cad[other], self._pairs.cad[index]):
                break
        return other


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
        config: What to change.
        rng: Source of the draws.
        damage: Whether the SLAM map may be turned, distorted and damaged (it is the input).
        side: Side of the result, if the images are larger [px]; 0 keeps their size.

    Returns:
        The pair; the inputs stay as they are.
    """
    is_damaged = config.real_maps and damage
    is_resampled = not config.real_maps or rng.random() < RESAMPLED
    if config.windows and side and side < cad.shape[0]:
        cad, slam = _cut_window(cad, slam, min(cad.shape[0], round(ROOM_TO_TURN * side)), rng)
    both = _joint_motion(cad.shape[0], config, is_resampled, rng)
    own = both
    if is_resampled and is_damaged:
        own = _about_centre(cad.shape[0], rng.normal(0.0, TURN_DEG), 1.0, (0.0, 0.0)) @ both
    cad = _moved(cad, both, cv2.INTER_LINEAR, OCCUPIED)
    if is_damaged and rng.random() < DAMAGE_PROBABILITY:
        slam = _wobbled(slam, own, rng.uniform(0.0, WOBBLE_PX), rng)
    else:
        slam = _moved(slam, own, cv2.INTER_NEAREST, UNKNOWN)
    if is_damaged:
        slam = _damaged(slam, rng)
    if side and side < cad.shape[0]:
        start = (cad.shape[0] - side) // 2
        cad, slam = (image[start : start + side, start : start + side] for image in (cad, slam))
    symmetry = int(rng.integers(8))
    return np.ascontiguousarray(flipped(cad, symmetry)), np.ascontiguousarray(flipped(slam, symmetry))


def _joint_motion(
    side: int, config: AugmentConfig, is_resampled: bool, rng: np.random.Generator
) -> np.ndarray:
    """A zoom, shift and turn, or a shift by whole pixels, as a 3 x 3 matrix on (col, row)."""
    largest = 0.0 if config.windows else SHIFT
    if not is_resampled:
        motion = np.eye(3)
        motion[:2, 2] = np.rint(rng.uniform(-largest, largest, 2) * side)
        return motion
    angle = rng.uniform(-45.0, 45.0) if config.windows and rng.random() < ROTATED else 0.0
    if not config.real_maps:
        return _about_centre(side, angle, 1.0, (0.0, 0.0))
    zoom = math.exp(rng.uniform(-1.0, 1.0) * math.log1p(ZOOM))
    shift = rng.uniform(-largest, largest, 2) * side
    return _about_centre(side, angle, zoom, (float(shift[0]), float(shift[1])))


def _cut_window(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """A window of both images about a random place of what the SLAM map shows."""
    known = np.flatnonzero(slam != UNKNOWN)
    at = int(known[rng.integers(known.size)]) if known.size else slam.size // 2
    row, col = window_corner(slam, side, divmod(at, slam.shape[1]))
    window = slice(row, row + side), slice(col, col + side)
    return cad[window], slam[window]


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
    from_cols, from_rows = (
        (b[0] * cols + b[1] * rows + b[2] + field[..., axis]).astype(np.float32)
        for axis, b in enumerate(back[:2])
    )
    warped = cv2.remap(image, from_cols, from_rows, cv2.INTER_NEAREST, borderValue=UNKNOWN)
    return np.asarray(warped, dtype=np.uint8)


def _damaged(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    damaged = slam.copy()
    side = slam.shape[0]
    if rng.random() < DAMAGE_PROBABILITY:
        gaps = (damaged == OCCUPIED) & _blobs(side, rng.uniform(0.0, WALL_DROPOUT), rng)
        damaged[gaps] = FREE if rng.random() < 0.3 else UNKNOWN
    if rng.random() < DAMAGE_PROBABILITY:
        damaged[_blobs(side, rng.uniform(0.0, UNKNOWN_BLOBS), rng)] = UNKNOWN
    if rng.random() < OCCLUSION:
        damaged[_half_plane(side, rng)] = UNKNOWN
    if rng.random() < DAMAGE_PROBABILITY:
        count = int(rng.uniform(0.0, SALT_NOISE) * side * side)
        rows, cols = rng.integers(0, side, (2, count))
        # Mostly stray hits; a few holes and rays.
        damaged[rows, cols] = rng.choice([OCCUPIED, OCCUPIED, FREE, UNKNOWN], count)
    return damaged


def _blobs(side: int, share: float, rng: np.random.Generator) -> BoolArray:
    """Random smooth blobs that cover about this share of the square."""
    noise = rng.random((BLOB_CELLS, BLOB_CELLS), dtype=np.float32)
    smooth: Float32Array = np.asarray(cv2.GaussianBlur(noise, (0, 0), 0.8), dtype=np.float32)
    level = float(np.quantile(smooth, max(0.0, 1.0 - share)))
    return cv2.resize(smooth, (side, side), interpolation=cv2.INTER_LINEAR) > level


def _half_plane(side: int, rng: np.random.Generator) -> BoolArray:
    """All beyond a random line."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    distance = rng.uniform(*CUT_RANGE) * side
    offsets = np.arange(side, dtype=np.float32) - 0.5 * (side - 1)
    return math.cos(angle) * offsets[None, :] + math.sin(angle) * offsets[:, None] > distance
