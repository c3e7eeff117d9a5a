"""Which plan is explored when, and with which seed: a pure function of the dataset's seed.

Nothing here depends on how many pairs are asked for, how many workers there are or in which order they
finish, so an interrupted, resumed or extended dataset is the same dataset.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Slot:
    """One place in the sequence of explorations."""

    index: int
    plan_id: str
    repetition: int
    """How many slots of the same plan come before."""
    seed: int

    @property
    def name(self) -> str:
        """Name of the pair's files; sorts by index."""
        return f"{self.index:06d}_{re.sub(r'[^A-Za-z0-9_.-]+', '-', self.plan_id)}"


def schedule(plan_ids: Sequence[str], seed: int) -> Iterator[Slot]:
    """Go through the plans in a shuffled order, over and over, without end."""
    order = np.random.default_rng(seed).permutation(len(plan_ids))
    index, repetition = 0, 0
    while True:
        for position in order:
            plan_id = plan_ids[position]
            yield Slot(index, plan_id, repetition, exploration_seed(seed, plan_id, repetition))
            index += 1
        repetition += 1


def exploration_seed(seed: int, plan_id: str, repetition: int) -> int:
    """The seed of one exploration, 0 to 2^63 - 1."""
    digest = hashlib.sha256(f"{seed}/{plan_id}/{repetition}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def ids_digest(plan_ids: Sequence[str]) -> str:
    """SHA-256 of a list of plan ids, so that a changed list is noticed."""
    digest = hashlib.sha256()
    for plan_id in plan_ids:
        digest.update(plan_id.encode() + b"\n")
    return digest.hexdigest()
