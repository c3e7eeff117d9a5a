"""Weights of the particles and their resampling (Grisetti et al. 2007, section II and IV-B)."""

import numpy as np

from slamgym.core.types import FloatArray, IntArray


def normalized_weights(log_weights: FloatArray, gain: float) -> FloatArray:
    """Weights that sum to 1, flattened as GMapping does: exp(l / (gain x particles)).

    Args:
        log_weights: (particles,) log-likelihood since the last resampling.
        gain: GMapping's ``ogain``.
    """
    weights = np.exp((log_weights - log_weights.max()) / (gain * len(log_weights)))
    normalized: FloatArray = weights / weights.sum()
    return normalized


def effective_sample_size(weights: FloatArray) -> float:
    """N_eff = 1 / sum of squares, from 1 (one particle has all the weight) to the number of particles."""
    return float(1.0 / np.dot(weights, weights))


def systematic_resample(weights: FloatArray, uniform: float) -> IntArray:
    """Draw as many ancestors as there are particles, particle i about ``N x weights[i]`` times.

    Args:
        weights: (particles,) that sum to 1.
        uniform: One draw from [0, 1).

    Returns:
        (particles,) ancestor of each place. Every survivor keeps its own place, so that only the maps of
        those who die are replaced.
    """
    count = len(weights)
    ticks = (np.arange(count) + uniform) / count
    drawn = np.searchsorted(np.cumsum(weights), ticks, side="right").clip(max=count - 1)
    copies = np.bincount(drawn, minlength=count)
    ancestors = np.arange(count)
    ancestors[copies == 0] = np.repeat(np.arange(count), np.maximum(copies - 1, 0))
    return ancestors
