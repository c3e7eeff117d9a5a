"""What lies in a dataset: tables by condition, a few lines of text, and one picture of many pairs."""

import io
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slamgym.core.files import open_regular, replace_file
from slamgym.core.png import encode_png
from slamgym.core.progress import counted
from slamgym.core.types import FloatArray, IntArray
from slamgym.dataset.columns import RecordColumns
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, iterate_verdicts
from slamgym.dataset.folder import read_rejected, read_seconds
from slamgym.dataset.format import SIDES, Layout, load_pair, read_manifest
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord
from slamgym.interop import read_tum
from slamgym.viz.sheets import SheetEntry, draw_contact_sheet

MOST_MEASURED = 20_000
"""Of more pairs the bytes on disk are those of so many, evenly spaced, scaled up."""


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
    """Bytes on disk: ``A``, ``B``, and the files of the explorations by name; of many pairs an estimate."""
    by_condition: dict[str, dict[str, GroupStatistics]] = field(default_factory=dict)
    """For each condition that varies, the figures by its value; also by kind of plan."""


def dataset_statistics(root: Path | str) -> DatasetStatistics:
    """Summarise a dataset of any size; a million records take some 50 CPU seconds and 0.3 GB.

    Raises:
        InputFileError: If the folder holds no dataset or a list is malformed.
    """
    layout = Layout(Path(root))
    measured = _spread_over(layout)
    sizes: Counter[str] = Counter()
    columns = RecordColumns.of(_count_bytes(layout, measured, sizes))
    dropped: Counter[str] = Counter()
    kept = columns.joined(_verdicts(layout.root, dropped))
    seconds = columns.joined(read_seconds(layout.timing))
    rejected = {entry["plan_id"]: entry["error"] for entry in read_rejected(layout.rejected).values()}
    everything = np.arange(len(columns))
    endings = (
        np.bincount(np.frombuffer(columns.endings.codes, dtype=np.int32)) if len(columns) else np.empty(0)
    )
    scale = len(columns) / min(max(len(columns), 1), MOST_MEASURED)
    return DatasetStatistics(
        dataset=str(root),
        whole=_summarise(columns, everything, kept, seconds),
        endings=dict(Counter(dict(zip(columns.endings.known, endings.tolist(), strict=True))).most_common()),
        rejected=dict(Counter(rejected.values()).most_common()),
        left_out=dict(dropped.most_common()),
        bytes={name: round(size * scale) for name, size in sizes.most_common()},
        by_condition={
            name: {label: _summarise(columns, places, kept, seconds) for label, places in groups.items()}
            for name, groups in _groupings(columns)
        },
    )


def _spread_over(layout: Layout) -> Callable[[int], bool]:
    """Which places of the manifest are looked at on the disk: all, or so many evenly spaced ones."""
    with open_regular(layout.manifest) if layout.manifest.is_file() else io.BytesIO() as file:
        count = sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))
    if count <= MOST_MEASURED:
        return lambda place: True  # noqa: ARG005 - all of them
    chosen = frozenset(np.linspace(0, count - 1, MOST_MEASURED).astype(int).tolist())
    return chosen.__contains__


def _count_bytes(
    layout: Layout, measured: Callable[[int], bool], sizes: Counter[str]
) -> Iterator[PairRecord]:
    """The records, and on the way the sizes of their files, added up by kind; missing files count nothing."""
    for place, record in enumerate(read_manifest(layout.root)):
        if measured(place):
            for side in SIDES:
                path = layout.image(side, record.name)
                sizes[side] += path.stat().st_size if path.is_file() else 0
            folder = layout.episode(record.name)
            for path in folder.iterdir() if folder.is_dir() else ():
                sizes[path.name] += path.stat().st_size
        yield record


def _verdicts(root: Path, dropped: Counter[str]) -> Iterator[tuple[str, float]]:
    """Name and whether it is kept, of what was cleaned; the reasons of the others are counted."""
    for verdict in iterate_verdicts(root) if (root / VERDICTS_FILE).is_file() else ():
        if not verdict.keep:
            dropped[verdict.kind] += 1
        yield verdict.name, float(verdict.keep)


def _groupings(columns: RecordColumns) -> Iterator[tuple[str, dict[str, IntArray]]]:
    """Every way to group the pairs that gives more than one group."""
    if len(columns.kinds.known) > 1:
        codes = np.frombuffer(columns.kinds.codes, dtype=np.int32)
        yield (
            "plans",
            {kind: np.flatnonzero(codes == code) for kind, code in sorted(columns.kinds.known.items())},
        )
    for name, column in sorted(columns.conditions.items()):
        groups = column.groups()
        if len(groups) > 1:
            yield name, groups


def _summarise(
    columns: RecordColumns, places: IntArray, kept: FloatArray, seconds: FloatArray
) -> GroupStatistics:
    times, judged = (values[places][~np.isnan(values[places])] for values in (seconds, kept))
    minutes = columns.column("robot_seconds")[places] / 60.0
    coverage = columns.column("coverage")[places]
    return GroupStatistics(
        pairs=len(places),
        plans=len(np.unique(np.frombuffer(columns.plans.codes, dtype=np.int32)[places]))
        if len(places)
        else 0,
        robot_hours=float(minutes.sum() / 60.0),
        complete=float(np.mean(coverage >= GOOD_COVERAGE)) if len(places) else 0.0,
        kept=float(np.mean(judged)) if len(judged) else None,
        coverage=_percentiles(coverage, 5, 50),
        ate=_percentiles(columns.column("ate")[places], 50, 95),
        odometry_ate=_percentiles(columns.column("odometry_ate")[places], 50, 50)[0],
        map_error=_percentiles(columns.column("map_error")[places], 50, 95),
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
            f"{root}: {counted(len(coverage), 'pair')} of {counted(len(plans), 'plan')}",
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
