"""What became of the beams that scans sent towards frontiers: lost, passed beyond, or met something there."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, IntArray, Pose2D
from slamgym.planning.context import ExplorerContext

_MOVED = 0.2
"""A scan is kept if the robot has moved so far since the last one [m]."""
_TURNED = 0.3
"""A scan is kept if the robot has turned so far since the last one [rad]."""
_POINTS = 6
"""Beams are compared with so many points of a frontier."""
_BESIDE = 0.2
"""What a beam meets so near to a frontier is there [m]."""
_NEAR_BY = 1.2
"""A beam lost from nearer than this was lost near by [m]."""
_LONGEST = 0.999
"""Readings of more than this share of the range are no returns."""


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
        self._last: Pose2D | None = None
        self._poses = np.zeros((0, 3))
        self._scans = np.zeros((0, laser.num_beams), np.float32)
        self._new: list[tuple[Pose2D, Float32Array]] = []  # not among these yet

    def note(self, pose: Pose2D, scan: Float32Array) -> bool:
        """Keep a scan, unless it was taken where the last one was; returns whether it is kept."""
        last = self._last
        if last is not None:
            moved = math.dist(pose[:2], last[:2])
            turned = math.remainder(pose.theta - last.theta, 2.0 * math.pi)
            if moved < _MOVED and abs(turned) < _TURNED:
                return False
        self._last = pose
        self._new.append((pose, np.array(scan, np.float32)))
        return True

    def figures(self, points: FloatArray, starts: IntArray, outward: FloatArray) -> FloatArray:
        """What became of the beams towards frontiers.

        Args:
            points: Of all, one frontier after the other, shape (M, 2) [m].
            starts: Where each begins, with the end appended, shape (N + 1,).
            outward: Direction from the known to the unknown at each, shape (N, 2).

        Returns:
            Shape (N, 10): looks, the nearest, those lost without return, the nearest of them, those near by, those that
            passed beyond, how far, those that met something there, the nearest, and how squarely one was lost.
        """
        if self._new:
            poses, scans = zip(*self._new, strict=True)
            self._poses = np.vstack([self._poses, *poses])
            self._scans = np.vstack([self._scans, *scans])
            self._new.clear()
        return _tally_all(self._poses, self._scans, points, starts, outward, self._laser)


@kernel
def _tally_all(
    poses: FloatArray,
    scans: Float32Array,
    points: FloatArray,
    starts: IntArray,
    outward: FloatArray,
    laser: FloatArray,
) -> FloatArray:
    """:func:`_tally` of some points of each frontier, shape (N, 10)."""
    tallies = np.empty((len(outward), 10))
    for i in range(len(outward)):
        first = starts[i]
        last = starts[i + 1] - first - 1
        count = min(_POINTS, last + 1)
        chosen = np.empty((count, 2))
        for k in range(count):
            place = last if k == count - 1 else int(k * (last / (count - 1)))
            chosen[k] = points[first + place]
        tallies[i] = _tally(poses, scans, chosen, outward[i], laser)
    return tallies


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
    looks = 0
    lost = 0
    near_by = 0
    passed = 0
    met = 0
    nearest = longest
    nearest_lost = longest
    nearest_met = longest
    beyond = 0.0
    square = 0.0
    for t in range(len(poses)):
        cos = math.cos(poses[t, 2])
        sin = math.sin(poses[t, 2])
        for p in range(len(points)):
            dx = points[p, 0] - (poses[t, 0] + cos * x - sin * y)
            dy = points[p, 1] - (poses[t, 1] + sin * x + cos * y)
            away = math.sqrt(dx * dx + dy * dy)
            if away >= longest - 0.05:
                continue
            angle = math.atan2(dy, dx) - poses[t, 2] - turn - first
            angle -= 2.0 * math.pi * math.floor((angle + 0.5 * step) / (2.0 * math.pi))
            index = math.floor(angle / step + 0.5)
            if index >= scans.shape[1]:
                continue
            read = scans[t, index]
            if read < away - _BESIDE:
                continue
            looks += 1
            nearest = min(nearest, away)
            if read >= _LONGEST * longest:
                lost += 1
                near_by += away < _NEAR_BY
                nearest_lost = min(nearest_lost, away)
                squarely = abs(dx * outward[0] + dy * outward[1]) / max(away, 1e-3)
                square = max(square, squarely)
            if read <= away + _BESIDE:  # also where the scanner's range ends
                met += 1
                nearest_met = min(nearest_met, away)
            elif read < _LONGEST * longest:
                passed += 1
                beyond = max(beyond, read - away)
    count = len(points)
    return np.array(
        [
            math.log1p(looks / count) / 3.0,
            nearest / longest,
            math.log1p(lost / count) / 3.0,
            nearest_lost / longest,
            math.log1p(near_by / count) / 2.0,
            math.log1p(passed / count) / 3.0,
            beyond / longest,
            math.log1p(met / count) / 3.0,
            nearest_met / longest,
            square,
        ]
    )
