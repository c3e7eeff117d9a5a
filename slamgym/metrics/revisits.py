"""Accuracy of a map without any reference: do the passes through a place agree?

Where the robot came twice, its scans must show the same walls in the same place. The distance between what
different passes saw is zero for a perfect trajectory (up to sensor noise and things that moved), grows with
the local error of the path, and can be had for every log that visits a place again.
"""

import numpy as np
from scipy.spatial import cKDTree

from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.metrics.trajectory import ErrorStatistics


def revisit_disagreement(
    points: FloatArray, owners: IntArray, *, gap: int, reach: float = 0.5, stride: int = 5
) -> ErrorStatistics:
    """Distance from end points to the nearest end point that another pass saw [m].

    Args:
        points: End points of all scans in the map frame, shape (N, 2) [m].
        owners: Index of each point's scan, shape (N,), ascending.
        gap: Scans whose indices differ by at least this belong to different passes.
        reach: Points with nothing of another pass within this distance were seen once only, or belong to
            something that moved; they don't count [m].
        stride: Judge every so many points.

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
            found, _ = cKDTree(points[other]).query(points[own][::stride], distance_upper_bound=reach)
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
