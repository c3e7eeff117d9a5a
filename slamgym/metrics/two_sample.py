"""Classifier two-sample test: how well can a learner tell two kinds of maps apart?

After Lopez-Paz and Oquab, *Revisiting Classifier Two-Sample Tests* (ICLR 2017): the cross-validated accuracy
of a classifier is 0.5 if the two samples come from one distribution. Folds are made of whole plans, so that
the learner can't recognise a plan instead of a kind of map. Needs scikit-learn.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.stats import ks_2samp

from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray, IntArray

Learner = Literal["gradient_boosting", "extra_trees"]
LEARNERS: tuple[Learner, ...] = ("gradient_boosting", "extra_trees")


@dataclass(frozen=True)
class TwoSampleResult:
    """Accuracy of telling the kinds apart, over plans."""

    accuracy: float
    low: float  # 95 % interval, bootstrap over plans
    high: float
    telling: list[tuple[str, float]]  # (statistic, Kolmogorov-Smirnov distance), the largest first


def two_sample_test(
    first: list[dict[str, float]],
    second: list[dict[str, float]],
    first_plans: list[str],
    second_plans: list[str],
    learner: Learner = "gradient_boosting",
    folds: int = 5,
    repeats: int = 4,
    seed: int = 0,
) -> TwoSampleResult:
    """Try to tell two sets of maps apart by their statistics.

    Args:
        first: Statistics of each map of one kind; all with the same names.
        second: Those of the other kind.
        first_plans: The plan of each map; maps of one plan stay in one fold.
        second_plans: The same for the other kind.
        learner: ``gradient_boosting`` or ``extra_trees``.
        folds: Number of folds.
        repeats: How often plans are dealt to folds anew; the accuracies are averaged.
        seed: Of the folds and the learner.

    Raises:
        ConfigError: If there are fewer plans than folds.
    """
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
    low, high = _interval(right, group, np.random.default_rng(seed))
    # The distance alone is wanted; the exact p-value beside it costs more and warns on small samples.
    distances = [
        (name, float(ks_2samp(X[y == 0, i], X[y == 1, i], method="asymp").statistic))
        for i, name in enumerate(names)
    ]
    return TwoSampleResult(float(right.mean()), low, high, sorted(distances, key=lambda item: -item[1]))


def _make(learner: Learner, seed: int) -> Any:
    from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier

    if learner == "extra_trees":
        return ExtraTreesClassifier(500, min_samples_leaf=2, random_state=seed, n_jobs=1)
    return HistGradientBoostingClassifier(
        max_iter=150, learning_rate=0.08, max_leaf_nodes=8, min_samples_leaf=5, random_state=seed
    )


def _interval(right: FloatArray, group: IntArray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % bootstrap interval of the mean, plans drawn with replacement."""
    plans = np.arange(group.max() + 1)
    total = np.bincount(group, weights=right)
    count = np.bincount(group)
    means = []
    for _ in range(2000):
        picked = rng.choice(plans, len(plans))
        means.append(total[picked].sum() / count[picked].sum())
    low, high = np.percentile(means, (2.5, 97.5))
    return float(low), float(high)
