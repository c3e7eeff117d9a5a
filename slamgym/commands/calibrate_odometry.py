"""``slamgym calibrate-odometry``: measure the simulated robot's odometry as one measures a real one's.

The robot drives straight lines and turns in place in an empty hall; true and believed motion give the
coefficients of the two-phase model (Souza et al. 2008), which ``slamgym deform --calibration`` takes.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import numpy as np

from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, Within
from slamgym.core.geometry import between
from slamgym.core.progress import tell
from slamgym.core.types import FloatArray, Pose2D, Twist2D
from slamgym.sim import OdometryLevel

if TYPE_CHECKING:
    from slamgym.parametric.calibration import Runs
    from slamgym.sim import OdometryConfig, RobotConfig, WheelOdometry, World

_STEP = 0.05  # [s]
_HALL = 20.0  # [m]
_LENGTH = 3.0
"""Longest straight line [m]; the shortest is a third of it."""
_ANGLE = 2.0 * math.pi
"""Largest turn [rad], in either direction; the smallest is a quarter of it."""


class CalibrateArguments(Arguments):
    """Measure the odometry errors of straight lines and turns in place, and write their coefficients."""

    out: Out
    """JSON file to write."""
    odometry: OdometryLevel = "medium"
    """Level of the odometry errors."""
    robots: Annotated[int, Within(ge=2)] = 60
    """Robots; each draws its own systematic errors."""
    repeats: Annotated[int, Within(ge=2)] = 8
    """Lines and turns per robot."""
    seed: int = 0
    """Seed of everything random."""


def main(arguments: CalibrateArguments) -> None:
    """Run the command."""
    from slamgym.parametric.calibration import fit_phases, write_calibration
    from slamgym.sim import RobotConfig, odometry_level

    runs = measure_odometry(
        odometry_level(arguments.odometry),
        RobotConfig(),
        arguments.robots,
        arguments.repeats,
        np.random.default_rng(arguments.seed),
    )
    coefficients = fit_phases(runs)
    about = {name: value for name, value in asdict(arguments).items() if name != "out"}
    write_calibration(arguments.out, coefficients, about)
    tell(f"{arguments.robots} robots x {arguments.repeats} lines and turns, odometry {arguments.odometry}:")
    tell(*(f"  {name:<5}{value:.5f}" for name, value in asdict(coefficients).items()), str(arguments.out))


def measure_odometry(
    odometry: OdometryConfig,
    robot: RobotConfig,
    num_robots: int,
    repeats: int,
    rng: np.random.Generator,
) -> Runs:
    """Drive the calibration runs of several robots.

    Args:
        odometry: Sizes of the errors.
        robot: The robot's measures and limits.
        num_robots: Robots, each with its own systematic errors.
        repeats: Lines and turns per robot.
        rng: Source of all randomness.
    """
    import shapely

    from slamgym.cad import FloorPlan
    from slamgym.parametric.calibration import Runs
    from slamgym.sim import WheelOdometry, World

    hall = FloorPlan("calibration hall", shapely.box(0.0, 0.0, _HALL, _HALL))
    world = World(hall, robot)
    rows = np.empty((5, num_robots, repeats))
    for i in range(num_robots):
        wheels = WheelOdometry(odometry, robot, rng)
        for j in range(repeats):
            target = _LENGTH * (1.0 - 2.0 / 3.0 * j / (repeats - 1))
            forward = Twist2D(0.8 * robot.max_linear, 0.0)
            true, seen = _run(world, wheels, forward, target, rng)
            rows[:3, i, j] = true[0], seen[0] - true[0], seen[1] - true[1]
            span = _ANGLE * (1.0 - 0.75 * j / (repeats - 1))
            spin = Twist2D(0.0, (1.0 if j % 2 else -1.0) * 0.5 * robot.max_angular)
            true, seen = _run(world, wheels, spin, span, rng)
            rows[3:, i, j] = true[1], seen[1] - true[1]
    return Runs(*rows)


def _run(
    world: World, wheels: WheelOdometry, command: Twist2D, amount: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Follow a command until the body has moved ``amount`` [m or rad].

    Returns:
        True and believed (distance [m], turn [rad]), turns not wrapped.
    """
    world.reset(Pose2D(0.25 * _HALL, 0.5 * _HALL, 0.0))
    wheels.reset(world.pose)
    true, seen = np.zeros(2), np.zeros(2)
    while abs(true[0 if command.linear else 1]) < amount:
        motion = world.step(command, _STEP)
        step = between(wheels.pose, wheels.update(motion, rng))
        true += motion.increment.x, motion.increment.theta
        seen += step.x, step.theta
    return true, seen
