"""The smooth part of a map's errors: SLAM drifts, so all walls of a region lie a little off together.

The drift is a smooth random field of shifts (a Gaussian process, or kriging: Rasmussen and Williams, "Gaussian
Processes for Machine Learning", 2006, chapters 2 and 5.4.2). Every straight face of a wall measures the part of it
along its normal. What the field is at a wall is predicted from all *other* walls, with a standard error that grows with
their distance. What remains of the wall's own offset is what has moved. Walls that don't fit what the others say count
little for the others in turn. Both the offset and the drift are reported.
"""

import itertools
from typing import NamedTuple

import numpy as np

from slamgym.core.types import BoolArray, FloatArray

DEVIATIONS = (0.01, 0.02, 0.04, 0.08, 0.15)
"""Standard deviations of the drift that are tried [m]."""
LENGTHS = (2.0, 4.0, 8.0)
"""Distances over which the drift changes that are tried [m]."""
ROUNDS = 6
_OUTLIER = 2.0
"""A stretch this many standard errors off what the others say counts half [1]."""


class Stretches(NamedTuple):
    """Measured offsets of stretches of walls."""

    places: FloatArray  # (M, 2) [m]
    normals: FloatArray  # (M, 2)
    values: FloatArray  # (M,) offsets along the normals [m]
    noise: FloatArray  # (M,) standard errors of the offsets [m]


def estimate_drift(
    stretches: Stretches, same_wall: BoolArray, asked: Stretches
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Estimate the drift field; its size and smoothness are those that predict the stretches best.

    Args:
        stretches: The measurements.
        same_wall: (M, M) which stretches belong to one wall, so that they don't predict each other.
        asked: Other stretches, whose values don't count; (Q,).

    Returns:
        Offsets and standard errors at each stretch without its own wall, (M,), and at the asked ones, (Q,).
    """
    fits = (_Fit(stretches, same_wall, *guess) for guess in itertools.product(DEVIATIONS, LENGTHS))
    fit = max(fits, key=lambda fit: fit.likelihood)
    return fit.expected, fit.deviation, *fit.predict(asked)


class _Fit:
    """The field for one size and smoothness."""

    def __init__(self, stretches: Stretches, same_wall: BoolArray, size: float, length: float) -> None:
        self.size, self.length, self._stretches = size, length, stretches
        field = _covariance(stretches, stretches, size, length)
        noise = stretches.noise**2
        weight = np.ones(len(noise))
        blocks = [np.flatnonzero(row) for row in same_wall]
        for _ in range(ROUNDS):
            inverse = np.linalg.inv(field + np.diag(noise / weight))
            pulled = inverse @ stretches.values
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
        self.expected = stretches.values - residual
        self.deviation = np.sqrt(variance)
        self._inverse, self._pulled = inverse, pulled

    def predict(self, asked: Stretches) -> tuple[FloatArray, FloatArray]:
        """Offsets and standard errors elsewhere."""
        cross = _covariance(asked, self._stretches, self.size, self.length)
        variance = self.size**2 - ((cross @ self._inverse) * cross).sum(axis=1)
        return cross @ self._pulled, np.sqrt(np.maximum(variance, 1e-6))


def _covariance(first: Stretches, second: Stretches, size: float, length: float) -> FloatArray:
    """Covariance of the field's parts along two sets of normals; smooth at short distances (Matern 3/2)."""
    away = np.hypot(*(first.places[:, None] - second.places[None]).transpose(2, 0, 1)) * np.sqrt(3.0) / length
    return size**2 * (1.0 + away) * np.exp(-away) * (first.normals @ second.normals.T)
