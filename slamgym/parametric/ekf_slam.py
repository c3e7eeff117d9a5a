"""EKF-SLAM over wall-cell landmarks, all observations of a scan in one update.

The textbook update (I - K H) P with dense H costs O(n^3) per landmark, which is what makes the paper's
conversion take 15-94 s at 64 x 64. Here H is gathered, never built, and the m observations of a scan enter as
P -= W^T W with W = L^-1 H P and L the Cholesky factor of the innovation covariance: O(m n^2) per scan, and P
stays symmetric and positive semi-definite by construction.
"""

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.parametric.landmarks import LandmarkEstimate, LandmarkProblem, observation_model


class BatchedEkf:
    """The filter's state: the base pose, then the landmarks in the order in which they were first seen.

    Args:
        start: First pose (3,), known exactly.
        num_landmarks: How many landmarks will come; memory grows with its square.
        mount_x: [m] of the scanner ahead of the base.
        sigmas: Standard deviations of a range [m] and a bearing [rad].
    """

    def __init__(
        self, start: FloatArray, num_landmarks: int, mount_x: float, sigmas: tuple[float, float]
    ) -> None:
        n = 3 + 2 * num_landmarks
        self._mean = np.zeros(n)
        self._mean[:3] = start
        self._covariance = np.zeros((n, n))
        self._size = 3
        self._mount_x = mount_x
        self._noise = np.square(np.array(sigmas))

    @property
    def pose(self) -> FloatArray:
        """Estimated pose (3,), heading not wrapped."""
        return self._mean[:3].copy()

    @property
    def landmarks(self) -> FloatArray:
        """Estimated landmarks seen so far (n, 2) [m]."""
        return self._mean[3 : self._size].reshape(-1, 2).copy()

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the pose and the landmarks seen so far."""
        return self._covariance[: self._size, : self._size].copy()

    def predict(self, motion: FloatArray, sigmas: FloatArray) -> None:
        """Move by a control (distance [m], lateral [m], turn [rad]) with these standard deviations (3,)."""
        distance, lateral, turn = motion
        middle = self._mean[2] + 0.5 * turn
        cos, sin = np.cos(middle), np.sin(middle)
        dx, dy = cos * distance - sin * lateral, sin * distance + cos * lateral
        self._mean[:3] += (dx, dy, turn)
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        V = np.array([[cos, -sin, -0.5 * dy], [sin, cos, 0.5 * dx], [0.0, 0.0, 1.0]])
        n, P = self._size, self._covariance
        P[:3, :n] = F @ P[:3, :n]
        P[:n, :3] = P[:n, :3] @ F.T
        P[:3, :3] += (V * sigmas**2) @ V.T

    def add_landmarks(self, measured: FloatArray) -> None:
        """Append landmarks first seen in this scan at (range, bearing), shape (m, 2)."""
        x, y, theta = self._mean[:3]
        direction = theta + measured[:, 1]
        cos, sin = np.cos(direction), np.sin(direction)
        r = measured[:, 0]
        n, m = self._size, 2 * len(measured)
        points = np.empty((len(measured), 2))
        points[:, 0] = x + self._mount_x * np.cos(theta) + r * cos
        points[:, 1] = y + self._mount_x * np.sin(theta) + r * sin
        self._mean[n : n + m] = points.ravel()
        by_pose = np.zeros((len(measured), 2, 3))
        by_pose[:, 0, 0] = by_pose[:, 1, 1] = 1.0
        by_pose[:, 0, 2], by_pose[:, 1, 2] = y - points[:, 1], points[:, 0] - x
        G = by_pose.reshape(m, 3)
        P = self._covariance
        P[n : n + m, :n] = G @ P[:3, :n]
        P[:n, n : n + m] = P[n : n + m, :n].T
        block = G @ P[:3, :3] @ G.T
        Z = np.empty((len(measured), 2, 2))  # by the measurement
        Z[:, 0, 0], Z[:, 0, 1], Z[:, 1, 0], Z[:, 1, 1] = cos, -r * sin, sin, r * cos
        own = np.einsum("mij,j,mkj->mik", Z, self._noise, Z)
        i = np.arange(0, m, 2)
        for a in range(2):
            for b in range(2):
                block[i + a, i + b] += own[:, a, b]
        P[n : n + m, n : n + m] = block
        self._size = n + m

    def update(self, landmark: IntArray, measured: FloatArray) -> None:
        """Correct by all observations of a scan at once.

        Args:
            landmark: (m,) indices of landmarks seen before.
            measured: (m, 2) range [m] and bearing [rad].
        """
        n, P = self._size, self._covariance
        columns = 3 + 2 * landmark[:, None] + np.arange(2)  # (m, 2)
        points = self._mean[columns]
        poses = np.broadcast_to(self._mean[:3], (len(landmark), 3))
        predicted, by_pose, by_point = observation_model(poses, points, self._mount_x)
        innovation = measured - predicted
        innovation[:, 1] = wrap_angle(innovation[:, 1])
        m = 2 * len(landmark)
        # H P, (m, n): H touches the pose's three rows of P and the landmark's two.
        HP = np.einsum("mij,jn->min", by_pose, P[:3, :n])
        HP += np.einsum("mij,mjn->min", by_point, P[columns, :n])
        HP = HP.reshape(m, n)
        # H P H^T, (m, m), by the same gathering on the columns.
        S = (HP[:, :3] @ by_pose.reshape(m, 3).T) + np.einsum(
            "rmj,mij->rmi", HP[:, columns], by_point
        ).reshape(m, m)
        S = 0.5 * (S + S.T)
        S[np.arange(m), np.arange(m)] += np.tile(self._noise, len(landmark))
        L = cholesky(S, lower=True, check_finite=False)
        W = solve_triangular(L, HP, lower=True, check_finite=False)  # (m, n)
        weighted = solve_triangular(L, innovation.ravel(), lower=True, check_finite=False)
        self._mean[:n] += weighted @ W
        P[:n, :n] -= W.T @ W


def run_ekf(problem: LandmarkProblem, max_landmarks: int) -> LandmarkEstimate:
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
            f"the batched EKF would need {num} landmarks, more than max_landmarks = {max_landmarks}; "
            "use the method ekf_schur, a coarser resolution or fewer landmarks per scan"
        )
    motions = problem.controls
    controls = np.column_stack([motions.distance, motions.lateral, motions.turn])
    measured = np.column_stack([problem.ranges, problem.bearings])
    bounds = np.searchsorted(problem.scan, np.arange(len(problem.true_poses) + 1))
    ekf = BatchedEkf(problem.true_poses[0], num, problem.mount_x, problem.sigmas)
    poses = np.empty_like(problem.true_poses)
    known = 0
    for k in range(len(poses)):
        if k > 0:
            ekf.predict(controls[k - 1], problem.control_sigmas[k - 1])
        scan = slice(bounds[k], bounds[k + 1])
        landmark = problem.landmark[scan]
        old = landmark < known
        if old.any():
            ekf.update(landmark[old], measured[scan][old])
        if not old.all():
            # Landmarks are numbered by first observation, so the new ones of a scan follow each other.
            ekf.add_landmarks(measured[scan][~old][np.argsort(landmark[~old])])
            known += int((~old).sum())
        poses[k] = ekf.pose
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, ekf.landmarks)
