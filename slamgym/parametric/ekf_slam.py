"""EKF-SLAM over wall cells as landmarks, all observations of a scan in one update.

The textbook update (I - K H) P with dense H costs O(n^3) per landmark, which is what makes the paper's
conversion take 15-94 s at 64 x 64. Here H is gathered, never built, and the m observations of a scan enter as
P -= W^T W with W = L^-1 H P and L the Cholesky factor of the innovation covariance: O(m n^2) per scan, and P
stays symmetric and positive semi-definite by construction.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Int32Array, IntArray
from slamgym.parametric.config import EkfConfig
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import Increments, increments_of
from slamgym.parametric.visibility import Visibility

MAX_LANDMARKS = 4000
"""The batched filter's covariance grows with the square of this; more landmarks are refused."""
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
        true_poses, believed, control_sigmas, mount_x, unique, points, scan, landmark, measured, sigmas
    )


def _observed_cells(hits: Int32Array, per_scan: int, rng: np.random.Generator) -> tuple[IntArray, Int32Array]:
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


class BatchedEkf:
    """The filter's state: the base pose, then the landmarks in the order in which they were first seen.

    Args:
        start: First pose (3,), known exactly.
        num_landmarks: How many landmarks will come; memory grows with its square.
        mount_x: [m] of the scanner ahead of the base.
        sigmas: Standard deviations of a range [m] and a bearing [rad], (2,).

    Attributes:
        mean: Pose (heading not wrapped) and landmarks.
        covariance: Their covariance.
        size: Numbers that are in use of either.
    """

    def __init__(self, start: FloatArray, num_landmarks: int, mount_x: float, sigmas: FloatArray) -> None:
        n = 3 + 2 * num_landmarks
        self.mean = np.zeros(n)
        self.mean[:3] = start
        self.covariance = np.zeros((n, n))
        self.size = 3
        self._mount_x = mount_x
        self._noise = np.square(sigmas)

    def predict(self, motion: FloatArray, sigmas: FloatArray) -> None:
        """Move by a control (distance [m], lateral [m], turn [rad]) with these standard deviations (3,)."""
        distance, lateral, turn = motion
        middle = self.mean[2] + 0.5 * turn
        cos, sin = np.cos(middle), np.sin(middle)
        dx, dy = cos * distance - sin * lateral, sin * distance + cos * lateral
        self.mean[:3] += (dx, dy, turn)
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        V = np.array([[cos, -sin, -0.5 * dy], [sin, cos, 0.5 * dx], [0.0, 0.0, 1.0]])
        n, P = self.size, self.covariance
        P[:3, :n] = F @ P[:3, :n]
        P[:n, :3] = P[:n, :3] @ F.T
        P[:3, :3] += (V * sigmas**2) @ V.T

    def add_landmarks(self, measured: FloatArray) -> None:
        """Append landmarks first seen in this scan at (range, bearing), shape (m, 2)."""
        x, y, theta = self.mean[:3]
        r, direction = measured[:, 0], theta + measured[:, 1]
        cos, sin = np.cos(direction), np.sin(direction)
        n, m, P = self.size, 2 * len(measured), self.covariance
        points = np.empty((len(measured), 2))
        points[:, 0] = x + self._mount_x * np.cos(theta) + r * cos
        points[:, 1] = y + self._mount_x * np.sin(theta) + r * sin
        self.mean[n : n + m] = points.ravel()
        by_pose = np.zeros((len(measured), 2, 3))
        by_pose[:, 0, 0] = by_pose[:, 1, 1] = 1.0
        by_pose[:, 0, 2], by_pose[:, 1, 2] = y - points[:, 1], points[:, 0] - x
        G = by_pose.reshape(m, 3)
        P[n : n + m, :n] = G @ P[:3, :n]
        P[:n, n : n + m] = P[n : n + m, :n].T
        block = G @ P[:3, :3] @ G.T
        Z = np.stack([cos, -r * sin, sin, r * cos], axis=-1).reshape(-1, 2, 2)  # by the measurement
        i = np.arange(len(measured))
        block.reshape(len(i), 2, len(i), 2)[i, :, i] += np.einsum("mij,j,mkj->mik", Z, self._noise, Z)
        P[n : n + m, n : n + m] = block
        self.size = n + m

    def update(self, landmark: IntArray, measured: FloatArray) -> None:
        """Correct by all observations of a scan at once.

        Args:
            landmark: (m,) indices of landmarks seen before.
            measured: (m, 2) range [m] and bearing [rad].
        """
        n, P = self.size, self.covariance
        columns = 3 + 2 * landmark[:, None] + np.arange(2)  # (m, 2)
        poses = np.broadcast_to(self.mean[:3], (len(landmark), 3))
        predicted, by_pose, by_point = observation_model(poses, self.mean[columns], self._mount_x)
        innovation = measured - predicted
        innovation[:, 1] = wrap_angle(innovation[:, 1])
        m = 2 * len(landmark)
        # H P, (m, n): H touches the pose's three rows of P and the landmark's two.
        HP = np.einsum("mij,jn->min", by_pose, P[:3, :n])
        HP += np.einsum("mij,mjn->min", by_point, P[columns, :n])
        HP = HP.reshape(m, n)
        # H P H^T, (m, m), by the same gathering on the columns.
        S = HP[:, :3] @ by_pose.reshape(m, 3).T
        S += np.einsum("rmj,mij->rmi", HP[:, columns], by_point).reshape(m, m)
        S = 0.5 * (S + S.T)
        S[np.arange(m), np.arange(m)] += np.tile(self._noise, len(landmark))
        L = cholesky(S, lower=True, check_finite=False)
        W = solve_triangular(L, HP, lower=True, check_finite=False)  # (m, n)
        self.mean[:n] += solve_triangular(L, innovation.ravel(), lower=True, check_finite=False) @ W
        P[:n, :n] -= W.T @ W


def run_ekf(problem: LandmarkProblem, max_landmarks: int = MAX_LANDMARKS) -> LandmarkEstimate:
    """Filter a whole run.

    Args:
        problem: Controls and measurements.
        max_landmarks: Largest number of landmarks that the dense covariance may hold.

    Returns:
        Poses as filtered at their time, and the final landmarks.

    Raises:
        ConfigError: If there are more landmarks.
    """
    num = len(problem.cells)
    if num > max_landmarks:
        raise ConfigError(
            f"the batched EKF would need {num} landmarks, more than {max_landmarks}; "
            "use the method ekf_schur, a coarser resolution or fewer landmarks per scan"
        )
    bounds = np.searchsorted(problem.scan, np.arange(len(problem.true_poses) + 1))
    ekf = BatchedEkf(problem.true_poses[0], num, problem.mount_x, problem.sigmas)
    poses = np.empty_like(problem.true_poses)
    for k in range(len(poses)):
        if k > 0:
            ekf.predict(problem.controls[k - 1], problem.control_sigmas[k - 1])
        scan = slice(bounds[k], bounds[k + 1])
        landmark, measured = problem.landmark[scan], problem.measured[scan]
        old = 3 + 2 * landmark < ekf.size
        if old.any():
            ekf.update(landmark[old], measured[old])
        if not old.all():
            # Landmarks are numbered by first observation, so the new ones of a scan follow each other.
            ekf.add_landmarks(measured[~old][np.argsort(landmark[~old])])
        poses[k] = ekf.mean[:3]
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, ekf.mean[3 : ekf.size].reshape(-1, 2))
