"""From the errors of the odometry to errors of the map, by dead reckoning or by landmarks seen again.

Both conversions work on one robot: its systematic errors are drawn once and only written differently for either.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import BoolArray, Float32Array, FloatArray
from slamgym.parametric.config import ParametricConfig
from slamgym.parametric.ekf_slam import run_ekf
from slamgym.parametric.landmarks import landmark_problem
from slamgym.parametric.lidar_error import LidarErrors, draw_lidar_errors
from slamgym.parametric.odometry_error import (
    Increments,
    WheelErrors,
    believed_increments,
    integrate,
)
from slamgym.parametric.robot_scans import RobotScans
from slamgym.parametric.scan_matching import matched_path
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.two_phase import (
    PhaseErrors,
    disturb,
    placement_field,
)
from slamgym.parametric.visibility import Visibility


@dataclass(frozen=True)
class RobotErrors:
    """The systematic errors of one robot, drawn once."""

    wheels: WheelErrors
    phases: PhaseErrors
    lidar: LidarErrors


@dataclass(frozen=True)
class DeformStreams:
    """Independent randomness per cause, so that the same seed gives the same robot to every method."""

    odometry: np.random.Generator
    lidar: np.random.Generator
    noise: np.random.Generator
    unused: np.random.Generator  # once for failures of the matching: seeds keep their maps
    scans: np.random.Generator
    beams: np.random.Generator


@dataclass(frozen=True)
class ConversionInput:
    """What the conversion of odometry errors to map errors works on."""

    poses: FloatArray  # (T, 3) true poses of the scans
    motion: Increments  # between them
    visibility: Visibility
    robot: RobotErrors
    model: ParametricConfig
    streams: DeformStreams
    stamps: FloatArray  # (T,) [s]
    scans: RobotScans | None  # what the simulator's robot measures there, where it is asked for


@dataclass(frozen=True)
class Conversion:
    """What it makes of it."""

    field: Float32Array  # (2, H, W) [m] on true cells, true minus measured
    known: BoolArray  # (H, W) cells that have a value
    odometry: FloatArray  # (T, 3)
    believed: FloatArray  # (T, 3)


def draw_robot(model: ParametricConfig, streams: DeformStreams) -> RobotErrors:
    """Draw the systematic errors of one robot; wheels and phases are two descriptions of the same."""
    unit = streams.odometry.standard_normal(3)
    return RobotErrors(
        wheels=WheelErrors.of_unit(model.odometry, unit),
        phases=PhaseErrors.of_unit(model.two_phase, unit),
        lidar=draw_lidar_errors(model.lidar, streams.lidar),
    )


def convert(run: ConversionInput) -> Conversion:
    """The map's displacement by the method that the settings name."""
    if run.model.method == "two_phase":
        return _two_phase(run)
    return _scan_matching(run) if run.model.method == "scan_matching" else _landmark_slam(run)


def _two_phase(run: ConversionInput) -> Conversion:
    """Empirical odometry errors, and every cell where its scan would have put it."""
    controls = disturb(run.motion, run.robot.phases, run.model.two_phase, run.streams.noise)
    believed = integrate(run.poses[0], controls)
    return _placed(run, controls, believed)


def _scan_matching(run: ConversionInput) -> Conversion:
    """The same odometry, pulled towards the map by a scan matcher."""
    if run.scans is None:
        raise ValueError("scan matching needs the robot's scans")
    controls = disturb(run.motion, run.robot.phases, run.model.two_phase, run.streams.noise)
    believed = matched_path(
        run.scans,
        controls,
        np.maximum(1.0, np.round(np.diff(run.stamps) * run.model.sensing.lidar.rate)),
        run.visibility.frame,
        run.model.matching,
        run.streams.noise,
    )
    return _placed(run, controls, believed)


def _placed(run: ConversionInput, controls: Increments, believed: FloatArray) -> Conversion:
    """Every cell where the first scan that saw it put it."""
    return Conversion(
        field=placement_field(run.poses, believed, run.visibility),
        known=run.visibility.seen,
        odometry=integrate(run.poses[0], controls),
        believed=believed,
    )


def _landmark_slam(run: ConversionInput) -> Conversion:
    """EKF-SLAM over wall cells, batched or as one least-squares problem."""
    model, frame = run.model, run.visibility.frame
    base, diameter = model.odometry.wheel_base, model.odometry.wheel_diameter
    controls = believed_increments(run.motion, run.robot.wheels, base, diameter)
    problem = landmark_problem(
        run.poses,
        controls,
        run.visibility,
        model.scanner.mount_x,
        run.robot.lidar,
        model.ekf,
        run.streams.noise,
    )
    if model.method == "ekf":
        estimate = run_ekf(problem, model.ekf.max_landmarks)
    else:
        estimate = solve_schur(problem, model.ekf.iterations)
    rows, cols = np.divmod(problem.cells, frame.width_px)
    field = np.zeros((2, *frame.shape), dtype=np.float32)
    field[:, rows, cols] = (problem.points - estimate.landmarks).T
    known = np.zeros(frame.shape, dtype=np.bool_)
    known[rows, cols] = True
    return Conversion(field, known, integrate(run.poses[0], controls), estimate.poses)
