"""Is a translated map nearer to the CAD drawing than the map it was made from?

The comparison of the paper's Table I and Fig. 6, with the intervals and tests that it lacks.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.intervals import Interval, mean_interval, ratio_of_means, wilson_interval
from slamgym.core.types import FloatArray


@dataclass(frozen=True)
class Improvement:
    """Errors of translated maps (MSE1) against errors of the maps themselves (MSE2)."""

    count: int
    share_improved: Interval
    """Maps with MSE1 < MSE2; Wilson's interval."""
    mean_mse1: Interval
    mean_mse2: Interval
    ratio_of_means: Interval
    """Mean MSE1 over mean MSE2; bootstrap over groups."""
    median_ratio: float
    """Median of the maps' own ratios."""
    sign_p: float
    """Two-sided sign test; ties are left out."""
    wilcoxon_p: float
    """Two-sided Wilcoxon signed-rank test."""


def improvement(mse1: FloatArray, mse2: FloatArray, groups: list[str] | None = None) -> Improvement:
    """Compare the errors of translated maps with those of the maps themselves.

    Args:
        mse1: Error of each translated map, shape (N,).
        mse2: Error of the map it was made from, shape (N,).
        groups: The plan of each map; plans, not maps, are resampled by the bootstrap. None takes every map
            as its own plan.

    Raises:
        ValueError: If there is no map, or the lengths differ.
    """
    from scipy.stats import binomtest, wilcoxon

    mse1 = np.asarray(mse1, dtype=np.float64)
    mse2 = np.asarray(mse2, dtype=np.float64)
    same_length = mse1.shape == mse2.shape
    if not same_length or mse1.ndim != 1 or len(mse1) == 0:
        raise ValueError(
            f"the errors of maps and translations need one length above 0, not {mse1.shape} and {mse2.shape}"
        )
    wins = int(np.count_nonzero(mse1 < mse2))
    losses = int(np.count_nonzero(mse1 > mse2))
    sign_p = 1.0
    wilcoxon_p = 1.0
    if wins + losses:
        sign_test = binomtest(wins, wins + losses)
        sign_p = float(sign_test.pvalue)
        rank_test = wilcoxon(mse1, mse2)
        wilcoxon_p = float(rank_test.pvalue)
    ratios = mse1 / np.maximum(mse2, 1e-12)
    count = len(mse1)
    return Improvement(
        count=count,
        share_improved=wilson_interval(wins, count),
        mean_mse1=mean_interval(mse1, groups=groups),
        mean_mse2=mean_interval(mse2, groups=groups),
        ratio_of_means=ratio_of_means(mse1, mse2, groups=groups),
        median_ratio=float(np.median(ratios)),
        sign_p=sign_p,
        wilcoxon_p=wilcoxon_p,
    )
