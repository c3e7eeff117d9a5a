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
from slamgym.metrics.trajectory import ErrorStatistics, relative_poses

MOMENT_TOLERANCE = 0.1
"""A pose stands for a moment that is no further away, as in the paper's own program (``metricEvaluator``) [s]."""
REVISIT_SECONDS = 10.0
"""A relation over more time than this closes a loop; the others are those of one pass [s]."""


@dataclass(frozen=True)
class RelationError:
    """Error over relations: translation [m] and rotation [rad]."""

    translation: ErrorStatistics
    rotation: ErrorStatistics
    missing: int
    """Relations with a moment at which no pose is known; they don't count."""


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
    wanted = np.abs(np.asarray(end_stamps) - start_stamps) > REVISIT_SECONDS if revisits else np.s_[:]
    starts, start_known = _nearest_poses(trajectory, np.asarray(start_stamps)[wanted])
    ends, end_known = _nearest_poses(trajectory, np.asarray(end_stamps)[wanted])
    known = start_known & end_known
    if not known.any():
        raise ValueError("no relation lies within the time of the trajectory; are they of the same log?")
    error = relative_poses(np.asarray(relative)[wanted][known], relative_poses(starts[known], ends[known]))
    return RelationError(
        translation=ErrorStatistics.of(np.hypot(error[:, 0], error[:, 1])),
        rotation=ErrorStatistics.of(error[:, 2]),
        missing=int(np.count_nonzero(~known)),
    )


def _nearest_poses(trajectory: Trajectory, stamps: FloatArray) -> tuple[FloatArray, BoolArray]:
    """The pose nearest in time to each moment, and whether it is near enough."""
    known = trajectory.stamps
    after = np.clip(np.searchsorted(known, stamps), 1, max(len(known) - 1, 1))
    last = np.minimum(after, len(known) - 1)
    nearest = np.where(stamps - known[after - 1] <= known[last] - stamps, after - 1, last)
    return trajectory.poses[nearest], np.abs(known[nearest] - stamps) <= MOMENT_TOLERANCE


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
