"""Noise that belongs to a place: a hash of its coordinates, and values that vary smoothly with it (numba kernels)."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray

TO_DEVIATION = 1.0 / 0.385
"""Linear interpolation of values that are even in [-1, 1] has a standard deviation of 0.385, over a cell's area."""


@kernel
def place_hash(seed: int, i: int, j: int) -> float:
    """An even value in [0, 1) that belongs to a cell of a lattice (SplitMix64 of its coordinates)."""
    h = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
    for value in (i, j):
        h = (h ^ np.uint64(np.int64(value))) + np.uint64(0x9E3779B97F4A7C15)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return float(h >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def no_corners() -> FloatArray:
    """The memory of :func:`smooth_noise` before its first call."""
    return np.full(6, np.nan)


@kernel
def smooth_noise(seed: int, x: float, y: float, corners: FloatArray) -> float:
    """A value that varies smoothly with the place, with mean 0 and a standard deviation of about 1 (at most 2.6).

    Args:
        seed: Of the lattice.
        x: The place [cells of the lattice].
        y: The place [cells of the lattice].
        corners: The last cell and the values at its corners, shape (6,): neighbouring beams mostly meet the same one.
    """
    col = math.floor(x)
    row = math.floor(y)
    fx = x - col
    fy = y - row
    if corners[0] != col or corners[1] != row:
        corners[0] = col
        corners[1] = row
        corners[2] = place_hash(seed, col, row)
        corners[3] = place_hash(seed, col + 1, row)
        corners[4] = place_hash(seed, col, row + 1)
        corners[5] = place_hash(seed, col + 1, row + 1)
    low = (1.0 - fx) * corners[2] + fx * corners[3]
    high = (1.0 - fx) * corners[4] + fx * corners[5]
    return TO_DEVIATION * (2.0 * ((1.0 - fy) * low + fy * high) - 1.0)
