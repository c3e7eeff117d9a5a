"""What lies in a dataset, as tables: yield, errors, endings and bytes, as a whole and by condition."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, read_verdicts
from slamgym.dataset.folder import read_rejected
from slamgym.dataset.format import Layout, PairRecord, read_manifest
from slamgym.dataset.summary import GOOD_COVERAGE

MAX_VALUES = 6
"""A condition with more different numbers is told in ranges."""
RANGES = 4


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
    bytes: dict[str, int]
    """Bytes on disk: ``A``, ``B``, and the files of the explorations by name."""
    by_condition: dict[str, dict[str, GroupStatistics]] = field(default_factory=dict)
    """For each condition that varies, the figures by its value; also by kind of plan."""


def dataset_statistics(root: Path | str) -> DatasetStatistics:
    """Summarise a dataset.

    Raises:
        InputFileError: If the folder holds no dataset or a list is malformed.
    """
    layout = Layout(Path(root))
    records = list(read_manifest(root))
    verdicts = read_verdicts(root) if (layout.root / VERDICTS_FILE).is_file() else {}
    kept = {name: verdict.keep for name, verdict in verdicts.items()}
    seconds = read_cpu_seconds(layout.timing)
    rejected = {entry["plan_id"]: entry["error"] for entry in read_rejected(layout.rejected).values()}
    dropped = Counter(verdict.kind for verdict in verdicts.values() if not verdict.keep)
    return DatasetStatistics(
        dataset=str(root),
        whole=_summarise(records, kept, seconds),
        endings=dict(Counter(record.finished for record in records).most_common()),
        rejected=dict(Counter(rejected.values()).most_common()),
        left_out=dict(dropped.most_common()),
        bytes=bytes_on_disk(layout, records),
        by_condition={
            name: {label: _summarise(group, kept, seconds) for label, group in groups.items()}
            for name, groups in _groupings(records)
        },
    )


def read_cpu_seconds(path: Path) -> dict[str, float]:
    """Computing time of each exploration [s] by its name, as far as ``timing.jsonl`` has it."""
    if not path.is_file():
        return {}
    seconds = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
            seconds[str(entry["name"])] = float(entry["cpu_seconds"])
        except (ValueError, KeyError, TypeError):
            continue  # a run that was killed may leave a torn line; times are no part of the data
    return seconds


def bytes_on_disk(layout: Layout, records: Sequence[PairRecord]) -> dict[str, int]:
    """Sizes of the pairs' files, added up by kind; files that are missing count nothing."""
    sizes: Counter[str] = Counter()
    for record in records:
        for side in ("A", "B"):
            path = layout.image(side, record.name)
            sizes[side] += path.stat().st_size if path.is_file() else 0
        folder = layout.episode(record.name)
        for path in folder.iterdir() if folder.is_dir() else ():
            sizes[path.name] += path.stat().st_size
    return dict(sizes.most_common())


def group_by_condition(records: Sequence[PairRecord], name: str) -> dict[str, list[PairRecord]]:
    """The pairs by the value of one condition; many different numbers are gathered in ranges."""
    values = [record.conditions.get(name) for record in records]
    label = _labeller(values)
    groups: dict[str, list[PairRecord]] = {}
    order = sorted(range(len(records)), key=lambda index: _sort_key(values[index]))
    for index in order:
        groups.setdefault(label(values[index]), []).append(records[index])
    return groups


def _groupings(records: Sequence[PairRecord]) -> Iterator[tuple[str, dict[str, list[PairRecord]]]]:
    """Every way to group the pairs that gives more than one group."""
    kinds: dict[str, list[PairRecord]] = {}
    for record in records:
        kinds.setdefault(_kind_of_plan(record), []).append(record)
    if len(kinds) > 1:
        yield "plans", dict(sorted(kinds.items()))
    for name in sorted({name for record in records for name in record.conditions}):
        groups = group_by_condition(records, name)
        if len(groups) > 1:
            yield name, groups


def _kind_of_plan(record: PairRecord) -> str:
    """Generated plans by their kind, all others as files."""
    if record.plan_source.startswith("generator:"):
        return "generated " + record.plan_id.rstrip("0123456789~").rstrip("_").rstrip("0123456789").rstrip(
            "_"
        )
    return "from files"


def _labeller(values: Sequence[Any]) -> Any:
    """A function from a value to the name of its group."""
    numbers = sorted({value for value in values if isinstance(value, (int, float))})
    if len(numbers) <= MAX_VALUES or any(isinstance(value, str) for value in values):
        return lambda value: "not set" if value is None else str(value)
    low, high = numbers[0], numbers[-1]
    if low == 0:
        low = numbers[1]  # nothing at all is a case of its own
    edges = np.linspace(low, high, RANGES + 1)

    def label(value: Any) -> str:
        if value is None:
            return "not set"
        if value < low:
            return str(value)
        place = min(int(np.searchsorted(edges, value, side="right")), RANGES) - 1
        return f"{edges[place]:.2g} to {edges[place + 1]:.2g}"

    return label


def _sort_key(value: Any) -> tuple[int, float, str]:
    if isinstance(value, (int, float)):
        return 0, float(value), ""
    return (1, 0.0, str(value)) if value is not None else (2, 0.0, "")


def _summarise(
    records: Sequence[PairRecord], kept: Mapping[str, bool], seconds: Mapping[str, float]
) -> GroupStatistics:
    times = [seconds[record.name] for record in records if record.name in seconds]
    judged = [kept[record.name] for record in records if record.name in kept]
    minutes = _column(records, "robot_seconds") / 60.0
    return GroupStatistics(
        pairs=len(records),
        plans=len({record.plan_id for record in records}),
        robot_hours=float(minutes.sum() / 60.0),
        complete=float(np.mean(_column(records, "coverage") >= GOOD_COVERAGE)) if records else 0.0,
        kept=float(np.mean(judged)) if judged else None,
        coverage=_percentiles(_column(records, "coverage"), 5, 50),
        ate=_percentiles(_column(records, "ate"), 50, 95),
        odometry_ate=_percentiles(_column(records, "odometry_ate"), 50, 50)[0],
        map_error=_percentiles(_column(records, "map_error"), 50, 95),
        minutes=_percentiles(minutes, 50, 100),
        cpu_seconds=float(np.mean(times)) if times else None,
    )


def _column(records: Sequence[PairRecord], name: str) -> FloatArray:
    return np.array([getattr(record, name) for record in records], dtype=np.float64)


def _percentiles(values: FloatArray, first: float, second: float) -> tuple[float, float]:
    if len(values) == 0:
        return 0.0, 0.0
    low, high = np.percentile(values, [first, second])
    return float(low), float(high)
