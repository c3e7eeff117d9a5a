"""Training of the classifier of completeness: maps in the middle of explorations, Extra Trees, and their scores.

A finished dataset has few incomplete maps to learn from. But each exploration was incomplete for most of its
time: its scans up to some moment, drawn at the estimated poses, are the map of that moment, and the truth
says how complete it was. Nothing is simulated again.

The poses are those of the path as corrected by the end, so loops that were closed later are closed already.
"""

import dataclasses
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import brier_score_loss, roc_auc_score

from slamgym import __version__
from slamgym.core.config import from_dict
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import write_bytes
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
from slamgym.dataset.curate.completeness_model import LEAF, CompletenessModel
from slamgym.dataset.faults import STUCK_PATH, Criteria, has_clutter, stuck_fault
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
    """True if it is the map at the exploration's end."""
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
        # What lies open is seen, however the mapper treats beams without return.
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
    """Contents of an exploration's folder."""

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
    """SLAM settings of the dataset's maps: its own, and what the pair's conditions changed."""
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
    minutes: Sequence[float] = MINUTES,
) -> LabelledMaps:
    """Draw the maps of explorations at some moments, measure them, and label them by the truth.

    Args:
        pairs: Datasets and their records of pairs.
        criteria: When a map is complete.
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
                        stuck_fault(features, shot.resolution) is not None,
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


@dataclass(frozen=True)
class Trees:
    """Settings of the trees (Geurts, Ernst and Wehenkel, Extremely randomized trees, Machine Learning 2006)."""

    trees: int = 100
    """Their number."""
    min_leaf: int = 4
    """A leaf holds at least so many samples: fewer give bolder probabilities, which are worse calibrated."""
    max_features: int = 8
    """Features tried for a split."""
    seed: int = 0
    """Random seed of the thresholds."""


def train_completeness(
    features: FloatArray, complete: BoolArray, config: Trees, about: dict[str, Any] | None = None
) -> CompletenessModel:
    """Grow trees on maps of which the truth is known.

    Args:
        features: (N, 15).
        complete: (N,) whether each map is complete; both kinds must occur.
        config: The settings.
        about: What to note with the model.

    Raises:
        SlamgymError: If all maps are of one kind.
    """
    if complete.all() or not complete.any():
        kind = "complete" if len(complete) and complete.all() else "incomplete"
        raise SlamgymError(
            f"all {len(complete)} maps are {kind}; a classifier needs both kinds to learn from, "
            "e.g. explorations that were cut off early (slamgym generate --minutes 2)"
        )
    ensemble = ExtraTreesClassifier(
        n_estimators=config.trees,
        min_samples_leaf=config.min_leaf,
        max_features=config.max_features,
        random_state=config.seed,
        n_jobs=1,
    )
    ensemble.fit(features.astype(np.float32), complete)
    notes = {"version": __version__, "maps": len(complete), "complete": int(complete.sum())}
    trees = [estimator.tree_ for estimator in ensemble.estimators_]
    return _to_model(trees, {**notes, "trees": dataclasses.asdict(config), **(about or {})})


@dataclass(frozen=True)
class CrossFittedModel:
    """Models of which at least one has seen no map of a given plan.

    The plans are split into parts; each part's model learned from all the others, and ``whole`` from all.
    """

    whole: CompletenessModel
    parts: tuple[CompletenessModel, ...]
    part_of: dict[str, int]
    """Plan id to its part; other plans are left to ``whole``, which hasn't seen them either."""

    def probabilities(self, features: FloatArray, plan_ids: Sequence[str]) -> FloatArray:
        """Probability of being complete by a model that has seen no map of the same plan.

        Args:
            features: (N, 15).
            plan_ids: (N,).

        Returns:
            (N,).
        """
        part = np.array([self.part_of.get(plan_id, -1) for plan_id in plan_ids], dtype=np.int64)
        probabilities = np.zeros(len(part))
        for number in np.unique(part):
            chosen = part == number
            model = self.whole if number < 0 else self.parts[number]
            probabilities[chosen] = model.probabilities(features[chosen])
        return probabilities


def cross_fit(
    features: FloatArray,
    complete: BoolArray,
    plan_ids: Sequence[str],
    config: Trees,
    folds: int = 5,
) -> CrossFittedModel:
    """Train models for predictions on held-out plans.

    Args:
        features: (N, 15).
        complete: (N,).
        plan_ids: (N,) maps of one plan stay together.
        config: The settings.
        folds: Parts into which the plans are split; fewer where there are fewer plans.

    Raises:
        SlamgymError: If there are less than two plans, or one kind of maps alone
            is there, in all plans or outside some part.
    """
    plans = sorted(set(plan_ids))
    if len(plans) < 2:
        raise SlamgymError("held-out plans need at least two plans; add pairs of other plans")
    count = min(folds, len(plans))
    order = np.random.default_rng(config.seed).permutation(len(plans))
    part_of = {plans[place]: number % count for number, place in enumerate(order)}
    part = np.array([part_of[plan_id] for plan_id in plan_ids])
    whole = train_completeness(features, complete, config)
    parts = [
        train_completeness(features[part != number], complete[part != number], config)
        for number in range(count)
    ]
    return CrossFittedModel(whole, tuple(parts), part_of)


def _to_model(trees: Sequence[Any], about: dict[str, Any]) -> CompletenessModel:
    """Put scikit-learn's trees into one list of nodes."""
    sizes = [tree.node_count for tree in trees]
    roots = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    is_leaf = np.concatenate([tree.children_left == -1 for tree in trees])
    offset = np.repeat(roots, sizes)

    def child(name: str) -> np.ndarray:
        return np.where(is_leaf, 0, np.concatenate([getattr(tree, name) for tree in trees]) + offset)

    counts = np.concatenate([tree.value[:, 0, :] for tree in trees])  # (nodes, classes), false before true
    shares = counts[:, 1] / counts.sum(axis=1)
    return CompletenessModel(
        feature=np.where(is_leaf, LEAF, np.concatenate([tree.feature for tree in trees])),
        threshold=np.where(is_leaf, 0.0, np.concatenate([tree.threshold for tree in trees])),
        left=child("children_left"),
        right=child("children_right"),
        # As stored: a model answers the same before and after it was written.
        value=np.where(is_leaf, shares, 0.0).astype(np.float32).astype(np.float64),
        roots=roots,
        about=about,
    )


def write_model(path: Path, model: CompletenessModel) -> None:
    """Write a model as an npz file; the same content gives the same bytes."""
    about = {**model.about, "features": list(FEATURES)}
    arrays: dict[str, Any] = {
        "feature": model.feature.astype(np.int8),
        "threshold": model.threshold,
        "left": model.left.astype(np.int32),
        "right": model.right.astype(np.int32),
        "value": model.value.astype(np.float32),
        "roots": model.roots.astype(np.int32),
        "about": np.frombuffer(json.dumps(about).encode(), dtype=np.uint8),
    }
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_bytes(path, content.getvalue())


@dataclass(frozen=True)
class ProbabilityScore:
    """Comparison of predicted probabilities with the truth."""

    count: int
    accuracy: float
    """Share of predictions on the right side of 1/2."""
    roc_auc: float
    """Probability that a true sample ranks before a false one; nan if there is but one kind."""
    brier: float
    """Mean squared difference of probability and truth (Brier 1950); 0.25 for a coin."""
    band_share: float
    """Share of the predictions in the band that goes to a person."""
    accuracy_outside_band: float
    """Share of the others that are right; nan if there are none."""


def score_probabilities(
    probabilities: FloatArray, truth: BoolArray, band: tuple[float, float]
) -> ProbabilityScore:
    """Score predictions.

    Args:
        probabilities: (N,), N at least 1.
        truth: (N,).
        band: Probabilities from the first up to, but not including, the second go to a person.
    """
    below, above = probabilities < band[0], probabilities >= band[1]
    outside, right = below | above, (above & truth) | (below & ~truth)
    return ProbabilityScore(
        count=len(truth),
        accuracy=float(((probabilities >= 0.5) == truth).mean()),
        roc_auc=roc_auc(probabilities, truth),
        brier=float(brier_score_loss(truth, probabilities)),
        band_share=float((~outside).mean()),
        accuracy_outside_band=float(right[outside].mean()) if outside.any() else float("nan"),
    )


def roc_auc(probabilities: FloatArray, truth: BoolArray) -> float:
    """Area under the ROC curve; nan with one class only."""
    return float(roc_auc_score(truth, probabilities)) if len(np.unique(truth)) == 2 else float("nan")
