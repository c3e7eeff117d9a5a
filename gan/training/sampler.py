"""Which pairs come next, and how they are changed: a stream that can be stored and taken up again.

Changes are motions of both images, and damage to the SLAM map that real robots do: real maps have more unknown, gaps
in walls, double walls and noise than clean simulation, and a quarter of them are turned. Every change of one
sample comes from a separate generator, so it doesn't depend on the rest of the batch. Threads prepare the next samples
while the networks learn: a sample of ``slam2cad`` takes 22 ms of a core, far longer than a GPU learns from it.
"""

import math
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, Float32Array, IntArray
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import PairSet, window_corner
from slamgym.metrics.layers import door_cells, layer_shares
from slamgym.metrics.maps import resample_slam
from slamgym.metrics.wall_direction import flipped, transformed

ZOOM = 0.15
"""Images are enlarged by up to this share, or shrunk by it."""
RESAMPLED = 0.5
"""Share of the samples that are zoomed and turned, which moves walls by half a pixel at random; the others stay on
their grid, as maps in use do."""
MAX_REDRAWS = 20
"""Attempts to find an unassociated target that differs from the associated one."""
ROOM_TO_TURN = 1.42
"""Windows are cut larger by this, so that a turn about their middle takes nothing from beyond them."""
ROTATED = 0.3
"""Share of the resampled windows that are turned by any angle."""
DAMAGE_PROBABILITY = 0.2
"""Probability of each kind of damage: clean maps shall stay common."""
TURN_DEG = 0.5
"""Standard deviation of a turn of the SLAM map [deg]; the published code turns it by up to 3."""
WOBBLE_PX = 1.5
"""Largest amplitude of a smooth random distortion of the SLAM map [px]: more drift than the data has."""
WALL_DROPOUT, UNKNOWN_BLOBS, SALT_NOISE = 0.2, 0.08, 0.004
"""Largest shares of the walls that are erased in blobs, of the image that becomes unknown in blobs, and of the pixels
that become occupied or free at random."""
DOUBLED_PX, DOUBLED_DEG = 6.0, 2.0
"""Largest displacement of a part that is drawn twice, as after a loop that was closed late [px, deg]."""
COARSEST = 2.0
"""Cells are made coarser by up to this factor."""
BLOB_CELLS, WOBBLE_CELLS = 24, 6
"""Blobs and distortions come from noise on grids of this many cells a side."""
CUT_RANGE = (0.1, 0.45)
"""Distance of a cut from the image's centre, in sides."""


@dataclass(frozen=True)
class Batch:
    """Changed pairs, ready to be encoded."""

    cad: ByteArray  # (B, S, S), or (B, 4, S, S) layers
    slam: ByteArray  # (B, S, S)
    other_cad: ByteArray | None = (
        None  # CAD maps of other places, as ``cad``, if they were asked for
    )
    other_slam: ByteArray | None = None  # (B, S, S) SLAM maps of other places


class BatchSampler:
    """Draws batches: every pair once per pass, in an order that changes from pass to pass."""

    def __init__(
        self, pairs: PairSet, config: TranslatorTrainingConfig, rng: np.random.Generator
    ) -> None:
        """Prepare the stream that a training draws from.

        Args:
            pairs: What to draw from.
            config: Of the training.
            rng: Source of the order and of all changes.
        """
        self._pairs, self._config, self._rng = pairs, config, rng
        self._others = config.loss.adversarial > 0.0
        self._order: IntArray = rng.permutation(len(pairs)).astype(np.int64)
        self._position = 0
        self._threads = ThreadPoolExecutor(torch.get_num_threads())
        self._doors: dict[int, IntArray] = {}
        self._ahead: deque[tuple[dict[str, Any], Future[tuple[ByteArray, ...]]]] = deque()

    def draw(self, count: int) -> Batch:
        """The next batch of this many pairs."""
        # As many again are in work while the networks learn; what they draw is decided here, in order.
        while len(self._ahead) < 2 * count:
            self._ahead.append((self._place(), self._threads.submit(self._sample, *self._drawn())))
        samples = [self._ahead.popleft()[1].result() for _ in range(count)]
        return Batch(*(np.stack(part) for part in zip(*samples, strict=True)))

    def state(self) -> dict[str, Any]:
        """Where the stream stands, as JSON values."""
        place = self._ahead[0][0] if self._ahead else self._place()
        return place | {"order": place["order"].tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue where :meth:`state` was taken."""
        self._ahead.clear()
        self._rng.bit_generator.state = state["rng"]
        self._order = np.asarray(state["order"], dtype=np.int64)
        self._position = int(state["position"])

    def _place(self) -> dict[str, Any]:
        return {
            "rng": self._rng.bit_generator.state,
            "order": self._order,
            "position": self._position,
        }

    def _next(self) -> int:
        if self._position == len(self._order):
            self._order = self._rng.permutation(len(self._pairs)).astype(np.int64)
            self._position = 0
        self._position += 1
        return int(self._order[self._position - 1])

    def _drawn(self) -> list[tuple[int, int]]:
        """(index, seed of the changes) of the next pair, and of another one if others are wanted."""
        # A seed per sample, so that what one sample draws doesn't shift the others' draws.
        index = self._next()
        indices = [index, self._other(index)] if self._others else [index]
        return list(zip(indices, self._rng.integers(0, 2**63, len(indices)).tolist(), strict=True))

    def _sample(self, *drawn: tuple[int, int]) -> tuple[ByteArray, ...]:
        """CAD and SLAM map of each, changed."""
        # Unassociated targets go through the same transform, or the discriminator could recognise them by it.
        changed = [self._changed(index, np.random.default_rng(seed)) for index, seed in drawn]
        return tuple(image for pair in changed for image in pair)

    def _changed(self, index: int, rng: np.random.Generator) -> tuple[ByteArray, ByteArray]:
        translator, slam = self._config.translator, self._pairs.slam[index]
        to_layers = translator.output_encoding == "layers"
        cad = self._with_doors(index) if to_layers else self._pairs.cad[index]
        if self._config.augment:
            cad, slam = augment(cad, slam, translator.input_size, rng)
        symmetry = int(rng.integers(8))
        cad, slam = (np.ascontiguousarray(flipped(image, symmetry)) for image in (cad, slam))
        if to_layers:
            # The zoom changes the scale by a few per cent, which the layers needn't know.
            cad = layer_shares(
                cad[..., 0], cad[..., 1] > FREE // 2, slam, self._pairs.usual_scale(index)
            )
        return cad, slam

    def _with_doors(self, index: int) -> ByteArray:
        """(S, S, 2): the CAD map and its doors, which are found once."""
        cad = self._pairs.cad[index]
        if index not in self._doors:
            self._doors[index] = np.flatnonzero(
                door_cells(cad > FREE // 2, self._pairs.usual_scale(index))
            )
        doors = np.zeros_like(cad)
        doors.ravel()[self._doors[index]] = FREE
        return np.dstack([cad, doors])

    def _other(self, index: int) -> int:
        other = index
        for _ in range(MAX_REDRAWS):
            other = int(self._rng.integers(len(self._pairs)))
            if other != index and not np.array_equal(
                self._pairs.cad[other], self._pairs.cad[index]
            ):
                break
        return other


def augment(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """Cut a window out of a pair, move it, and damage its SLAM map.

    Args:
        cad: (S, S), or (S, S, C) several images that move together.
        slam: (S, S).
        side: Side of the result [px]; images that aren't larger keep theirs.
        rng: Source of the draws.

    Returns:
        The window of both; the inputs stay as they are.
    """
    if side < cad.shape[0]:
        cad, slam = _cut_window(cad, slam, min(cad.shape[0], round(ROOM_TO_TURN * side)), rng)
    both = own = np.eye(3)
    if rng.random() < RESAMPLED:
        angle = rng.uniform(-45.0, 45.0) if rng.random() < ROTATED else 0.0
        both = _about_centre(
            cad.shape[0], angle, math.exp(rng.uniform(-1.0, 1.0) * math.log1p(ZOOM))
        )
        own = _about_centre(cad.shape[0], rng.normal(0.0, TURN_DEG)) @ both
    cad = _moved(cad, both, cv2.INTER_LINEAR, OCCUPIED)
    if rng.random() < DAMAGE_PROBABILITY:
        slam = _wobbled(slam, own, rng.uniform(0.0, WOBBLE_PX), rng)
    else:
        slam = _moved(slam, own, cv2.INTER_NEAREST, UNKNOWN)
    for damage in (_doubled, _with_gaps, _forgotten, _cut_off, _speckled, _coarsened):
        if rng.random() < DAMAGE_PROBABILITY:
            slam = damage(slam, rng)
    if side < cad.shape[0]:
        start = (cad.shape[0] - side) // 2
        cad, slam = (image[start : start + side, start : start + side] for image in (cad, slam))
    return cad, slam


def _cut_window(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """A window of both images about a random place of what the SLAM map shows."""
    known = np.flatnonzero(slam != UNKNOWN)
    at = int(known[rng.integers(known.size)]) if known.size else slam.size // 2
    row, col = window_corner(slam, side, divmod(at, slam.shape[1]))
    window = slice(row, row + side), slice(col, col + side)
    return cad[window], slam[window]


def _about_centre(
    side: int, angle_deg: float, zoom: float = 1.0, shift: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """A turn, zoom and shift as a 3 x 3 matrix on (col, row)."""
    centre = 0.5 * (side - 1)
    matrix = np.vstack(
        [cv2.getRotationMatrix2D((centre, centre), angle_deg, zoom), [0.0, 0.0, 1.0]]
    )
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


def _doubled(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Draw the part beyond a line a second time, displaced."""
    shift = tuple(rng.uniform(-DOUBLED_PX, DOUBLED_PX, 2).tolist())
    motion = _about_centre(slam.shape[0], rng.uniform(-DOUBLED_DEG, DOUBLED_DEG), 1.0, shift)
    again = _moved(slam, motion, cv2.INTER_NEAREST, UNKNOWN)
    adds = (again == OCCUPIED) | ((again == FREE) & (slam == UNKNOWN))
    return np.where(adds & _half_plane(slam.shape[0], rng), again, slam)


def _with_gaps(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    gaps = (slam == OCCUPIED) & _blobs(slam.shape[0], rng.uniform(0.0, WALL_DROPOUT), rng)
    return np.where(gaps, UNKNOWN, slam).astype(np.uint8)


def _forgotten(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    blobs = _blobs(slam.shape[0], rng.uniform(0.0, UNKNOWN_BLOBS), rng)
    return np.where(blobs, UNKNOWN, slam).astype(np.uint8)


def _cut_off(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    return np.where(_half_plane(slam.shape[0], rng), UNKNOWN, slam).astype(np.uint8)


def _speckled(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    count = int(rng.uniform(0.0, SALT_NOISE) * slam.size)
    rows, cols = rng.integers(0, slam.shape[0], (2, count))
    speckled = slam.copy()
    # Mostly stray hits; a few holes and rays.
    speckled[rows, cols] = rng.choice([OCCUPIED, OCCUPIED, FREE, UNKNOWN], count)
    return speckled


def _coarsened(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """The map as one of coarser cells shows it."""
    side = round(slam.shape[0] / rng.uniform(1.0, COARSEST))
    return resample_slam(resample_slam(slam, (side, side)), slam.shape)


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
