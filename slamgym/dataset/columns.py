"""What a million records hold, as columns: some three hundred bytes each, where the records take five thousand."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from slamgym.core.types import FloatArray, IntArray
from slamgym.dataset.record import PairRecord

FIGURES = ("coverage", "robot_seconds", "ate", "odometry_ate", "map_error")
"""Figures of a record that are summarised."""
MAX_VALUES = 6
"""A condition with more different numbers is shown in ranges."""
RANGES = 4
_BATCH = 32  # records that are taken apart at once; of more the garbage collector makes a round
_FIGURES_OF = attrgetter(*FIGURES)


class Words:
    """A column of words, of which each is kept once."""

    def __init__(self) -> None:
        self.codes = array("i")
        self.known: dict[str, int] = {}

    def extend(self, words: Iterable[str]) -> None:
        """Add more."""
        known = self.known
        self.codes.extend([known.setdefault(word, len(known)) for word in words])


class ConditionColumn:
    """Values of one condition: numbers, or words, or neither where a record doesn't have it."""

    def __init__(self, missing: int) -> None:
        self.numbers = array("d", [math.nan]) * missing
        self.codes = array("i", [-1]) * missing
        self.words: dict[str, int] = {}
        self.few: dict[float, Any] = {}
        """The different numbers as they were given, up to one more than are shown singly."""
        self.zero: Any = 0

    def extend(self, values: Sequence[Any]) -> None:
        """Add more; None for records that have no such condition."""
        if {int, float}.issuperset(map(type, values)):
            self.numbers.extend(values)
            self.codes.extend([-1] * len(values))
            numbers = values
        else:
            numbers = [value for value in values if type(value) in (int, float)]
            self.numbers.extend(value if type(value) in (int, float) else math.nan for value in values)
            self.codes.extend(map(self._code, values))
        for number in dict.fromkeys(numbers):
            if number == 0:
                self.zero = number
            if len(self.few) <= MAX_VALUES:
                self.few.setdefault(number, number)

    def _code(self, value: Any) -> int:
        if value is None or type(value) in (int, float):
            return -1
        return self.words.setdefault(str(value), len(self.words))

    def groups(self) -> dict[str, IntArray]:
        """Places of the records by the value; many different numbers are gathered in ranges."""
        numbers, codes = np.frombuffer(self.numbers), np.frombuffer(self.codes, dtype=np.int32)
        found: dict[str, IntArray] = {}
        there = ~np.isnan(numbers)
        if there.any():
            found |= self._number_groups(numbers) if self._as_ranges else self._single_numbers(numbers)
        for word, code in sorted(self.words.items()):
            found[word] = np.flatnonzero(codes == code)
        missing = np.flatnonzero(~there & (codes < 0))
        return found | ({"not set": missing} if len(missing) else {})

    @property
    def _as_ranges(self) -> bool:
        return len(self.few) > MAX_VALUES and not self.words

    def _single_numbers(self, numbers: FloatArray) -> dict[str, IntArray]:
        if len(self.few) <= MAX_VALUES:
            return {str(shown): np.flatnonzero(numbers == value) for value, shown in sorted(self.few.items())}
        values, place = np.unique(numbers, return_inverse=True)
        return {
            f"{value:g}": np.flatnonzero(place == i) for i, value in enumerate(values) if not np.isnan(value)
        }

    def _number_groups(self, numbers: FloatArray) -> dict[str, IntArray]:
        """Ranges of equal width; nothing at all is a case of its own."""
        low, high = float(np.nanmin(numbers)), float(np.nanmax(numbers))
        found = {}
        if low == 0.0:
            found[str(self.zero)] = np.flatnonzero(numbers == 0.0)
            low = float(np.nanmin(numbers[numbers > 0.0]))
        edges = np.linspace(low, high, RANGES + 1)
        place = np.minimum(np.searchsorted(edges, numbers, side="right"), RANGES) - 1
        inside = numbers >= low
        for number in range(RANGES):
            chosen = np.flatnonzero(inside & (place == number))
            if len(chosen):
                found[f"{edges[number]:.2g} to {edges[number + 1]:.2g}"] = chosen
        return found


@dataclass
class RecordColumns:
    """The records of a dataset, column by column."""

    keys: array[int] = field(default_factory=lambda: array("q"))
    """Hashes of the names, by which other lists are joined; equal ones are as good as impossible."""
    figures: array[float] = field(default_factory=lambda: array("d"))
    plans: Words = field(default_factory=Words)
    endings: Words = field(default_factory=Words)
    kinds: Words = field(default_factory=Words)
    """What kind of plan it was."""
    conditions: dict[str, ConditionColumn] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Iterable[PairRecord]) -> RecordColumns:
        """Gather the columns of records that are read one by one."""
        columns, remaining = cls(), iter(records)
        while batch := list(itertools.islice(remaining, _BATCH)):
            columns._extend(batch)
        return columns

    def __len__(self) -> int:
        return len(self.keys)

    def column(self, name: str) -> FloatArray:
        """One of the figures, shape (N,)."""
        return np.frombuffer(self.figures).reshape(-1, len(FIGURES))[:, FIGURES.index(name)]

    def joined(self, names: Iterable[tuple[str, float]]) -> FloatArray:
        """Values of another list in the order of the records, shape (N,); nan where it has none."""
        keys, values = array("q"), array("d")
        for name, value in names:
            keys.append(hash(name))
            values.append(value)
        found = np.full(len(self), np.nan)
        if len(keys):
            order = np.argsort(np.frombuffer(keys, dtype=np.int64), kind="stable")
            known = np.frombuffer(keys, dtype=np.int64)[order]
            own = np.frombuffer(self.keys, dtype=np.int64)
            place = np.minimum(np.searchsorted(known, own, side="right") - 1, len(known) - 1)
            hit = known[place] == own
            found[hit] = np.frombuffer(values)[order][place[hit]]
        return found

    def _extend(self, batch: list[PairRecord]) -> None:
        before = len(self)
        self.keys.extend([hash(record.name) for record in batch])
        for record in batch:
            self.figures.extend(_FIGURES_OF(record))
        self.plans.extend([record.plan_id for record in batch])
        self.endings.extend([record.finished for record in batch])
        self.kinds.extend(map(_kind_of_plan, batch))
        drawn = [record.conditions for record in batch]
        for name in {name for conditions in drawn for name in conditions} - self.conditions.keys():
            self.conditions[name] = ConditionColumn(before)
        for name, column in self.conditions.items():
            column.extend([conditions.get(name) for conditions in drawn])


def _kind_of_plan(record: PairRecord) -> str:
    """Generated plans by their kind, all others as files."""
    if not record.plan_source.startswith("generator:"):
        return "from files"
    name = record.plan_id.rstrip("0123456789~").rstrip("_").rstrip("0123456789").rstrip("_")
    return f"generated {name}"
