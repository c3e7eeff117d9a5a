"""Proprioceptive model: what a differential drive with wrong wheel parameters believes about its motion.

Equation numbers are those of Daher, Chakhachiro and Asmar (*From SLAM to CAD Maps and Back Using Generative
Models*), corrected: docs/parametric.md lists the misprints. Sources: Borenstein and Feng 1996 (UMBmark), Jung
and Chung 2011.

Convention: the given trajectory is the *true* one, it stays in free space; the *believed* one is integrated
from the increments below and starts at the same pose.
"""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.parametric.config import OdometryErrorConfig


@dataclass(frozen=True)
class Increments:
    """Motion between successive poses, split as eqs. (18)-(20) need it."""

    distance: FloatArray  # (T - 1,) [m] along the mean heading of the two poses, negative backwards
    lateral: FloatArray  # (T - 1,) [m] across it; 0 unless a recorded robot was pushed
    turn: FloatArray  # (T - 1,) [rad]


@dataclass(frozen=True)
class WheelErrors:
    """Parameters of one robot, drawn once."""

    kappa: float = 0.0  # [rad/m] curvature of a straight line, beta / L of UMBmark
    alpha_eb: float = 0.0  # [rad] error of a quarter turn through the wheel base
    scale: float = 1.0  # [-] E_s, mean wheel diameter over nominal

    @classmethod
    def of_unit(cls, config: OdometryErrorConfig, unit: FloatArray) -> "WheelErrors":
        """The robot of three draws (3,) from the standard normal: wheel diameters, wheel base, scale."""
        return cls(
            kappa=math.radians(config.kappa_deg) * float(unit[0]),
            alpha_eb=math.radians(config.alpha_eb_deg) * float(unit[1]),
            scale=1.0 + config.scale * float(unit[2]),
        )

    def alpha_ed(self, wheel_base: float) -> float:
        """Error of a quarter turn through unequal wheels [rad]: Jung and Chung's pi b beta / (4 L)."""
        return math.pi * wheel_base * self.kappa / 4.0

    def wheel_base_ratio(self, wheel_base: float) -> float:
        """E_b = b_actual / b_nominal, eq. (13) in radians."""
        quarter = math.pi / 2.0
        return quarter / (quarter - (self.alpha_eb + self.alpha_ed(wheel_base)))

    def diameter_ratio(self, wheel_base: float) -> float:
        """E_d = D_right / D_left, eq. (14) with R = 1 / kappa, once per robot."""
        half = 0.5 * self.wheel_base_ratio(wheel_base) * wheel_base
        return (1.0 + self.kappa * half) / (1.0 - self.kappa * half)


def increments_of(poses: FloatArray) -> Increments:
    """Split a path of poses (T, 3) into increments."""
    step = np.diff(poses[:, :2], axis=0)
    turn = np.asarray(wrap_angle(np.diff(poses[:, 2])))
    middle = poses[:-1, 2] + 0.5 * turn
    cos, sin = np.cos(middle), np.sin(middle)
    return Increments(
        distance=cos * step[:, 0] + sin * step[:, 1],
        lateral=-sin * step[:, 0] + cos * step[:, 1],
        turn=turn,
    )


def integrate(start: FloatArray, increments: Increments) -> FloatArray:
    """Eqs. (18)-(20): turn half, translate, turn half.

    Args:
        start: First pose, shape (3,).
        increments: T - 1 motions.

    Returns:
        Poses, shape (T, 3), heading wrapped.
    """
    heading = start[2] + np.concatenate([[0.0], np.cumsum(increments.turn)])
    middle = heading[:-1] + 0.5 * increments.turn
    cos, sin = np.cos(middle), np.sin(middle)
    dx = increments.distance * cos - increments.lateral * sin
    dy = increments.distance * sin + increments.lateral * cos
    poses = np.empty((len(heading), 3))
    poses[:, 0] = start[0] + np.concatenate([[0.0], np.cumsum(dx)])
    poses[:, 1] = start[1] + np.concatenate([[0.0], np.cumsum(dy)])
    poses[:, 2] = wrap_angle(heading)
    return poses


def believed_increments(
    true: Increments, errors: WheelErrors, wheel_base: float, wheel_diameter: float
) -> Increments:
    """What odometry with the actual wheels reports for the true motion.

    Args:
        true: The motion.
        errors: The robot's wheels.
        wheel_base: Nominal b [m].
        wheel_diameter: Nominal D [m].

    Returns:
        Believed increments; the lateral part, which wheels can't measure, is kept.
    """
    base = errors.wheel_base_ratio(wheel_base) * wheel_base
    ratio = errors.diameter_ratio(wheel_base)
    left = 2.0 * errors.scale * wheel_diameter / (ratio + 1.0)  # eq. (15)
    right = 2.0 * errors.scale * wheel_diameter / (1.0 / ratio + 1.0)  # eq. (16)
    # Eq. (17), corrected: one rolled angle per wheel, and the arc is half the angle times the diameter.
    half_turn = 0.5 * wheel_base * true.turn
    rolled_right = 2.0 * (true.distance + half_turn) / wheel_diameter
    rolled_left = 2.0 * (true.distance - half_turn) / wheel_diameter
    distance_right, distance_left = 0.5 * rolled_right * right, 0.5 * rolled_left * left
    return Increments(
        distance=0.5 * (distance_right + distance_left),
        lateral=true.lateral,
        turn=(distance_right - distance_left) / base,
    )
