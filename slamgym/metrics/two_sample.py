"""Classifier two-sample test: how well can a learner distinguish two kinds of maps?

After Lopez-Paz and Oquab, *Revisiting Classifier Two-Sample Tests* (ICLR 2017): the cross-validated accuracy
of a classifier is 0.5 if the two samples come from one distribution. Folds are made of whole buildings, so that
the learner can't recognise a building instead of a kind of map. The trees need scikit-learn.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from slamgym.core.errors import ConfigError
from slamgym.core.intervals import Interval, balanced_accuracy
from slamgym.core.types import BoolArray, FloatArray, IntArray

MapLearner = Callable[[BoolArray, BoolArray, int], FloatArray]
"""Given which samples to learn from (N,), which are of the second kind (N,; only those to learn from may be looked
at) and a seed: the probability of the second kind for each of the others, in their order."""


def distinguish(
    of_second: BoolArray,
    buildings: Sequence[str],
    learner: MapLearner,
    folds: int = 5,
    repeats: int = 1,
    seed: int = 0,
) -> Interval:
    """Try to distinguish two kinds of maps by any learner.

    Args:
        of_second: Which samples are of the second kind, (N,).
        buildings: The building of each sample: maps of one building are all learnt from or all held out.
        learner: Is trained on some and judges the others.
        folds: Parts that are held out in turn, if each kind shows so many buildings, else as many as they show.
        repeats: How often buildings are dealt to folds again.
        seed: Seed of the folds and the learner.

    Returns:
        Balanced accuracy of the held-out samples, with a 95 % bootstrap interval over buildings.

    Raises:
        ConfigError: If a kind shows one building only.
    """
    _, group = np.unique(buildings, return_inverse=True)
    of_first_kind = np.unique(group[~of_second])
    of_second_kind = np.unique(group[of_second])
    fewest = min(len(of_first_kind), len(of_second_kind))
    if fewest < 2:
        raise ConfigError(
            "a test needs maps of at least two buildings of each kind; add maps of others"
        )
    folds = min(folds, fewest)
    right = np.zeros(len(of_second))
    for repeat in range(repeats):
        fold = _deal(group, of_second, folds, np.random.default_rng([seed, repeat]))
        for k in range(folds):
            held = fold == k
            found = learner(~held, of_second, seed + repeat * folds + k)
            is_right = (found > 0.5) == of_second[held]
            right[held] += is_right / repeats
    return balanced_accuracy(right, of_second, group, seed)


def half_against_half(
    buildings: Sequence[str], learner: MapLearner, folds: int, halvings: int, seed: int = 0
) -> Interval:
    """The same test where there is no difference: half of one kind's buildings against the other half.

    Args:
        buildings: The building of each sample.
        learner: As for :func:`distinguish`.
        folds: The same.
        halvings: How often the buildings are halved.
        seed: Seed of the halves.

    Returns:
        Mean of the balanced accuracies, and the range that 95 % of the halvings lie in; of one halving its bootstrap
        interval.

    Raises:
        ConfigError: If there are fewer than four buildings.
    """
    names, group = np.unique(buildings, return_inverse=True)
    half = len(names) // 2
    found = []
    for halving in range(halvings):
        rng = np.random.default_rng([seed, halving])
        chosen = rng.permutation(len(names)) < half
        of_chosen = chosen[group]
        accuracy = distinguish(of_chosen, buildings, learner, folds, seed=seed)
        found.append(accuracy)
    if halvings == 1:
        return found[0]
    values = [accuracy.value for accuracy in found]
    low, high = np.percentile(values, [2.5, 97.5])
    mean = float(np.mean(values))
    return Interval(mean, float(low), float(high))


def tree_learner(rows: Sequence[dict[str, float]], trees: int = 100) -> MapLearner:
    """Extremely randomised trees on statistics, both kinds weighing the same.

    Args:
        rows: Statistics of each sample; all with the same names.
        trees: How many are grown.
    """
    values = [list(row.values()) for row in rows]
    X = np.array(values)

    def learn(train: BoolArray, of_second: BoolArray, seed: int) -> FloatArray:
        from sklearn.ensemble import ExtraTreesClassifier

        model = ExtraTreesClassifier(
            trees, min_samples_leaf=2, class_weight="balanced", random_state=seed, n_jobs=1
        )
        model.fit(X[train], of_second[train])
        chances = model.predict_proba(X[~train])
        return chances[:, 1]

    return learn


def ks_distance(first: ArrayLike, second: ArrayLike) -> float:
    """Kolmogorov-Smirnov distance of two samples of one statistic.

    A threshold on this statistic alone distinguishes them with a balanced accuracy of (1 + distance) / 2.
    """
    from scipy.stats import ks_2samp

    # The distance alone is wanted; the exact p-value costs more and warns on small samples.
    a = np.asarray(first, dtype=np.float64)
    b = np.asarray(second, dtype=np.float64)
    test = ks_2samp(a.ravel(), b.ravel(), method="asymp")
    return float(test.statistic)


def _deal(group: IntArray, of_second: BoolArray, folds: int, rng: np.random.Generator) -> IntArray:
    """The fold of each sample; the buildings of each kind are spread evenly over the folds."""
    count = int(group.max()) + 1
    fold_of_group = np.full(count, -1)
    for kind in (False, True):
        of_kind = group[of_second == kind]
        left = np.unique(of_kind)
        is_new = fold_of_group[left] < 0
        left = left[is_new]
        shuffled = rng.permutation(left)
        fold_of_group[shuffled] = np.arange(len(left)) % folds
    return fold_of_group[group]
