"""Is a translated map nearer to the CAD drawing than the map it was made from?

The comparison of the paper's Table I and Fig. 6, with the intervals and tests that it lacks.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import FloatArray

BOOTSTRAP_SAMPLES = 2000


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float


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
        groups: The plan of each map; plans, not maps, are drawn anew by the bootstrap. None takes every map
            as its own plan.

    Raises:
        ValueError: If there is no map, or the lengths differ.
    """
    from scipy.stats import binomtest, wilcoxon

    mse1, mse2 = np.asarray(mse1, dtype=np.float64), np.asarray(mse2, dtype=np.float64)
    if mse1.shape != mse2.shape or mse1.ndim != 1 or len(mse1) == 0:
        raise ValueError(
            f"the errors of maps and translations need one length above 0, not {mse1.shape} and {mse2.shape}"
        )
    wins, losses = int((mse1 < mse2).sum()), int((mse1 > mse2).sum())
    ratio = _bootstrap_ratio(mse1, mse2, _codes(groups, len(mse1)))
    return Improvement(
        count=len(mse1),
        share_improved=wilson_interval(wins, len(mse1)),
        mean_mse1=mean_interval(mse1, groups),
        mean_mse2=mean_interval(mse2, groups),
        ratio_of_means=ratio,
        median_ratio=float(np.median(mse1 / np.maximum(mse2, 1e-12))),
        sign_p=float(binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0,
        wilcoxon_p=float(wilcoxon(mse1, mse2).pvalue) if wins + losses else 1.0,
    )


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> Interval:
    """A share with its 95 % interval (Wilson 1927), which stays inside [0, 1] and holds for shares near 1.

    Raises:
        ValueError: If there is no trial.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is not a share")
    share = successes / trials
    centre = (share + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    # At 0 and at 1 a bound is the share itself, but for rounding.
    low, high = max(0.0, float(centre - half)), min(1.0, float(centre + half))
    return Interval(share, min(share, low), max(share, high))


def mean_interval(values: FloatArray, groups: list[str] | None = None, seed: int = 0) -> Interval:
    """The mean with its 95 % interval by a bootstrap over groups.

    Args:
        values: Shape (N,), N >= 1.
        groups: Values of one group are drawn together; None takes each as its own.
        seed: Of the bootstrap.
    """
    values = np.asarray(values, dtype=np.float64)
    return _bootstrap_ratio(values, np.ones(len(values)), _codes(groups, len(values)), seed)


def _codes(groups: list[str] | None, count: int) -> np.ndarray:
    return np.arange(count) if groups is None else np.unique(np.array(groups), return_inverse=True)[1]


def _bootstrap_ratio(above: FloatArray, below: FloatArray, codes: np.ndarray, seed: int = 0) -> Interval:
    """Sum over sum, with the 95 % interval of groups drawn with replacement."""
    sums, weights = np.bincount(codes, weights=above), np.bincount(codes, weights=below)
    rng = np.random.default_rng(seed)
    picked = rng.integers(0, len(sums), (BOOTSTRAP_SAMPLES, len(sums)))
    ratios = sums[picked].sum(axis=1) / np.maximum(weights[picked].sum(axis=1), 1e-12)
    low, high = np.percentile(ratios, (2.5, 97.5))
    return Interval(float(above.sum() / max(float(below.sum()), 1e-12)), float(low), float(high))
