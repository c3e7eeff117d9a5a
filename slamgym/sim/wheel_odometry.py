"""Wheel odometry: what a robot believes about its motion from the turning of its wheels alone.

It integrates what the wheels *rolled*, not what was commanded and not how the body moved: where contact holds
the body and the wheels spin, odometry errs as a real one does.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from slamgym.core.config import CountOrZero, NonNegative, Settings, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D
from slamgym.sim.robot import WHEEL_RADIUS, RobotConfig

if TYPE_CHECKING:
    from slamgym.sim.space import Motion

OdometryLevel = Literal["ideal", "low", "medium", "high"]


class OdometryConfig(Settings, section="odometry"):
    """Errors of wheel odometry; the defaults are the level ``medium`` of :func:`odometry_level`.

    Systematic errors are drawn once per robot, i.e. per episode, each with a mean of 1: E_d, the right wheel's
    diameter over the left's, and E_b, the effective wheel base over the nominal one, as Borenstein and Feng define
    them (UMBmark, IEEE Trans. Robotics and Automation 12(6), 1996), and a common scale, measured over true distance.
    Random slip grows with the square root of the distance and of the turned angle, as a sum of independent slips does
    (Chong and Kleeman, ICRA 1997).
    """

    model: Literal["wheel", "ideal"] = "wheel"
    """``ideal`` reports the body's true motion, as TurtleBot3's stock Gazebo plugin does."""

    ticks_per_revolution: CountOrZero = 4096
    """Encoder resolution (Dynamixel XM430-W210 e-manual: 4,096 a turn); 0 for a continuous
    encoder."""

    diameter_ratio_std: NonNegative = 0.0017
    """Spread of E_d over robots."""

    wheelbase_ratio_std: NonNegative = 0.018
    """Spread of E_b over robots and floors."""

    scale_std: NonNegative = 0.006
    """Spread of the scale."""

    slip_distance: NonNegative = 0.0045
    """Random error of the distance, per square root of a metre [m/sqrt(m)]."""

    slip_drift: NonNegative = 0.009
    """Random error of the heading, per square root of a metre driven [rad/sqrt(m)]."""

    slip_turn: NonNegative = 0.017
    """Random error of the heading, per square root of a turned radian [rad/sqrt(rad)]."""


_LEVELS: dict[OdometryLevel, OdometryConfig] = {
    # The plugin reads the simulator's own pose.
    "ideal": OdometryConfig("ideal", 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    # A calibrated robot on a smooth floor: figures recomputed from OptiOdom's and Ivanjko's data sets. E_b
    # 0.983 to 1.013; heading per metre 0.0040 rad rms, which is E_d - 1 = 0.0040 * 0.287 m; slips 0.0005,
    # 0.004, 0.0035.
    "low": OdometryConfig(
        diameter_ratio_std=0.0011,
        wheelbase_ratio_std=0.011,
        scale_std=0.002,
        slip_distance=0.0005,
        slip_drift=0.004,
        slip_turn=0.0035,
    ),
    # Geometric means of low and high, about three times from either.
    "medium": OdometryConfig(),
    # Six public logs of other robots: distance 2.6 to 5.4 % (4 % here), heading 0.5
    # to 1.8 deg a metre (1.2 here, half of the least again as a constant drift), turns 3.5 to 13 % (8 %
    # here), bias to 3 %.
    "high": OdometryConfig(
        diameter_ratio_std=0.0025,
        wheelbase_ratio_std=0.03,
        scale_std=0.02,
        slip_distance=0.04,
        slip_drift=0.021,
        slip_turn=0.08,
    ),
}


def odometry_level(name: str) -> OdometryConfig:
    """Odometry errors by name.

    ``ideal``: none, as in stock Gazebo. ``low``: a calibrated robot (OptiOdom). ``high``: as measured from
    six public logs of older robots. ``medium``: between the two, which differ by about ten.

    Raises:
        ConfigError: If there is no such level.
    """
    for level, config in _LEVELS.items():
        if level == name:
            return config
    raise ConfigError(f"unknown odometry level {name!r}; {suggest(name, _LEVELS)}")


def name_of_odometry(config: OdometryConfig) -> OdometryLevel | Literal["custom"]:
    """The error level that these settings are, or ``custom``."""
    return next((level for level, known in _LEVELS.items() if known == config), "custom")


class WheelOdometry:
    """Encoders and dead reckoning of one robot.

    Args:
        config: Sizes of the errors.
        robot: The robot's nominal measures.
        rng: Draws this robot's systematic errors.

    Attributes:
        pose: Integrated pose in the odometry frame.
        diameter_ratio: This robot's E_d.
        wheelbase_ratio: This robot's E_b.
        scale: This robot's ratio of measured to true distance.
        gains: Distance that the left and the right nominal wheel would have rolled over what the real one did.
        believed_base: The wheel base that the odometry believes in [m].
    """

    def __init__(
        self, config: OdometryConfig, robot: RobotConfig, rng: np.random.Generator
    ) -> None:
        self.config = config
        diameter, wheelbase, scale = rng.standard_normal(3).tolist()
        self.diameter_ratio = 1.0 + config.diameter_ratio_std * diameter
        self.wheelbase_ratio = 1.0 + config.wheelbase_ratio_std * wheelbase
        self.scale = 1.0 + config.scale_std * scale
        # Distance that the nominal wheel would have rolled over what the real one did. D_L = 2 / (E_d + 1) D
        # and D_R = 2 / (1 / E_d + 1) D (Borenstein and Feng 1996, the inverse of their correction factors).
        left_gain = self.scale * 0.5 * (self.diameter_ratio + 1.0)
        self.gains = left_gain, self.scale * 0.5 * (1.0 / self.diameter_ratio + 1.0)
        # The robot's true wheel base is the configured one, so the odometry believes in a wrong one.
        self.believed_base = robot.wheel_separation / self.wheelbase_ratio
        ticks = config.ticks_per_revolution
        self._tick = 2.0 * math.pi * WHEEL_RADIUS / ticks if ticks else 0.0
        self._slips = config.slip_distance, config.slip_drift, config.slip_turn
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self._rolled = (0.0, 0.0)

    def reset(self, pose: Pose2D) -> None:
        """Start to integrate from a pose; the robot, with its systematic errors, stays the same."""
        self.pose = pose
        self._rolled = (0.0, 0.0)

    def update(self, motion: Motion, rng: np.random.Generator) -> Pose2D:
        """Integrate one step.

        Args:
            motion: What the robot did.
            rng: Source of the slip.

        Returns:
            The pose in the odometry frame.
        """
        if self.config.model == "ideal":
            self.pose = compose(self.pose, motion.increment)
            return self.pose
        before = self._rolled
        left_before, right_before = before
        left, right = motion.wheels
        left_gain, right_gain = self.gains
        self._rolled = (left_before + left_gain * left, right_before + right_gain * right)
        counted = count_ticks(before, self._rolled, self._tick)
        slip, drift, turn = rng.standard_normal(3).tolist()
        moved = slipped_arc(counted, self.believed_base, self._slips, (slip, drift, turn))
        self.pose = compose(self.pose, moved)
        return self.pose


def count_ticks(
    before: tuple[float, float], rolled: tuple[float, float], tick: float
) -> tuple[float, float]:
    """Distance of each wheel by its ticks [m]; a fraction of a tick is carried over to the next reading.

    Args:
        before: How far the wheels had rolled [m].
        rolled: How far they have rolled [m].
        tick: Length of a tick [m]; 0 for a continuous encoder.
    """
    left_before, right_before = before
    left, right = rolled
    if tick == 0.0:
        return left - left_before, right - right_before
    left_ticks = math.floor(left / tick) - math.floor(left_before / tick)
    right_ticks = math.floor(right / tick) - math.floor(right_before / tick)
    return left_ticks * tick, right_ticks * tick


def slipped_arc(
    wheels: tuple[float, float],
    base: float,
    slips: tuple[float, float, float],
    normal: tuple[float, float, float],
) -> Pose2D:
    """Where the robot seems to be after a step, seen from before it.

    Args:
        wheels: What the encoders counted, left and right [m].
        base: The wheel base that the odometry believes in [m].
        slips: ``slip_distance``, ``slip_drift`` and ``slip_turn`` of the settings.
        normal: Standard normal draws for each.
    """
    distance = 0.5 * (wheels[0] + wheels[1])
    turn = (wheels[1] - wheels[0]) / base
    root_distance = math.sqrt(abs(distance))
    root_turn = math.sqrt(abs(turn))
    distance += slips[0] * root_distance * normal[0]
    turn += slips[1] * root_distance * normal[1] + slips[2] * root_turn * normal[2]
    half = 0.5 * turn
    shortening = math.sin(half) / half if abs(half) > 1e-8 else 1.0
    length = distance * shortening
    return Pose2D(length * math.cos(half), length * math.sin(half), turn)
