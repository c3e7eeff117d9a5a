"""EKF-SLAM over wall cells as landmarks with known association: what one run measures, and its observation model."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Int32Array, IntArray
from slamgym.parametric.config import EkfConfig
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import Increments, increments_of
from slamgym.parametric.visibility import Visibility

_DISTANCE_FLOOR, _HEADING_FLOOR_DEG = 0.002, 0.1
"""Least standard deviations of an increment [m, deg]; the systematic parts on top are the paper's."""
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
    mount_x: float,
    errors: LidarErrors,
    config: EkfConfig,
    rng: np.random.Generator,
    noise: float = 1.0,
) -> LandmarkProblem:
    """Draw the measurements of one run.

    The systematic LIDAR error enters here, as the paper's z_meas, and so must not be added to the map again.

    Args:
        true_poses: (T, 3).
        controls: T - 1 motions that odometry reports.
        visibility: Which beams meet which cells.
        mount_x: [m] of the scanner ahead of the base.
        errors: Systematic LIDAR errors.
        config: Assumed noise, number of landmarks.
        rng: Source of randomness.
        noise: Noise that the measurements really have, as a share of what is assumed.
    """
    scan, cells = _observed_cells(visibility.cells.hits, config.landmarks_per_scan, rng)
    unique, first_use, landmark = np.unique(cells, return_index=True, return_inverse=True)
    order = np.argsort(first_use, kind="stable")
    landmark, unique = np.argsort(order)[landmark], unique[order]
    points = visibility.cell_points(unique)
    sensors = visibility.sensors[scan]
    delta = points[landmark] - sensors[:, :2]
    distance = np.hypot(delta[:, 0], delta[:, 1])
    bearing = np.asarray(wrap_angle(np.arctan2(delta[:, 1], delta[:, 0]) - sensors[:, 2]))
    sigma_range = max(config.sigma_range, visibility.frame.resolution / math.sqrt(12.0))
    sigma_bearing = math.radians(config.sigma_bearing_deg)
    draws = noise * rng.standard_normal((2, len(scan)))
    believed = np.column_stack(controls)
    # The paper takes the difference of nominal and actual motion for a standard deviation.
    control_sigmas = np.abs(believed - np.column_stack(increments_of(true_poses)))
    control_sigmas += (_DISTANCE_FLOOR, 0.0, math.radians(_HEADING_FLOOR_DEG))
    control_sigmas[:, 1] = _LATERAL_SLIP
    measured = np.column_stack(
        [
            distance - errors.range_error(distance) + sigma_range * draws[0],
            bearing - errors.bearing_error(distance, bearing) + sigma_bearing * draws[1],
        ]
    )
    sigmas = np.array([sigma_range, sigma_bearing])
    return LandmarkProblem(
        true_poses,
        believed,
        control_sigmas,
        mount_x,
        unique,
        points,
        scan,
        landmark,
        measured,
        sigmas,
    )


def _observed_cells(
    hits: Int32Array, per_scan: int, rng: np.random.Generator
) -> tuple[IntArray, Int32Array]:
    """(scan, cell) of every observation: each cell once per scan, at most ``per_scan`` of them, at random."""
    cells = []
    for row in hits:
        seen = np.unique(row)
        seen = seen[seen >= 0]
        if per_scan and len(seen) > per_scan:
            seen = np.sort(rng.choice(seen, per_scan, replace=False))
        cells.append(seen)
    return np.repeat(np.arange(len(hits)), [len(seen) for seen in cells]), np.concatenate(cells)


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
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx = points[:, 0] - (poses[:, 0] + mount_x * cos)
    dy = points[:, 1] - (poses[:, 1] + mount_x * sin)
    square = np.maximum(dx**2 + dy**2, 1e-12)
    distance = np.sqrt(square)
    predicted = np.column_stack([distance, np.arctan2(dy, dx) - poses[:, 2]])
    by_point = np.empty((len(poses), 2, 2))
    by_point[:, 0, 0], by_point[:, 0, 1] = dx / distance, dy / distance
    by_point[:, 1, 0], by_point[:, 1, 1] = -dy / square, dx / square
    by_pose = np.empty((len(poses), 2, 3))
    by_pose[:, :, :2] = -by_point
    # Turning the base also swings the scanner.
    swing = np.column_stack([-mount_x * sin, mount_x * cos])
    by_pose[:, :, 2] = -np.einsum("mij,mj->mi", by_point, swing)
    by_pose[:, 1, 2] -= 1.0
    return predicted, by_pose, by_point
