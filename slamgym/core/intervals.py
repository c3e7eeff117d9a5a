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
CONFIDENCE = 0.95
_BAND_RESAMPLES = 2000

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
    centre = (share + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    # At 0 and at 1 a bound is the share itself, but for rounding.
    low, high = max(0.0, float(centre - half)), min(1.0, float(centre + half))
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
    columns = [values, reference]
    return _bootstrap(
        columns, lambda means: means[:, 0] / np.maximum(means[:, 1], 1e-12), seed, groups
    )


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
    columns = [
        w.astype(np.float64) for w in (right * ~of_second, ~of_second, right * of_second, of_second)
    ]

    def balanced(means: FloatArray) -> FloatArray:
        counts = np.maximum(means[:, 1::2], 1e-12)
        return (means[:, ::2] / counts).mean(axis=1)

    return _bootstrap(columns, balanced, seed, groups)


def median_interval(values: FloatArray, seed: int = 0, groups: ArrayLike | None = None) -> Interval:
    """Median of values, shape (N,).

    Args:
        values: At least one.
        seed: Of the resampling.
        groups: What is drawn again together, e.g. the building of each value, shape (N,); each value without it.
    """
    values = np.asarray(values, dtype=np.float64)
    group = np.arange(len(values)) if groups is None else np.unique(groups, return_inverse=True)[1]
    order = np.argsort(values)
    # How often each value is drawn; its median lies where half of the draws are reached.
    drawn = _fresh_draws(int(group.max()) + 1, seed, _BAND_RESAMPLES)[:, group[order]].cumsum(
        axis=1
    )
    half = 0.5 * drawn[:, -1:]
    below, above = (drawn >= half).argmax(axis=1), (drawn > half).argmax(axis=1)
    low, high = _percentiles(0.5 * (values[order][below] + values[order][above]))
    return Interval(float(np.median(values)), float(low), float(high))


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
        reference: Shape (other runs, the same plans), positive.
        seed: Of the resampling.

    Raises:
        ValueError: If there is no plan, or the plans differ in number.
    """
    values, reference = (
        np.asarray(values, dtype=np.float64),
        np.asarray(reference, dtype=np.float64),
    )
    if values.shape[1] != reference.shape[1] or values.size == 0 or reference.size == 0:
        raise ValueError(
            f"there are no plans to compare on in shapes {values.shape} and {reference.shape}"
        )
    rng = np.random.default_rng(seed)
    plans = _draws(values.shape[1], rng)
    means = [
        ((_draws(len(table), rng) @ table) * plans).sum(axis=1) / table.size
        for table in (values, reference)
    ]
    low, high = _percentiles(means[0] / means[1])
    return Interval(float(values.mean() / reference.mean()), float(low), float(high))


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
    weights = np.einsum("rk,rp->rkp", runs, plans).reshape(len(runs), -1)
    flat = values.ravel()
    order = np.argsort(flat)

    def means(drawn: FloatArray) -> FloatArray:
        reached = drawn[:, order].cumsum(axis=1) / drawn.sum(axis=1, keepdims=True)
        kept = np.diff(np.clip(reached, 0.25, 0.75), axis=1, prepend=0.25)
        return 2.0 * kept @ flat[order]

    low, high = _percentiles(means(weights))
    return Interval(float(means(np.ones((1, flat.size)))[0]), float(low), float(high))


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
    values, reference = (
        np.asarray(values, dtype=np.float64),
        np.asarray(reference, dtype=np.float64),
    )
    draw = _paired_draws(values, reference, seed)
    better = (values[:, None] < reference).astype(np.float64) + 0.5 * (values[:, None] == reference)
    low, high = _percentiles(draw(better) / better.size)
    return Interval(float(better.mean()), float(low), float(high))


def ratio_where_both(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Ratio of means over the pairs of runs on the same plan in which neither failed; both drawn again.

    Args:
        values: Shape (runs, plans); NaN where a run failed.
        reference: Shape (other runs, the same plans), positive or NaN.
        seed: Of the resampling.

    Raises:
        ValueError: If there is none, the plans differ in number, or one of both always failed.
    """
    values, reference = (
        np.asarray(values, dtype=np.float64),
        np.asarray(reference, dtype=np.float64),
    )
    draw = _paired_draws(values, reference, seed)
    both = np.isfinite(values)[:, None] & np.isfinite(reference)
    if not both.any():
        raise ValueError("there is no plan on which neither failed")
    sums = [np.where(both, table, 0.0) for table in (values[:, None], reference[None])]
    # A draw of failures alone has no ratio.
    drawn = [draw(table) for table in sums]
    held = drawn[1] > 0.0
    low, high = _percentiles(drawn[0][held] / drawn[1][held])
    return Interval(float(sums[0].sum() / sums[1].sum()), float(low), float(high))


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
    runs, plans = (_draws(count, rng, _BAND_RESAMPLES) for count in values.shape)
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
    return rng.multinomial(count, np.full(count, 1.0 / count), size=resamples).astype(np.float64)


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
    figures = statistic(_fresh_draws(len(table), seed) @ table / len(table))
    low, high = _percentiles(figures)
    value = float(statistic(table.mean(axis=0, keepdims=True))[0])
    return Interval(value, float(low), float(high))
