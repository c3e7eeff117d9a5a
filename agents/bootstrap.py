"""Paired comparisons with bootstrap intervals (Efron and Tibshirani, An Introduction to the Bootstrap, 1993).

The plans are what is drawn again: every explorer saw the same plans, starts and noise, so the differences
between plans, which are large, cancel out.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamgym.types import FloatArray

RESAMPLES = 10_000
CONFIDENCE = 0.95

Statistic = Callable[[FloatArray], FloatArray]
"""From sums over resampled plans, shape (R, columns), to figures of shape (R,)."""


@dataclass(frozen=True)
class Interval:
    """A figure with its percentile interval."""

    value: float
    low: float
    high: float

    def excludes(self, value: float) -> bool:
        """Whether the interval lies wholly on one side of a value."""
        return self.high < value or self.low > value


def mean_interval(values: FloatArray, seed: int = 0) -> Interval:
    """Mean of values, shape (N,), one of each plan."""
    return _bootstrap(np.asarray(values, dtype=np.float64)[:, None], lambda means: means[:, 0], seed)


def ratio_of_means(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Mean of the values over the mean of the reference: what a fleet would spend on all these plans.

    Long explorations weigh more.

    Args:
        values: One of each plan, shape (N,).
        reference: The same of the reference explorer on the same plans, shape (N,), positive.
        seed: Of the resampling.
    """
    table = np.column_stack([values, reference])
    return _bootstrap(table, lambda means: means[:, 0] / means[:, 1], seed)


def mean_of_ratios(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Mean of the plans' own ratios: every plan weighs the same.

    Args:
        values: One of each plan, shape (N,).
        reference: The same of the reference explorer on the same plans, shape (N,), positive.
        seed: Of the resampling.
    """
    return mean_interval(np.asarray(values) / np.asarray(reference), seed)


def mean_difference(values: FloatArray, reference: FloatArray, seed: int = 0) -> Interval:
    """Mean of the paired differences, shape (N,) each."""
    return mean_interval(np.asarray(values) - np.asarray(reference), seed)


def _bootstrap(table: FloatArray, statistic: Statistic, seed: int) -> Interval:
    """A statistic of column means with its percentile interval over resampled rows.

    Raises:
        ValueError: If there is no row.
    """
    if len(table) == 0:
        raise ValueError("there are no plans to compare on")
    rng = np.random.default_rng(seed)
    # How often each row is drawn: the same draws as picking N rows with replacement, in much less memory.
    counts = rng.multinomial(len(table), np.full(len(table), 1.0 / len(table)), size=RESAMPLES)
    figures = statistic(counts @ table / len(table))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(figures, [tail, 100.0 - tail])
    value = float(statistic(table.mean(axis=0, keepdims=True))[0])
    return Interval(value, float(low), float(high))
