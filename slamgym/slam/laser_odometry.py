"""Odometry by the laser alone: for logs that have none, and for stretches in which the wheels lie.

Each scan is aligned with a few scans before it, from where constant speed would have brought the robot; where it fits
poorly, it is searched as far as a robot gets meanwhile (Olson, *Real-time correlative scan matching*, ICRA 2009).
"""

import itertools
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import unit_vectors, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.types import AT_REST, FloatArray, LaserScan, Pose2D
from slamgym.interop.odometry import with_track
from slamgym.interop.records import Log, OdometryTrack
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import SlamConfig
from slamgym.slam.deskew import placed_returns
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.alignment import Alignment, AlignmentTarget, NormalEquations
from slamgym.slam.graph.mapper import FEW_POINTS
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.graph.submaps import Submap, sides_of
from slamgym.slam.hit_count_kernels import BeamTable

TRACKED_RANGE = 10.0
"""Points of a scan so near are aligned [m]."""
MOST_POINTS = 360
"""About so many points of a scan are aligned, at most twice as many."""
KEYFRAME = 0.15
"""A scan is drawn into the newest submap after so much driving [m] or turning [rad]."""
KEYFRAMES = 6
"""So many scans are drawn into a submap."""
SURE_FIT = 0.75
"""A scan of which such a share of the points fits needs no search."""
BETTER_FIT = 0.1
"""What a search finds must fit better by this share of the points."""
FASTEST = (2.0, 3.0)
"""Speeds that a robot doesn't exceed [m/s], [rad/s]: the search is so wide for each second between scans."""
LEAST_WIDTH = 0.15
"""Least width of a search [m or rad]."""
MOST_WIDTH = 1.0
"""Largest width of a search [m or rad]."""


class LaserMotion(NamedTuple):
    """Motion from one scan to the next."""

    step: FloatArray  # (3,) in the frame of the robot at the first
    information: FloatArray  # (3, 3) of it
    fit: float  # share of the points that lie on what was seen before


class LaserTracker:
    """Follows the laser from scan to scan.

    Where scans take their time, each is aligned as the speed until now has it, and once more by the motion found.

    Args:
        scan: The first one.
        trusts_odometry: True if the scans' own motions are used instead.
    """

    def __init__(self, scan: LaserScan, trusts_odometry: bool = False) -> None:
        self._trusts_odometry = trusts_odometry
        self._beams = BeamTable.of(scan.geometry, SlamConfig(max_usable_range=TRACKED_RANGE))
        self._stamp = scan.stamp
        self._pose = np.zeros(3)
        self._keyframe = self._pose  # where a scan was last drawn
        self._speed = np.zeros(3)
        self._submaps: list[Submap] = []  # the newest two
        self._frames: list[FloatArray] = []  # their poses
        self._first: LaserScan | None = scan
        self._draw(self._points(scan, self._speed))

    def move(self, scan: LaserScan, expected: FloatArray | None = None) -> LaserMotion:
        """Take the next scan, which is ``expected`` (3,) away; by default the speed has stayed as it was."""
        wait = max(scan.stamp - self._stamp, 1e-3)
        if expected is None:
            expected = self._speed * wait
        guess = moved_by(self._pose, expected)
        points = self._points(scan, expected / wait)
        placed = self._place(points, guess, wait)
        if scan.geometry.scan_time > 0.0 and not self._trusts_odometry:
            speed = seen_from(self._pose, placed.pose) / wait
            self._draw_first(speed)
            points = self._points(scan, speed)
            placed = self._place(points, placed.pose, wait)
        self._first = None
        pose = placed.pose
        step = seen_from(self._pose, pose)
        self._speed = step / wait
        self._stamp = scan.stamp
        self._pose = pose
        if np.abs(seen_from(self._keyframe, pose)).max() > KEYFRAME:
            self._draw(points)
        information = placed.equations.sums.sum(axis=0)[:3, :3]
        return LaserMotion(step, information, placed.fit)

    def _points(self, scan: LaserScan, speed: FloatArray) -> FloatArray:
        """End points (n, 2) in the robot's frame [m], as it stands at the first beam, at a speed (3,)."""
        motion = Pose2D(*(speed * scan.geometry.scan_time).tolist())
        if self._trusts_odometry:
            motion = scan.motion
        beams = self._beams
        if motion == AT_REST:
            points = usable_end_points(scan.ranges, plain(beams), TRACKED_RANGE)
        else:
            is_near = (scan.ranges >= beams.range_min) & (scan.ranges <= TRACKED_RANGE)
            points = placed_returns(scan, motion)[is_near & (scan.ranges < beams.range_max)]
        stride = max(1, len(points) // MOST_POINTS)
        return np.ascontiguousarray(points[::stride])

    def _place(self, points: FloatArray, guess: FloatArray, wait: float) -> Alignment:
        """Find where points (n, 2) were seen, so long after the scan before [s]."""
        if len(points) < FEW_POINTS:
            nothing = NormalEquations(np.zeros((1, 4, 4)), np.zeros(1, dtype=np.int64))
            return Alignment(guess, nothing, 0.0)
        sides = sides_of(points, self._beams.mount)
        unknown = np.zeros((3, 3))
        target = AlignmentTarget(self._submaps, np.array(self._frames))
        placed = target.align(points, sides, guess, guess, unknown)
        if placed.fit < SURE_FIT:
            widths = np.clip(np.multiply(FASTEST, wait), LEAST_WIDTH, MOST_WIDTH)
            window, turn = widths.tolist()
            space = SearchWindow(target, guess, window, turn, TRACKED_RANGE)
            place, _ = space.search(points, sides, 0.0)
            found = target.align(points, sides, place, place, unknown)
            if found.fit > placed.fit + BETTER_FIT:
                placed = found
        x, y, heading = placed.pose
        return placed._replace(pose=np.array([x, y, wrap_angle(heading)]))

    def _draw_first(self, speed: FloatArray) -> None:
        """Draw the first scan again, now that the speed (3,) is known at which it was taken."""
        if self._first is not None:
            self._submaps.clear()
            self._frames.clear()
            self._draw(self._points(self._first, speed))

    def _draw(self, points: FloatArray) -> None:
        """Draw points (n, 2) of the newest scan into the newest submap, or into a new one."""
        if not self._submaps or len(self._submaps[-1].poses) >= KEYFRAMES:
            newest = Submap(0, TRACKED_RANGE + KEYFRAMES * MOST_WIDTH)
            self._submaps = [*self._submaps[-1:], newest]
            self._frames = [*self._frames[-1:], self._pose]
        pose = seen_from(self._frames[-1], self._pose)
        self._submaps[-1].add(pose, points, sides_of(points, self._beams.mount))
        self._keyframe = self._pose


def with_laser_odometry(log: Log) -> Log:
    """The log with poses by the laser where it has no odometry, or one that isn't trusted."""
    spans = log.distrusted if log.has_odometry else ((-np.inf, np.inf),)
    if not spans:
        return log
    _, poses, scans = log.track
    steps = relative_poses(poses[:-1], poses[1:])
    tracker: LaserTracker | None = None
    moments = itertools.pairwise([0, *scans.tolist()])
    for record, (begin, end) in zip(log, moments, strict=True):
        is_distrusted = any(first <= record.stamp <= last for first, last in spans)
        if not is_distrusted:
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
    shifts = steps[:, :1] * ahead + steps[:, 1:2] * left
    places = np.cumsum(np.vstack([poses[:1, :2], shifts]), axis=0)
    moved = np.column_stack([places, wrap_angle(headings)])
    return with_track(log, OdometryTrack(stamps, moved, scans))
