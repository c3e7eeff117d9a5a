"""Wall cells as landmarks: which scan measures which cell, and as what."""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Int32Array, IntArray
from slamgym.parametric.config import EkfConfig
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import Increments, increments_of
from slamgym.parametric.visibility import Visibility


@dataclass(frozen=True)
class LandmarkProblem:
    """EKF-SLAM with known association: controls, measurements, and the truth to linearise about.

    Convention: world frame; bearings counter-clockwise from the heading, seen from the scanner, which stands
    ``mount_x`` ahead of the base.
    """

    true_poses: FloatArray  # (T, 3)
    controls: Increments  # T - 1 believed motions
    control_sigmas: FloatArray  # (T - 1, 3) of distance [m], lateral [m], turn [rad]
    mount_x: float  # [m]
    cells: Int32Array  # (N,) flat index of each landmark's cell, in the order of first observation
    points: FloatArray  # (N, 2) true landmarks [m]
    scan: IntArray  # (M,) scan of each observation, not decreasing
    landmark: IntArray  # (M,) landmark of each observation
    ranges: FloatArray  # (M,) [m]
    bearings: FloatArray  # (M,) [rad]
    sigmas: tuple[float, float]  # of a range [m] and a bearing [rad]


@dataclass(frozen=True)
class LandmarkEstimate:
    """What SLAM makes of a problem."""

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
) -> LandmarkProblem:
    """Draw the measurements of one run.

    The systematic LIDAR error enters here, as the paper's z_meas, and so must not be added to the map again.

    Args:
        true_poses: (T, 3).
        controls: T - 1 motions that odometry reports.
        visibility: Which beams meet which cells.
        mount_x: [m] of the scanner ahead of the base.
        errors: Systematic LIDAR errors.
        config: Noise, number of landmarks.
        rng: Source of randomness.
    """
    true_motion = increments_of(true_poses)
    scan, cells = _observed_cells(visibility.cells.hits, config.landmarks_per_scan, rng)
    unique, first_use, landmark = np.unique(cells, return_index=True, return_inverse=True)
    order = np.argsort(first_use, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    landmark, unique = rank[landmark], unique[order]
    points = visibility.cell_points(unique)
    sensors = visibility.sensors[scan]
    delta = points[landmark] - sensors[:, :2]
    distance = np.hypot(delta[:, 0], delta[:, 1])
    bearing = np.asarray(wrap_angle(np.arctan2(delta[:, 1], delta[:, 0]) - sensors[:, 2]))
    sigma_range = max(config.sigma_range, visibility.frame.resolution / math.sqrt(12.0))
    sigma_bearing = math.radians(config.sigma_bearing_deg)
    noise = config.noise * rng.standard_normal((2, len(scan)))
    floors = (config.sigma_distance_floor, math.radians(config.sigma_heading_floor_deg))
    return LandmarkProblem(
        true_poses=true_poses,
        controls=controls,
        # The paper takes the difference of nominal and actual motion for a standard deviation.
        control_sigmas=np.column_stack(
            [
                np.abs(controls.distance - true_motion.distance) + floors[0],
                np.full(len(controls.turn), config.sigma_lateral),
                np.abs(controls.turn - true_motion.turn) + floors[1],
            ]
        ),
        mount_x=mount_x,
        cells=unique,
        points=points,
        scan=scan,
        landmark=landmark,
        ranges=distance - errors.range_error(distance) + sigma_range * noise[0],
        bearings=bearing - errors.bearing_error(distance, bearing) + sigma_bearing * noise[1],
        sigmas=(sigma_range, sigma_bearing),
    )


def _observed_cells(hits: Int32Array, per_scan: int, rng: np.random.Generator) -> tuple[IntArray, Int32Array]:
    """(scan, cell) of every observation: each cell once per scan, at most ``per_scan`` of them, at random."""
    scans, cells = [], []
    for k in range(len(hits)):
        seen = np.unique(hits[k])
        seen = seen[seen >= 0]
        if per_scan and len(seen) > per_scan:
            seen = np.sort(rng.choice(seen, per_scan, replace=False))
        scans.append(np.full(len(seen), k))
        cells.append(seen)
    return np.concatenate(scans), np.concatenate(cells)


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
