"""A path between the poses that were corrected."""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.metrics.trajectory import relative_poses


def poses_between(poses: FloatArray, indices: IntArray, odometry: FloatArray) -> FloatArray:
    """Fill in the poses of the moments between the processed scans.

    Between two processed scans the robot moved as odometry says, up to a small error, the difference of the
    two corrections, which is spread linearly over the moments in between.

    Args:
        poses: Estimates at the processed scans, shape (P, 3).
        indices: Which of the moments those are, shape (P,), ascending.
        odometry: Odometry pose at every moment, shape (N, 3).

    Returns:
        Poses at every moment, shape (N, 3).
    """
    every = np.arange(len(odometry))
    before = np.maximum(np.searchsorted(indices, every, side="right") - 1, 0)
    after = np.minimum(before + 1, len(indices) - 1)
    from_before = _carried(poses, indices, odometry, every, before)
    from_after = _carried(poses, indices, odometry, every, after)
    span = indices[after] - indices[before]
    share = np.clip((every - indices[before]) / np.maximum(span, 1), 0.0, 1.0)[:, None]
    difference = from_after - from_before
    difference[:, 2] = wrap_angle(difference[:, 2])
    filled: FloatArray = from_before + share * difference
    filled[:, 2] = wrap_angle(filled[:, 2])
    return filled


def _carried(
    poses: FloatArray, indices: IntArray, odometry: FloatArray, every: IntArray, anchor: IntArray
) -> FloatArray:
    """Every scan's pose by odometry from the processed scan ``anchor``."""
    motion = relative_poses(odometry[indices[anchor]], odometry[every])
    base = poses[anchor]
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    return np.column_stack(
        [
            base[:, 0] + cos * motion[:, 0] - sin * motion[:, 1],
            base[:, 1] + sin * motion[:, 0] + cos * motion[:, 1],
            wrap_angle(base[:, 2] + motion[:, 2]),
        ]
    )
