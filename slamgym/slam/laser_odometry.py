"""Odometry by the laser alone: for logs that have none, and for stretches in which the wheels lie.

Each scan is aligned with a few scans before it, from where a robot of steady speed is by then
(:mod:`slamgym.slam.steady_motion`); where it fits poorly, it is searched as far as that isn't known (Olson, *Real-time
correlative scan matching*, ICRA 2009). Where the laser binds nothing, the speed leads on, and once that
may have led astray, the scans are in doubt.
"""

import itertools
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.geometry import runs_of, unit_vectors, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.portable import inverted
from slamgym.core.types import (
    AT_REST,
    BoolArray,
    FloatArray,
    IntArray,
    LaserGeometry,
    LaserScan,
    Pose2D,
)
from slamgym.interop.odometry import with_track
from slamgym.interop.records import Log, OdometryTrack
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import SlamConfig
from slamgym.slam.deskew import placed_returns
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.alignment import Alignment, AlignmentTarget
from slamgym.slam.graph.mapper import FEW_POINTS, LEAST_POINTS
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.recovery import NARROW_SEARCH_NATS, POINT_NATS
from slamgym.slam.graph.relative import chi_squared, pose_spreads, seen_from, weigh_match
from slamgym.slam.graph.sight import ScanView, Sight
from slamgym.slam.graph.submaps import OrientedPoints, Submap, oriented
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.steady_motion import SteadyMotion

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
"""What a search of a pair finds must fit better by this share of the points."""
FASTEST = (2.0, 3.0)
"""Speeds that a robot doesn't exceed [m/s], [rad/s]: the search of a pair is so wide for each second between scans."""
SEARCHED_DEVIATIONS = 3.0
"""A search reaches so many standard deviations from where the robot should be."""
LEAST_WIDTH = 0.15
"""Least width of a search [m or rad]."""
MOST_WIDTH = 1.0
"""Largest width of a search [m or rad]."""
BINDING = 60_000.0
"""Information of a direction that counts half [1/m^2], [1/rad^2]. Scans are aligned with what the same beams drew
before, so a bare corridor seems to bind a little along it: with 15,000, as in the graph, a robot that drives 5.9 m in
one seems to drive 3.7 m, with this 5.8 m."""
DOUBT_METRES = 0.3
"""A scan is in doubt if the standard deviation of its place among those before is more than this [m]. In ten homes with
a laser of 3.5 m that sees ahead, right paths reach 0.29, wrong ones 0.35 to 0.98, and one that is right 0.48."""
DOUBT_RADIANS = 0.25
"""Or that of its heading [rad]."""


class PairMotions(NamedTuple):
    """Motions between pairs of scans, in the frame of the robot at the first."""

    scans: IntArray  # (N, 2) indices
    stamps: FloatArray  # (N, 2) [s]
    laser: FloatArray  # (N, 3)
    information: FloatArray  # (N, 3, 3) of the laser's motions
    fits: FloatArray  # (N,) shares of the points that lie on what was seen before
    odometry: FloatArray  # (N, 3)

    @staticmethod
    def between(log: Log, scans: IntArray) -> "PairMotions":
        """The motions between pairs of scans (N, 2) of a log."""
        odometry = odometry_between(log, scans)
        motions = [
            motion_between(log.records[first].scan, log.records[second].scan, expected)
            for (first, second), expected in zip(scans.tolist(), odometry, strict=True)
        ]
        return PairMotions(
            scans=scans,
            stamps=np.array([record.stamp for record in log])[scans],
            laser=np.array([motion.pose for motion in motions]).reshape(-1, 3),
            information=np.array([motion.total[:3, :3] for motion in motions]).reshape(-1, 3, 3),
            fits=np.array([motion.fit for motion in motions]),
            odometry=odometry,
        )

    def at(self, which: BoolArray) -> "PairMotions":
        """Some of the pairs."""
        columns: list[Any] = [column[which] for column in self]
        return PairMotions(*columns)


def odometry_between(log: Log, scans: IntArray) -> FloatArray:
    """Motions (N, 3) by odometry between pairs of scans (N, 2)."""
    poses = np.array([record.odometry for record in log], dtype=np.float64)
    first, second = scans.T
    return relative_poses(poses[first], poses[second])


class RecentScans:
    """What the laser saw last: two submaps of a few scans each.

    Args:
        geometry: The scanner.
    """

    def __init__(self, geometry: LaserGeometry) -> None:
        self._beams = BeamTable.of(geometry, SlamConfig(max_usable_range=TRACKED_RANGE))
        self._reach = min(TRACKED_RANGE, geometry.range_max)
        self._submaps: list[Submap] = []  # the newest two
        self._frames: list[FloatArray] = []  # their poses
        self._keyframe = np.zeros(3)  # where a scan was last drawn

    def seen(self, scan: LaserScan, motion: Pose2D) -> OrientedPoints:
        """End points in the robot's frame as it stands at the first beam, if it moves during the scan."""
        beams = self._beams
        if motion == AT_REST:
            points = usable_end_points(scan.ranges, plain(beams), TRACKED_RANGE)
        else:
            is_near = (scan.ranges >= beams.range_min) & (scan.ranges <= TRACKED_RANGE)
            points = placed_returns(scan, motion)[is_near & (scan.ranges < beams.range_max)]
        stride = max(1, len(points) // MOST_POINTS)
        return oriented(points[::stride], beams.mount, stride * beams.spacing)

    def align(
        self, seen: OrientedPoints, start: FloatArray, prior: FloatArray, known: FloatArray
    ) -> Alignment:
        """Align a scan, from a pose (3,), by a prior (3,) of known information (3, 3)."""
        placed = self._target().align(seen, start, prior, known)
        x, y, heading = placed.pose
        return placed._replace(pose=np.array([x, y, wrap_angle(heading)]))

    def search(
        self, seen: OrientedPoints, centre: FloatArray, deviations: FloatArray
    ) -> FloatArray:
        """The pose (3,) about another, known to within deviations (2,) [m], [rad], at which a scan fits best."""
        window = np.clip(deviations, LEAST_WIDTH, MOST_WIDTH)
        place, _ = SearchWindow(self._target(), centre, window, seen.reach).search(seen, 0.0)
        return place

    def draw(self, seen: OrientedPoints, pose: FloatArray) -> None:
        """Draw a scan, taken at a pose (3,), into the newest submap, or into a new one."""
        if not self._submaps or len(self._submaps[-1].poses) >= KEYFRAMES:
            newest = Submap(0, self._reach + KEYFRAMES * MOST_WIDTH)
            self._submaps = [*self._submaps[-1:], newest]
            self._frames = [*self._frames[-1:], pose]
        self._submaps[-1].add(seen_from(self._frames[-1], pose), seen)
        self._keyframe = pose

    def is_due(self, seen: OrientedPoints, pose: FloatArray) -> bool:
        """True if a scan shall be drawn: it was taken away from the last one, and shows something."""
        moved = np.abs(seen_from(self._keyframe, pose)).max()
        return bool(moved > KEYFRAME) and len(seen.points) >= FEW_POINTS

    def _target(self) -> AlignmentTarget:
        return AlignmentTarget(self._submaps, np.array(self._frames))


def no_alignment(pose: FloatArray) -> Alignment:
    """A pose (3,) of which nothing was seen."""
    return Alignment(pose, np.zeros((1, 4, 4)), np.zeros(1, dtype=np.int64), np.zeros(1))


def motion_between(first: LaserScan, second: LaserScan, expected: FloatArray) -> Alignment:
    """The motion between two scans by the laser, which is ``expected`` (3,); their own motions are taken as true.

    Another one must fit better, and less of it be contradicted by what the scans saw through: in a bare corridor each
    scan fits the one before best where that was taken.
    """
    before = RecentScans(first.geometry)
    start = np.zeros(3)
    older = ScanView(before.seen(first, first.motion), first.ranges)
    newer = ScanView(before.seen(second, second.motion), second.ranges)
    before.draw(older.seen, start)
    unknown = np.zeros((3, 3))
    placed = no_alignment(expected)
    count = len(newer.seen.points)
    if count >= FEW_POINTS:
        placed = before.align(newer.seen, expected, expected, unknown)
        if placed.fit < SURE_FIT:
            wait = second.stamp - first.stamp
            place = before.search(newer.seen, expected, np.multiply(FASTEST, wait))
            found = before.align(newer.seen, place, place, unknown)
            if found.fit > placed.fit + BETTER_FIT:
                sight = Sight(first.geometry, TRACKED_RANGE)
                as_expected = sight.clashes(newer, placed, older, start)
                as_found = sight.clashes(newer, found, older, start)
                if as_expected > as_found + BETTER_FIT * count:
                    placed = found
    return placed


class LaserTracker:
    """Follows the laser from scan to scan.

    Where scans take their time, each is aligned as the speed until now has it, and once more by the motion found.

    Args:
        scan: The first one.
    """

    def __init__(self, scan: LaserScan) -> None:
        self._motion = SteadyMotion()
        self._stamp = scan.stamp
        self._recent = RecentScans(scan.geometry)
        self._first: LaserScan | None = scan
        self._draw_first(np.zeros(3))

    @property
    def is_doubtful(self) -> bool:
        """True if the laser doesn't tell where the newest scan lies among those before."""
        metres, radians = pose_spreads(self._motion.pose_covariance)
        return metres > DOUBT_METRES or radians > DOUBT_RADIANS

    def move(self, scan: LaserScan) -> FloatArray:
        """Take the next scan; returns the motion (3,) since the last one, in the robot's frame there."""
        wait = max(scan.stamp - self._stamp, 1e-3)
        self._stamp = scan.stamp
        motion = self._motion
        before = motion.pose
        motion.predict(wait)
        seen = self._seen(scan, motion.speed)
        placed = self._place(seen)
        if scan.geometry.scan_time > 0.0:
            speed = seen_from(before, placed.pose) / wait
            self._draw_first(speed)
            seen = self._seen(scan, speed)
            placed = self._place(seen)
        self._first = None
        if len(seen.points) >= LEAST_POINTS:
            # What the laser by itself says of a pose that was aligned by a prior, too.
            shift, information = weigh_match(placed.total, 0.0, 1, BINDING)
            motion.correct(placed.pose - shift, information)
        if self._recent.is_due(seen, motion.pose):
            self._recent.draw(seen, motion.pose)
        return seen_from(before, motion.pose)

    def _seen(self, scan: LaserScan, speed: FloatArray) -> OrientedPoints:
        """End points at a speed (3,)."""
        moved = Pose2D(*(speed * scan.geometry.scan_time).tolist())
        return self._recent.seen(scan, moved)

    def _place(self, seen: OrientedPoints) -> Alignment:
        """Find where a scan was taken: where it fits best, given where a robot of steady speed should be."""
        guess = self._motion.pose
        count = len(seen.points)
        if count < LEAST_POINTS:
            return no_alignment(guess)
        covariance = self._motion.pose_covariance
        known = inverted(covariance)
        placed = self._recent.align(seen, guess, guess, known)
        if placed.fit >= SURE_FIT or count < FEW_POINTS:
            return placed
        place = self._recent.search(seen, guess, SEARCHED_DEVIATIONS * pose_spreads(covariance))
        found = self._recent.align(seen, place, guess, known)

        def evidence(one: Alignment) -> float:
            """Log-likelihood of an alignment [nats]."""
            fitting = POINT_NATS * one.fit * count
            return fitting - 0.5 * chi_squared(one.pose, guess, known)

        is_better = evidence(found) > evidence(placed) + NARROW_SEARCH_NATS
        return found if is_better else placed

    def _draw_first(self, speed: FloatArray) -> None:
        """Draw the first scan, again once the speed (3,) is known at which it was taken."""
        if self._first is not None:
            self._recent = RecentScans(self._first.geometry)
            self._recent.draw(self._seen(self._first, speed), np.zeros(3))


def with_laser_odometry(log: Log) -> Log:
    """The log with poses by the laser where it has no odometry, or one that isn't trusted.

    Where the laser tells no motion either, it is doubted.
    """
    doubtful = np.zeros(len(log), dtype=bool)
    spans = log.distrusted if log.has_odometry else ((-np.inf, np.inf),)
    if not spans:
        return log
    _, poses, scans = log.track
    steps = relative_poses(poses[:-1], poses[1:])
    tracker: LaserTracker | None = None
    is_distrusted = log.within(spans)
    moments = itertools.pairwise([0, *scans.tolist()])
    for index, (record, (begin, end)) in enumerate(zip(log, moments, strict=True)):
        if not is_distrusted[index]:
            tracker = None
        elif tracker is None:
            tracker = LaserTracker(record.scan)
        else:
            motion = tracker.move(record.scan)
            doubtful[index] = tracker.is_doubtful
            if end > begin:  # it is spread over the moments between the scans
                steps[begin:end] = motion / (end - begin)
    stretches = [
        (log.records[begin].stamp, log.records[end - 1].stamp) for begin, end in runs_of(doubtful)
    ]
    moved = with_steps(log, steps)
    return replace(moved, doubted=(*log.doubted, *stretches)) if stretches else moved


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
