"""Errors of an estimated trajectory against the true one, and whether the reported covariance is consistent.

ATE and RPE after Sturm et al. (2012), in the plane; consistency after Bar-Shalom, Li and Kirubarajan (2001),
section 5.4.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import transform_poses, wrap_angle
from slamgym.core.types import BoolArray, FloatArray, Pose2D, Trajectory


@dataclass(frozen=True)
class ErrorStatistics:
    """Summary of a set of non-negative errors; the unit is that of the errors."""

    rmse: float
    mean: float
    deviation: float
    median: float
    maximum: float
    count: int

    @staticmethod
    def of(errors: FloatArray) -> "ErrorStatistics":
        """Summarise errors, shape (N,).

        Raises:
            ValueError: If there is none.
        """
        errors = np.abs(np.asarray(errors, dtype=np.float64))
        if errors.size == 0:
            raise ValueError("there is no error to summarise: the trajectories share no moment in time")
        return ErrorStatistics(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(errors.mean()),
            deviation=float(errors.std()),
            median=float(np.median(errors)),
            maximum=float(errors.max()),
            count=int(errors.size),
        )


@dataclass(frozen=True)
class PoseError:
    """Errors in position [m] and heading [rad]."""

    translation: ErrorStatistics
    rotation: ErrorStatistics


def poses_at(
    trajectory: Trajectory, stamps: FloatArray, tolerance: float = 0.0
) -> tuple[FloatArray, BoolArray]:
    """Interpolate a trajectory linearly in x, y and (along the shorter arc) theta.

    Args:
        trajectory: At least one pose.
        stamps: Wanted moments, shape (N,) [s].
        tolerance: How far outside the trajectory's time a moment may lie [s]; it gets the end pose.

    Returns:
        The poses, shape (N, 3), and which of them are valid, shape (N,).
    """
    stamps = np.asarray(stamps, dtype=np.float64)
    known, poses = trajectory.stamps, trajectory.poses
    if len(known) == 0:
        return np.zeros((len(stamps), 3)), np.zeros(len(stamps), bool)
    x = np.interp(stamps, known, poses[:, 0])
    y = np.interp(stamps, known, poses[:, 1])
    theta = wrap_angle(np.interp(stamps, known, np.unwrap(poses[:, 2])))
    # 1 us: stamps that went through a text file.
    valid = (stamps >= known[0] - tolerance - 1e-6) & (stamps <= known[-1] + tolerance + 1e-6)
    return np.column_stack([x, y, theta]), valid


def align_se2(points: FloatArray, target: FloatArray) -> Pose2D:
    """The rigid motion that brings ``points`` onto ``target`` with the least squared error.

    Args:
        points: Shape (N, 2) [m].
        target: Shape (N, 2) [m], the same points in the target frame.

    Returns:
        The pose T with ``T * points ~ target`` (Umeyama 1991, eq. 40-42, in the plane without scale).
    """
    centre, target_centre = points.mean(axis=0), target.mean(axis=0)
    a, b = points - centre, target - target_centre
    theta = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    cos, sin = np.cos(theta), np.sin(theta)
    shift = target_centre - np.array([[cos, -sin], [sin, cos]]) @ centre
    return Pose2D(float(shift[0]), float(shift[1]), theta)


def absolute_trajectory_error(estimate: Trajectory, truth: Trajectory, *, align: bool = True) -> PoseError:
    """ATE: distance of the estimated poses from the true ones at the same moments.

    Args:
        estimate: The trajectory to measure; each of its poses within the truth's time counts once.
        truth: The reference, interpolated at the estimate's stamps.
        align: Remove the best rigid motion first (a SLAM frame is arbitrary). Without it the two must be in
            one frame, and the error includes the drift since the start.

    Raises:
        ValueError: If the two share no moment in time.
    """
    reference, valid = poses_at(truth, estimate.stamps)
    reference, poses = reference[valid], estimate.poses[valid]
    if align and len(poses):
        poses = transform_poses(align_se2(poses[:, :2], reference[:, :2]), poses)
    distance = np.hypot(*(poses[:, :2] - reference[:, :2]).T)
    return PoseError(
        ErrorStatistics.of(distance), ErrorStatistics.of(wrap_angle(poses[:, 2] - reference[:, 2]))
    )


def relative_pose_error(estimate: Trajectory, truth: Trajectory, *, delta: float = 1.0) -> PoseError:
    """RPE: error of the motion over each stretch of ``delta`` metres of the true path.

    Args:
        estimate: The trajectory to measure.
        truth: The reference, interpolated at the estimate's stamps.
        delta: Length of a stretch along the true path [m].

    Raises:
        ValueError: If the shared path is shorter than ``delta``.
    """
    reference, valid = poses_at(truth, estimate.stamps)
    reference, poses = reference[valid], estimate.poses[valid]
    travelled = np.concatenate([[0.0], np.hypot(*np.diff(reference[:, :2], axis=0).T).cumsum()])
    ends = np.searchsorted(travelled, travelled + delta - 1e-9)
    starts = np.flatnonzero(ends < len(travelled))
    ends = ends[starts]
    error = relative_poses(
        relative_poses(reference[starts], reference[ends]), relative_poses(poses[starts], poses[ends])
    )
    return PoseError(ErrorStatistics.of(np.hypot(error[:, 0], error[:, 1])), ErrorStatistics.of(error[:, 2]))


def relative_poses(a: FloatArray, b: FloatArray) -> FloatArray:
    """Each pose of ``b`` seen from the pose of ``a`` in the same row; both have shape (N, 3)."""
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy, wrap_angle(b[:, 2] - a[:, 2])])


def normalised_estimation_error_squared(
    poses: FloatArray, truth: FloatArray, covariances: FloatArray, floor: float = 1e-6
) -> FloatArray:
    """NEES of each pose: ``e^T P^-1 e`` (eq. 5.4.2-1).

    Args:
        poses: Estimates, shape (N, 3).
        truth: True poses in the same frame, shape (N, 3).
        covariances: Reported covariances, shape (N, 3, 3).
        floor: Variance added to each axis, so that a filter whose particles agree to the last digit (a
            covariance of zero) gets a large but finite value [m^2, rad^2].

    Returns:
        Shape (N,). A consistent filter has a mean of 3, the number of dimensions; more means overconfident.
    """
    error: FloatArray = np.asarray(poses, dtype=np.float64) - truth
    error[:, 2] = wrap_angle(error[:, 2])
    inflated = np.asarray(covariances, dtype=np.float64) + floor * np.eye(3)
    solved = np.linalg.solve(inflated, error[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ni,ni->n", error, solved), dtype=np.float64)


def nees_interval(num_runs: int, dimensions: int = 3, probability: float = 0.95) -> tuple[float, float]:
    """Where the NEES of a consistent filter, averaged over independent runs, lies (eq. 5.4.2-10).

    Args:
        num_runs: Number of independent runs that are averaged.
        dimensions: Of the error.
        probability: Of a consistent filter lying inside.
    """
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - probability)
    degrees = num_runs * dimensions
    return float(chi2.ppf(tail, degrees)) / num_runs, float(chi2.ppf(1.0 - tail, degrees)) / num_runs
