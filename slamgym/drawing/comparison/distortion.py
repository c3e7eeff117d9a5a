"""The smooth part of a map's errors: SLAM drifts, so all walls of a region lie a little off together.

At each face of a wall the shift and turn are estimated that the *other* walls near it show (least squares, robust,
weighted by distance, with a prior that maps are right). What remains of the face's own offset is what has moved. Both
are reported.
"""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.types import BoolArray, FloatArray, IntArray

PRIOR = (0.1, 0.1, math.radians(1.0))
"""Usual local distortion of a map: shift in x and y [m], turn [rad]."""
NOISE = 0.025
"""Standard deviation of a single offset [m]: half a cell, and the wall's own roughness."""
CORRELATED = 0.25
"""Offsets nearer to each other than this say the same [m]."""
ROBUST = 0.05
"""Offsets this far from what their neighbours say lose half of their weight [m]."""
ITERATIONS = 8


@dataclass(frozen=True)
class Offsets:
    """Measured offsets of points on faces, along their normals [m]."""

    points: FloatArray  # (S, 2)
    normals: FloatArray  # (S, 2)
    face: IntArray  # (S,)
    values: FloatArray  # (S,); nan where nothing was found
    spacing: float  # of the points on a face [m]


@dataclass(frozen=True)
class LocalDistortion:
    """The distortion at one place, with its uncertainty."""

    place: FloatArray  # (2,)
    motion: FloatArray  # (3,) shift in x and y [m], turn [rad]
    covariance: FloatArray  # (3, 3)

    def offset(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """How far it moves faces along their normals, (N,) [m]."""
        found: FloatArray = _design(points - self.place, normals) @ self.motion
        return found

    def deviation(self, normal: FloatArray) -> float:
        """Standard error of the offset at its place along a normal [m]."""
        row = np.array([normal[0], normal[1], 0.0])
        return math.sqrt(float(row @ self.covariance @ row))


def local_distortion(
    offsets: Offsets, place: FloatArray, radius: float, left_out: BoolArray
) -> LocalDistortion:
    """Estimate it at one place.

    Args:
        offsets: Of all faces.
        place: (2,) [m].
        radius: Standard deviation of the weight over the distance [m].
        left_out: (S,) points that don't count: those of the wall itself, and of walls known to have moved.
    """
    arm = offsets.points - place
    away = np.hypot(*arm.T)
    use = ~left_out & np.isfinite(offsets.values) & (away < 3.0 * radius)
    design, values = _design(arm[use], offsets.normals[use]), offsets.values[use]
    # Each point counts for its share of an independent measurement.
    base = np.exp(-0.5 * (away[use] / radius) ** 2) * min(1.0, offsets.spacing / CORRELATED) / NOISE**2
    prior = np.diag(1.0 / np.square(PRIOR))
    motion = np.zeros(3)
    for step in range(ITERATIONS):
        # Wide at first, so that a common shift isn't taken for many outliers.
        width = max(ROBUST, 0.3 * 0.6**step)
        weight = base / np.square(1.0 + np.square((values - design @ motion) / width))
        information = design.T @ (weight[:, None] * design) + prior
        motion = np.linalg.solve(information, design.T @ (weight * values))
    return LocalDistortion(place, motion, np.linalg.inv(information))


def _design(arm: FloatArray, normals: FloatArray) -> FloatArray:
    """Derivatives of offsets along normals by shift and turn, (N, 3)."""
    return np.column_stack([normals, normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]])
