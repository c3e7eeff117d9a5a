"""Which pairs come next, and how they are changed: a stream that can be stored and taken up again.

Every change of one sample (:mod:`slamgym.gan.training.augmentation`) comes from a separate generator, so it doesn't
depend on the rest of the batch. Threads prepare the next samples while the networks learn: a sample of ``slam2cad``
takes 22 ms of a core, far longer than a GPU learns from it.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch

from slamgym.core.types import FREE, ByteArray, IntArray
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import PairSet
from slamgym.gan.training.augmentation import augment
from slamgym.metrics.layers import door_cells, layer_shares
from slamgym.metrics.wall_direction import flipped

MAX_REDRAWS = 20
"""Attempts to find an unassociated target that differs from the associated one."""


@dataclass(frozen=True)
class Batch:
    """Changed pairs, ready to be encoded."""

    cad: ByteArray  # (B, S, S), or (B, 4, S, S) layers
    slam: ByteArray  # (B, S, S)
    other_cad: ByteArray | None = None
    """CAD maps of other places, as ``cad``, if they were asked for."""
    other_slam: ByteArray | None = None
    """SLAM maps of other places, (B, S, S)."""


class _Pair(NamedTuple):
    """One pair, or a stack of pairs."""

    cad: ByteArray
    slam: ByteArray


class _Ahead(NamedTuple):
    """A sample in work."""

    place: dict[str, Any]
    """Where the stream stood before it."""
    pairs: Future[list[_Pair]]
    """The pair, and one of another place if others are wanted."""


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
        self._pairs = pairs
        self._config = config
        self._rng = rng
        self._others = config.loss.adversarial > 0.0
        self._order = self._shuffled()
        self._position = 0
        self._threads = ThreadPoolExecutor(torch.get_num_threads())
        self._doors: dict[int, IntArray] = {}
        self._ahead: deque[_Ahead] = deque()

    def draw(self, count: int) -> Batch:
        """The next batch of this many pairs."""
        # As many again are in work while the networks learn; what they draw is decided here, in order.
        while len(self._ahead) < 2 * count:
            place = self._place()
            drawn = self._drawn()
            pairs = self._threads.submit(self._sample, drawn)
            self._ahead.append(_Ahead(place, pairs))
        samples = [self._ahead.popleft().pairs.result() for _ in range(count)]
        batch = _stacked([pairs[0] for pairs in samples])
        if not self._others:
            return Batch(batch.cad, batch.slam)
        others = _stacked([pairs[1] for pairs in samples])
        return Batch(batch.cad, batch.slam, others.cad, others.slam)

    def state(self) -> dict[str, Any]:
        """Where the stream stands, as JSON values."""
        place = self._ahead[0].place if self._ahead else self._place()
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

    def _shuffled(self) -> IntArray:
        """All pairs' indices in a random order."""
        return self._rng.permutation(len(self._pairs)).astype(np.int64)

    def _next(self) -> int:
        if self._position == len(self._order):
            self._order = self._shuffled()
            self._position = 0
        index = self._order[self._position]
        self._position += 1
        return int(index)

    def _drawn(self) -> list[tuple[int, int]]:
        """(index, seed of the changes) of the next pair, and of another one if others are wanted."""
        # A seed per sample, so that what one sample draws doesn't shift the others' draws.
        indices = [self._next()]
        if self._others:
            indices.append(self._other(indices[0]))
        seeds = self._rng.integers(0, 2**63, len(indices)).tolist()
        return list(zip(indices, seeds, strict=True))

    def _sample(self, drawn: list[tuple[int, int]]) -> list[_Pair]:
        """The drawn pairs, changed."""
        # Unassociated targets go through the same transform, or the discriminator could recognise them by it.
        return [self._changed(index, np.random.default_rng(seed)) for index, seed in drawn]

    def _changed(self, index: int, rng: np.random.Generator) -> _Pair:
        translator = self._config.translator
        to_layers = translator.output_encoding == "layers"
        cad = self._with_doors(index) if to_layers else self._pairs.cad[index]
        slam = self._pairs.slam[index]
        if self._config.augment:
            cad, slam = augment(cad, slam, translator.input_size, rng)
        symmetry = int(rng.integers(8)) if self._config.flips else 0
        cad = np.ascontiguousarray(flipped(cad, symmetry))
        slam = np.ascontiguousarray(flipped(slam, symmetry))
        if to_layers:
            # The zoom changes the scale by a few per cent, which the layers needn't know.
            scale = self._pairs.usual_scale(index)
            doors = cad[..., 1] > FREE // 2
            cad = layer_shares(cad[..., 0], doors, slam, scale)
        return _Pair(cad, slam)

    def _with_doors(self, index: int) -> ByteArray:
        """(S, S, 2): the CAD map and its doors, which are found once."""
        cad = self._pairs.cad[index]
        if index not in self._doors:
            scale = self._pairs.usual_scale(index)
            found = door_cells(cad > FREE // 2, scale)
            self._doors[index] = np.flatnonzero(found)
        doors = np.zeros_like(cad)
        doors.ravel()[self._doors[index]] = FREE
        return np.dstack([cad, doors])

    def _other(self, index: int) -> int:
        """Index of a pair with another CAD map, if the draws find one."""
        cads = self._pairs.cad
        other = index
        for _ in range(MAX_REDRAWS):
            other = int(self._rng.integers(len(cads)))
            if other != index and not np.array_equal(cads[other], cads[index]):
                break
        return other


def _stacked(pairs: Sequence[_Pair]) -> _Pair:
    cads = np.stack([pair.cad for pair in pairs])
    slams = np.stack([pair.slam for pair in pairs])
    return _Pair(cads, slams)
