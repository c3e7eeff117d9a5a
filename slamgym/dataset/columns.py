"""What a million records hold, as columns: some three hundred bytes each, where the records take five thousand."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slamgym.core.types import FloatArray, IntArray
from slamgym.dataset.record import PairRecord

FIGURES = ("coverage", "robot_seconds", "ate", "odometry_ate", "map_error")
"""Figures of a record that are summarised."""
MAX_VALUES = 6
"""A condition with more different numbers is shown in ranges."""
RANGES = 4


class Words:
    """A column of words, of which each is kept once."""

    def __init__(self) -> None:
        self.codes = array("i")
        self.known: dict[str, int] = {}

    def append(self, word: str) -> None:
        """Add one more."""
        self.codes.append(self.known.setdefault(word, len(self.known)))


class ConditionColumn:
    """Values of one condition: numbers, or words, or neither where a record doesn't have it."""

    def __init__(self, missing: int) -> None:
        self.numbers = array("d", [math.nan]) * missing
        self.codes = array("i", [-1]) * missing
        self.words: dict[str, int] = {}
        self.few: dict[float, Any] = {}
        """The different numbers as they were given, up to one more than are shown singly."""
        self.zero: Any = 0

    def append(self, value: Any) -> None:
        """Add one more; None if the record has no such condition."""
        if type(value) in (int, float):
            self.numbers.append(value)
            self.codes.append(-1)
            if value == 0:
                self.zero = value
            if len(self.few) <= MAX_VALUES:
                self.few.setdefault(value, value)
        else:
            self.numbers.append(math.nan)
            self.codes.append(-1 if value is None else self.words.setdefault(str(value), len(self.words)))

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
        columns = cls()
        for record in records:
            columns._append(record)
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

    def _append(self, record: PairRecord) -> None:
        self.keys.append(hash(record.name))
        self.figures.extend([getattr(record, name) for name in FIGURES])
        self.plans.append(record.plan_id)
        self.endings.append(record.finished)
        self.kinds.append(_kind_of_plan(record))
        for name in record.conditions.keys() - self.conditions.keys():
            self.conditions[name] = ConditionColumn(len(self.keys) - 1)
        for name, column in self.conditions.items():
            column.append(record.conditions.get(name))


def _kind_of_plan(record: PairRecord) -> str:
    """Generated plans by their kind, all others as files."""
    if not record.plan_source.startswith("generator:"):
        return "from files"
    name = record.plan_id.rstrip("0123456789~").rstrip("_").rstrip("0123456789").rstrip("_")
    return f"generated {name}"
