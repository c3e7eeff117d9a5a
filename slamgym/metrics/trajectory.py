"""Errors of an estimated trajectory, and whether the reported covariance is consistent.

Against the true trajectory: ATE and RPE after Sturm et al. (2012), in the plane. Against known relative poses, without
a map or a global reference: R. Kuemmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner,
*On Measuring the Accuracy of SLAM Algorithms*, Autonomous Robots 27 (2009). Consistency: Bar-Shalom, Li and
Kirubarajan (2001), section 5.4.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import transform_poses, wrap_angle
from slamgym.core.types import BoolArray, FloatArray, Pose2D, Trajectory

MOMENT_TOLERANCE = 0.1
"""A pose stands for a moment that is no further away, as in the paper's own program (``metricEvaluator``) [s]."""
REVISIT_SECONDS = 10.0
"""A relation over more time than this closes a loop; the others are those of one pass [s]."""


@dataclass(frozen=True)
class ErrorStatistics:
    """Summary of a set of non-negative errors; the unit is that of the errors."""

    rmse: float
    mean: float
    deviation: float
    count: int

    @staticmethod
    def of(errors: FloatArray) -> "ErrorStatistics":
        """Summarise errors, shape (N,).

        Raises:
            ValueError: If there is none.
        """
        errors = np.abs(np.asarray(errors, dtype=np.float64))
        if errors.size == 0:
            raise ValueError(
                "there is no error to summarise: the trajectories share no moment in time"
            )
        return ErrorStatistics(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(errors.mean()),
            deviation=float(errors.std()),
            count=int(errors.size),
        )


@dataclass(frozen=True)
class PoseError:
    """Errors in position [m] and heading [rad]."""

    translation: ErrorStatistics
    rotation: ErrorStatistics


@dataclass(frozen=True)
class RelationError(PoseError):
    """Errors over relations."""

    missing: int
    """Relations with a moment at which no pose is known; they don't count."""


def poses_at(trajectory: Trajectory, stamps: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Interpolate a trajectory linearly in x, y and (along the shorter arc) theta.

    Args:
        trajectory: At least one pose.
        stamps: Wanted moments, shape (N,) [s].

    Returns:
        The poses, shape (N, 3), and which of them are valid, shape (N,).
    """
    stamps = np.asarray(stamps, dtype=np.float64)
    known = trajectory.stamps
    poses = trajectory.poses
    if len(known) == 0:
        count = len(stamps)
        return np.zeros((count, 3)), np.zeros(count, bool)
    known_x, known_y, known_theta = poses.T
    x = np.interp(stamps, known, known_x)
    y = np.interp(stamps, known, known_y)
    unwrapped = np.unwrap(known_theta)
    turned = np.interp(stamps, known, unwrapped)
    theta = wrap_angle(turned)
    # 1 us: stamps that went through a text file.
    first = known[0] - 1e-6
    last = known[-1] + 1e-6
    valid = (stamps >= first) & (stamps <= last)
    poses_then = np.column_stack([x, y, theta])
    return poses_then, valid


def align_se2(points: FloatArray, target: FloatArray) -> Pose2D:
    """The rigid motion that brings ``points`` onto ``target`` with the least squared error.

    Args:
        points: Shape (N, 2) [m].
        target: Shape (N, 2) [m], the same points in the target frame.

    Returns:
        The pose T with ``T * points ~ target`` (Umeyama 1991, eq. 40-42, in the plane without scale).
    """
    centre = points.mean(axis=0)
    target_centre = target.mean(axis=0)
    a = points - centre
    b = target - target_centre
    a_x, a_y = a.T
    b_x, b_y = b.T
    crosses = a_x * b_y - a_y * b_x
    dots = a * b
    angle = np.arctan2(crosses.sum(), dots.sum())
    theta = float(angle)
    cos = np.cos(theta)
    sin = np.sin(theta)
    rotation = np.array([[cos, -sin], [sin, cos]])
    shift = target_centre - rotation @ centre
    x, y = shift.tolist()
    return Pose2D(x, y, theta)


def absolute_trajectory_error(
    estimate: Trajectory, truth: Trajectory, *, align: bool = True
) -> PoseError:
    """ATE: distance of the estimated poses from the true ones at the same moments.

    Args:
        estimate: The trajectory to measure; each of its poses within the truth's time counts once.
        truth: The reference, interpolated at the estimate's stamps.
        align: Remove the best rigid motion first (a SLAM frame is arbitrary). Without it the two must be in
            one frame, and the error includes the drift since the start.

    Raises:
        ValueError: If the two share no moment in time.
    """
    reference, poses = _paired(estimate, truth)
    if align and len(poses):
        motion = align_se2(poses[:, :2], reference[:, :2])
        poses = transform_poses(motion, poses)
    error = poses - reference
    error[:, 2] = wrap_angle(error[:, 2])
    return _pose_error(error)


def _paired(estimate: Trajectory, truth: Trajectory) -> tuple[FloatArray, FloatArray]:
    """True and estimated poses at the estimate's stamps that lie within the truth's time."""
    reference, valid = poses_at(truth, estimate.stamps)
    return reference[valid], estimate.poses[valid]


def relative_pose_error(
    estimate: Trajectory, truth: Trajectory, *, delta: float = 1.0
) -> PoseError:
    """RPE: error of the motion over each stretch of ``delta`` metres of the true path.

    Args:
        estimate: The trajectory to measure.
        truth: The reference, interpolated at the estimate's stamps.
        delta: Length of a stretch along the true path [m].

    Raises:
        ValueError: If the shared path is shorter than ``delta``.
    """
    reference, poses = _paired(estimate, truth)
    positions = reference[:, :2]
    dx, dy = np.diff(positions, axis=0).T
    steps = np.hypot(dx, dy)
    travelled = np.concatenate([[0.0], steps.cumsum()])
    further = travelled + delta - 1e-9
    ends = np.searchsorted(travelled, further)
    is_inside = ends < len(travelled)
    starts = np.flatnonzero(is_inside)
    ends = ends[starts]
    true_motion = relative_poses(reference[starts], reference[ends])
    motion = relative_poses(poses[starts], poses[ends])
    return _pose_error(relative_poses(true_motion, motion))


def relation_error(
    trajectory: Trajectory,
    start_stamps: FloatArray,
    end_stamps: FloatArray,
    relative: FloatArray,
    *,
    revisits: bool = False,
) -> RelationError:
    """Mean and deviation of the errors over the given relations.

    Args:
        trajectory: The estimate. The poses at all moments at which the log holds odometry give an error that is the
            SLAM's; those at the scans alone are what the published figures were taken from, and where scans are rare
            (Intel) the time to the nearest one adds more to the error than the SLAM does.
        start_stamps: Shape (N,) [s].
        end_stamps: Shape (N,) [s].
        relative: True pose at the end seen from the pose at the start, shape (N, 3).
        revisits: Count relations over more than ten seconds only: those between two passes through a place.

    Raises:
        ValueError: If no relation can be measured.

    The errors are those of eq. (4) of the paper with the absolute instead of the squared error, as its tables
    have it: ``delta = relative^-1 * estimated``, of which the length and the angle are taken.
    """
    start_stamps = np.asarray(start_stamps)
    end_stamps = np.asarray(end_stamps)
    relative = np.asarray(relative)
    if revisits:
        wanted = np.abs(end_stamps - start_stamps) > REVISIT_SECONDS
        start_stamps = start_stamps[wanted]
        end_stamps = end_stamps[wanted]
        relative = relative[wanted]
    starts, start_known = _nearest_poses(trajectory, start_stamps)
    ends, end_known = _nearest_poses(trajectory, end_stamps)
    known = start_known & end_known
    if not known.any():
        raise ValueError(
            "no relation lies within the time of the trajectory; are they of the same log?"
        )
    motion = relative_poses(starts[known], ends[known])
    error = _pose_error(relative_poses(relative[known], motion))
    missing = int(np.count_nonzero(~known))
    return RelationError(error.translation, error.rotation, missing)


def _pose_error(error: FloatArray) -> PoseError:
    """Statistics of the position and of the heading, from errors (N, 3)."""
    x, y, theta = error.T
    distances = np.hypot(x, y)
    translation = ErrorStatistics.of(distances)
    rotation = ErrorStatistics.of(theta)
    return PoseError(translation, rotation)


def _nearest_poses(trajectory: Trajectory, stamps: FloatArray) -> tuple[FloatArray, BoolArray]:
    """The pose nearest in time to each moment, and whether it is near enough."""
    known = trajectory.stamps
    end = len(known) - 1
    following = np.searchsorted(known, stamps)
    after = np.clip(following, 1, max(end, 1))
    before = after - 1
    after = np.minimum(after, end)
    since = stamps - known[before]
    until = known[after] - stamps
    is_before_nearer = since <= until
    nearest = np.where(is_before_nearer, before, after)
    away = np.abs(known[nearest] - stamps)
    return trajectory.poses[nearest], away <= MOMENT_TOLERANCE


def relative_poses(a: FloatArray, b: FloatArray) -> FloatArray:
    """Each pose of ``b`` seen from the pose of ``a`` in the same row; both have shape (N, 3)."""
    a_x, a_y, a_theta = a.T
    b_x, b_y, b_theta = b.T
    cos = np.cos(a_theta)
    sin = np.sin(a_theta)
    dx = b_x - a_x
    dy = b_y - a_y
    forward = cos * dx + sin * dy
    left = -sin * dx + cos * dy
    turn = wrap_angle(b_theta - a_theta)
    return np.column_stack([forward, left, turn])


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
    exact_poses = np.asarray(poses, dtype=np.float64)
    error: FloatArray = exact_poses - truth
    theta = error[:, 2]
    theta[:] = wrap_angle(theta)
    exact_covariances = np.asarray(covariances, dtype=np.float64)
    inflated = exact_covariances + floor * np.eye(3)
    columns = error[:, :, None]
    solved = np.linalg.solve(inflated, columns)
    products = np.einsum("ni,ni->n", error, solved[:, :, 0])
    return np.asarray(products, dtype=np.float64)
