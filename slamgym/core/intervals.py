"""Intervals of shares, and bootstrap intervals (Efron and Tibshirani, An Introduction to the Bootstrap, 1993).

The plans are what is drawn again: every explorer saw the same plans, starts and noise, so the differences
between plans, which are large, cancel out. Several values of one plan are a group that is drawn together.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamgym.core.types import BoolArray, FloatArray

RESAMPLES = 10_000
"""So many times the plans are drawn again for a figure ..."""
_BAND_RESAMPLES = 2000
"""... and for tables and curves, whose draws take more memory."""
CONFIDENCE = 0.95
"""Probability with which an interval holds the figure."""

Statistic = Callable[[FloatArray], FloatArray]
"""From sums over resampled plans, shape (R, columns), to figures of shape (R,)."""


@dataclass(frozen=True)
class Interval:
    """A figure with its percentile interval."""

    value: float
    low: float
    high: float


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> Interval:
    """A share with its 95 % interval (Wilson 1927), which stays inside [0, 1] and holds for shares near 1.

    Raises:
        ValueError: If there is no trial.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is not a share")
    share = successes / trials
    shrinkage = 1 + z**2 / trials
    centre = (share + z**2 / (2 * trials)) / shrinkage
    variance = share * (1 - share) / trials + z**2 / (4 * trials**2)
    half = z / shrinkage * np.sqrt(variance)
    low = max(0.0, float(centre - half))
    high = min(1.0, float(centre + half))
    # At 0 and at 1 a bound is the share itself, but for rounding.
    return Interval(share, min(share, low), max(share, high))


def mean_interval(values: FloatArray, seed: int = 0, groups: ArrayLike | None = None) -> Interval:
    """Mean of values, shape (N,).

    Args:
        values: One of each plan, or with ``groups`` several.
        seed: Of the resampling.
        groups: The plan of each value, shape (N,).
    """
    values = np.asarray(values, dtype=np.float64)
    if groups is not None:
        return ratio_of_means(values, np.ones(len(values)), seed, groups)
    return _bootstrap([values], lambda means: means[:, 0], seed)


def ratio_of_means(
    values: FloatArray, reference: FloatArray, seed: int = 0, groups: ArrayLike | None = None
) -> Interval:
    """Mean of the values over the mean of the reference: what a fleet would spend on all these plans.

    Long explorations weigh more.

    Args:
        values: One of each plan, shape (N,).
        reference: The same of the reference explorer on the same plans, shape (N,), positive.
        seed: Of the resampling.
        groups: The plan of each value, shape (N,), where a plan has several.
    """
    return _bootstrap([values, reference], _ratio, seed, groups)


def _ratio(means: FloatArray) -> FloatArray:
    """The first of two columns over the second."""
    return means[:, 0] / np.maximum(means[:, 1], 1e-12)


def balanced_accuracy(
    right: FloatArray, of_second: BoolArray, groups: ArrayLike, seed: int = 0
) -> Interval:
    """Mean of the accuracies on two classes, however many samples each has: 0.5 for a guess.

    Args:
        right: Whether each sample was classified rightly, or how often, in [0, 1], shape (N,).
        of_second: Which samples belong to the second class, shape (N,); both classes have some.
        groups: What is drawn again, e.g. the building of each sample, shape (N,).
        seed: Of the resampling.
    """
    columns: list[FloatArray] = []
    for members in (~of_second, of_second):
        columns.append((right * members).astype(np.float64))
        columns.append(members.astype(np.float64))
    return _bootstrap(columns, _mean_accuracy, seed, groups)


def _mean_accuracy(means: FloatArray) -> FloatArray:
    """Of the two classes, each with its samples classified rightly and all of its samples."""
    counts = np.maximum(means[:, 1::2], 1e-12)
    return (means[:, ::2] / counts).mean(axis=1)


def median_interval(values: FloatArray, seed: int = 0, groups: ArrayLike | None = None) -> Interval:
    """Median of values, shape (N,).

    Args:
        values: At least one.
        seed: Of the resampling.
        groups: What is drawn again together, e.g. the building of each value, shape (N,); each value without it.
    """
    values = np.asarray(values, dtype=np.float64)
    group = np.arange(len(values))
    if groups is not None:
        group = np.unique(groups, return_inverse=True)[1]
    order = np.argsort(values)
    ascending = values[order]
    # How often each value is drawn; its median lies where half of the draws are reached.
    draws = _fresh_draws(int(group.max()) + 1, seed, _BAND_RESAMPLES)
    reached = draws[:, group[order]].cumsum(axis=1)
    half = 0.5 * reached[:, -1:]
    below = (reached >= half).argmax(axis=1)
    above = (reached > half).argmax(axis=1)
    medians = 0.5 * (ascending[below] + ascending[above])
    return _percentile_interval(float(np.median(values)), medians)


def crossed_mean(values: FloatArray, seed: int = 0) -> Interval:
    """Mean over runs and plans, both drawn again; see :func:`crossed_ratio`.

    Args:
        values: Shape (runs, plans).
        seed: Of the resampling.
    """
    return crossed_ratio(values, np.ones((1, np.shape(values)[1])), seed)


def crossed_ratio(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Ratio of means of two learners, each trained several times and tested on the same plans.

    Explorations of one run, and those of one plan, are no independent draws. So runs and plans are drawn again,
    each by themselves (Owen, "The pigeonhole bootstrap", Annals of Applied Statistics 1(2), 2007): the interval
    covers other plans as well as other seeds of the training, and errs to the wide side.

    Args:
        values: Shape (runs, plans).
        reference: Shape (other runs, the same plans), not negative; where some draws hold nothing but zeros the ends of
            the interval aren't finite.
        seed: Of the resampling.

    Raises:
        ValueError: If there is no plan, or the plans differ in number.
    """
    values = np.asarray(values, dtype=np.float64)
    reference = np.asarray(reference, dtype=np.float64)
    if values.shape[1] != reference.shape[1] or values.size == 0 or reference.size == 0:
        raise ValueError(
            f"there are no plans to compare on in shapes {values.shape} and {reference.shape}"
        )
    rng = np.random.default_rng(seed)
    plans = _draws(values.shape[1], rng)
    own_means = _drawn_means(values, plans, rng)
    reference_means = _drawn_means(reference, plans, rng)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = own_means / reference_means
        ratio = float(values.mean() / reference.mean())
        return _percentile_interval(ratio, ratios)


def _drawn_means(table: FloatArray, plans: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Means (R,) of a table (runs, plans) over draws of its runs, and given draws (R, plans) of its plans."""
    runs = _draws(len(table), rng)
    return ((runs @ table) * plans).sum(axis=1) / table.size


def interquartile_mean(values: FloatArray, seed: int = 0) -> Interval:
    """Mean of the middle half of all explorations: hardly moved by a few that failed, steadier than the median.

    Agarwal et al. 2021 (Deep Reinforcement Learning at the Edge of the Statistical Precipice, NeurIPS) draw the runs
    of each task again. Here the tasks are plans and are drawn again too, as in :func:`crossed_ratio`, so the interval
    holds for other plans as well, and there is one for a single run. Quarters are cut through an exploration where
    their number isn't divisible by four.

    Args:
        values: Shape (runs, plans).
        seed: Of the resampling.

    Raises:
        ValueError: If there is none.
    """
    values = np.asarray(values, dtype=np.float64)
    runs, plans = _crossed_draws(values, seed)
    draws = np.einsum("rk,rp->rkp", runs, plans).reshape(len(runs), -1)
    flat = values.ravel()
    all_once = np.ones((1, flat.size))
    value = float(_middle_means(flat, all_once)[0])
    return _percentile_interval(value, _middle_means(flat, draws))


def _middle_means(values: FloatArray, draws: FloatArray) -> FloatArray:
    """Means (R,) of the middle half of values (N,), each drawn as often as ``draws`` (R, N) says."""
    order = np.argsort(values)
    reached = draws[:, order].cumsum(axis=1) / draws.sum(axis=1, keepdims=True)
    kept = np.diff(np.clip(reached, 0.25, 0.75), axis=1, prepend=0.25)
    return 2.0 * kept @ values[order]


def probability_of_improvement(
    values: FloatArray, reference: FloatArray, seed: int = 0
) -> Interval:
    """Probability that a run on a plan gives a smaller value than one of the reference on the same plan; ties are half.

    As Agarwal et al. 2021 define it, averaged over plans, but with plans drawn again: see
    :func:`interquartile_mean`.

    Args:
        values: Shape (runs, plans).
        reference: Shape (other runs, the same plans).
        seed: Of the resampling.

    Raises:
        ValueError: If there is none, or the plans differ in number.
    """
    values = np.asarray(values, dtype=np.float64)
    reference = np.asarray(reference, dtype=np.float64)
    draw = _paired_draws(values, reference, seed)
    own = values[:, None]
    better = (own < reference).astype(np.float64) + 0.5 * (own == reference)
    return _percentile_interval(float(better.mean()), draw(better) / better.size)


def ratio_where_both(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Ratio of means over the pairs of runs on the same plan in which neither failed; both drawn again.

    Args:
        values: Shape (runs, plans); NaN where a run failed.
        reference: Shape (other runs, the same plans), positive or NaN.
        seed: Of the resampling.

    Raises:
        ValueError: If there is none, the plans differ in number, or one of both always failed.
    """
    values = np.asarray(values, dtype=np.float64)
    reference = np.asarray(reference, dtype=np.float64)
    draw = _paired_draws(values, reference, seed)
    both = np.isfinite(values)[:, None] & np.isfinite(reference)
    if not both.any():
        raise ValueError("there is no plan on which neither failed")
    own = np.where(both, values[:, None], 0.0)
    other = np.where(both, reference[None], 0.0)
    own_sums = draw(own)
    other_sums = draw(other)
    # A draw of failures alone has no ratio.
    held = other_sums > 0.0
    return _percentile_interval(float(own.sum() / other.sum()), own_sums[held] / other_sums[held])


def _paired_draws(
    values: FloatArray, reference: FloatArray, seed: int
) -> Callable[[FloatArray], FloatArray]:
    """Make a function that sums a table of shape (runs, other runs, plans) over draws of all three, to shape (R,)."""
    if values.shape[1:] != reference.shape[1:]:
        raise ValueError(
            f"there are no plans to compare on in shapes {values.shape} and {reference.shape}"
        )
    runs, plans = _crossed_draws(values, seed)
    others = _crossed_draws(reference, seed + 1)[0]

    def draw(table: FloatArray) -> FloatArray:
        return np.einsum("ri,rj,rp,ijp->r", runs, others, plans, table, optimize=True)

    return draw


def _crossed_draws(values: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """Counts of draws of each run and each plan of a table (runs, plans), shapes (R, runs) and (R, plans)."""
    if values.ndim != 2 or values.size == 0:
        raise ValueError(f"there are no runs and plans in the shape {values.shape}")
    rng = np.random.default_rng(seed)
    runs = _draws(values.shape[0], rng, _BAND_RESAMPLES)
    plans = _draws(values.shape[1], rng, _BAND_RESAMPLES)
    return runs, plans


def mean_band(rows: FloatArray, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Interval of the mean row.

    Args:
        rows: Curves at the same places, shape (N, places).
        seed: Of the resampling.

    Returns:
        Lower and upper bound, shape (places,) each.
    """
    drawn = _fresh_draws(len(rows), seed, _BAND_RESAMPLES) @ rows / len(rows)
    low, high = _percentiles(drawn)
    return low, high


def _draws(count: int, rng: np.random.Generator, resamples: int = RESAMPLES) -> FloatArray:
    """Counts of draws of each of N: the same as picking N with replacement, in much less memory; (R, N)."""
    equal = np.full(count, 1.0 / count)
    return rng.multinomial(count, equal, size=resamples).astype(np.float64)


@functools.lru_cache(maxsize=2)
def _fresh_draws(count: int, seed: int, resamples: int = RESAMPLES) -> FloatArray:
    """The draws of a new generator, kept: all figures of a comparison are of the same plans and seed."""
    drawn = _draws(count, np.random.default_rng(seed), resamples)
    drawn.flags.writeable = False
    return drawn


def _percentiles(figures: FloatArray) -> FloatArray:
    """Bounds of the percentile interval over the first axis."""
    tail = 50.0 * (1.0 - CONFIDENCE)
    return np.percentile(figures, [tail, 100.0 - tail], axis=0)


def _percentile_interval(value: float, figures: FloatArray) -> Interval:
    """A figure with the percentile interval of the figures of the draws, shape (R,)."""
    low, high = _percentiles(figures)
    return Interval(value, float(low), float(high))


def _bootstrap(
    columns: Sequence[Any], statistic: Statistic, seed: int, groups: ArrayLike | None = None
) -> Interval:
    """A statistic of column means with its percentile interval over resampled rows, or sums of groups of rows.

    Raises:
        ValueError: If there is no row.
    """
    if groups is not None:
        group = np.unique(np.asarray(groups), return_inverse=True)[1]
        columns = [np.bincount(group, weights=column) for column in columns]
    table = np.column_stack(columns)
    if len(table) == 0:
        raise ValueError("there are no plans to compare on")
    means = _fresh_draws(len(table), seed) @ table / len(table)
    value = float(statistic(table.mean(axis=0, keepdims=True))[0])
    return _percentile_interval(value, statistic(means))
