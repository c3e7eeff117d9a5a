"""Exteroceptive model: equations (7)-(12), what a LIDAR measures of a wall and the displacement that follows.

Systematic terms after Mader, Westfeld and Maas 2014; the kinds of beams after Thrun, Burgard and Fox (*Probabilistic
Robotics*, ch. 6.3). Equation numbers are those of Daher, Chakhachiro and Asmar (*From SLAM to CAD Maps and Back Using
Generative Models*); docs/parametric.md lists the misprints.

Convention: range D [m] and bearing a [rad, counter-clockwise] of a wall are in the sensor frame. It is measured at
the range z and the bearing a - da.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.sim.lidar import LidarConfig

LAMBDA_SHORT = 0.5
"""Rate of the short readings along the beam [1/m], the paper's lambda."""


@dataclass(frozen=True)
class LidarErrors:
    """Systematic coefficients of one scanner, drawn once."""

    a0: float = 0.0  # [m]
    a1: float = 0.0  # [-]
    b1: float = 0.0  # [-]
    b2: float = 0.0  # [rad]
    b3: float = 0.0  # [rad]
    b4: float = 0.0  # [rad]
    b5: float = 0.0  # [rad]
    b6: float = 0.0  # [rad m]

    @classmethod
    def draw(cls, rng: np.random.Generator, severity: float = 1.0) -> "LidarErrors":
        """Draw one scanner."""
        unit = rng.standard_normal(8).tolist()
        return cls(
            a0=severity * _SPREAD.a0 * unit[0],
            a1=severity * _SPREAD.a1 * unit[1],
            b1=severity * _SPREAD.b1 * unit[2],
            b2=severity * _SPREAD.b2 * unit[3],
            b3=severity * _SPREAD.b3 * unit[4],
            b4=severity * _SPREAD.b4 * unit[5],
            b5=severity * _SPREAD.b5 * unit[6],
            b6=severity * _SPREAD.b6 * unit[7],
        )

    def as_printed(self) -> "LidarErrors":
        """The same scanner with the paper's misprint: ``b4 sin 2a + b4 cos 2a``."""
        return replace(self, b5=self.b4)

    def range_error(self, distance: FloatArray) -> FloatArray:
        """Systematic part of D minus the measured range [m]: dD of (11), (12)."""
        return self.a0 + self.a1 * distance

    def bearing_error(self, distance: FloatArray, bearing: FloatArray) -> FloatArray:
        """Systematic part of a minus the measured bearing [rad]: da of (11), (12)."""
        return (
            self.b1 * bearing
            + self.b2 * np.sin(bearing)
            + self.b3 * np.cos(bearing)
            + self.b4 * np.sin(2.0 * bearing)
            + self.b5 * np.cos(2.0 * bearing)
            + self.b6 / np.maximum(distance, LidarConfig.range_min)
        )


_SPREAD = LidarErrors(
    a0=0.005,
    a1=0.002,
    b1=0.0003,
    b2=math.radians(0.1),
    b3=math.radians(0.1),
    b4=math.radians(0.05),
    b5=math.radians(0.05),
    b6=math.radians(0.01),
)
"""Standard deviations over scanners: Mader's table was not available, and these keep within the 0.2 % of range and
0.2 deg that its abstract reports."""


def short_density(ranges: FloatArray, distance: FloatArray) -> FloatArray:
    """Equation (7): density [1/m] of the range of a beam that meets something before the wall.

    Args:
        ranges: z (N,) [m] from 0 to the wall.
        distance: D (N,) [m] of the wall.
    """
    whole = -np.expm1(-LAMBDA_SHORT * distance)
    return LAMBDA_SHORT * np.exp(-LAMBDA_SHORT * ranges) / whole


def max_ranges(count: int, range_max: float) -> FloatArray:
    """Equation (8): beams without a return (count,) [m], a point mass at the longest range."""
    return np.full(count, range_max)


def rand_ranges(count: int, range_max: float, rng: np.random.Generator) -> FloatArray:
    """Equation (9): beams of any range (count,) [m], uniform up to the longest, wherever the wall is."""
    return rng.uniform(0.0, range_max, count)


def short_range(density: FloatArray, distance: FloatArray) -> FloatArray:
    """Equation (10): the range [m] at which (7) has a density, its inverse.

    Args:
        density: P (N,) [1/m], from (7)'s at the wall to (7)'s at the scanner.
        distance: D (N,) [m] of the wall.
    """
    whole = -np.expm1(-LAMBDA_SHORT * distance)
    return np.asarray(-np.log(density * whole / LAMBDA_SHORT) / LAMBDA_SHORT)


def short_ranges(distance: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Ranges of beams that meet something before the wall (N,) [m], distributed as (7) says.

    The paper gives P of (10) any random value, and half of them lie where (7) has no range. The distribution function
    of (7) falls linearly with its density, so a uniform density between both ends inverts it exactly.
    """
    most = short_density(np.zeros_like(distance), distance)
    share = rng.random(distance.shape)
    ranges = short_range(most - LAMBDA_SHORT * share, distance)
    return np.clip(ranges, 0.0, distance)


def displacement_x(
    distance: FloatArray, direction: FloatArray, measured: FloatArray, bearing_error: FloatArray
) -> FloatArray:
    """Equation (11): true minus measured x [m] of a wall.

    Args:
        distance: D (N,) [m].
        direction: a (N,) [rad] in the sensor frame, or plus the sensor's heading for x of the world.
        measured: z (N,) [m]; the paper prints the error E = D - z in its place.
        bearing_error: da (N,) [rad].
    """
    return distance * np.cos(direction) - measured * np.cos(direction - bearing_error)


def displacement_y(
    distance: FloatArray, direction: FloatArray, measured: FloatArray, bearing_error: FloatArray
) -> FloatArray:
    """Equation (12): true minus measured y [m] of a wall; arguments as of (11)."""
    return distance * np.sin(direction) - measured * np.sin(direction - bearing_error)


def measured_sight(offsets: FloatArray, displacements: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The paper's z_meas and alpha_meas: range (N,) [m] and direction (N,) [rad] of walls that are displaced.

    Printed as ``D - d / cos(a - da)``, with d in pixels, D in metres and a pole at 90 degrees, which nothing can
    compute; this is what the sentence round it says.

    Args:
        offsets: (N, 2) [m] true walls as seen from the scanner.
        displacements: (N, 2) [m] of the walls, true minus measured, in the same frame.
    """
    x, y = (offsets - displacements).T
    return np.hypot(x, y), np.arctan2(y, x)
