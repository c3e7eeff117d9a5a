"""The EKF's answer at full resolution: the whole run as one least-squares problem.

With static landmarks and known association the EKF's final means are the maximum a posteriori estimate up to
linearisation. Truth is known here, so the problem is linearised at the true path. Its normal equations are sparse: the
factorisation takes the landmarks out first, as a Schur complement does, and leaves the poses.
"""

import numpy as np
from scipy.sparse import block_array, bsr_array, csc_array
from scipy.sparse.linalg import splu

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.parametric.landmarks import LandmarkEstimate, LandmarkProblem, observation_model
from slamgym.parametric.odometry_error import increments_of

_ITERATIONS = 2
"""Gauss-Newton steps, the first from the truth; the second matters if the heading errs by 5 deg."""
MAX_SCANS = 4000
"""Beyond this the factors of a long winding path fill gigabytes: longer paths are to be thinned."""


def solve_schur(problem: LandmarkProblem) -> LandmarkEstimate:
    """Solve a run as a batch.

    Args:
        problem: Controls and measurements.

    Returns:
        Smoothed poses (the first is exact) and landmarks.
    """
    poses = problem.true_poses.copy()
    points = problem.points.copy()
    of_poses = 3 * (len(poses) - 1)
    for _ in range(_ITERATIONS):
        step = _gauss_newton_step(problem, poses, points)
        poses[1:] += step[:of_poses].reshape(-1, 3)
        points += step[of_poses:].reshape(-1, 2)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return LandmarkEstimate(poses, points)


def _gauss_newton_step(
    problem: LandmarkProblem, poses: FloatArray, points: FloatArray
) -> FloatArray:
    """One step, for the poses after the first and then for the landmarks, shape (3 (T - 1) + 2 N,)."""
    seen_from = poses[problem.scan]
    predicted, by_pose, by_point = observation_model(
        seen_from, points[problem.landmark], problem.mount_x
    )
    observed = problem.measured - predicted
    observed[:, 1] = wrap_angle(observed[:, 1])
    of_sight = problem.sigmas[:, None]
    sight_by_pose = _blocks(by_pose / of_sight, problem.scan, len(poses))
    sight_by_point = _blocks(by_point / of_sight, problem.landmark, len(points))

    moved, before, after = _motion_terms(problem, poses)
    both_ends = np.stack([before, after], axis=1).reshape(-1, 3, 3)
    pose_of_end = np.arange(len(moved))[:, None] + np.arange(2)
    motion = _blocks(both_ends, pose_of_end.ravel(), len(poses), 2)

    # The first pose is known: its three columns drop out.
    J = block_array([[motion, None], [sight_by_pose, sight_by_point]], format="csc")[:, 3:]
    sighted = observed / problem.sigmas
    residual = np.concatenate([moved.ravel(), sighted.ravel()])
    factor = splu(
        csc_array(J.T @ J),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.asarray(factor.solve(J.T @ residual))


def _motion_terms(
    problem: LandmarkProblem, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Odometry's residuals (T - 1, 3), and their Jacobians by the earlier and the later pose (T - 1, 3, 3)."""
    motion = increments_of(poses)
    middle = poses[:-1, 2] + 0.5 * motion.turn
    cos = np.cos(middle)
    sin = np.sin(middle)
    after = np.zeros((len(middle), 3, 3))
    after[:, 0, 0] = cos
    after[:, 0, 1] = sin
    after[:, 1, 0] = -sin
    after[:, 1, 1] = cos
    after[:, 2, 2] = 1.0
    before = -after
    for jacobian in (before, after):  # half of either heading turns the mean heading
        jacobian[:, 0, 2] = 0.5 * motion.lateral
        jacobian[:, 1, 2] = -0.5 * motion.distance
    residual = problem.controls - np.column_stack(motion)
    residual[:, 2] = wrap_angle(residual[:, 2])
    sigmas = problem.control_sigmas
    of_jacobians = sigmas[:, :, None]
    return residual / sigmas, before / of_jacobians, after / of_jacobians


def _blocks(values: FloatArray, cols: IntArray, num_cols: int, per_row: int = 1) -> bsr_array:
    """Sparse matrix of dense blocks, so many in each row of blocks."""
    _, height, width = values.shape
    rows = len(values) // per_row
    pointers = per_row * np.arange(rows + 1)
    shape = (height * rows, width * num_cols)
    return bsr_array((values, cols, pointers), shape=shape)
