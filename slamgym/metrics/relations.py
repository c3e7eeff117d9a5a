"""Accuracy of SLAM without a map or a global reference: errors over known relative poses.

R. Kuemmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner, *On Measuring the
Accuracy of SLAM Algorithms*, Autonomous Robots 27 (2009).

Beside them, accuracy without any reference: where the robot came twice, its scans must show the same walls in the
same place.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slamgym.core.types import BoolArray, FloatArray, IntArray, Trajectory
from slamgym.metrics.trajectory import ErrorStatistics, poses_at, relative_poses

TIME_MARGIN = 0.5
"""A moment this far outside the trajectory's time gets the end pose [s]."""


@dataclass(frozen=True)
class RelationError:
    """Error over relations: translation [m] and rotation [rad]."""

    translation: ErrorStatistics
    rotation: ErrorStatistics
    missing: int
    """Relations whose moments the trajectory doesn't cover; they don't count."""


def relation_error(
    trajectory: Trajectory,
    start_stamps: FloatArray,
    end_stamps: FloatArray,
    relative: FloatArray,
    max_gap: float | None = None,
) -> RelationError:
    """Mean and deviation of the errors over the given relations.

    Args:
        trajectory: The estimate.
        start_stamps: Shape (N,) [s].
        end_stamps: Shape (N,) [s].
        relative: True pose at the end seen from the pose at the start, shape (N, 3).
        max_gap: Count a relation only if both of its moments lie this close to a pose of the trajectory [s].
            None interpolates the trajectory everywhere, which is right where poses are dense; a thinned log,
            or one whose stamps come in bursts (Intel), then adds an error that is not the SLAM's.

    Raises:
        ValueError: If no relation can be measured.

    The errors are those of eq. (4) of the paper with the absolute instead of the squared error, as its tables
    have it: ``delta = relative^-1 * estimated``, of which the length and the angle are taken.
    """
    starts, start_valid = poses_at(trajectory, start_stamps, TIME_MARGIN)
    ends, end_valid = poses_at(trajectory, end_stamps, TIME_MARGIN)
    valid = start_valid & end_valid
    if max_gap is not None:
        valid &= _gap(trajectory, start_stamps) <= max_gap
        valid &= _gap(trajectory, end_stamps) <= max_gap
    if not valid.any():
        raise ValueError("no relation lies within the time of the trajectory; are they of the same log?")
    error = relative_poses(np.asarray(relative)[valid], relative_poses(starts[valid], ends[valid]))
    return RelationError(
        translation=ErrorStatistics.of(np.hypot(error[:, 0], error[:, 1])),
        rotation=ErrorStatistics.of(error[:, 2]),
        missing=int(np.count_nonzero(~valid)),
    )


def _gap(trajectory: Trajectory, stamps: FloatArray) -> FloatArray:
    """Time from each moment to the nearest pose [s]."""
    known = trajectory.stamps
    after = np.clip(np.searchsorted(known, stamps), 1, max(len(known) - 1, 1))
    before_gap = np.abs(np.asarray(stamps) - known[after - 1])
    after_gap = np.abs(known[np.minimum(after, len(known) - 1)] - stamps)
    return np.asarray(np.minimum(before_gap, after_gap), dtype=np.float64)


def revisit_disagreement(
    points: FloatArray, owners: IntArray, *, gap: int, radius: float = 0.5, stride: int = 5
) -> ErrorStatistics:
    """Distance from end points to the nearest end point that another pass saw [m].

    Args:
        points: End points of all scans in the map frame, shape (N, 2) [m].
        owners: Index of each point's scan, shape (N,), ascending.
        gap: Scans whose indices differ by at least this belong to different passes.
        radius: Points with nothing of another pass within this distance were seen once only, or belong to
            something that moved; they don't count [m].
        stride: Measure every so many points.

    Raises:
        ValueError: If no place was seen twice.
    """
    num_scans = int(owners[-1]) + 1 if len(owners) else 0
    block = max(1, gap // 4)
    distances: list[FloatArray] = []
    # Points of one block of scans are compared with all scans that are at least a gap away.
    for first in range(0, num_scans, block):
        own = (owners >= first) & (owners < first + block)
        other: BoolArray = (owners <= first - gap) | (owners >= first + block - 1 + gap)
        if own.any() and other.any():
            found, _ = cKDTree(points[other]).query(points[own][::stride], distance_upper_bound=radius)
            distances.append(np.asarray(found, dtype=np.float64)[np.isfinite(found)])
    return ErrorStatistics.of(np.concatenate(distances) if distances else np.zeros(0))


def end_points(
    ranges: FloatArray, directions: FloatArray, mount: FloatArray, poses: FloatArray, range_max: float
) -> tuple[FloatArray, IntArray]:
    """End points of scans in the map frame.

    Args:
        ranges: (scans, num_beams) [m]; only finite ones below ``range_max`` count.
        directions: (num_beams, 2) unit vectors of the beams in the robot frame.
        mount: (2,) sensor position in the robot frame [m].
        poses: (scans, 3) robot poses.
        range_max: Longer returns are left out [m].

    Returns:
        Points (N, 2) [m] and the index of each point's scan (N,).
    """
    usable = np.isfinite(ranges) & (ranges < range_max)
    owners, beams = np.nonzero(usable)
    local = ranges[owners, beams][:, None] * directions[beams] + mount
    cos, sin = np.cos(poses[owners, 2]), np.sin(poses[owners, 2])
    x = poses[owners, 0] + cos * local[:, 0] - sin * local[:, 1]
    y = poses[owners, 1] + sin * local[:, 0] + cos * local[:, 1]
    return np.column_stack([x, y]), owners
