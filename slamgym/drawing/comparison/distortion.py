"""The smooth part of a map's errors: SLAM drifts, so all walls of a region lie a little off together.

The drift is a smooth random field of shifts (a Gaussian process, or kriging: Rasmussen and Williams, "Gaussian
Processes for Machine Learning", 2006, chapters 2 and 5.4.2). Every straight wall measures the part of it along its
normal. What the field is at a wall is predicted from all *other* walls, with a standard error that grows with their
distance. What remains of the wall's own offset is what has moved. Walls that don't fit what the others say count
little for the others in turn. Both the offset and the drift are reported.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from slamgym.core.types import BoolArray, FloatArray

DEVIATIONS = (0.01, 0.02, 0.04, 0.08, 0.15)
"""Standard deviations of the drift that are tried [m]."""
LENGTHS = (2.0, 4.0, 8.0)
"""Distances over which the drift changes that are tried [m]."""
ROUNDS = 6
_OUTLIER = 2.0
"""A wall this many standard errors off what the others say counts half [1]."""


class Offsets(NamedTuple):
    """Measured offsets of walls."""

    places: FloatArray  # (M, 2) [m]
    normals: FloatArray  # (M, 2)
    values: FloatArray  # (M,) offsets along the normals [m]
    noise: FloatArray  # (M,) standard errors of the offsets [m]


class Drift:
    """The field of one size and smoothness."""

    def __init__(self, offsets: Offsets, in_line: BoolArray, size: float, length: float) -> None:
        """Fit the field; ``in_line`` (M, M) says which walls don't predict each other: they are one."""
        self.size, self.length, self._offsets = size, length, offsets
        field = self._covariance(offsets.places, offsets.normals)
        noise = offsets.noise**2
        weight = np.ones(len(noise))
        blocks = [np.flatnonzero(row) for row in in_line]
        for _ in range(ROUNDS):
            inverse = np.linalg.inv(field + np.diag(noise / weight))
            pulled = inverse @ offsets.values
            residual, variance = np.empty(len(noise)), np.empty(len(noise))
            for i, block in enumerate(blocks):
                # Prediction of a block from all others (equation 5.12, for blocks).
                own = np.linalg.inv(inverse[np.ix_(block, block)])
                at = int(np.flatnonzero(block == i)[0])
                residual[i] = own[at] @ pulled[block]
                variance[i] = own[at, at] - noise[i] / weight[i]
            variance = np.maximum(variance, 1e-6)
            total = variance + noise
            weight = 1.0 / np.square(1.0 + residual**2 / (_OUTLIER**2 * total))
        # Student's t with two degrees of freedom: a moved wall says nothing about the drift's size.
        self.likelihood = float((-0.5 * np.log(total) - 1.5 * np.log1p(residual**2 / (2.0 * total))).sum())
        self.expected = offsets.values - residual
        """At each wall, from those that aren't in line with it, (M,) [m]."""
        self.deviation = np.sqrt(variance)
        """Standard error of that, (M,) [m]."""
        self._inverse, self._pulled = inverse, pulled

    @classmethod
    def of(cls, offsets: Offsets, in_line: BoolArray) -> "Drift":
        """The field whose size and smoothness predict the offsets best."""
        fits = (cls(offsets, in_line, *guess) for guess in itertools.product(DEVIATIONS, LENGTHS))
        return max(fits, key=lambda fit: fit.likelihood)

    def predict(self, places: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its parts along normals (Q, 2) at places (Q, 2), and their standard errors, (Q,) [m]."""
        cross = self._covariance(places, normals)
        variance = self.size**2 - ((cross @ self._inverse) * cross).sum(axis=1)
        return cross @ self._pulled, np.sqrt(np.maximum(variance, 1e-6))

    def _covariance(self, places: FloatArray, normals: FloatArray) -> FloatArray:
        """Covariance with the offsets, (Q, M); smooth at short distances (Matern 3/2)."""
        away = cdist(places, self._offsets.places) * np.sqrt(3.0) / self.length
        return self.size**2 * (1.0 + away) * np.exp(-away) * (normals @ self._offsets.normals.T)
