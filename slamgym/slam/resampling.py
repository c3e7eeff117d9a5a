"""Weights of particles, their resampling, and how many are needed."""

import math

import numpy as np

from slamgym.core.portable import exp
from slamgym.core.types import FloatArray, IntArray

FULL_NOISE = 4.0
"""Learned noise at which all particles are needed."""
LEAST_CHANGE = 0.25
"""The number of particles changes by no smaller share."""


def needed_particles(least: int, most: int, noise: float) -> int:
    """How many particles the odometry at hand needs.

    What the particles must cover until walls are met again are the poses that random slip may have led to. Their
    spread grows with its standard deviation, and with it the particles that cover it equally densely; that is what KLD
    sampling counts (Fox, *Adapting the sample size in particle filters through KLD-sampling*, IJRR 22, 2003). It
    counts the particles' own spread, which here says little: all are matched to nearly the same optimum.

    Args:
        least: Never fewer than this, unless ``most`` is.
        most: Never more.
        noise: Variance of the random errors that was learned, over what is expected before
            (:attr:`slamgym.slam.odometry_calibration.OdometryCalibration.random_noise`).
    """
    return min(max(math.ceil(most * math.sqrt(max(noise, 0.0) / FULL_NOISE)), least), most)


def normalized_weights(log_weights: FloatArray, gain: float) -> FloatArray:
    """Weights that sum to 1, flattened as GMapping does: exp(l / (gain x particles)).

    Args:
        log_weights: (particles,) log-likelihood since the last resampling.
        gain: GMapping's ``ogain``.
    """
    weights = exp((log_weights - log_weights.max()) / (gain * len(log_weights)))
    normalized: FloatArray = weights / weights.sum()
    return normalized


def effective_sample_size(weights: FloatArray) -> float:
    """N_eff = 1 / sum of squares, from 1 (one particle has all the weight) to the number of particles."""
    return float(1.0 / np.square(weights).sum())


def systematic_resample(weights: FloatArray, uniform: float, count: int) -> IntArray:
    """Draw ancestors, particle i about ``count x weights[i]`` times.

    Args:
        weights: (particles,) that sum to 1.
        uniform: One draw from [0, 1).
        count: How many.

    Returns:
        (count,) ancestor of each place. Every survivor keeps its own place if there still is one, so that only the
        maps of those that die are replaced.
    """
    ticks = (np.arange(count) + uniform) / count
    drawn = np.searchsorted(np.cumsum(weights), ticks, side="right").clip(max=len(weights) - 1)
    return in_place(drawn, count, len(weights))


def in_place(drawn: IntArray, count: int, before: int) -> IntArray:
    """Order ancestors so that every survivor keeps its own place, if there still is one.

    Args:
        drawn: (count,) ancestors in any order.
        count: Number of particles.
        before: Number of particles before.
    """
    copies = np.bincount(drawn, minlength=max(count, before))
    ancestors = np.arange(count)
    dead = copies[:count] == 0
    copies[:count][~dead] -= 1
    ancestors[dead] = np.repeat(np.arange(len(copies)), copies)
    return ancestors
