"""EKF-SLAM over wall cells as landmarks: the paper's conversion of odometry errors to map errors.

The state is the robot's pose and all landmarks, 3 + 2 N numbers, with one covariance. The textbook update (I - K H) P
with a dense H costs O(n^3) for each landmark, 15-94 s of the paper at 64 x 64. Here H touches the five columns that it
has, and the m observations of a scan enter at once as P -= W^T W with W = L^-1 H P and L the Cholesky factor of the
innovation's covariance: O(m n^2) for each scan, and P stays symmetric.
"""

import math

import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, GridFrame, IntArray
from slamgym.parametric.landmarks import LandmarkEstimate, LandmarkProblem, observation_model
from slamgym.parametric.odometry_error import Increments, step_x, step_y

MAX_PIXELS = 128
"""Side of the largest map: the covariance grows with the fourth power of it."""


@kernel
def correct(
    mean: FloatArray, P: FloatArray, S: FloatArray, HP: FloatArray, innovation: FloatArray
) -> None:
    """Correct a state and its covariance by observations, both in place.

    A kernel, as the matrices are small: a library's threads would wait for each other longer than they compute, and
    round differently from processor to processor.

    Args:
        mean: The state, of which the first n numbers are in use.
        P: Its covariance, likewise.
        S: Covariance of the innovation (m, m); its lower triangle becomes its Cholesky factor.
        HP: H P (m, n); becomes W.
        innovation: Measured minus predicted (m,); becomes L^-1 of it.
    """
    count, size = HP.shape
    for i in range(count):
        # Row i of L, by Cholesky and Banachiewicz.
        for k in range(i):
            for j in range(k):
                S[i, k] -= S[i, j] * S[k, j]
            S[i, k] /= S[k, k]
            S[i, i] -= S[i, k] * S[i, k]
        S[i, i] = math.sqrt(S[i, i])
        # Row i of W, by forward substitution.
        for k in range(i):
            innovation[i] -= S[i, k] * innovation[k]
            factor = S[i, k]
            for j in range(size):
                HP[i, j] -= factor * HP[k, j]
        innovation[i] /= S[i, i]
        for j in range(size):
            HP[i, j] /= S[i, i]
            mean[j] += innovation[i] * HP[i, j]
    for i in range(size):
        for k in range(count):
            factor = HP[k, i]
            for j in range(size):
                P[i, j] -= factor * HP[k, j]


class EkfSlam:
    """The filter: the base pose, then the landmarks in the order in which they were first seen.

    Convention: world frame; bearings counter-clockwise from the heading, seen from the scanner.

    Args:
        start: First pose (3,), known exactly.
        num_landmarks: How many landmarks will come.
        mount_x: [m] of the scanner ahead of the base.
        sigmas: Standard deviations of a range [m] and a bearing [rad], (2,).

    Attributes:
        mean: Pose (heading not wrapped) and landmarks, (3 + 2 N,).
        covariance: Of the same, (3 + 2 N, 3 + 2 N).
        size: How many numbers are in use of either.
    """

    def __init__(
        self, start: FloatArray, num_landmarks: int, mount_x: float, sigmas: FloatArray
    ) -> None:
        size = 3 + 2 * num_landmarks
        self.mean = np.zeros(size)
        self.mean[:3] = start
        self.covariance = np.zeros((size, size))
        self.size = 3
        self._mount_x = mount_x
        self._noise = np.square(sigmas)

    def predict(self, motion: FloatArray, sigmas: FloatArray) -> None:
        """Move by (18)-(20).

        Args:
            motion: Distance [m], lateral [m] and turn [rad] that odometry reports, (3,).
            sigmas: Standard deviations of the same; their Q enters by the Jacobian V.
        """
        moved = Increments(*motion)
        middle = self.mean[2] + 0.5 * moved.turn
        cos = np.cos(middle)
        sin = np.sin(middle)
        dx = step_x(moved, middle)
        dy = step_y(moved, middle)
        self.mean[:3] += (dx, dy, moved.turn)
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        V = np.array([[cos, -sin, -0.5 * dy], [sin, cos, 0.5 * dx], [0.0, 0.0, 1.0]])
        P = self.covariance[: self.size, : self.size]
        P[:3] = F @ P[:3]
        P[:, :3] = P[:, :3] @ F.T
        P[:3, :3] += (V * sigmas**2) @ V.T

    def add_landmarks(self, measured: FloatArray) -> None:
        """Append landmarks first seen in this scan at (range [m], bearing [rad]), shape (m, 2)."""
        x, y, theta = self.mean[:3]
        distance = measured[:, 0]
        direction = theta + measured[:, 1]
        cos = np.cos(direction)
        sin = np.sin(direction)
        points = np.empty((len(measured), 2))
        points[:, 0] = x + self._mount_x * np.cos(theta) + distance * cos
        points[:, 1] = y + self._mount_x * np.sin(theta) + distance * sin
        by_pose = np.zeros((len(measured), 2, 3))
        by_pose[:, 0, 0] = 1.0
        by_pose[:, 1, 1] = 1.0
        by_pose[:, 0, 2] = y - points[:, 1]
        by_pose[:, 1, 2] = points[:, 0] - x
        by_sight = np.stack([cos, -distance * sin, sin, distance * cos], axis=-1)
        by_sight = by_sight.reshape(-1, 2, 2)

        old = self.size
        new = old + points.size
        G = by_pose.reshape(points.size, 3)
        P = self.covariance
        with_old = G @ P[:3, :old]
        among_new = G @ P[:3, :3] @ G.T
        number = np.arange(len(points))
        blocks = among_new.reshape(len(points), 2, len(points), 2)
        blocks[number, :, number] += np.einsum("mij,j,mkj->mik", by_sight, self._noise, by_sight)
        self.mean[old:new] = points.ravel()
        P[old:new, :old] = with_old
        P[:old, old:new] = with_old.T
        P[old:new, old:new] = among_new
        self.size = new

    def update(self, landmark: IntArray, measured: FloatArray) -> None:
        """Correct by z_meas and alpha_meas of all known landmarks of a scan at once.

        Args:
            landmark: (m,) numbers of landmarks seen before.
            measured: (m, 2) range [m] and bearing [rad].
        """
        count = len(landmark)
        columns = 3 + 2 * landmark[:, None] + np.arange(2)  # (m, 2)
        pose = np.broadcast_to(self.mean[:3], (count, 3))
        predicted, by_pose, by_point = observation_model(pose, self.mean[columns], self._mount_x)
        innovation = measured - predicted
        innovation[:, 1] = wrap_angle(innovation[:, 1])
        P = self.covariance[: self.size, : self.size]
        # H P and H P H^T: H has the pose's three columns and the landmark's two.
        HP = np.einsum("mij,jn->min", by_pose, P[:3])
        HP += np.einsum("mij,mjn->min", by_point, P[columns])
        HP = HP.reshape(2 * count, self.size)
        S = HP[:, :3] @ by_pose.reshape(2 * count, 3).T
        S += np.einsum("rmj,mij->rmi", HP[:, columns], by_point).reshape(S.shape)
        S = 0.5 * (S + S.T)
        S += np.diag(np.tile(self._noise, count))
        correct(self.mean, self.covariance, S, HP, innovation.ravel())


def check_ekf_size(frame: GridFrame, num_landmarks: int) -> None:
    """Refuse a map that is too large for one covariance of everything.

    Raises:
        ConfigError: If a side is longer than :data:`MAX_PIXELS`.
    """
    height, width = frame.shape
    if max(height, width) <= MAX_PIXELS:
        return
    gigabytes = 8.0 * (3 + 2 * num_landmarks) ** 2 / 1e9
    raise ConfigError(
        f"ekf would keep one covariance of the robot and {num_landmarks:,} wall cells, {gigabytes:.2g} GB, for a map "
        f"of {width} x {height} px; give --size {MAX_PIXELS} or less (--resize enlarges the result), or take "
        "--conversion ekf_schur"
    )


def run_ekf(problem: LandmarkProblem) -> LandmarkEstimate:
    """Filter a whole run.

    Args:
        problem: Controls and measurements.

    Returns:
        Poses as filtered at their time (the first is exact), and the final landmarks.
    """
    bounds = np.searchsorted(problem.scan, np.arange(len(problem.true_poses) + 1))
    ekf = EkfSlam(problem.true_poses[0], len(problem.cells), problem.mount_x, problem.sigmas)
    poses = np.empty_like(problem.true_poses)
    for k in range(len(poses)):
        if k > 0:
            ekf.predict(problem.controls[k - 1], problem.control_sigmas[k - 1])
        scan = slice(bounds[k], bounds[k + 1])
        landmark = problem.landmark[scan]
        measured = problem.measured[scan]
        is_known = 3 + 2 * landmark < ekf.size
        if is_known.any():
            ekf.update(landmark[is_known], measured[is_known])
        if not is_known.all():
            # Landmarks are numbered by first observation: the new ones of a scan follow each other.
            in_order = np.argsort(landmark[~is_known])
            ekf.add_landmarks(measured[~is_known][in_order])
        poses[k] = ekf.mean[:3]
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, ekf.mean[3 : ekf.size].reshape(-1, 2))
