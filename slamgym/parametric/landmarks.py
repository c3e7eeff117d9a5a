"""EKF-SLAM's problem: wall cells as landmarks with known association, what one run measures, the observation model."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Float32Array, FloatArray, Int32Array, IntArray
from slamgym.parametric.config import EkfConfig
from slamgym.parametric.lidar_error import (
    LidarErrors,
    displacement_x,
    displacement_y,
    measured_sight,
)
from slamgym.parametric.odometry_error import Increments, increments_of
from slamgym.parametric.visibility import Visibility

_DISTANCE_FLOOR = 0.002
"""Least standard deviation of an increment's distance [m]; the systematic part on top is the paper's."""
_HEADING_FLOOR_DEG = 0.1
"""Least standard deviation of an increment's turn [deg]; the systematic part on top is the paper's."""
_LATERAL_SLIP = 0.0005
"""Standard deviation of the slip sideways [m]; small, it only keeps the increments' covariance regular."""


@dataclass(frozen=True)
class LandmarkProblem:
    """EKF-SLAM with known association: controls, measurements, and the truth to linearise about.

    Convention: world frame; bearings counter-clockwise from the heading, seen from the scanner, which stands
    ``mount_x`` ahead of the base.
    """

    true_poses: FloatArray  # (T, 3)
    controls: FloatArray  # (T - 1, 3) believed distance [m], lateral [m], turn [rad]
    control_sigmas: FloatArray  # (T - 1, 3) of the same
    mount_x: float  # [m]
    cells: Int32Array  # (N,) flat index of each landmark's cell, in the order of first observation
    points: FloatArray  # (N, 2) true landmarks [m]
    scan: IntArray  # (M,) scan of each observation, not decreasing
    landmark: IntArray  # (M,) landmark of each observation
    measured: FloatArray  # (M, 2) range [m] and bearing [rad]
    sigmas: FloatArray  # (2,) of a range [m] and a bearing [rad]


class LandmarkEstimate(NamedTuple):
    """SLAM's estimate for a problem."""

    poses: FloatArray  # (T, 3)
    landmarks: FloatArray  # (N, 2) [m]


def landmark_problem(
    true_poses: FloatArray,
    controls: Increments,
    visibility: Visibility,
    errors: LidarErrors,
    config: EkfConfig,
    rng: np.random.Generator,
    noise: float = 1.0,
    field: Float32Array | None = None,
) -> LandmarkProblem:
    """Draw the measurements of one run.

    The LIDAR's displacement of a wall enters here, as the paper's z_meas and alpha_meas, and so must not be added to
    the map again.

    Args:
        true_poses: (T, 3).
        controls: T - 1 motions that odometry reports.
        visibility: Which beams meet which cells.
        errors: Systematic LIDAR errors.
        config: Assumed noise, number of landmarks.
        rng: Source of randomness.
        noise: Noise that the measurements really have, as a share of what is assumed.
        field: Displacements (2, H, W) [m] of the walls where they don't follow from where they are seen from.
    """
    scan, seen_cells = _observed_cells(visibility.cells.hits, config.landmarks_per_scan, rng)
    cells, landmark = _numbered_by_first_use(seen_cells)
    points = visibility.cell_points(cells)
    sensors = visibility.sensors[scan]
    offsets = points[landmark] - sensors[:, :2]
    if field is None:
        shifts = _systematic_shifts(offsets, sensors[:, 2], errors)
    else:
        shifts = field.reshape(2, -1)[:, seen_cells].T.astype(np.float64)
    seen_range, direction = measured_sight(offsets, shifts)
    sigma_range = max(config.sigma_range, visibility.frame.resolution / math.sqrt(12.0))
    sigma_bearing = math.radians(config.sigma_bearing_deg)
    range_noise, bearing_noise = noise * rng.standard_normal((2, len(scan)))
    measured_range = seen_range + sigma_range * range_noise
    measured_bearing = wrap_angle(direction - sensors[:, 2] + sigma_bearing * bearing_noise)
    believed = np.column_stack(controls)
    return LandmarkProblem(
        true_poses=true_poses,
        controls=believed,
        control_sigmas=control_sigmas(believed, np.column_stack(increments_of(true_poses))),
        mount_x=visibility.mount_x,
        cells=cells,
        points=points,
        scan=scan,
        landmark=landmark,
        measured=np.column_stack([measured_range, measured_bearing]),
        sigmas=np.array([sigma_range, sigma_bearing]),
    )


def control_sigmas(believed: FloatArray, true: FloatArray) -> FloatArray:
    """Standard deviations (T - 1, 3) of believed motions (T - 1, 3): distance [m], lateral [m], turn [rad].

    The paper takes the difference of nominal and actual motion itself for a covariance. It is a bias with a sign: here
    its size is a standard deviation, on top of a floor.
    """
    sigmas = np.abs(believed - true)
    sigmas += (_DISTANCE_FLOOR, 0.0, math.radians(_HEADING_FLOOR_DEG))
    sigmas[:, 1] = _LATERAL_SLIP
    return sigmas


def _systematic_shifts(offsets: FloatArray, heading: FloatArray, errors: LidarErrors) -> FloatArray:
    """Displacements (M, 2) [m] by (11) and (12) of walls at offsets (M, 2) [m] from scanners with headings (M,)."""
    distance = np.hypot(*offsets.T)
    direction = np.arctan2(offsets[:, 1], offsets[:, 0])
    bearing = np.asarray(wrap_angle(direction - heading))
    bearing_error = errors.bearing_error(distance, bearing)
    measured = distance - errors.range_error(distance)
    shift_x = displacement_x(distance, direction, measured, bearing_error)
    shift_y = displacement_y(distance, direction, measured, bearing_error)
    return np.column_stack([shift_x, shift_y])


def _numbered_by_first_use(seen_cells: Int32Array) -> tuple[Int32Array, IntArray]:
    """Each cell once, in the order of first observation (N,), and its number for each observation (M,)."""
    cells, first_use, number = np.unique(seen_cells, return_index=True, return_inverse=True)
    order = np.argsort(first_use, kind="stable")
    new_number = np.argsort(order)
    return cells[order], new_number[number]


def _observed_cells(
    hits: Int32Array, per_scan: int, rng: np.random.Generator
) -> tuple[IntArray, Int32Array]:
    """(scan, cell) of every observation: each cell once per scan, at most ``per_scan`` of them, at random."""
    of_scan = []
    for row in hits:
        seen = np.unique(row)
        seen = seen[seen >= 0]
        if per_scan and len(seen) > per_scan:
            seen = np.sort(rng.choice(seen, per_scan, replace=False))
        of_scan.append(seen)
    counts = [len(seen) for seen in of_scan]
    return np.repeat(np.arange(len(hits)), counts), np.concatenate(of_scan)


def observation_model(
    poses: FloatArray, points: FloatArray, mount_x: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range and bearing of landmarks from poses, with Jacobians.

    Args:
        poses: (M, 3) of the base.
        points: (M, 2).
        mount_x: [m] of the scanner ahead of the base.

    Returns:
        Predicted (M, 2) range [m] and bearing [rad, not wrapped]; Jacobian by the pose (M, 2, 3); by the
        landmark (M, 2, 2).
    """
    x, y, heading = poses.T
    cos = np.cos(heading)
    sin = np.sin(heading)
    dx = points[:, 0] - (x + mount_x * cos)
    dy = points[:, 1] - (y + mount_x * sin)
    square = np.maximum(dx**2 + dy**2, 1e-12)
    distance = np.sqrt(square)
    bearing = np.arctan2(dy, dx) - heading
    by_point = np.empty((len(poses), 2, 2))
    by_point[:, 0, 0] = dx / distance
    by_point[:, 0, 1] = dy / distance
    by_point[:, 1, 0] = -dy / square
    by_point[:, 1, 1] = dx / square
    by_pose = np.empty((len(poses), 2, 3))
    by_pose[:, :, :2] = -by_point
    # Turning the base also swings the scanner.
    swing = np.column_stack([-mount_x * sin, mount_x * cos])
    by_pose[:, :, 2] = -np.einsum("mij,mj->mi", by_point, swing)
    by_pose[:, 1, 2] -= 1.0
    return np.column_stack([distance, bearing]), by_pose, by_point
