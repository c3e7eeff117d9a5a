"""Which pairs come next, and how they are changed: a stream that can be stored and taken up again."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slamgym.core.types import ByteArray, IntArray
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import PairSet
from slamgym.gan.training.augmentation import augment
from slamgym.gan.translation.explored import limited_to_explored
from slamgym.metrics.wall_direction import MAX_DRIFT_DEG, angle_to_undo_deg, turned

MAX_REDRAWS = 20
"""Attempts to find an unassociated target that differs from the associated one."""


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
        self._others = config.needs_unassociated
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
        """Go on where :meth:`state` was taken."""
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


def derotated(pairs: PairSet) -> PairSet:
    """The pairs with each SLAM map turned so that most of its walls lie along the axes, as the CAD map's do."""
    slam = np.stack([_without_drift(cells) for cells in pairs.slam]) if len(pairs) else pairs.slam
    return replace(pairs, slam=slam)


def _without_drift(cells: ByteArray) -> ByteArray:
    angle = angle_to_undo_deg(cells)
    return turned(cells, -angle) if abs(angle) <= MAX_DRIFT_DEG else cells
