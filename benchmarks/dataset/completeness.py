"""Does a SLAM map alone show whether it is complete? The classifier of completeness on plans that it has not seen.

    python benchmarks/dataset/completeness.py DATASET [DATASET ...] [--test DATASET] [--write-model]

A finished dataset has few incomplete maps to learn from. But each exploration was incomplete for most of its time: its
scans up to some moment, drawn at the poses as corrected by the end, are the map of that moment, and scans drawn at the
true poses show how much had been seen. Nothing is simulated again.

The shipped classifier (logistic regression on five features) and the baseline (extra trees on the 15 features of the
paper's kind) learn from four fifths of the plans and are tested on the last, in turn. `--test` takes a dataset of other
plans, on which what was learned from all others is tested. `--write-model` fits the weights on all maps but those of
`--test` and stores them as those of the package, or with `--model m.json` for `slamgym dataset clean --model m.json`.
It takes 0.4 s of CPU time an exploration.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from slamgym import __version__
from slamgym.commands.deforming.hypotheses import recorded_settings
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import write_text
from slamgym.core.parallel.engine import run_tasks
from slamgym.core.progress import show_progress
from slamgym.core.types import FREE, BoolArray, ByteArray, FloatArray, Trajectory
from slamgym.dataset.curate.cleaning import CleanConfig
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel, scaled
from slamgym.dataset.curate.completeness_trees import grow_trees
from slamgym.dataset.curate.paper_features import paper_features
from slamgym.dataset.faults import STUCK_PATH
from slamgym.dataset.format import Layout, load_pair, read_manifest
from slamgym.dataset.generate.recipe import MIXTURE, apply_conditions
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord
from slamgym.interop import read_carmen, read_tum
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/dataset/curate",)
"""What is measured."""

MINUTES = (0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0)
"""Robot times at which explorations are looked at, besides their end [min]: after 0.1 the map is that of a robot that
got stuck at its start, and 7 is the paper's limit."""
FOLDS = 5
BINS = 10
"""Bins of the reliability table, of equal width."""
RESAMPLES = 300
"""Bootstrap samples of plans for the 95 % intervals."""
LEAST = 5
"""Maps of each kind without which no AUC is given."""

Learner = Callable[["Maps", "Maps"], FloatArray]
"""From maps to learn from, and others, to the probabilities of the others."""


@dataclass(frozen=True)
class Arguments:
    """Accuracy and calibration of the classifier of completeness."""

    datasets: tyro.conf.Positional[tuple[Path, ...]]
    """Datasets that `slamgym generate` has made."""
    test: tuple[Path, ...] = ()
    """Datasets of other plans, to test on only."""
    workers: int = 2
    """Processes that draw maps."""
    write_model: bool = False
    """Store the weights fitted on all maps but those of --test."""
    model: Path = PRETRAINED_MODEL
    """Where --write-model stores them: by default as those of the package."""


@dataclass(frozen=True)
class Snapshot:
    """The map at one moment of an exploration."""

    is_last: bool
    cells: ByteArray  # (rows, cols), in the pair's frame
    driven: float  # truly, so far [m]
    coverage: float  # true


@dataclass(frozen=True)
class Maps:
    """Maps in numbers; arrays of the same length N."""

    features: FloatArray  # (N, 5)
    paper: FloatArray  # (N, 15)
    coverage: FloatArray  # true
    driven: FloatArray  # truly [m]
    is_last: BoolArray
    recipes: NDArray[np.str_]
    plans: NDArray[np.str_]

    @property
    def complete(self) -> BoolArray:
        """By the truth."""
        return np.asarray(self.coverage >= GOOD_COVERAGE)

    def where(self, chosen: BoolArray) -> "Maps":
        """Some of the maps."""
        return Maps(*(values[chosen] for values in vars(self).values()))


def main() -> None:
    arguments = tyro.cli(Arguments)
    maps = measure(arguments.datasets, arguments.workers)
    learners: dict[str, Learner] = {"shipped": by_regression, "paper's 15": by_trees}
    said = {name: cross_fit(learner, maps) for name, learner in learners.items()}
    report_accuracy("completeness", maps, said)
    report_reliability(maps, said["shipped"])
    if arguments.test:
        others = measure(arguments.test, arguments.workers)
        seen = set(maps.plans) & set(others.plans)
        if seen:
            raise SystemExit(
                f"{len(seen)} plans of --test are among those to learn from, e.g. {min(seen)}"
            )
        said = {name: learner(maps, others) for name, learner in learners.items()}
        report_accuracy("completeness_test", others, said)
    if arguments.write_model:
        write_model(arguments.model, fit(maps))


def measure(roots: Sequence[Path], workers: int) -> Maps:
    """Draw and measure the maps of explorations at some moments and at their ends."""
    pairs = [(root, record) for root in roots for record in read_manifest(root)]
    parts = []
    with show_progress("explorations", 0, len(pairs)) as advance:
        for part in run_tasks(_measure_one, pairs, workers):
            parts.append(part)
            advance()
    if not parts:
        raise SystemExit("there are no explorations")
    # Workers answer in any order.
    parts.sort(key=lambda part: part[0])
    return Maps(
        *(np.concatenate(column) for column in zip(*(part[1] for part in parts), strict=True))
    )


def _measure_one(pair: tuple[Path, PairRecord]) -> tuple[tuple[str, str], list[NDArray[Any]]]:
    root, record = pair
    shots = list(take_snapshots(root, record))
    columns = [
        np.array([completeness_features(shot.cells, record.resolution) for shot in shots]),
        np.array([paper_features(shot.cells, record.resolution) for shot in shots]),
        np.array([shot.coverage for shot in shots]),
        np.array([shot.driven for shot in shots]),
        np.array([shot.is_last for shot in shots]),
        np.array([str(record.conditions.get(MIXTURE, root.name))] * len(shots)),
        np.array([record.plan_id] * len(shots)),
    ]
    return (str(root), record.name), columns


def take_snapshots(root: Path, record: PairRecord) -> Iterator[Snapshot]:
    """Draw the map of an exploration at some moments and at its end.

    The true coverage of a moment is the share of the finally seen floor that had been seen by then, times the
    final coverage: scans drawn at the true poses show which cells were seen.

    Raises:
        InputFileError: If a file of the exploration is missing or malformed.
    """
    folder = Layout(root).episode(record.name)
    log = read_carmen(next(path for path in sorted(folder.glob("scans.log*"))))
    truth, estimate = read_tum(folder / "truth.tum"), read_tum(folder / "estimate.tum")
    stamps, ranges = (
        np.array([entry.stamp for entry in log]),
        np.stack([entry.scan.ranges for entry in log]),
    )
    ranges = ranges.astype(np.float32)
    # Stamps are written with microseconds.
    scan_of_pose = np.searchsorted(stamps, estimate.stamps - 1e-5)
    if len(stamps) != len(truth) or (scan_of_pose >= len(stamps)).any():
        raise InputFileError(
            folder, "has paths that don't fit its scans; run `slamgym generate` again"
        )
    slam = apply_conditions(recorded_settings(root), record.conditions).env.slam
    cad, last_map = load_pair(root, record.name)
    believed, true = (HitCountMap(BeamTable.of(log.geometry, slam), slam) for _ in range(2))
    # What lies open is seen, however the mapper treats beams without return.
    sight = np.minimum(ranges, np.nextafter(np.float32(log.geometry.range_max), np.float32(0.0)))
    moments: list[tuple[float, ByteArray, int]] = []
    drawn_scans = drawn_poses = 0
    for end in [
        *(60.0 * limit for limit in MINUTES if 60.0 * limit < stamps[-1]),
        float(stamps[-1]),
    ]:
        scans = int(np.searchsorted(stamps, end, side="right"))
        poses = int(np.searchsorted(estimate.stamps, end + 1e-6, side="right"))
        is_last = end == stamps[-1]
        if not is_last:  # the map at the end is there
            believed.draw(
                estimate.poses[drawn_poses:poses], ranges[scan_of_pose[drawn_poses:poses]]
            )
        true.draw(truth.poses[drawn_scans:scans], sight[drawn_scans:scans])
        drawn_scans, drawn_poses = scans, poses
        seen = int(np.count_nonzero((true.render(record.frame) == FREE) & (cad == FREE)))
        driven = Trajectory(stamps[:scans], truth.poses[:scans]).length
        moments.append((driven, last_map if is_last else believed.render(record.frame), seen))
    finally_seen = max(moments[-1][2], 1)
    for driven, drawn, seen in moments[:-1]:
        yield Snapshot(False, drawn, driven, record.coverage * min(seen / finally_seen, 1.0))
    yield Snapshot(True, last_map, moments[-1][0], record.coverage)


def cross_fit(learner: Learner, maps: Maps) -> FloatArray:
    """Probabilities by learners that have seen no map of the same plan, shape (N,)."""
    plans = np.unique(maps.plans)
    order = np.random.default_rng(0).permutation(len(plans))
    folds = min(FOLDS, len(plans))
    fold = (order % folds)[np.searchsorted(plans, maps.plans)]
    said = np.zeros(len(fold))
    for number in range(folds):
        said[fold == number] = learner(maps.where(fold != number), maps.where(fold == number))
    return said


def by_regression(known: Maps, others: Maps) -> FloatArray:
    return fit(known).probabilities(others.features)


def by_trees(known: Maps, others: Maps) -> FloatArray:
    return grow_trees(known.paper, known.complete, others.paper, seed=0)


def fit(maps: Maps) -> CompletenessModel:
    """Weights of the features, rounded so that they don't depend on the processor."""
    if len(set(maps.complete)) < 2:
        raise SystemExit(
            "all maps are of one kind; a classifier needs complete and incomplete ones"
        )
    found = LogisticRegression(max_iter=1000).fit(scaled(maps.features), maps.complete)
    about = {
        "version": __version__,
        "coverage": GOOD_COVERAGE,
        "maps": len(maps.complete),
        "complete": int(maps.complete.sum()),
        "plans": len(set(maps.plans)),
    }
    weights = dict(zip(FEATURES, found.coef_[0].round(3).tolist(), strict=True))
    return CompletenessModel(round(float(found.intercept_[0]), 3), weights, about)


def write_model(path: Path, model: CompletenessModel) -> None:
    write_text(path, json.dumps(vars(model), indent=1) + "\n")
    print(f"model: {path}; if that is the package's, run `python -m slamgym.core.provenance` now")


def report_accuracy(name: str, maps: Maps, said: dict[str, FloatArray]) -> None:
    """The figures of final maps and of all moments by recipe, and of robots that hardly drove."""
    recipes = sorted(set(maps.recipes))
    groups = {f"final, {recipe}": maps.is_last & (maps.recipes == recipe) for recipe in recipes}
    groups |= {"final, all": maps.is_last}
    groups |= {f"moments, {recipe}": maps.recipes == recipe for recipe in recipes}
    groups |= {"moments, all": np.ones(len(maps.complete), np.bool_)}
    groups |= {"hardly driven": (maps.driven < STUCK_PATH) & ~maps.complete}
    rows = [
        {"maps": group, "classifier": classifier}
        | figures(maps.where(chosen), probabilities[chosen])
        for group, chosen in groups.items()
        for classifier, probabilities in said.items()
        if chosen.any()
    ]
    title = (
        f"classifiers of completeness on unseen plans: {int(maps.is_last.sum())} explorations of "
        f"{len(set(maps.plans))} plans; intervals of 95 % over plans"
    )
    print_and_save(f"dataset/{name}", title, rows, list(rows[0]), MODULES)


def figures(maps: Maps, said: FloatArray) -> dict[str, object]:
    """Scores of predicted probabilities, and intervals of some."""
    low, high = CleanConfig().band
    complete = maps.complete
    in_band = (said >= low) & (said < high)
    right = (said >= 0.5) == complete
    members = [np.flatnonzero(maps.plans == plan) for plan in np.unique(maps.plans)]
    drawn = [np.concatenate(some) for some in resampled(members)]
    return {
        "number": len(complete),
        "complete [%]": _percent(complete),
        "AUC": auc(said, complete),
        "AUC, 95 %": interval([auc(said[some], complete[some]) for some in drawn], 3),
        "Brier": round(float(np.square(said - complete).mean()), 3),
        "calibration error": round(calibration_error(said, complete), 3),
        "in the band [%]": _percent(in_band),
        "right [%]": _percent(right),
        "right, 95 %": interval([_percent(right[some]) for some in drawn], 1),
        "right outside the band [%]": _percent(right[~in_band]),
    }


def resampled(members: Sequence[NDArray[np.int64]]) -> Iterator[list[NDArray[np.int64]]]:
    """Bootstrap samples of groups."""
    rng = np.random.default_rng(0)
    for _ in range(RESAMPLES):
        yield [members[number] for number in rng.integers(len(members), size=len(members))]


def auc(said: FloatArray, complete: BoolArray) -> float | None:
    """Area under the ROC curve; None with too few maps of one kind."""
    fewest = min(int(complete.sum()), int((~complete).sum()))
    return None if fewest < LEAST else round(float(roc_auc_score(complete, said)), 3)


def interval(values: Sequence[float | None], digits: int) -> str:
    """2.5 and 97.5 percentiles of the values that exist."""
    existing = [value for value in values if value is not None]
    if len(existing) < RESAMPLES // 2:
        return "-"
    low, high = np.percentile(existing, [2.5, 97.5])
    return f"{low:.{digits}f}-{high:.{digits}f}"


def reliability(said: FloatArray, complete: BoolArray) -> list[tuple[int, float, float]]:
    """Number, mean probability and share that was complete of predictions of about the same probability."""
    place = np.minimum((said * BINS).astype(np.int64), BINS - 1)
    chosen = [place == number for number in range(BINS) if (place == number).any()]
    return [
        (int(some.sum()), float(said[some].mean()), float(complete[some].mean())) for some in chosen
    ]


def calibration_error(said: FloatArray, complete: BoolArray) -> float:
    """Mean difference of predicted and observed share over the bins, weighed by their counts."""
    bins = reliability(said, complete)
    return sum(count * abs(predicted - observed) for count, predicted, observed in bins) / len(said)


def report_reliability(maps: Maps, said: FloatArray) -> None:
    """Predicted and observed shares of final maps by recipe."""
    rows: list[tuple[object, ...]] = []
    for recipe in sorted(set(maps.recipes)):
        chosen = maps.is_last & (maps.recipes == recipe)
        bins = reliability(said[chosen], maps.complete[chosen]) if chosen.any() else []
        rows += [
            (recipe, count, round(predicted, 2), round(observed, 2))
            for count, predicted, observed in bins
        ]
    columns = ["recipe", "final maps", "predicted", "complete"]
    print_and_save(
        "dataset/completeness_reliability", "reliability on unseen plans", rows, columns, MODULES
    )


def _percent(values: BoolArray) -> float | None:
    return round(100.0 * float(values.mean()), 1) if len(values) else None


if __name__ == "__main__":
    try:
        main()
    except SlamgymError as error:
        raise SystemExit(str(error)) from error
