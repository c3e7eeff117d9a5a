"""Which plan is explored when, and with which seed: a pure function of the dataset's seed.

Nothing here depends on how many pairs are asked for, how many workers there are or in which order they
finish, so an interrupted, resumed or extended dataset is the same dataset.
"""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from slamgym.cad import PlanGroup


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


def schedule(plan_ids: Sequence[str], seed: int, trajectories: int = 1) -> Iterator[Slot]:
    """Go through the plans in a shuffled order, over and over, without end.

    Args:
        plan_ids: The plans.
        seed: Of the order and of the explorations.
        trajectories: How many explorations of a plan come one after the other.
    """
    from slamgym.cad import PlanGroup

    return schedule_groups([PlanGroup(plan_ids, 1.0)], seed, trajectories)


def schedule_groups(groups: Sequence[PlanGroup], seed: int, trajectories: int = 1) -> Iterator[Slot]:
    """Go through the plans of several sources at once, each as often as its weight says.

    The sources take turns as evenly as their weights allow (smooth weighted round robin), so that every
    beginning of the sequence has their proportions. Within a source the order is shuffled.
    """
    total = sum(group.weight for group in groups)
    credits = [0.0] * len(groups)
    turns = [_rounds(group.ids, seed, number) for number, group in enumerate(groups)]
    index = 0
    while True:
        credits = [credit + group.weight for credit, group in zip(credits, groups, strict=True)]
        chosen = credits.index(max(credits))
        credits[chosen] -= total
        plan_id, turn = next(turns[chosen])
        for repetition in range(turn * trajectories, (turn + 1) * trajectories):
            yield Slot(index, plan_id, repetition, exploration_seed(seed, plan_id, repetition))
            index += 1


def _rounds(plan_ids: Sequence[str], seed: int, number: int) -> Iterator[tuple[str, int]]:
    """The plans of one source in its order, and how often each came before."""
    order = np.random.default_rng((seed, number) if number else seed).permutation(len(plan_ids))
    for turn in itertools.count():
        for position in order:
            yield plan_ids[position], turn


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
