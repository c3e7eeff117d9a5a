"""Odometry: which scans are processed, GMapping's motion model, and the path between the poses that were estimated."""

import math

import numpy as np

from slamgym.core.geometry import between, wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import AT_REST, FloatArray, IntArray, Pose2D
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import MotionNoise, SlamConfig
from slamgym.slam.graph.relative import placed_points


def add_way(distance: float, turn: float, increment: Pose2D) -> tuple[float, float]:
    """Distance [m] and turn [rad] along a path, with one more increment: there and back again is motion too."""
    x, y, theta = increment
    return distance + math.hypot(x, y), turn + abs(theta)


def is_far_enough(
    distance: float, turn: float, waited: float, updates: tuple[float, float, float]
) -> bool:
    """Return True if a scan must be processed after so much motion [m, rad] and time [s], by three thresholds."""
    return distance >= updates[0] or turn >= updates[1] or waited > updates[2]


def update_thresholds(config: SlamConfig) -> tuple[float, float, float]:
    """Distance [m], turn [rad] and time [s] after which a scan is processed; an infinite time where none counts."""
    temporal = math.inf
    if config.temporal_update is not None:
        temporal = float(config.temporal_update)
    return float(config.linear_update), float(config.angular_update), temporal


class OdometryGate:
    """Collects the motion between scans until one must be processed.

    Distance and turn add up along the path, as in GMapping.

    Args:
        thresholds: Distance [m], turn [rad] and time [s]; see :func:`update_thresholds`.
    """

    def __init__(self, thresholds: tuple[float, float, float]) -> None:
        self._updates = thresholds
        self._is_first = True
        self._last = AT_REST
        self._last_processed = AT_REST
        self._last_stamp = 0.0
        self._distance = 0.0
        self._turn = 0.0
        self._increments: list[Pose2D] = []

    @property
    def since_processed(self) -> Pose2D:
        """Motion since the last processed scan, in the robot frame of that time."""
        return between(self._last_processed, self._last)

    def must_process(self, odometry: Pose2D, stamp: float) -> bool:
        """Take the odometry pose of a scan; True if the scan must be processed. The first one must."""
        if self._is_first:
            self._is_first = False
            self._last = odometry
            self._last_processed = odometry
            return True
        increment = between(self._last, odometry)
        self._increments.append(increment)
        self._last = odometry
        self._distance, self._turn = add_way(self._distance, self._turn, increment)
        return is_far_enough(self._distance, self._turn, stamp - self._last_stamp, self._updates)

    def take(self, stamp: float) -> FloatArray:
        """Start again from here; returns the increments (scans, 3) since the last processed scan."""
        increments = np.array(self._increments, dtype=np.float64).reshape(-1, 3)
        self._last_processed = self._last
        self._last_stamp = stamp
        self._distance = 0.0
        self._turn = 0.0
        self._increments.clear()
        return increments


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
    since = every - indices[before]
    share = np.clip(since / np.maximum(span, 1), 0.0, 1.0)
    difference = from_after - from_before
    difference[:, 2] = wrap_angle(difference[:, 2])
    filled: FloatArray = from_before + share[:, None] * difference
    filled[:, 2] = wrap_angle(filled[:, 2])
    return filled


def _carried(
    poses: FloatArray, indices: IntArray, odometry: FloatArray, every: IntArray, anchor: IntArray
) -> FloatArray:
    """Every scan's pose by odometry from the processed scan ``anchor``."""
    motion = relative_poses(odometry[indices[anchor]], odometry[every])
    base = poses[anchor]
    x, y = placed_points(base, motion)
    heading = wrap_angle(base[:, 2] + motion[:, 2])
    return np.column_stack([x, y, heading])


LATERAL_SHARE = 0.3
"""Share of srr that goes from one axis into the other (GMapping's ``sxy``)."""


def noise_array(noise: MotionNoise) -> FloatArray:
    """The noise as (srr, srt, str, stt), as the kernel takes it."""
    return np.array([noise.srr, noise.srt, noise.str, noise.stt])


@kernel
def sample_motion(
    poses: FloatArray, increments: FloatArray, normals: FloatArray, noise: FloatArray
) -> None:
    """Move each particle by the odometry increments since the last processed scan, with its own noise.

    GMapping adds noise at every scan, also at those it doesn't process; so the spread depends on the scan
    rate, and to draw it once for the sum would be another filter.

    Args:
        poses: (particles, 3) [m, m, rad], changed in place.
        increments: (steps, 3) motion between scans in the robot frame.
        normals: (steps, particles, 3) standard normal draws.
        noise: (4,) srr, srt, str, stt.
    """
    srr = noise[0]
    srt = noise[1]
    str_ = noise[2]
    stt = noise[3]
    for k in range(len(increments)):
        dx = increments[k, 0]
        dy = increments[k, 1]
        turn = increments[k, 2]
        sigma_x = srr * abs(dx) + str_ * abs(turn) + LATERAL_SHARE * srr * abs(dy)
        sigma_y = srr * abs(dy) + str_ * abs(turn) + LATERAL_SHARE * srr * abs(dx)
        sigma_turn = stt * abs(turn) + srt * math.hypot(dx, dy)
        for p in range(len(poses)):
            noisy_x = dx + sigma_x * normals[k, p, 0]
            noisy_y = dy + sigma_y * normals[k, p, 1]
            cos = math.cos(poses[p, 2])
            sin = math.sin(poses[p, 2])
            poses[p, 0] += cos * noisy_x - sin * noisy_y
            poses[p, 1] += sin * noisy_x + cos * noisy_y
            poses[p, 2] += turn + sigma_turn * normals[k, p, 2]
