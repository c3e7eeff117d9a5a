"""A classifier of completeness: Extra Trees on the fifteen features, as in the paper.

Training needs scikit-learn (the extra ``clean``); using a trained model doesn't. The pretrained model was
trained by ``benchmarks/dataset/completeness.py``.
"""

import dataclasses
import importlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import numpy as np

from slamgym import __version__
from slamgym.core.config import Count, Settings, Within
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.types import BoolArray, FloatArray
from slamgym.dataset.curate.completeness import FEATURES
from slamgym.dataset.curate.forest import LEAF, Forest, read_forest, write_forest

PRETRAINED_MODEL = Path(__file__).parent / "pretrained" / "completeness.npz"


class TreesConfig(Settings):
    """How the trees are grown (Geurts, Ernst and Wehenkel, Extremely randomized trees, Machine Learning 2006)."""

    trees: Count = 100
    """Their number."""
    min_leaf: Count = 4
    """A leaf holds at least so many samples: fewer give bolder probabilities, which are worse calibrated."""
    max_features: Annotated[int, Within(ge=1, le=len(FEATURES))] = 8
    """Features tried for a split."""
    seed: int = 0
    """Of the random thresholds."""


@dataclass(frozen=True)
class CompletenessModel:
    """Predicts from the features of a map how probable it is that the map is complete."""

    forest: Forest
    about: dict[str, Any] = field(default_factory=dict)
    """Where it comes from: criteria, number of maps, version."""

    def probabilities(self, features: FloatArray) -> FloatArray:
        """Probability of being complete, shape (N,), for features of shape (N, 15)."""
        return self.forest.predict(features.reshape(-1, len(FEATURES)))

    def write(self, path: Path | str) -> None:
        """Write the model as an npz file.

        Raises:
            InputFileError: If the file can't be written.
        """
        write_forest(path, self.forest, {**self.about, "features": list(FEATURES)})

    @classmethod
    def read(cls, path: Path | str = PRETRAINED_MODEL) -> "CompletenessModel":
        """Read a model; nothing in the file is executed.

        Raises:
            InputFileError: If the file is no model, or one of other features.
        """
        forest, about = read_forest(path)
        if about.get("features") != list(FEATURES) or forest.feature.max() >= len(FEATURES):
            raise InputFileError(path, "was trained on other features; train it again with this version")
        return cls(forest, about)


def train_completeness(
    features: FloatArray, complete: BoolArray, config: TreesConfig, about: dict[str, Any] | None = None
) -> CompletenessModel:
    """Grow trees on maps of which the truth is known.

    Args:
        features: (N, 15).
        complete: (N,) whether each map is complete; both kinds must occur.
        config: The settings.
        about: What to note with the model.

    Raises:
        SlamgymError: If scikit-learn is missing, or all maps are of one kind.
    """
    _refuse_one_kind(complete)
    ensemble = _require_sklearn("ensemble").ExtraTreesClassifier(
        n_estimators=config.trees,
        min_samples_leaf=config.min_leaf,
        max_features=config.max_features,
        random_state=config.seed,
        n_jobs=1,
    )
    ensemble.fit(features.astype(np.float32), complete)
    notes = {"version": __version__, "maps": len(complete), "complete": int(complete.sum())}
    trees = [estimator.tree_ for estimator in ensemble.estimators_]
    return CompletenessModel(
        _to_forest(trees), {**notes, "trees": dataclasses.asdict(config), **(about or {})}
    )


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
    config: TreesConfig,
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
        SlamgymError: If scikit-learn is missing, there are less than two plans, or one kind of maps alone
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


def _to_forest(trees: Sequence[Any]) -> Forest:
    """Put scikit-learn's trees into one list of nodes."""
    sizes = [tree.node_count for tree in trees]
    roots = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    is_leaf = np.concatenate([tree.children_left == -1 for tree in trees])
    offset = np.repeat(roots, sizes)

    def child(name: str) -> np.ndarray:
        return np.where(is_leaf, 0, np.concatenate([getattr(tree, name) for tree in trees]) + offset)

    counts = np.concatenate([tree.value[:, 0, :] for tree in trees])  # (nodes, classes), false before true
    shares = counts[:, 1] / counts.sum(axis=1)
    return Forest(
        feature=np.where(is_leaf, LEAF, np.concatenate([tree.feature for tree in trees])),
        threshold=np.where(is_leaf, 0.0, np.concatenate([tree.threshold for tree in trees])),
        left=child("children_left"),
        right=child("children_right"),
        # As stored: a model answers the same before and after it was written.
        value=np.where(is_leaf, shares, 0.0).astype(np.float32).astype(np.float64),
        roots=roots,
    )


def _refuse_one_kind(complete: BoolArray) -> None:
    if complete.all() or not complete.any():
        kind = "complete" if len(complete) and complete.all() else "incomplete"
        raise SlamgymError(
            f"all {len(complete)} maps are {kind}; a classifier needs both kinds to learn from, "
            "e.g. explorations that were cut off early (slamgym generate --minutes 2)"
        )


def _require_sklearn(module: str) -> ModuleType:
    """A module of scikit-learn, or an error that says how to get it."""
    try:
        return importlib.import_module(f"sklearn.{module}")
    except ImportError as error:
        raise SlamgymError(
            "training the completeness classifier needs scikit-learn: pip install 'slamgym[clean]' "
            "(using a trained model doesn't)"
        ) from error


BINS = 10
"""Bins of the reliability table, of equal width."""


@dataclass(frozen=True)
class ReliabilityBin:
    """Predictions of about the same probability."""

    low: float
    high: float
    count: int
    predicted: float
    """Mean probability; nan without predictions."""
    observed: float
    """Share that was true; nan without predictions."""


@dataclass(frozen=True)
class ProbabilityScore:
    """Predicted probabilities beside what was true."""

    count: int
    positives: int
    accuracy: float
    """Share of predictions on the right side of 1/2."""
    roc_auc: float
    """Probability that a true sample ranks before a false one; nan if there is but one kind."""
    brier: float
    """Mean squared difference of probability and truth (Brier 1950); 0.25 for a coin."""
    calibration_error: float
    """Mean difference of predicted and observed share over the bins, weighed by their counts."""
    band_share: float
    """Share of the predictions in the band that goes to a person."""
    accuracy_outside_band: float
    """Share of the others that are right; nan if there are none."""
    kept_purity: float
    """Share of true ones among those above the band; nan if there are none."""
    dropped_purity: float
    """Share of false ones among those below the band; nan if there are none."""
    bins: tuple[ReliabilityBin, ...]


def score_probabilities(
    probabilities: FloatArray, truth: BoolArray, band: tuple[float, float]
) -> ProbabilityScore:
    """Score predictions.

    Args:
        probabilities: (N,), N at least 1.
        truth: (N,).
        band: Probabilities from the first up to, but not including, the second go to a person.

    Raises:
        ValueError: If there are no predictions or the shapes differ.
    """
    if probabilities.shape != truth.shape or probabilities.size == 0:
        raise ValueError(f"{probabilities.shape} probabilities don't fit {truth.shape} truths")
    bins = reliability(probabilities, truth)
    below, above = probabilities < band[0], probabilities >= band[1]
    right = (above & truth) | (below & ~truth)
    return ProbabilityScore(
        count=len(truth),
        positives=int(truth.sum()),
        accuracy=float(((probabilities >= 0.5) == truth).mean()),
        roc_auc=roc_auc(probabilities, truth),
        brier=float(((probabilities - truth) ** 2).mean()),
        calibration_error=sum(b.count * abs(b.predicted - b.observed) for b in bins if b.count) / len(truth),
        band_share=float((~below & ~above).mean()),
        accuracy_outside_band=_mean(right[below | above]),
        kept_purity=_mean(truth[above]),
        dropped_purity=_mean(~truth[below]),
        bins=bins,
    )


def roc_auc(probabilities: FloatArray, truth: BoolArray) -> float:
    """Area under the ROC curve, as the Mann-Whitney statistic; ties count half; nan with one class only."""
    from scipy.stats import rankdata

    positives, negatives = int(truth.sum()), int((~truth).sum())
    if positives == 0 or negatives == 0:
        return float("nan")
    rank_sum = float(rankdata(probabilities)[truth].sum())
    return (rank_sum - positives * (positives + 1) / 2.0) / (positives * negatives)


def reliability(probabilities: FloatArray, truth: BoolArray) -> tuple[ReliabilityBin, ...]:
    """The reliability table: what share was true among predictions of about the same probability."""
    place = np.minimum((probabilities * BINS).astype(np.int64), BINS - 1)
    table = []
    for i in range(BINS):
        chosen = place == i
        table.append(
            ReliabilityBin(
                low=i / BINS,
                high=(i + 1) / BINS,
                count=int(chosen.sum()),
                predicted=_mean(probabilities[chosen]),
                observed=_mean(truth[chosen]),
            )
        )
    return tuple(table)


def _mean(values: FloatArray | BoolArray) -> float:
    return float(values.mean()) if len(values) else float("nan")
