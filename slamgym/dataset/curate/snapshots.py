"""Maps as they were in the middle of an exploration, drawn again from what a dataset keeps.

A finished dataset has few incomplete maps to learn from. But each exploration was incomplete for most of its
time: its scans up to some moment, drawn at the estimated poses, are the map of that moment, and the truth
says how complete it was. Nothing is simulated again.

The poses are those of the path as corrected by the end, so loops that were closed later are closed already.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.config import from_dict
from slamgym.core.errors import InputFileError
from slamgym.core.progress import show_progress
from slamgym.core.types import (
    FREE,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    LaserGeometry,
    Trajectory,
)
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.curate.criteria import STUCK_PATH, Criteria, StuckFilter, has_clutter
from slamgym.dataset.format import Layout, load_pair, read_dataset_config
from slamgym.dataset.record import PairRecord
from slamgym.interop import read_carmen, read_tum
from slamgym.metrics import absolute_trajectory_error, wall_error
from slamgym.slam import SlamConfig
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap

MINUTES = (0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0)
"""Robot times at which explorations are looked at, besides their end [min]: after 0.1 the map
is that of a robot that got stuck at its start, and 7 is the paper's limit."""


@dataclass(frozen=True)
class Snapshot:
    """The map at one moment of an exploration, and how good it truly was."""

    plan_id: str
    time: float
    """Since the start [s]."""
    is_last: bool
    """Whether it is the map at the exploration's end."""
    cells: ByteArray  # (rows, cols), in the pair's frame
    resolution: float
    """[m/px]"""
    path_length: float
    """Truly driven so far [m]."""
    coverage: float
    """Share of the reachable floor that was truly seen."""
    ate: float
    """Position error of the path so far [m]."""
    map_error: float
    """Mean distance of the occupied cells to the nearest CAD wall [m]."""


def take_snapshots(
    root: Path | str, record: PairRecord, minutes: Sequence[float] = MINUTES
) -> Iterator[Snapshot]:
    """Draw the map of an exploration at some moments and at its end.

    The true coverage of a moment is the share of the finally seen floor that had been seen by then, times the
    final coverage: scans drawn at the true poses show which cells were seen.

    Args:
        root: The dataset.
        record: Its record of the pair.
        minutes: Robot times [min]; those after the end are left out.

    Raises:
        InputFileError: If a file of the exploration is missing or malformed.
    """
    recording = _read_recording(Path(root), record)
    cad, last_map = load_pair(root, record.name)
    ends = [60.0 * limit for limit in sorted(minutes) if 60.0 * limit < recording.stamps[-1]]
    believed, true = _canvas(recording), _canvas(recording)
    open_range = np.nextafter(np.float32(recording.geometry.range_max), np.float32(0.0))
    moments: list[tuple[float, ByteArray, int]] = []
    drawn_scans = drawn_poses = 0
    for end in [*ends, float(recording.stamps[-1])]:
        scans = int(np.searchsorted(recording.stamps, end, side="right"))
        poses = int(np.searchsorted(recording.estimate.stamps, end + 1e-6, side="right"))
        chosen = recording.scan_of_pose[drawn_poses:poses]
        believed.draw(recording.estimate.poses[drawn_poses:poses], recording.ranges[chosen])
        # What lies open is seen, whatever the mapper makes of beams without return.
        sight = np.minimum(recording.ranges[drawn_scans:scans], open_range)
        true.draw(recording.truth.poses[drawn_scans:scans], sight)
        drawn_scans, drawn_poses = scans, poses
        seen = int(np.count_nonzero((true.render(record.frame) == FREE) & (cad == FREE)))
        moments.append((end, believed.render(record.frame), seen))
    finally_seen = max(moments[-1][2], 1)
    for end, drawn, seen in moments:
        is_last = end == recording.stamps[-1]
        cells = last_map if is_last else drawn
        yield Snapshot(
            plan_id=record.plan_id,
            time=end,
            is_last=is_last,
            cells=cells,
            resolution=record.resolution,
            path_length=_driven_until(recording, end),
            coverage=record.coverage if is_last else record.coverage * min(seen / finally_seen, 1.0),
            ate=record.ate if is_last else _error_until(recording, end),
            map_error=record.map_error if is_last else wall_error(cells, cad, record.frame.resolution),
        )


@dataclass(frozen=True)
class _Recording:
    """What an exploration's folder holds."""

    stamps: FloatArray  # (scans,) [s]
    ranges: Float32Array  # (scans, num_beams) [m]
    truth: Trajectory  # one pose a scan, map frame
    estimate: Trajectory  # one pose a processed scan, map frame
    scan_of_pose: np.ndarray  # (processed scans,) which scan each estimated pose belongs to
    geometry: LaserGeometry
    slam: SlamConfig


def _read_recording(root: Path, record: PairRecord) -> _Recording:
    folder = Layout(root).episode(record.name)
    log = read_carmen(_scans_file(folder))
    truth, estimate = read_tum(folder / "truth.tum"), read_tum(folder / "estimate.tum")
    stamps = np.array([entry.stamp for entry in log])
    if len(stamps) != len(truth):
        raise InputFileError(
            folder, f"has {len(stamps)} scans but {len(truth)} true poses; run `slamgym generate` again"
        )
    # Stamps are written with microseconds.
    scan_of_pose = np.searchsorted(stamps, estimate.stamps - 1e-5)
    if (scan_of_pose >= len(stamps)).any():
        raise InputFileError(folder / "estimate.tum", "has a pose after the last scan")
    return _Recording(
        stamps=stamps,
        ranges=np.stack([entry.scan.ranges for entry in log]).astype(np.float32),
        truth=truth,
        estimate=estimate,
        scan_of_pose=scan_of_pose,
        geometry=log.geometry,
        slam=_slam_settings(root, record),
    )


def _scans_file(folder: Path) -> Path:
    """The log of the scans, compressed or not."""
    plain = folder / "scans.log"
    return plain if plain.exists() else folder / "scans.log.gz"


def _slam_settings(root: Path, record: PairRecord) -> SlamConfig:
    """How the maps of the dataset were drawn: its settings, and what the pair's conditions changed."""
    settings = read_dataset_config(root)
    try:
        values: dict[str, Any] = dict(settings["episode"]["env"]["slam"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputFileError(Layout(root).config, f"lacks the settings of SLAM ({error})") from error
    for name, value in record.conditions.items():
        part, _, setting = name.partition(".")
        if part == "slam":
            values[setting] = value
    return from_dict(SlamConfig, values, str(Layout(root).config))


def _canvas(recording: _Recording) -> HitCountMap:
    return HitCountMap(BeamTable.of(recording.geometry, recording.slam), recording.slam)


def _error_until(recording: _Recording, end: float) -> float:
    """RMSE of the estimated positions up to a moment [m]."""
    poses = max(int(np.searchsorted(recording.estimate.stamps, end, side="right")), 1)
    path = Trajectory(recording.estimate.stamps[:poses], recording.estimate.poses[:poses])
    return float(absolute_trajectory_error(path, recording.truth, align=False).translation.rmse)


def _driven_until(recording: _Recording, end: float) -> float:
    """True path length up to a moment [m]."""
    scans = int(np.searchsorted(recording.stamps, end, side="right"))
    return Trajectory(recording.stamps[:scans], recording.truth.poses[:scans]).length


StrArray = NDArray[np.str_]
_COLUMN_TYPES = (float, bool, float, float, bool, bool, bool, str, str)


@dataclass(frozen=True)
class LabelledMaps:
    """Snapshots of explorations; arrays of the same length N."""

    features: FloatArray  # (N, 15)
    complete: BoolArray  # by the truth
    coverage: FloatArray  # true
    minutes: FloatArray  # robot time since the start [min]
    is_last: BoolArray  # whether the exploration ended there
    is_stuck: BoolArray  # by the truth: hardly driven, and incomplete
    looks_stuck: BoolArray  # by the filter, from the map alone
    plan_ids: StrArray
    sources: StrArray  # what each comes from, e.g. the dataset's name

    def __len__(self) -> int:
        return len(self.complete)

    def where(self, chosen: BoolArray) -> "LabelledMaps":
        """Some of the maps."""
        return LabelledMaps(*(getattr(self, field.name)[chosen] for field in dataclasses.fields(self)))

    @property
    def learnable(self) -> BoolArray:
        """Which maps the classifier learns from: those that the stuck filter lets through."""
        return ~self.looks_stuck


def label_maps(
    pairs: Sequence[tuple[Path, PairRecord]],
    criteria: Criteria,
    stuck: StuckFilter,
    minutes: Sequence[float] = MINUTES,
) -> LabelledMaps:
    """Draw the maps of explorations at some moments, measure them, and label them by the truth.

    Args:
        pairs: Datasets and their records of pairs.
        criteria: When a map is complete.
        stuck: Finds which maps look like those of a stuck robot.
        minutes: Robot times besides the end [min].

    Raises:
        InputFileError: If a file of an exploration is missing or malformed.
    """
    rows: list[tuple[FloatArray, bool, float, float, bool, bool, bool, str, str]] = []
    with show_progress("explorations", 0, len(pairs)) as advance:
        for root, record in pairs:
            clutter = has_clutter(record)
            for shot in take_snapshots(root, record, minutes):
                features = completeness_features(shot.cells, shot.resolution)
                faults = criteria.faults(shot.coverage, shot.map_error, shot.ate, has_clutter=clutter)
                rows.append(
                    (
                        features,
                        not faults,
                        shot.coverage,
                        shot.time / 60.0,
                        shot.is_last,
                        shot.path_length < STUCK_PATH and shot.coverage < criteria.min_coverage,
                        stuck.fault(features, shot.resolution) is not None,
                        shot.plan_id,
                        root.name,
                    )
                )
            advance()
    columns = list(zip(*rows, strict=True)) or [()] * len(_COLUMN_TYPES)
    arrays: list[NDArray[Any]] = [
        np.array(column, dtype=kind) for column, kind in zip(columns, _COLUMN_TYPES, strict=True)
    ]
    return LabelledMaps(arrays[0].reshape(-1, len(FEATURES)), *arrays[1:])
