"""Contents of a dataset: tables by condition, a few lines of text, and pairs for a sheet."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.progress import counted
from slamgym.core.types import FloatArray, IntArray
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, iterate_verdicts
from slamgym.dataset.folder import read_rejected, read_times
from slamgym.dataset.format import Layout, load_pair, read_manifest
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord
from slamgym.interop import read_tum
from slamgym.viz.sheets import SheetEntry

MAX_VALUES = 6
"""A condition with more different numbers is shown in ranges."""
RANGES = 4
"""Ranges in which many different numbers are shown."""


class ValueColumn:
    """One value of each record, numbers or words, of which each different one is kept once."""

    def __init__(self, missing: int = 0) -> None:
        self._codes = array("i", [-1]) * missing
        self._known: dict[Any, int] = {}

    def add(self, value: Any) -> None:
        """Add the value of the next record; None if it has none."""
        known = self._known
        key = value if type(value) in (int, float, str) else str(value)
        self._codes.append(-1 if value is None else known.setdefault(key, len(known)))

    @property
    def codes(self) -> IntArray:
        """Number of the value of each record, -1 where it has none, shape (N,)."""
        return np.frombuffer(self._codes, dtype=np.int32) if self._codes else np.empty(0, np.int32)

    def counts(self) -> dict[str, int]:
        """Number of records with each value, the most frequent first."""
        codes = self.codes
        counts: Counter[str] = Counter()
        for value, code in self._known.items():
            counts[value] = int((codes == code).sum())
        return dict(counts.most_common())

    def groups(self) -> dict[str, IntArray]:
        """Places of the records by the value; many different numbers are gathered in ranges."""
        numbers = sorted(value for value in self._known if not isinstance(value, str))
        words = sorted(value for value in self._known if isinstance(value, str))
        found: dict[str, IntArray] = {}
        if len(numbers) > MAX_VALUES and not words:
            found = self._ranges(numbers)
        else:
            for key in (*numbers, *words):
                found[str(key)] = np.flatnonzero(self.codes == self._known[key])
        missing = np.flatnonzero(self.codes < 0)
        if len(missing):
            found["not set"] = missing
        return found

    def _ranges(self, numbers: list[float]) -> dict[str, IntArray]:
        """Ranges of equal width; 0 is a separate case where nothing is less."""
        values = np.array([*self._known, math.nan])[self.codes]  # -1 is the last
        found = {}
        if numbers[0] == 0:
            found[str(numbers.pop(0))] = np.flatnonzero(values == 0)
        edges = np.linspace(numbers[0], numbers[-1], RANGES + 1)
        place = np.minimum(np.searchsorted(edges, values, side="right"), RANGES) - 1
        for number in range(RANGES):
            chosen = np.flatnonzero((values >= numbers[0]) & (place == number))
            if len(chosen):
                found[f"{edges[number]:.2g} to {edges[number + 1]:.2g}"] = chosen
        return found


class _Figures(NamedTuple):
    """Figures of the records that are summarised, each of shape (N,)."""

    coverage: FloatArray
    robot_seconds: FloatArray
    ate: FloatArray
    odometry_ate: FloatArray
    map_error: FloatArray


class RecordColumns:
    """Contents of a million records in columns: about 300 bytes each, where the records take 5000.

    Args:
        records: Are read one by one.
    """

    def __init__(self, records: Iterable[PairRecord]) -> None:
        self.conditions: dict[str, ValueColumn] = {}
        self.plans = ValueColumn()
        self.endings = ValueColumn()
        self.kinds = ValueColumn()
        keys = array("q")
        figures = array("d")
        for place, record in enumerate(records):
            # By hashes other lists are joined; equal ones are as good as impossible.
            keys.append(hash(record.name))
            figures.append(record.coverage)
            figures.append(record.robot_seconds)
            figures.append(record.ate)
            figures.append(record.odometry_ate)
            figures.append(record.map_error)
            self.plans.add(record.plan_id)
            self.endings.add(record.finished)
            self.kinds.add(_kind_of_plan(record))
            for name in record.conditions.keys() - self.conditions.keys():
                self.conditions[name] = ValueColumn(place)
            for name, column in self.conditions.items():
                column.add(record.conditions.get(name))
        self._keys = np.array(keys)
        coverage, robot_seconds, ate, odometry_ate, map_error = np.array(figures).reshape(-1, 5).T
        self.figures = _Figures(
            coverage=coverage,
            robot_seconds=robot_seconds,
            ate=ate,
            odometry_ate=odometry_ate,
            map_error=map_error,
        )

    def __len__(self) -> int:
        return len(self._keys)

    def joined(self, names: Iterable[tuple[str, float]]) -> FloatArray:
        """Values of another list in the order of the records, shape (N,); nan where it has none."""
        keys = array("q")
        values = array("d")
        for name, value in names:
            keys.append(hash(name))
            values.append(value)
        found = np.full(len(self), np.nan)
        # Of several values the last counts, which is the first of the reversed list.
        _, here, there = np.intersect1d(self._keys, np.array(keys)[::-1], return_indices=True)
        found[here] = np.array(values)[::-1][there]
        return found

    def groupings(self) -> Iterator[tuple[str, dict[str, IntArray]]]:
        """Every way to group the records that gives more than one group."""
        for name, column in [("plans", self.kinds), *sorted(self.conditions.items())]:
            groups = column.groups()
            if len(groups) > 1:
                yield name, groups


def _kind_of_plan(record: PairRecord) -> str:
    """Generated plans by their kind, all others as files."""
    if not record.plan_source.startswith("generator:"):
        return "from files"
    name = record.plan_id.rstrip("0123456789~").rstrip("_").rstrip("0123456789").rstrip("_")
    return f"generated {name}"


@dataclass(frozen=True)
class GroupStatistics:
    """Figures of some pairs."""

    pairs: int
    plans: int
    robot_hours: float
    complete: float
    """Share of the pairs that saw 95 % of the reachable floor or more."""
    kept: float | None
    """Share of the pairs that cleaning keeps; None if the dataset wasn't cleaned."""
    coverage: tuple[float, float]
    """5th percentile and median."""
    ate: tuple[float, float]
    """Position error: median and 95th percentile [m]."""
    odometry_ate: float
    """Median of the wheels' own position error [m]."""
    map_error: tuple[float, float]
    """Median and 95th percentile [m]."""
    minutes: tuple[float, float]
    """Robot time: median and longest [min]."""
    cpu_seconds: float | None
    """Mean computing time of an exploration [s]; None where it isn't known."""


@dataclass(frozen=True)
class DatasetStatistics:
    """Everything that ``slamgym dataset stats`` shows."""

    dataset: str
    whole: GroupStatistics
    endings: dict[str, int]
    """Pairs by the reason why the exploration ended."""
    rejected: dict[str, int]
    """Plans that gave no pair, by the kind of error."""
    left_out: dict[str, int]
    """Pairs that cleaning drops, by reason."""
    by_condition: dict[str, dict[str, GroupStatistics]] = field(default_factory=dict)
    """For each condition that varies, the figures by its value; also by kind of plan."""


def dataset_statistics(root: Path | str) -> DatasetStatistics:
    """Summarise a dataset of any size; a million records take some 50 CPU seconds and 0.3 GB.

    Raises:
        InputFileError: If the folder holds no dataset or a list is malformed.
    """
    layout = Layout(Path(root))
    dropped = Counter[str]()
    columns = RecordColumns(read_manifest(layout.root))
    kept = columns.joined(_verdicts(layout.root, dropped))
    seconds = columns.joined(
        (name, times["cpu_seconds"]) for name, times in read_times(layout.timing)
    )
    rejected = {
        entry["plan_id"]: entry["error"] for entry in read_rejected(layout.rejected).values()
    }

    def summarise(places: IntArray) -> GroupStatistics:
        return _summarise(columns, places, kept[places], seconds[places])

    return DatasetStatistics(
        dataset=str(root),
        whole=summarise(np.arange(len(columns))),
        endings=columns.endings.counts(),
        rejected=dict(Counter(rejected.values()).most_common()),
        left_out=dict(dropped.most_common()),
        by_condition={
            name: {label: summarise(places) for label, places in groups.items()}
            for name, groups in columns.groupings()
        },
    )


def _verdicts(root: Path, dropped: Counter[str]) -> Iterator[tuple[str, float]]:
    """Name and 1 if it is kept, of what was cleaned; the reasons of the others are counted."""
    for verdict in iterate_verdicts(root) if (root / VERDICTS_FILE).is_file() else ():
        if not verdict.keep:
            dropped[verdict.kind] += 1
        yield verdict.name, float(verdict.keep)


def _summarise(
    columns: RecordColumns, places: IntArray, kept: FloatArray, seconds: FloatArray
) -> GroupStatistics:
    times = seconds[~np.isnan(seconds)]
    judged = kept[~np.isnan(kept)]
    figures = columns.figures
    coverage = figures.coverage[places]
    minutes = figures.robot_seconds[places] / 60.0
    return GroupStatistics(
        pairs=len(places),
        plans=len(np.unique(columns.plans.codes[places])),
        robot_hours=float(minutes.sum() / 60.0),
        complete=float(np.mean(coverage >= GOOD_COVERAGE)) if len(places) else 0.0,
        kept=float(np.mean(judged)) if len(judged) else None,
        coverage=_percentiles(coverage, 5, 50),
        ate=_percentiles(figures.ate[places], 50, 95),
        odometry_ate=_percentiles(figures.odometry_ate[places], 50, 50)[0],
        map_error=_percentiles(figures.map_error[places], 50, 95),
        minutes=_percentiles(minutes, 50, 100),
        cpu_seconds=float(np.mean(times)) if len(times) else None,
    )


def _percentiles(values: FloatArray, first: float, second: float) -> tuple[float, float]:
    if len(values) == 0:
        return 0.0, 0.0
    low, high = np.percentile(values, [first, second])
    return float(low), float(high)


def describe_pairs(root: Path | str) -> str:
    """Summarise a dataset in a few lines of text.

    Raises:
        InputFileError: If the folder holds no dataset.
    """
    columns = RecordColumns(read_manifest(root))
    if len(columns) == 0:
        return f"{root}: no pairs"
    unknown = np.full(len(columns), np.nan)
    whole = _summarise(columns, np.arange(len(columns)), unknown, unknown)
    endings = ", ".join(f"{count} {reason}" for reason, count in columns.endings.counts().items())
    return "\n".join(
        [
            f"{root}: {counted(whole.pairs, 'pair')} of {counted(whole.plans, 'plan')}",
            f"  coverage        median {100 * whole.coverage[1]:.1f} %, "
            f"{100 * whole.complete:.0f} % of the pairs at {100 * GOOD_COVERAGE:.0f} % or more",
            f"  robot time      median {whole.minutes[0]:.1f} min, longest {whole.minutes[1]:.1f} min",
            f"  ended by        {endings}",
            f"  position error  median {whole.ate[0]:.3f} m, of one in twenty above {whole.ate[1]:.3f} m "
            f"(wheels alone: median {whole.odometry_ate:.3f} m)",
            f"  wall error      median {whole.map_error[0]:.3f} m, of one in twenty above {whole.map_error[1]:.3f} m",
        ]
    )


def sheet_entries(root: Path | str, records: Sequence[PairRecord]) -> list[SheetEntry]:
    """Read the pairs of some records for a contact sheet."""
    entries = []
    for record in records:
        cad, slam = load_pair(root, record.name)
        estimate = Layout(Path(root)).episode(record.name) / "estimate.tum"
        path = np.empty((0, 2))
        if estimate.is_file():  # a network maps without a path
            path = read_tum(estimate).poses[:, :2]
        details = (
            f"{100 * record.coverage:.1f} % covered in {record.robot_seconds / 60:.1f} min, "
            f"{record.path_length:.0f} m; errors: pose {record.ate:.2f} m (wheels {record.odometry_ate:.2f} m), "
            f"walls {record.map_error:.3f} m"
        )
        entries.append(SheetEntry(record.plan_id, details, cad, slam, record.frame, path))
    return entries
