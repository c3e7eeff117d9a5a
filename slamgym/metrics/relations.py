"""Accuracy of SLAM without a map or a global reference: errors over known relative poses.

R. Kuemmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner, *On Measuring the
Accuracy of SLAM Algorithms*, Autonomous Robots 27 (2009).
"""

from dataclasses import dataclass

import numpy as np

from slamgym.metrics.trajectory import ErrorStatistics, poses_at, relative_poses
from slamgym.types import FloatArray, Trajectory


@dataclass(frozen=True)
class RelationError:
    """Error over relations: translation [m] and rotation [rad]."""

    translation: ErrorStatistics
    rotation: ErrorStatistics
    missing: int
    """Relations whose moments lie outside the trajectory; they don't count."""


def relation_error(
    trajectory: Trajectory,
    start_stamps: FloatArray,
    end_stamps: FloatArray,
    relative: FloatArray,
    tolerance: float = 0.5,
) -> RelationError:
    """Mean and deviation of the errors over the given relations.

    Args:
        trajectory: The estimate; it is interpolated at the relations' moments.
        start_stamps: Shape (N,) [s].
        end_stamps: Shape (N,) [s].
        relative: True pose at the end seen from the pose at the start, shape (N, 3).
        tolerance: How far outside the trajectory's time a moment may lie [s].

    Raises:
        ValueError: If no relation lies within the trajectory's time.

    The errors are those of eq. (4) of the paper with the absolute instead of the squared error, as its tables
    have it: ``delta = relative^-1 * estimated``, of which the length and the angle are taken.
    """
    starts, start_valid = poses_at(trajectory, start_stamps, tolerance)
    ends, end_valid = poses_at(trajectory, end_stamps, tolerance)
    valid = start_valid & end_valid
    if not valid.any():
        raise ValueError("no relation lies within the time of the trajectory; are they of the same log?")
    error = relative_poses(np.asarray(relative)[valid], relative_poses(starts[valid], ends[valid]))
    return RelationError(
        translation=ErrorStatistics.of(np.hypot(error[:, 0], error[:, 1])),
        rotation=ErrorStatistics.of(error[:, 2]),
        missing=int(np.count_nonzero(~valid)),
    )
