"""What became of the beams that scans sent towards frontiers: lost, passed beyond, or met something there."""

import math
from collections.abc import Sequence

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, Pose2D
from slamgym.planning.context import ExplorerContext

_MOVED, _TURNED = 0.2, 0.3  # a scan is kept if the robot did so much since the last one [m, rad]
_POINTS = 6  # of a frontier that beams are compared with
_BESIDE = 0.2  # what a beam meets so near to a frontier is there [m]
_NEAR_BY = 1.2  # [m]


class ViewHistory:
    """Scans of one exploration, and where they were taken.

    Args:
        context: Of the robot.
    """

    def __init__(self, context: ExplorerContext) -> None:
        laser = context.geometry
        self._laser = np.array(
            [*laser.mount, laser.angle_min, laser.angle_increment, laser.range_max]
        )
        self._poses: list[Pose2D] = []
        self._scans: list[Float32Array] = []

    def note(self, pose: Pose2D, scan: Float32Array) -> bool:
        """Keep a scan, unless it was taken where the last one was; returns whether it is kept."""
        if self._poses:
            last = self._poses[-1]
            turned = abs(math.remainder(pose.theta - last.theta, 2.0 * math.pi))
            if math.dist(pose[:2], last[:2]) < _MOVED and turned < _TURNED:
                return False
        self._poses.append(pose)
        self._scans.append(np.array(scan, np.float32))
        return True

    def figures(self, frontiers: Sequence[FloatArray], outward: FloatArray) -> FloatArray:
        """What became of the beams towards frontiers.

        Args:
            frontiers: Points of each, shapes (M, 2) [m].
            outward: Direction from the known to the unknown at each, shape (N, 2).

        Returns:
            Shape (N, 10): looks, the nearest, those lost without return, the nearest of them, those near by, those that
            passed beyond, how far, those that met something there, the nearest, and how squarely one was lost.
        """
        poses, scans = np.array(self._poses), np.array(self._scans)
        chosen = [
            one[np.linspace(0, len(one) - 1, min(_POINTS, len(one))).astype(int)]
            for one in frontiers
        ]
        pairs = zip(chosen, outward, strict=True)
        return np.array(
            [_tally(poses, scans, points, towards, self._laser) for points, towards in pairs]
        )


@kernel
def _tally(
    poses: FloatArray,
    scans: Float32Array,
    points: FloatArray,
    outward: FloatArray,
    laser: FloatArray,
) -> FloatArray:
    """Count the beams of scans (T, beams) from poses (T, 3) towards points (N, 2), by what became of them."""
    x, y, turn, first, step, longest = laser
    looks, lost, near_by, passed, met = 0, 0, 0, 0, 0
    nearest, nearest_lost, nearest_met, beyond, square = longest, longest, longest, 0.0, 0.0
    for t in range(len(poses)):
        cos, sin = math.cos(poses[t, 2]), math.sin(poses[t, 2])
        for p in range(len(points)):
            dx = points[p, 0] - (poses[t, 0] + cos * x - sin * y)
            dy = points[p, 1] - (poses[t, 1] + sin * x + cos * y)
            away = math.sqrt(dx * dx + dy * dy)
            if away >= longest - 0.05:
                continue
            angle = math.atan2(dy, dx) - poses[t, 2] - turn - first
            angle -= 2.0 * math.pi * math.floor((angle + 0.5 * step) / (2.0 * math.pi))
            index = math.floor(angle / step + 0.5)
            if index >= scans.shape[1] or scans[t, index] < away - _BESIDE:
                continue
            read = scans[t, index]
            looks += 1
            nearest = min(nearest, away)
            if read >= 0.999 * longest:
                lost += 1
                near_by += away < _NEAR_BY
                nearest_lost = min(nearest_lost, away)
                square = max(square, abs(dx * outward[0] + dy * outward[1]) / max(away, 1e-3))
            if read <= away + _BESIDE:  # also where the scanner's range ends
                met += 1
                nearest_met = min(nearest_met, away)
            elif read < 0.999 * longest:
                passed += 1
                beyond = max(beyond, read - away)
    counts = [math.log1p(one / len(points)) / 3.0 for one in (looks, lost, passed, met)]
    near = math.log1p(near_by / len(points)) / 2.0
    at, lost_at, met_at = nearest / longest, nearest_lost / longest, nearest_met / longest
    return np.array(
        [
            counts[0],
            at,
            counts[1],
            lost_at,
            near,
            counts[2],
            beyond / longest,
            counts[3],
            met_at,
            square,
        ]
    )
