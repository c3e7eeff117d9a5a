"""The paper's classifier of completeness: extremely randomised trees on the 15 features of its kind.

It learns from the pairs at hand, of which the true coverage is known, and judges each map by trees that have seen no
map of its plan.
"""

from collections.abc import Sequence

import numpy as np

from slamgym.core.errors import ConfigError, needing_extra
from slamgym.core.types import BoolArray, FloatArray

_FOLDS = 5
"""Parts of the plans, each judged by trees of the others."""
_LEAST_MAPS = 20
"""With fewer maps of a known truth, trees learn nothing that would hold for others."""


def grow_trees(
    features: FloatArray, is_complete: BoolArray, others: FloatArray, seed: int
) -> FloatArray:
    """Probabilities of being complete.

    Geurts, Ernst and Wehenkel, Extremely randomized trees, Machine Learning 2006.

    Args:
        features: Of the maps to learn from, shape (N, 15).
        is_complete: By the truth, shape (N,).
        others: Features of the maps to judge, shape (M, 15).
        seed: Of the trees.

    Returns:
        Shape (M,).

    Raises:
        ConfigError: If scikit-learn isn't installed.
    """
    with needing_extra("by=trees", "clean"):
        from sklearn.ensemble import ExtraTreesClassifier

    trees = ExtraTreesClassifier(100, min_samples_leaf=4, max_features=8, random_state=seed)
    trees.fit(features, is_complete)
    # The known maps may all be of one kind; then there is one column.
    return np.asarray(trees.predict_proba(others) @ trees.classes_, dtype=np.float64)


def unseen_probabilities(
    features: FloatArray, is_complete: Sequence[bool | None], plans: Sequence[str], seed: int
) -> FloatArray:
    """Probabilities of being complete, each by trees that have seen no map of the same plan.

    Args:
        features: Shape (N, 15).
        is_complete: By the truth, N of them; None where it isn't known.
        plans: The plan of each map.
        seed: Of the folds and the trees.

    Returns:
        Shape (N,).

    Raises:
        ConfigError: If there is too little to learn from, or scikit-learn isn't installed.
    """
    is_known = np.array([truth is not None for truth in is_complete], dtype=np.bool_)
    complete = np.array([bool(truth) for truth in is_complete], dtype=np.bool_)
    names, plan = np.unique(np.array(plans, dtype=np.str_), return_inverse=True)
    count = int(is_known.sum())
    if count < _LEAST_MAPS:
        raise ConfigError(
            f"by=trees learns from pairs whose truth is known: {count} are too few, it takes {_LEAST_MAPS}"
        )
    if len(np.unique(complete[is_known])) < 2:
        kind = "complete" if complete[is_known].any() else "incomplete"
        raise ConfigError(f"by=trees learns from complete and incomplete maps, but all are {kind}")
    if len(np.unique(plan[is_known])) < 2:
        raise ConfigError("by=trees learns from the maps of other plans, but all are of one plan")
    fold = np.random.default_rng(seed).permutation(len(names))[plan] % _FOLDS
    found = np.zeros(len(plan))
    for number in np.unique(fold):
        is_judged = fold == number
        is_learnt = is_known & ~is_judged
        found[is_judged] = grow_trees(
            features[is_learnt], complete[is_learnt], features[is_judged], seed
        )
    return found
