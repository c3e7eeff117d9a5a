"""What lies in a dataset: tables by condition, a few lines of text, and one picture of many pairs."""

from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.files import replace_file
from slamgym.core.png import encode_png
from slamgym.core.types import FloatArray
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, read_verdicts
from slamgym.dataset.folder import read_rejected, read_times
from slamgym.dataset.format import Layout, load_pair, read_manifest
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord
from slamgym.interop import read_tum
from slamgym.viz.sheets import SheetEntry, draw_contact_sheet

MAX_VALUES = 6
"""A condition with more different numbers is shown in ranges."""
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
    seconds = {name: float(entry["cpu_seconds"]) for name, entry in read_times(layout.timing).items()}
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


def describe_pairs(root: Path | str) -> str:
    """Summarise a dataset in a few lines of text.

    Raises:
        InputFileError: If the folder holds no dataset.
    """
    # A million records would not fit in memory; five numbers of each do.
    figures, plans, endings_count = array("d"), set[str](), Counter[str]()
    for record in read_manifest(root):
        figures.extend(
            (record.coverage, record.ate, record.odometry_ate, record.map_error, record.robot_seconds / 60.0)
        )
        plans.add(record.plan_id)
        endings_count[record.finished] += 1
    if not figures:
        return f"{root}: no pairs"
    coverage, ate, odometry, walls, minutes = np.frombuffer(figures).reshape(-1, 5).T
    complete = 100.0 * np.mean(coverage >= GOOD_COVERAGE)
    endings = ", ".join(f"{count} {reason}" for reason, count in endings_count.most_common())
    return "\n".join(
        [
            f"{root}: {len(coverage)} pairs of {len(plans)} plans",
            f"  coverage        median {100 * np.median(coverage):.1f} %, "
            f"{complete:.0f} % of the pairs at {100 * GOOD_COVERAGE:.0f} % or more",
            f"  robot time      median {np.median(minutes):.1f} min, longest {minutes.max():.1f} min",
            f"  ended by        {endings}",
            f"  position error  median {np.median(ate):.3f} m, worst {ate.max():.3f} m "
            f"(wheels alone: median {np.median(odometry):.3f} m)",
            f"  wall error      median {np.median(walls):.3f} m, worst {walls.max():.3f} m",
        ]
    )


def write_contact_sheet(root: Path | str, limit: int) -> Path:
    """Draw up to ``limit`` pairs, spread evenly over the dataset, into its ``contact_sheet.png``.

    Returns:
        The picture's path.

    Raises:
        InputFileError: If a file of the dataset is missing or malformed.
        StorageError: If the picture can't be written.
    """
    layout = Layout(Path(root))
    count = sum(1 for _ in read_manifest(root))
    places = set(np.linspace(0, count - 1, min(limit, count)).astype(int).tolist())
    chosen = [record for place, record in enumerate(read_manifest(root)) if place in places]
    heading = f"slamgym: {len(chosen)} of {count} pairs" if len(chosen) < count else "slamgym: map pairs"
    picture = draw_contact_sheet(heading, sheet_entries(root, chosen), columns=2)
    replace_file(layout.contact_sheet, encode_png(picture[:, :, ::-1]))
    return layout.contact_sheet


def sheet_entries(root: Path | str, records: Sequence[PairRecord]) -> list[SheetEntry]:
    """Read the pairs of some records for a contact sheet."""
    layout = Layout(Path(root))
    entries = []
    for record in records:
        cad, slam = load_pair(root, record.name)
        path = read_tum(layout.episode(record.name) / "estimate.tum").poses[:, :2]
        entries.append(SheetEntry(record.plan_id, _details(record), cad, slam, record.frame, path))
    return entries


def _details(record: PairRecord) -> str:
    return (
        f"{100 * record.coverage:.1f} % covered in {record.robot_seconds / 60:.1f} min, "
        f"{record.path_length:.0f} m; errors: pose {record.ate:.2f} m (wheels {record.odometry_ate:.2f} m), "
        f"walls {record.map_error:.3f} m"
    )
