"""The EKF's answer at full resolution: the whole run as one least-squares problem.

With static landmarks and known association the EKF's final means are the maximum a posteriori estimate up to
linearisation. Truth is known here, so the problem is linearised at the true path. Its normal equations are sparse: the
factorisation takes the landmarks out first, as a Schur complement does, and leaves the poses.
"""

import numpy as np
from scipy.sparse import block_array, bsr_array, csc_array
from scipy.sparse.linalg import splu

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.parametric.ekf_slam import LandmarkEstimate, LandmarkProblem, observation_model
from slamgym.parametric.odometry_error import increments_of

_ITERATIONS = 2  # Gauss-Newton steps, the first from the truth; the second matters if the heading errs by 5 deg
_MAX_SCANS = 4000  # beyond this the factors of a long winding path fill gigabytes


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
        step = _gauss_newton_step(problem, poses, points)
        poses[1:] += step[: 3 * (len(poses) - 1)].reshape(-1, 3)
        points += step[3 * (len(poses) - 1) :].reshape(-1, 2)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, points)


def _gauss_newton_step(
    problem: LandmarkProblem, poses: FloatArray, points: FloatArray
) -> FloatArray:
    """One step, for the poses after the first and then for the landmarks, shape (3 (T - 1) + 2 N,)."""
    scan, landmark = problem.scan, problem.landmark
    predicted, by_pose, by_point = observation_model(poses[scan], points[landmark], problem.mount_x)
    observed = problem.measured - predicted
    observed[:, 1] = wrap_angle(observed[:, 1])
    by_pose, by_point = by_pose / problem.sigmas[:, None], by_point / problem.sigmas[:, None]

    moved, before, after = _motion_terms(problem, poses)
    ends = np.arange(len(moved))[:, None] + np.arange(2)
    motion = _blocks(
        np.stack([before, after], axis=1).reshape(-1, 3, 3), ends.ravel(), len(poses), 2
    )
    sight = _blocks(by_pose, scan, len(poses)), _blocks(by_point, landmark, len(points))
    # The first pose is known: its three columns drop out.
    J = block_array([[motion, None], list(sight)], format="csc")[:, 3:]
    residual = np.concatenate([moved.ravel(), (observed / problem.sigmas).ravel()])
    symmetric = {"SymmetricMode": True}
    factor = splu(
        csc_array(J.T @ J), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric
    )
    return np.asarray(factor.solve(J.T @ residual))


def _motion_terms(
    problem: LandmarkProblem, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Odometry's residuals (T - 1, 3), and their Jacobians by the earlier and the later pose (T - 1, 3, 3)."""
    motion = increments_of(poses)
    middle = poses[:-1, 2] + 0.5 * motion.turn
    cos, sin = np.cos(middle), np.sin(middle)
    after = np.zeros((len(motion.turn), 3, 3))
    after[:, 0, 0], after[:, 0, 1] = cos, sin
    after[:, 1, 0], after[:, 1, 1] = -sin, cos
    after[:, 2, 2] = 1.0
    before = -after
    for jacobian in (before, after):  # half of either heading turns the mean heading
        jacobian[:, 0, 2], jacobian[:, 1, 2] = 0.5 * motion.lateral, -0.5 * motion.distance
    residual = problem.controls - np.column_stack(motion)
    residual[:, 2] = wrap_angle(residual[:, 2])
    sigmas = problem.control_sigmas
    return residual / sigmas, before / sigmas[:, :, None], after / sigmas[:, :, None]


def _blocks(values: FloatArray, cols: IntArray, num_cols: int, per_row: int = 1) -> bsr_array:
    """Sparse matrix of dense blocks, so many in each row of blocks."""
    rows, (height, width) = len(values) // per_row, values.shape[1:]
    pointers = per_row * np.arange(rows + 1)
    return bsr_array((values, cols, pointers), shape=(height * rows, width * num_cols))
