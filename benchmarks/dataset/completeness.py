"""Test of how well the shape of a SLAM map alone shows whether it is complete, against the truth, on held-out plans.

    python benchmarks/dataset/completeness.py --make json.tar.gz [--out out/completeness]
    python benchmarks/dataset/completeness.py --read DATASET [DATASET ...]

``--make`` explores HouseExpo plans and furnished generated ones with several explorers and odometry errors;
``--read`` takes datasets that exist. Every exploration is sampled several times, from its first seconds to
its end, so that there are maps of every degree of completeness. ``--write-model`` stores the model trained on
all of them as the pretrained one of the package, or with ``--model m.npz`` for `slamgym dataset clean --model m.npz`.

The explorations of ``--make`` took 11 minutes of CPU in all, which two workers share; drawing, measuring and
learning from their maps takes less than 7 more, on one core: a quarter of an hour on two. An interrupted run
continues with the explorations that it has. ``--scale 0.02`` tries all steps with a few of them; to keep the
results and the model of the repository, do that in a copy.
"""

import dataclasses
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.core.errors import SlamgymError
from slamgym.core.intervals import wilson_interval
from slamgym.core.types import BoolArray, FloatArray
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL
from slamgym.dataset.faults import Criteria
from slamgym.dataset.format import load_pair, read_manifest
from slamgym.dataset.generate.build import DatasetConfig, build_dataset
from slamgym.envs import ExploreConfig
from slamgym.envs.episode import EpisodeConfig
from slamgym.sim import ClutterConfig, odometry_level
from slamgym.slam import SlamConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from dataset.completeness_training import (
    LabelledMaps,
    ProbabilityScore,
    StrArray,
    Trees,
    cross_fit,
    label_maps,
    roc_auc,
    score_probabilities,
    write_model,
)
from report import print_and_save

BAND = (0.4, 0.8)
BINS = 10
"""Bins of the reliability table, of equal width."""
RESAMPLES = 200
"""Bootstrap samples of plans for the 95 % intervals."""


@dataclass(frozen=True)
class Arguments:
    """Accuracy and calibration of the classifier of completeness."""

    make: str | None = None
    """HouseExpo plans to explore: a folder or a .tar.gz."""
    read: tuple[Path, ...] = ()
    """Datasets to read instead."""
    out: Path = Path("out/completeness")
    """Where --make puts its datasets."""
    scale: float = 1.0
    """Share of the explorations that --make makes."""
    workers: int = 2
    """Processes of --make."""
    write_model: bool = False
    """Store the model trained on everything."""
    model: Path = PRETRAINED_MODEL
    """Where --write-model stores it: by default as the pretrained one. `slamgym dataset clean --model` uses another."""


@dataclass(frozen=True)
class Group:
    """Explorations of one kind."""

    name: str
    pairs: int
    explorer: str
    minutes: float | None
    particles: int
    odometry: str
    furniture: float
    seed: int


GROUPS = (
    Group("houseexpo", 110, "explore_lite", None, 20, "medium", 0.0, 11),
    Group("high_noise", 60, "nearest", None, 12, "high", 0.0, 12),
    Group("furnished", 15, "cost_utility", None, 12, "medium", 0.6, 13),
    Group("random_walk", 40, "random", 3.0, 12, "medium", 0.0, 14),
)


def main() -> None:
    arguments = tyro.cli(Arguments)
    roots = list(arguments.read) or make_datasets(arguments)
    criteria, trees = Criteria(), Trees()
    pairs = [(root, record) for root in roots for record in read_manifest(root)]
    everything = label_maps(pairs, criteria)
    maps = everything.where(everything.learnable)
    models = cross_fit(maps.features, maps.complete, maps.plan_ids.tolist(), trees)
    probabilities = models.probabilities(maps.features, maps.plan_ids.tolist())

    report_accuracy(maps, probabilities, trees, len(pairs))
    report_calibration(maps, probabilities)
    report_features(maps)
    report_stuck(everything)
    report_speed(roots, models.whole.probabilities)
    if arguments.write_model:
        about = {
            "criteria": dataclasses.asdict(criteria),
            "explorations": len(pairs),
            "plans": len(set(maps.plan_ids)),
        }
        write_model(arguments.model, dataclasses.replace(models.whole, about=models.whole.about | about))
        print(f"model: {arguments.model}, {arguments.model.stat().st_size / 1e3:.0f} kB")


def make_datasets(arguments: Arguments) -> list[Path]:
    if arguments.make is None:
        raise SystemExit("name HouseExpo plans with --make, or datasets with --read")
    roots = []
    for group in GROUPS:
        env = ExploreConfig(
            odometry=odometry_level(group.odometry),
            slam=SlamConfig(particles=group.particles),
            clutter=ClutterConfig(furniture=group.furniture),
        )
        episode = EpisodeConfig(group.explorer, "auto" if group.minutes is None else group.minutes, env=env)
        from_houseexpo = group.furniture == 0.0
        plans = open_plans(arguments.make if from_houseexpo else "procedural")
        config = DatasetConfig(
            seed=group.seed, plans_filter="useful" if from_houseexpo else "none", episode=episode
        )
        root = arguments.out / group.name
        count = max(2, round(arguments.scale * group.pairs))
        build_dataset(root, plans, config, make_explorer, pairs=count, workers=arguments.workers)
        roots.append(root)
    return roots


def report_accuracy(maps: LabelledMaps, probabilities: FloatArray, trees: Trees, explorations: int) -> None:
    """The figures of the classifier on all maps and on the harder or more usual ones among them."""
    subsets: list[tuple[str, BoolArray]] = [("all", np.ones(len(maps), dtype=np.bool_))]
    subsets += [("at the end, or after 7 min", maps.is_last | (maps.minutes == 7.0))]
    subsets += [("at least half seen", maps.coverage >= 0.5), ("80 to 99 % seen", _between(maps, 0.8, 0.99))]
    sources = maps.sources
    by_coverage = dataclasses.replace(maps, complete=maps.coverage >= Criteria().min_coverage)
    subsets += [(f"of {source}", sources == source) for source in sorted(set(maps.sources))]
    rows = [
        accuracy_row(name, maps.where(chosen), probabilities[chosen])
        for name, chosen in subsets
        if chosen.any()
    ]
    # What can be seen of a map is whether it is whole, not whether its walls are in their places.
    models = cross_fit(by_coverage.features, by_coverage.complete, by_coverage.plan_ids.tolist(), trees)
    seen = models.probabilities(by_coverage.features, by_coverage.plan_ids.tolist())
    rows.append(accuracy_row("all, judged by coverage alone", by_coverage, seen))
    rows += transfer_rows(maps, trees)
    title = (
        f"Extra Trees on 15 features, held-out plans: {len(maps)} maps from {explorations} explorations of "
        f"{len(set(maps.plan_ids))} plans; intervals of 95 % over plans"
    )
    print_and_save("dataset/completeness", title, rows, list(rows[0]))


def transfer_rows(maps: LabelledMaps, trees: Trees) -> list[dict[str, object]]:
    """Each kind of explorations assessed by models that know neither its plans nor its explorer, noise or furniture."""
    sources = maps.sources
    rows = []
    for source in sorted(set(maps.sources)):
        test = sources == source
        if len(set(maps.sources)) < 2 or not 0 < maps.complete[~test].sum() < (~test).sum():
            continue
        others = maps.where(~test)
        model = cross_fit(others.features, others.complete, others.plan_ids.tolist(), trees)
        seen = model.probabilities(maps.features[test], maps.plan_ids[test].tolist())
        rows.append(accuracy_row(f"of {source}, trained on the others", maps.where(test), seen))
    return rows


def accuracy_row(name: str, maps: LabelledMaps, probabilities: FloatArray) -> dict[str, object]:
    score = score_probabilities(probabilities, maps.complete, BAND)
    low, high = intervals(probabilities, maps.complete, maps.plan_ids)
    return {
        "maps": name,
        "number": score.count,
        "complete [%]": round(100.0 * float(maps.complete.mean()), 1),
        "accuracy [%]": round(100.0 * score.accuracy, 1),
        "accuracy, 95 %": f"{100.0 * low.accuracy:.1f}-{100.0 * high.accuracy:.1f}",
        "ROC AUC": None if np.isnan(score.roc_auc) else round(score.roc_auc, 4),
        "AUC, 95 %": "-" if np.isnan(score.roc_auc) else f"{low.roc_auc:.3f}-{high.roc_auc:.3f}",
        "Brier": round(score.brier, 4),
        "calibration error": round(calibration_error(probabilities, maps.complete), 4),
        "in the band [%]": round(100.0 * score.band_share, 1),
        "right outside it [%]": _percent(score.accuracy_outside_band),
        "complete of the kept [%]": _percent(_mean(maps.complete[probabilities >= BAND[1]])),
    }


def intervals(
    probabilities: FloatArray, complete: BoolArray, plan_ids: StrArray
) -> tuple[ProbabilityScore, ProbabilityScore]:
    """Scores whose figures are the 2.5 and 97.5 percentiles over resampled plans."""
    plans = sorted(set(plan_ids))
    members = {plan: np.flatnonzero(plan_ids == plan) for plan in plans}
    rng = np.random.default_rng(0)
    scores = []
    for _ in range(RESAMPLES):
        drawn = rng.integers(len(plans), size=len(plans))
        chosen = np.concatenate([members[plans[i]] for i in drawn])
        scores.append(score_probabilities(probabilities[chosen], complete[chosen], BAND))
    bounds = []
    for percentile in (2.5, 97.5):
        accuracy = _percentile([score.accuracy for score in scores], percentile)
        area = _percentile([score.roc_auc for score in scores], percentile)
        bounds.append(dataclasses.replace(scores[0], accuracy=accuracy, roc_auc=area))
    return bounds[0], bounds[1]


def reliability(probabilities: FloatArray, truth: BoolArray) -> list[tuple[int, float, float]]:
    """Number, mean probability and share that was true of predictions of about the same probability, bin by bin."""
    place = np.minimum((probabilities * BINS).astype(np.int64), BINS - 1)
    chosen = [place == i for i in range(BINS)]
    return [(int(c.sum()), _mean(probabilities[c]), _mean(truth[c])) for c in chosen]


def calibration_error(probabilities: FloatArray, truth: BoolArray) -> float:
    """Mean difference of predicted and observed share over the bins, weighed by their counts."""
    bins = reliability(probabilities, truth)
    return sum(count * abs(predicted - observed) for count, predicted, observed in bins if count) / len(truth)


def _mean(values: FloatArray | BoolArray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def report_calibration(maps: LabelledMaps, probabilities: FloatArray) -> None:
    score = score_probabilities(probabilities, maps.complete, BAND)
    columns = ["probability", "maps", "predicted", "complete", "95 % of the latter"]
    rows = [
        [f"{i / BINS:.1f}-{(i + 1) / BINS:.1f}", count, _figure(predicted), _figure(observed), wilson(observed, count)]
        for i, (count, predicted, observed) in enumerate(reliability(probabilities, maps.complete))
    ]  # fmt: skip
    error = calibration_error(probabilities, maps.complete)
    title = (
        f"reliability on held-out plans: Brier score {score.brier:.4f}, calibration error "
        f"{error:.4f}, {100.0 * score.band_share:.1f} % in the band of {BAND[0]} to {BAND[1]}"
    )
    print_and_save("dataset/completeness_calibration", title, rows, columns)


def report_features(maps: LabelledMaps) -> None:
    """Predictive value of each feature alone: the area under its ROC curve, whichever side is complete."""
    rows: list[tuple[str, float, float, float]] = []
    for name, values in zip(FEATURES, maps.features.T, strict=True):
        area = roc_auc(values, maps.complete)
        complete, incomplete = np.median(values[maps.complete]), np.median(values[~maps.complete])
        rows.append(
            (name, round(max(area, 1.0 - area), 3), round(float(complete), 3), round(float(incomplete), 3))
        )
    rows.sort(key=lambda row: -row[1])
    columns = ["feature", "ROC AUC alone", "complete, median", "incomplete, median"]
    print_and_save("dataset/completeness_features", "single features", rows, columns)


def report_stuck(maps: LabelledMaps) -> None:
    """Maps that the stuck filter catches, and those that it catches wrongly."""
    kinds = {
        "stuck (driven less than 1 m)": maps.is_stuck,
        "complete": maps.complete,
        "incomplete, not stuck": ~maps.complete & ~maps.is_stuck,
    }
    rows = [
        [name, int(kind.sum()), round(100.0 * float(maps.looks_stuck[kind].mean()), 1) if kind.any() else None]
        for name, kind in kinds.items()
    ]  # fmt: skip
    print_and_save("dataset/completeness_stuck", "stuck filter", rows, ["maps", "number", "caught [%]"])


def report_speed(roots: list[Path], predict: Callable[[FloatArray], FloatArray]) -> None:
    seconds, sizes, features = [], [], []
    for root in roots:
        for record in list(read_manifest(root))[:40]:
            cells = load_pair(root, record.name)[1]
            begin = time.process_time()
            features.append(completeness_features(cells, record.resolution))
            seconds.append(time.process_time() - begin)
            sizes.append(cells.size)
    matrix = np.array(features)
    begin = time.process_time()
    predict(matrix)
    each = (time.process_time() - begin) / len(matrix)
    rows = [
        ["features", 1e3 * float(np.median(seconds)), 1e3 * float(np.percentile(seconds, 95))],
        ["classifier, in one go", 1e3 * each, None],
    ]
    cells_each = f"{np.median(sizes) / 1e3:.0f} thousand cells"
    title = f"CPU time a map, {len(seconds)} maps of {cells_each} (median); goal 10 ms"
    columns = ["part", "median [ms]", "95th percentile [ms]"]
    print_and_save("dataset/completeness_speed", title, rows, columns, times=columns[1:])


def wilson(share: float, count: int) -> str:
    """Wilson's 95 % interval of a share."""
    if count == 0:
        return "-"
    interval = wilson_interval(round(share * count), count)
    return f"{interval.low:.2f}-{interval.high:.2f}"


def _percentile(values: list[float], percentile: float) -> float:
    """Percentile of the figures that exist; nan if there are none."""
    existing = [value for value in values if not np.isnan(value)]
    return float(np.percentile(existing, percentile)) if existing else float("nan")


def _between(maps: LabelledMaps, low: float, high: float) -> BoolArray:
    chosen: BoolArray = (maps.coverage >= low) & (maps.coverage < high)
    return chosen


def _percent(share: float) -> float | None:
    return None if np.isnan(share) else round(100.0 * share, 1)


def _figure(value: float) -> float | None:
    return None if np.isnan(value) else round(value, 3)


if __name__ == "__main__":
    try:
        main()
    except SlamgymError as error:
        raise SystemExit(str(error)) from error
