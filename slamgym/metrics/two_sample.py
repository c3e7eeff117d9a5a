"""Classifier two-sample test: how well can a learner distinguish two kinds of maps?

After Lopez-Paz and Oquab, *Revisiting Classifier Two-Sample Tests* (ICLR 2017): the cross-validated accuracy
of a classifier is 0.5 if the two samples come from one distribution. Folds are made of whole plans, so that
the learner can't recognise a plan instead of a kind of map. Needs scikit-learn.

Beside the test, the maximum mean discrepancy and Wasserstein distances say by how much and in what two samples of map
statistics differ.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.distance import cdist

from slamgym.core.errors import ConfigError
from slamgym.core.intervals import Interval, balanced_accuracy, mean_interval
from slamgym.core.types import BoolArray, FloatArray, IntArray

ClassifierName = Literal["gradient_boosting", "extra_trees"]
MapLearner = Callable[[BoolArray, BoolArray, int], FloatArray]
"""Given which samples to learn from (N,), which are of the second kind (N,; only those to learn from may be looked
at) and a seed: the probability of the second kind for each of the others, in their order."""
CLASSIFIERS: tuple[ClassifierName, ...] = ("gradient_boosting", "extra_trees")


@dataclass(frozen=True)
class TwoSampleResult:
    """Accuracy of distinguishing the kinds, over plans."""

    accuracy: float
    low: float  # 95 % interval, bootstrap over plans
    high: float
    telling: list[tuple[str, float]]  # (statistic, Kolmogorov-Smirnov distance), the largest first


def two_sample_test(
    first: list[dict[str, float]],
    second: list[dict[str, float]],
    first_plans: list[str],
    second_plans: list[str],
    learner: ClassifierName = "gradient_boosting",
    folds: int = 5,
    repeats: int = 4,
    seed: int = 0,
) -> TwoSampleResult:
    """Try to distinguish two sets of maps by their statistics.

    Args:
        first: Statistics of each map of one kind; all with the same names.
        second: Those of the other kind.
        first_plans: The plan of each map; maps of one plan stay in one fold.
        second_plans: The same for the other kind.
        learner: ``gradient_boosting`` or ``extra_trees``.
        folds: Number of folds.
        repeats: How often plans are dealt to folds again; the accuracies are averaged.
        seed: Of the folds and the learner.

    Raises:
        ConfigError: If there are fewer plans than folds.
    """
    from scipy.stats import ks_2samp

    names = list(first[0])
    X = np.array([[row[name] for name in names] for row in [*first, *second]])
    y = np.array([0] * len(first) + [1] * len(second))
    _, group = np.unique(np.array([*first_plans, *second_plans]), return_inverse=True)
    if group.max() + 1 < folds:
        raise ConfigError(f"a test with {folds} folds needs as many plans, not {group.max() + 1}")
    right = np.zeros(len(y))
    for repeat in range(repeats):
        fold_of_plan = np.random.default_rng([seed, repeat]).permutation(group.max() + 1) % folds
        fold = fold_of_plan[group]
        for k in range(folds):
            model = _make(learner, seed + repeat)
            model.fit(X[fold != k], y[fold != k])
            right[fold == k] += model.predict(X[fold == k]) == y[fold == k]
    right /= repeats
    accuracy = mean_interval(right, seed, group)
    # The distance alone is wanted; the exact p-value beside it costs more and warns on small samples.
    distances = [
        (name, float(ks_2samp(X[y == 0, i], X[y == 1, i], method="asymp").statistic))
        for i, name in enumerate(names)
    ]
    return TwoSampleResult(
        float(right.mean()), accuracy.low, accuracy.high, sorted(distances, key=lambda item: -item[1])
    )


@dataclass(frozen=True)
class Distinction:
    """How well a learner distinguishes two kinds that may differ in number."""

    accuracy: Interval
    """Balanced accuracy, held out, with a 95 % bootstrap interval over buildings."""
    scores: FloatArray
    """Probability of the second kind of each sample, held out, (N,)."""


def distinguish(
    of_second: BoolArray,
    buildings: list[str],
    learner: MapLearner,
    folds: int,
    repeats: int = 1,
    seed: int = 0,
) -> Distinction:
    """Try to distinguish two kinds of maps by any learner.

    Args:
        of_second: Which samples are of the second kind, (N,).
        buildings: What each shows: maps of one building are learnt from together or not at all.
        learner: What is trained on some and judges the others.
        folds: Parts that are held out in turn, if each kind shows so many buildings, else as many as they show.
        repeats: How often buildings are dealt to folds again.
        seed: Of the folds and the learner.

    Raises:
        ConfigError: If a kind shows one building only.
    """
    _, group = np.unique(np.array(buildings), return_inverse=True)
    fewest = min(len(np.unique(group[of_second == kind])) for kind in (False, True))
    if fewest < 2:
        raise ConfigError("a test needs maps of at least two buildings of each kind; add maps of others")
    folds = min(folds, fewest)
    right, scores = np.zeros(len(of_second)), np.zeros(len(of_second))
    for repeat in range(repeats):
        fold = _deal(group, of_second, folds, np.random.default_rng([seed, repeat]))
        for k in range(folds):
            held = fold == k
            found = learner(~held, of_second, seed + repeat * folds + k)
            scores[held] += found / repeats
            right[held] += ((found > 0.5) == of_second[held]) / repeats
    return Distinction(balanced_accuracy(right, of_second, group, seed), scores)


def half_against_half(
    buildings: list[str], learner: MapLearner, folds: int, halvings: int, seed: int = 0
) -> Interval:
    """What the test makes of no difference: half of one kind's buildings against the other half.

    Args:
        buildings: What each sample shows.
        learner: As for :func:`distinguish`.
        folds: The same.
        halvings: How often the buildings are halved.
        seed: Of the halves.

    Returns:
        Mean of the balanced accuracies, and the range that 95 % of the halvings lie in; of one halving its bootstrap
        interval.

    Raises:
        ConfigError: If there are fewer than four buildings.
    """
    names, group = np.unique(np.array(buildings), return_inverse=True)
    found = []
    for halving in range(halvings):
        chosen = np.random.default_rng([seed, halving]).permutation(len(names)) < len(names) // 2
        found.append(distinguish(chosen[group], buildings, learner, folds, seed=seed).accuracy)
    if halvings == 1:
        return found[0]
    values = [accuracy.value for accuracy in found]
    low, high = np.percentile(values, [2.5, 97.5])
    return Interval(float(np.mean(values)), float(low), float(high))


def tree_learner(rows: list[dict[str, float]], trees: int = 100) -> MapLearner:
    """Extremely randomised trees on statistics, both kinds weighing the same.

    Args:
        rows: Statistics of each sample; all with the same names.
        trees: How many are grown.
    """
    X = np.array([list(row.values()) for row in rows])

    def learn(train: BoolArray, of_second: BoolArray, seed: int) -> FloatArray:
        model = _make("extra_trees", seed).set_params(n_estimators=trees, class_weight="balanced")
        model.fit(X[train], of_second[train])
        probability: FloatArray = model.predict_proba(X[~train])[:, 1]
        return probability

    return learn


def _deal(group: IntArray, of_second: BoolArray, folds: int, rng: np.random.Generator) -> IntArray:
    """The fold of each sample; the buildings of each kind are spread evenly over the folds."""
    fold_of_group = np.full(int(group.max()) + 1, -1)
    for kind in (False, True):
        left = np.unique(group[of_second == kind])
        left = left[fold_of_group[left] < 0]
        fold_of_group[rng.permutation(left)] = np.arange(len(left)) % folds
    fold: IntArray = fold_of_group[group]
    return fold


def _make(learner: ClassifierName, seed: int) -> Any:
    from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier

    if learner == "extra_trees":
        return ExtraTreesClassifier(500, min_samples_leaf=2, random_state=seed, n_jobs=1)
    return HistGradientBoostingClassifier(
        max_iter=150, learning_rate=0.08, max_leaf_nodes=8, min_samples_leaf=5, random_state=seed
    )


@dataclass(frozen=True)
class KernelDistance:
    """Squared maximum mean discrepancy of two samples."""

    mmd2: float
    """The unbiased estimate; around 0, also below it, if the samples have one distribution."""
    p: float
    """Share of random relabellings that give at least this distance."""


def kernel_distance(
    first: list[dict[str, float]],
    second: list[dict[str, float]],
    permutations: int = 500,
    seed: int = 0,
) -> KernelDistance:
    """Kernel two-sample test (Gretton et al., *A Kernel Two-Sample Test*, JMLR 2012, eq. 3).

    The kernel is Gaussian on standardised statistics, as wide as their median distance.

    Args:
        first: Statistics of each map of one kind, at least 2; all with the same names.
        second: Those of the other kind, at least 2.
        permutations: Relabellings that are tried.
        seed: Of the relabellings.

    Raises:
        ValueError: If a sample has fewer than 2 maps.
    """
    if min(len(first), len(second)) < 2:
        raise ValueError("a kernel distance needs at least 2 maps of each kind")
    values = _standardised(first, second)
    distances = cdist(values, values, "sqeuclidean")
    width = np.median(distances[np.triu_indices(len(values), 1)])
    kernel = np.exp(-distances / max(float(width), 1e-12))
    np.fill_diagonal(kernel, 0.0)
    labels = np.arange(len(values)) < len(first)
    found = _mmd2(kernel, labels)
    rng = np.random.default_rng(seed)
    # The labelling itself counts as one of the permutations, so that p is never 0.
    beyond = sum(_mmd2(kernel, rng.permutation(labels)) >= found for _ in range(permutations))
    return KernelDistance(found, (1 + beyond) / (1 + permutations))


def statistic_distances(first: list[dict[str, float]], second: list[dict[str, float]]) -> dict[str, float]:
    """Wasserstein-1 distance of each statistic, in standard deviations of the first sample.

    Args:
        first: Statistics of each map of the reference; all with the same names.
        second: Those of the other kind.
    """
    from scipy.stats import wasserstein_distance

    distances = {}
    for name in first[0]:
        a, b = np.array([row[name] for row in first]), np.array([row[name] for row in second])
        # Of a statistic that is the same in the whole reference, the spread over both counts: always finite.
        spread = float(a.std()) or float(np.concatenate([a, b]).std())
        distances[name] = float(wasserstein_distance(a, b)) / spread if spread > 0.0 else 0.0
    return distances


def _standardised(first: list[dict[str, float]], second: list[dict[str, float]]) -> FloatArray:
    names = list(first[0])
    values = np.array([[row[name] for name in names] for row in [*first, *second]], dtype=np.float64)
    spread = values.std(axis=0)
    varying = spread > 1e-12
    standardised: FloatArray = (values[:, varying] - values[:, varying].mean(axis=0)) / spread[varying]
    return standardised


def _mmd2(kernel: FloatArray, labels: np.ndarray) -> float:
    """The unbiased estimate from a kernel matrix with a diagonal of 0."""
    m, n = int(labels.sum()), int((~labels).sum())
    within = float(kernel[np.ix_(labels, labels)].sum()) / (m * (m - 1))
    other = float(kernel[np.ix_(~labels, ~labels)].sum()) / (n * (n - 1))
    return within + other - 2.0 * float(kernel[np.ix_(labels, ~labels)].mean())
