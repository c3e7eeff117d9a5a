"""Odometry by the laser alone: for logs that have none, and for stretches in which the wheels lie.

Each scan is aligned with a few scans before it, from where constant speed would have brought the robot; where it fits
poorly, it is searched as far as a robot gets meanwhile (Olson, *Real-time correlative scan matching*, ICRA 2009).
"""

import itertools
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import unit_vectors, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.types import FloatArray, LaserScan
from slamgym.interop.odometry import with_track
from slamgym.interop.records import Log, OdometryTrack
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.mapper import FEW_POINTS
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.graph.submaps import Submap, sides_of
from slamgym.slam.hit_count_kernels import BeamTable

REACH, MOST_POINTS = 10.0, 360
"""Points of a scan that are aligned: so near [m], and so many."""
KEYFRAME, KEYFRAMES = 0.15, 6
"""A scan is drawn into the newest submap after so much driving [m] or turning [rad], and a submap takes so many."""
SURE_FIT, BETTER_FIT = 0.75, 0.1
"""A scan that fits so well needs no search, and what a search finds must fit better by the second."""
FASTEST, WINDOWS = (2.0, 3.0), (0.15, 1.0)
"""The search is so wide for each second between scans [m/s, rad/s], within these bounds [m or rad]."""


class LaserMotion(NamedTuple):
    """Motion from one scan to the next."""

    step: FloatArray  # (3,) in the frame of the robot at the first
    information: FloatArray  # (3, 3) of it
    fit: float  # share of the points that lie on what was seen before


class LaserTracker:
    """Follows the laser from scan to scan.

    Args:
        scan: The first one.
    """

    def __init__(self, scan: LaserScan) -> None:
        self._beams = plain(BeamTable.of(scan.geometry, SlamConfig(max_usable_range=REACH)))
        self._stamp = scan.stamp
        self._pose = self._keyframe = np.zeros(3)
        self._speed = np.zeros(3)
        self._submaps: list[Submap] = []
        self._frames: list[FloatArray] = []
        self._draw(self._points(scan))

    def move(self, scan: LaserScan, expected: FloatArray | None = None) -> LaserMotion:
        """Take the next scan, which is ``expected`` (3,) away; by default the speed has stayed as it was."""
        points = self._points(scan)
        wait = max(scan.stamp - self._stamp, 1e-3)
        guess = moved_by(self._pose, self._speed * wait if expected is None else expected)
        pose, information, fit = self._place(points, guess, wait)
        step = seen_from(self._pose, pose)
        self._speed = step / wait
        self._stamp = scan.stamp
        self._pose = pose
        if np.abs(seen_from(self._keyframe, pose)).max() > KEYFRAME:
            self._draw(points)
        return LaserMotion(step, information, fit)

    def _points(self, scan: LaserScan) -> FloatArray:
        """End points (n, 2) in the robot's frame [m]."""
        points = usable_end_points(scan.ranges, self._beams, REACH)
        return np.ascontiguousarray(points[:: max(1, len(points) // MOST_POINTS)])

    def _place(self, points: FloatArray, guess: FloatArray, wait: float) -> LaserMotion:
        if len(points) < FEW_POINTS:
            return LaserMotion(guess, np.zeros((3, 3)), 0.0)
        sides = sides_of(points, self._beams[1])
        free = np.zeros((3, 3))
        chosen = AlignmentTarget(self._submaps, np.array(self._frames))
        placed = chosen.align(points, sides, guess, guess, free)
        if placed.fit < SURE_FIT:
            window, turn = np.clip(np.multiply(FASTEST, wait), *WINDOWS).tolist()
            place, _ = SearchWindow(chosen, guess, window, turn, REACH).search(points, sides, 0.0)
            found = chosen.align(points, sides, place, place, free)
            placed = found if found.fit > placed.fit + BETTER_FIT else placed
        pose = np.array([*placed.pose[:2], wrap_angle(placed.pose[2])])
        return LaserMotion(pose, placed.equations.sums.sum(axis=0)[:3, :3], placed.fit)

    def _draw(self, points: FloatArray) -> None:
        if not self._submaps or len(self._submaps[-1].poses) >= KEYFRAMES:
            self._submaps = [*self._submaps[-1:], Submap(0, REACH + KEYFRAMES * WINDOWS[1])]
            self._frames = [*self._frames[-1:], self._pose]
        self._submaps[-1].add(
            seen_from(self._frames[-1], self._pose), points, sides_of(points, self._beams[1])
        )
        self._keyframe = self._pose


def with_laser_odometry(log: Log) -> Log:
    """The log with poses by the laser where it has no odometry, or one that isn't trusted."""
    spans = log.distrusted if log.has_odometry else ((-np.inf, np.inf),)
    if not spans:
        return log
    _, poses, scans = log.track
    steps = relative_poses(poses[:-1], poses[1:])
    tracker: LaserTracker | None = None
    for record, (begin, end) in zip(log, itertools.pairwise([0, *scans.tolist()]), strict=True):
        if not any(first <= record.stamp <= last for first, last in spans):
            tracker = None
        elif tracker is None:
            tracker = LaserTracker(record.scan)
        else:
            motion = tracker.move(record.scan).step
            if end > begin:  # it is spread over the moments between the scans
                steps[begin:end] = motion / (end - begin)
    return with_steps(log, steps)


def with_steps(log: Log, steps: FloatArray) -> Log:
    """The log with other motions (N - 1, 3) between the N moments of its odometry."""
    stamps, poses, scans = log.track
    headings = np.cumsum(np.append(poses[0, 2], steps[:, 2]))
    ahead = unit_vectors(headings[:-1])
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    places = np.cumsum(
        np.vstack([poses[:1, :2], steps[:, :1] * ahead + steps[:, 1:2] * left]), axis=0
    )
    moved = np.column_stack([places, wrap_angle(headings)])
    return with_track(log, OdometryTrack(stamps, moved, scans))
