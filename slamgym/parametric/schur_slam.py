"""The EKF's answer at full resolution: the whole run as one least-squares problem.

With static landmarks and known association the EKF's final means are the maximum a posteriori estimate up to
linearisation. Truth is known here, so the problem is linearised at the true path, the landmarks are
eliminated in 2 x 2 blocks (Schur complement), and only the 3 (T - 1) pose unknowns are left to solve for.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_array, csc_array
from scipy.sparse.linalg import splu

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.parametric.ekf_slam import LandmarkEstimate, LandmarkProblem, observation_model
from slamgym.parametric.odometry_error import increments_of

_ITERATIONS = (
    2  # Gauss-Newton steps, the first from the truth; the second matters if the heading errs by 5 deg
)
_MAX_SCANS = 4000  # beyond this the factors of a long winding path fill gigabytes
_DENSE_UNKNOWNS = 1500  # above this the pose system is sparse enough for a sparse factorisation to win


def solve_schur(problem: LandmarkProblem) -> LandmarkEstimate:
    """Solve a run as a batch.

    Args:
        problem: Controls and measurements.

    Returns:
        Smoothed poses (the first is exact) and landmarks.

    Raises:
        ConfigError: If there are too many scans for the memory.
    """
    if len(problem.true_poses) > _MAX_SCANS:
        raise ConfigError(
            f"ekf_schur would solve for {len(problem.true_poses)} scans, more than {_MAX_SCANS}; use a "
            "larger scan spacing, a shorter path or the method two_phase"
        )
    poses, points = problem.true_poses.copy(), problem.points.copy()
    for _ in range(_ITERATIONS):
        pose_step, point_step = _gauss_newton_step(problem, poses, points)
        poses[1:] += pose_step
        points += point_step
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, points)


def _gauss_newton_step(
    problem: LandmarkProblem, poses: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One step: (T - 1, 3) for the poses after the first, (N, 2) for the landmarks."""
    num_poses, num_points = len(poses), len(points)
    diagonal, off_diagonal, pose_gradient = _motion_terms(problem, poses)

    scan, landmark = problem.scan, problem.landmark
    predicted, by_pose, by_point = observation_model(poses[scan], points[landmark], problem.mount_x)
    residual = problem.measured - predicted
    residual[:, 1] = wrap_angle(residual[:, 1])
    residual /= problem.sigmas
    by_pose /= problem.sigmas[:, None]
    by_point /= problem.sigmas[:, None]

    np.add.at(diagonal, scan, np.einsum("mai,maj->mij", by_pose, by_pose))
    np.add.at(pose_gradient, scan, np.einsum("mai,ma->mi", by_pose, residual))
    point_hessian = np.zeros((num_points, 2, 2))
    point_gradient = np.zeros((num_points, 2))
    np.add.at(point_hessian, landmark, np.einsum("mai,maj->mij", by_point, by_point))
    np.add.at(point_gradient, landmark, np.einsum("mai,ma->mi", by_point, residual))
    coupling = np.einsum("mai,maj->mij", by_pose, by_point)  # (M, 3, 2)

    # Eliminate the landmarks: with C = L L^T per landmark and F = B L^-T, S = A - F F^T.
    factor = np.linalg.cholesky(point_hessian)
    inverse = np.linalg.inv(factor)  # L^-1
    F = _blocks(np.einsum("mij,mkj->mik", coupling, inverse[landmark]), scan, landmark, num_poses, num_points)
    whitened = np.einsum("nij,nj->ni", inverse, point_gradient)  # L^-1 g
    A = _tridiagonal(diagonal, off_diagonal)
    # The first pose is known: its three rows and columns drop out.
    S = csc_array(A - F @ F.T)[3:, 3:]
    right = (pose_gradient.ravel() - F @ whitened.ravel())[3:]
    if S.shape[0] <= _DENSE_UNKNOWNS:
        step = cho_solve(cho_factor(S.toarray(), lower=True, check_finite=False), right)
    else:
        step = splu(S, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(right)
    full = np.concatenate([np.zeros(3), step])
    point_step = np.einsum("nji,nj->ni", inverse, whitened - (F.T @ full).reshape(-1, 2))
    return step.reshape(-1, 3), point_step


def _motion_terms(problem: LandmarkProblem, poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Odometry's part of the normal equations.

    Returns:
        Diagonal blocks (T, 3, 3), blocks (k, k + 1) (T - 1, 3, 3), and the gradient (T, 3).
    """
    motion = increments_of(poses)
    middle = poses[:-1, 2] + 0.5 * motion.turn
    cos, sin = np.cos(middle), np.sin(middle)
    after = np.zeros((len(motion.turn), 3, 3))  # by the later pose
    after[:, 0, 0], after[:, 0, 1] = cos, sin
    after[:, 1, 0], after[:, 1, 1] = -sin, cos
    after[:, 2, 2] = 1.0
    before = -after
    for jacobian in (before, after):  # half of either heading turns the mean heading
        jacobian[:, 0, 2], jacobian[:, 1, 2] = 0.5 * motion.lateral, -0.5 * motion.distance
    residual = problem.controls - np.column_stack(motion)
    residual[:, 2] = wrap_angle(residual[:, 2])
    residual /= problem.control_sigmas
    before /= problem.control_sigmas[:, :, None]
    after /= problem.control_sigmas[:, :, None]
    diagonal = np.zeros((len(poses), 3, 3))
    diagonal[:-1] += np.einsum("kai,kaj->kij", before, before)
    diagonal[1:] += np.einsum("kai,kaj->kij", after, after)
    gradient = np.zeros((len(poses), 3))
    gradient[:-1] += np.einsum("kai,ka->ki", before, residual)
    gradient[1:] += np.einsum("kai,ka->ki", after, residual)
    return diagonal, np.einsum("kai,kaj->kij", before, after), gradient


def _blocks(values: FloatArray, rows: IntArray, cols: IntArray, num_rows: int, num_cols: int) -> csc_array:
    """Sparse matrix from one dense block per (row, col), each pair at most once; rows don't decrease."""
    order = np.lexsort((cols, rows))
    indptr = np.searchsorted(rows[order], np.arange(num_rows + 1))
    height, width = values.shape[1:]
    shape = (num_rows * height, num_cols * width)
    return csc_array(bsr_array((values[order], cols[order], indptr), shape=shape))


def _tridiagonal(diagonal: FloatArray, off_diagonal: FloatArray) -> csc_array:
    """Sparse symmetric matrix with these 3 x 3 blocks on and next to its diagonal."""
    k = np.arange(len(diagonal))
    values = np.concatenate([diagonal, off_diagonal, off_diagonal.transpose(0, 2, 1)])
    rows = np.concatenate([k, k[:-1], k[1:]])
    cols = np.concatenate([k, k[1:], k[:-1]])
    return _blocks(values, rows, cols, len(k), len(k))
