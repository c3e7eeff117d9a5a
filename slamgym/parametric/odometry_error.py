"""Proprioceptive model: equations (13)-(20), what a differential drive with wrong wheels believes about its motion.

Two descriptions of one robot: wrong wheels (UMBmark), and the errors of straight lines and turns in place, after
Souza, Santana, Britto, Goncalves and Medeiros, *Representation of Odometry Errors on Occupancy Grids* (ICINCO 2008).
Equation numbers are those of Daher, Chakhachiro and Asmar (*From SLAM to CAD Maps and Back Using Generative
Models*), corrected: docs/parametric.md lists the misprints. Sources of the wheels: Borenstein and Feng 1996, Jung
and Chung 2011.

Convention: the given trajectory is the *true* one, it stays in free space; the *believed* one is integrated
from the increments below and starts at the same pose.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.parametric.config import TwoPhaseConfig
from slamgym.sim.robot import WHEEL_RADIUS, RobotConfig

WHEEL_BASE = RobotConfig.wheel_separation
"""Nominal distance of the wheels [m]: the simulated robot's."""
WHEEL_DIAMETER = 2.0 * WHEEL_RADIUS
"""Nominal diameter of the wheels [m]: the simulated robot's."""
_ALPHA_EB_DEG = 1.0
"""Spread of the error of a quarter turn through the wheel base [deg]; rms 0.98 over 8 OptiOdom sets."""
_KAPPA_DEG = 0.23
"""Spread of the curvature of a straight line through unequal wheels [deg/m]; rms 0.23 over the same sets."""
_SCALE = 0.002
"""Spread of the error of the mean wheel diameter [-]."""


class Increments(NamedTuple):
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
    def of_unit(cls, unit: FloatArray, severity: float = 1.0) -> "WheelErrors":
        """The robot of three draws (3,) from the standard normal: wheel diameters, wheel base, scale."""
        return cls(
            kappa=math.radians(severity * _KAPPA_DEG) * float(unit[0]),
            alpha_eb=math.radians(severity * _ALPHA_EB_DEG) * float(unit[1]),
            scale=1.0 + severity * _SCALE * float(unit[2]),
        )

    @property
    def wheel_base_ratio(self) -> float:
        """E_b = b_actual / b_nominal."""
        # Error of a quarter turn through unequal wheels: Jung and Chung's pi b beta / (4 L).
        alpha_ed = math.pi * WHEEL_BASE * self.kappa / 4.0
        return wheel_base_ratio(self.alpha_eb, alpha_ed)

    @property
    def diameter_ratio(self) -> float:
        """E_d = D_right / D_left."""
        return diameter_ratio(self.kappa, self.wheel_base_ratio * WHEEL_BASE)


def wheel_base_ratio(alpha_eb: float, alpha_ed: float) -> float:
    """Equation (13): E_b, the actual over the nominal distance of the wheels; printed in degrees.

    Args:
        alpha_eb: Error of a quarter turn [rad] through the wheel base.
        alpha_ed: Error of a quarter turn [rad] through unequal wheels.
    """
    quarter = math.pi / 2.0
    return quarter / (quarter - (alpha_eb + alpha_ed))


def diameter_ratio(kappa: float, wheel_base: float) -> float:
    """Equation (14): E_d, the right over the left diameter; printed as ``D_R / D_R``, for each segment of the path.

    Args:
        kappa: Curvature [rad/m] of a straight line, 1 / R, of the robot.
        wheel_base: Actual distance of the wheels [m].
    """
    half = 0.5 * wheel_base
    return (1.0 + kappa * half) / (1.0 - kappa * half)


def left_diameter(mean: float, ratio: float) -> float:
    """Equation (15): actual diameter [m] of the left wheel, from the mean diameter [m] and E_d."""
    return 2.0 * mean / (ratio + 1.0)


def right_diameter(mean: float, ratio: float) -> float:
    """Equation (16): actual diameter [m] of the right wheel, from the mean diameter [m] and E_d."""
    return 2.0 * mean / (1.0 / ratio + 1.0)


def wheel_way(rolled: FloatArray, diameter: float) -> FloatArray:
    """Equation (17): way (N,) [m] of a wheel that rolled by angles (N,) [rad].

    Printed without the half, and with one angle for both wheels, which could not turn: each wheel has its own here.
    """
    return 0.5 * rolled * diameter


@dataclass(frozen=True)
class PhaseErrors:
    """Systematic coefficients of one robot, drawn once."""

    k_l: float = 0.0  # [-]
    k_lt: float = 0.0  # [rad/m]
    k_t: float = 0.0  # [-]

    @classmethod
    def of_unit(cls, config: TwoPhaseConfig, unit: FloatArray) -> "PhaseErrors":
        """The robot that :meth:`WheelErrors.of_unit` makes of the same draws (3,), to first order.

        A line bends by k_lt = (E_d - 1) / b, a turn errs by k_t = 1 / E_b - 1: a wider base turns less.
        """
        return cls(
            k_l=config.k_l * float(unit[2]),
            k_lt=config.k_lt * float(unit[0]),
            k_t=-config.k_t * float(unit[1]),
        )


def increments_of(poses: FloatArray) -> Increments:
    """Split a path of poses (T, 3) into increments."""
    dx, dy = np.diff(poses[:, :2], axis=0).T
    turn = np.asarray(wrap_angle(np.diff(poses[:, 2])))
    middle = poses[:-1, 2] + 0.5 * turn
    cos = np.cos(middle)
    sin = np.sin(middle)
    return Increments(distance=cos * dx + sin * dy, lateral=-sin * dx + cos * dy, turn=turn)


def step_x(motion: Increments, middle: FloatArray) -> FloatArray:
    """Equation (18): change of x (N,) [m] of motions whose mean headings are ``middle`` (N,) [rad]."""
    return motion.distance * np.cos(middle) - motion.lateral * np.sin(middle)


def step_y(motion: Increments, middle: FloatArray) -> FloatArray:
    """Equation (19): change of y (N,) [m] of motions whose mean headings are ``middle`` (N,) [rad]."""
    return motion.distance * np.sin(middle) + motion.lateral * np.cos(middle)


def step_heading(way_right: FloatArray, way_left: FloatArray, wheel_base: float) -> FloatArray:
    """Equation (20): change of the heading (N,) [rad] by the ways of the wheels (N,) [m]."""
    return (way_right - way_left) / wheel_base


def integrate(start: FloatArray, increments: Increments) -> FloatArray:
    """Sum up the steps of (18)-(20): turn half, translate, turn half.

    Args:
        start: First pose, shape (3,).
        increments: T - 1 motions.

    Returns:
        Poses, shape (T, 3), heading wrapped.
    """
    heading = start[2] + _sums_from_zero(increments.turn)
    middle = heading[:-1] + 0.5 * increments.turn
    poses = np.empty((len(heading), 3))
    poses[:, 0] = start[0] + _sums_from_zero(step_x(increments, middle))
    poses[:, 1] = start[1] + _sums_from_zero(step_y(increments, middle))
    poses[:, 2] = wrap_angle(heading)
    return poses


def _sums_from_zero(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def believed_increments(true: Increments, errors: WheelErrors) -> Increments:
    """Motion that odometry with the actual wheels reports for the true one; the lateral part, unmeasured, is kept."""
    ratio = errors.diameter_ratio
    mean = errors.scale * WHEEL_DIAMETER
    half_turn = 0.5 * WHEEL_BASE * true.turn
    rolled_right = 2.0 * (true.distance + half_turn) / WHEEL_DIAMETER
    rolled_left = 2.0 * (true.distance - half_turn) / WHEEL_DIAMETER
    way_right = wheel_way(rolled_right, right_diameter(mean, ratio))
    way_left = wheel_way(rolled_left, left_diameter(mean, ratio))
    distance = 0.5 * (way_right + way_left)
    turn = step_heading(way_right, way_left, errors.wheel_base_ratio * WHEEL_BASE)
    return Increments(distance, true.lateral, turn)


def disturb(
    true: Increments, errors: PhaseErrors, config: TwoPhaseConfig, rng: np.random.Generator
) -> Increments:
    """Believed increments of the two phases: E_lin added to every distance, E_ang to every turn.

    Args:
        true: The motion.
        errors: Systematic coefficients.
        config: Random coefficients.
        rng: Source of the random part.
    """
    noise_linear, noise_angular = rng.standard_normal((2, len(true.turn)))
    root_driven = np.sqrt(np.abs(true.distance))
    root_turned = np.sqrt(np.abs(true.turn))
    linear = errors.k_l * true.distance + config.s_l * root_driven * noise_linear
    sigma_angular = config.s_t * root_turned + config.s_lt * root_driven
    systematic = errors.k_t * true.turn + errors.k_lt * true.distance
    angular = systematic + sigma_angular * noise_angular
    return Increments(true.distance + linear, true.lateral, true.turn + angular)
