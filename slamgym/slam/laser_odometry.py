"""Odometry by the laser alone: for logs that have none, and for stretches in which the wheels lie.

Each scan is aligned with a few scans before it, from where a robot of steady speed is by then
(:mod:`slamgym.slam.steady_motion`); where it fits poorly, it is searched as far as that isn't known (Olson, *Real-time
correlative scan matching*, ICRA 2009). Where the laser binds nothing, the speed leads on, and once that
may have led astray, the scans are in doubt.
"""

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import runs_of, unit_vectors, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.portable import inverted, product
from slamgym.core.types import AT_REST, FloatArray, LaserGeometry, LaserScan, Pose2D
from slamgym.interop.odometry import with_track
from slamgym.interop.records import Log, OdometryTrack
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import SlamConfig
from slamgym.slam.deskew import placed_returns
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.alignment import Alignment, AlignmentTarget, NormalEquations
from slamgym.slam.graph.mapper import FEW_POINTS, LEAST_POINTS
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.recovery import NARROW_SEARCH_NATS, POINT_NATS
from slamgym.slam.graph.relative import DAMPING, MATCH_FLOOR, chi_squared, pose_spreads, seen_from
from slamgym.slam.graph.sight import ScanView, Sight
from slamgym.slam.graph.submaps import Submap, sides_of
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


class LaserMotion(NamedTuple):
    """Motion from one scan to the next."""

    step: FloatArray  # (3,) in the frame of the robot at the first
    information: FloatArray  # (3, 3) of it
    fit: float  # share of the points that lie on what was seen before


class RecentScans:
    """What the laser saw last: two submaps of a few scans each.

    Args:
        geometry: The scanner.
    """

    def __init__(self, geometry: LaserGeometry) -> None:
        self._beams = BeamTable.of(geometry, SlamConfig(max_usable_range=TRACKED_RANGE))
        self._submaps: list[Submap] = []  # the newest two
        self._frames: list[FloatArray] = []  # their poses
        self._keyframe = np.zeros(3)  # where a scan was last drawn

    def points(self, scan: LaserScan, motion: Pose2D) -> FloatArray:
        """End points (n, 2) in the robot's frame as it stands at the first beam [m], if it moves during the scan."""
        beams = self._beams
        if motion == AT_REST:
            points = usable_end_points(scan.ranges, plain(beams), TRACKED_RANGE)
        else:
            is_near = (scan.ranges >= beams.range_min) & (scan.ranges <= TRACKED_RANGE)
            points = placed_returns(scan, motion)[is_near & (scan.ranges < beams.range_max)]
        stride = max(1, len(points) // MOST_POINTS)
        return np.ascontiguousarray(points[::stride])

    def align(
        self, points: FloatArray, start: FloatArray, prior: FloatArray, known: FloatArray
    ) -> Alignment:
        """Align points (n, 2), from a pose (3,), by a prior (3,) of known information (3, 3)."""
        placed = self._target().align(points, self._sides(points), start, prior, known)
        x, y, heading = placed.pose
        return placed._replace(pose=np.array([x, y, wrap_angle(heading)]))

    def search(
        self, points: FloatArray, centre: FloatArray, window: float, turn: float
    ) -> FloatArray:
        """The pose (3,) in a window [m], [rad] about another at which points (n, 2) fit best."""
        space = SearchWindow(self._target(), centre, window, turn, TRACKED_RANGE)
        place, _ = space.search(points, self._sides(points), 0.0)
        return place

    def draw(self, points: FloatArray, pose: FloatArray) -> None:
        """Draw points (n, 2) of a scan, taken at a pose (3,), into the newest submap, or into a new one."""
        if not self._submaps or len(self._submaps[-1].poses) >= KEYFRAMES:
            newest = Submap(0, TRACKED_RANGE + KEYFRAMES * MOST_WIDTH)
            self._submaps = [*self._submaps[-1:], newest]
            self._frames = [*self._frames[-1:], pose]
        place = seen_from(self._frames[-1], pose)
        self._submaps[-1].add(place, points, self._sides(points))
        self._keyframe = pose

    def is_due(self, points: FloatArray, pose: FloatArray) -> bool:
        """True if a scan shall be drawn: it was taken away from the last one, and shows something."""
        moved = np.abs(seen_from(self._keyframe, pose)).max()
        return bool(moved > KEYFRAME) and len(points) >= FEW_POINTS

    def view(self, scan: LaserScan, points: FloatArray) -> ScanView:
        """A scan with its points (n, 2)."""
        return ScanView(points, self._sides(points), scan.ranges)

    def _target(self) -> AlignmentTarget:
        return AlignmentTarget(self._submaps, np.array(self._frames))

    def _sides(self, points: FloatArray) -> FloatArray:
        return sides_of(points, self._beams.mount)


def no_alignment(pose: FloatArray) -> Alignment:
    """A pose (3,) of which nothing was seen."""
    nothing = NormalEquations(np.zeros((1, 4, 4)), np.zeros(1, dtype=np.int64))
    return Alignment(pose, nothing, np.zeros(1))


def by_laser(placed: Alignment) -> tuple[FloatArray, FloatArray]:
    """What the laser by itself says of a pose that was aligned by a prior, too.

    Returns:
        The motion (3,) from where the laser alone would have put it to where it is, and the information (3, 3) that is
        believed.
    """
    sums = placed.equations.sums.sum(axis=0)
    information = sums[:3, :3]
    own = np.eye(3)
    shift = product(inverted(information + DAMPING * own), sums[:3, 3:])
    doubted = BINDING * (own - BINDING * inverted(information + BINDING * own))
    covariance = inverted(information - doubted + own) + np.diag(np.square(MATCH_FLOOR))
    return shift[:, 0], inverted(covariance)


def motion_between(first: LaserScan, second: LaserScan, expected: FloatArray) -> LaserMotion:
    """The motion between two scans by the laser, which is ``expected`` (3,); their own motions are taken as true.

    Another one must fit better, and less of it be contradicted by what the scans saw through: in a bare corridor each
    scan fits the one before best where that was taken.
    """
    before = RecentScans(first.geometry)
    start = np.zeros(3)
    seen = before.points(first, first.motion)
    before.draw(seen, start)
    points = before.points(second, second.motion)
    unknown = np.zeros((3, 3))
    placed = no_alignment(expected)
    if len(points) >= FEW_POINTS:
        placed = before.align(points, expected, expected, unknown)
        if placed.fit < SURE_FIT:
            wait = second.stamp - first.stamp
            widths = np.clip(np.multiply(FASTEST, wait), LEAST_WIDTH, MOST_WIDTH)
            place = before.search(points, expected, *widths.tolist())
            found = before.align(points, place, place, unknown)
            if found.fit > placed.fit + BETTER_FIT:
                sight = Sight(first.geometry, TRACKED_RANGE)
                newer = before.view(second, points)
                older = before.view(first, seen)
                as_expected = sight.clashes(newer, placed, older, start)
                as_found = sight.clashes(newer, found, older, start)
                if as_expected > as_found + BETTER_FIT * len(points):
                    placed = found
    information = placed.equations.sums.sum(axis=0)[:3, :3]
    return LaserMotion(placed.pose, information, placed.fit)


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
        points = self._points(scan, motion.speed)
        placed = self._place(points)
        if scan.geometry.scan_time > 0.0:
            speed = seen_from(before, placed.pose) / wait
            self._draw_first(speed)
            points = self._points(scan, speed)
            placed = self._place(points)
        self._first = None
        if len(points) >= LEAST_POINTS:
            shift, information = by_laser(placed)
            motion.correct(placed.pose - shift, information)
        if self._recent.is_due(points, motion.pose):
            self._recent.draw(points, motion.pose)
        return seen_from(before, motion.pose)

    def _points(self, scan: LaserScan, speed: FloatArray) -> FloatArray:
        """End points (n, 2) at a speed (3,)."""
        moved = Pose2D(*(speed * scan.geometry.scan_time).tolist())
        return self._recent.points(scan, moved)

    def _place(self, points: FloatArray) -> Alignment:
        """Find where points (n, 2) were seen: where they fit best, given where a robot of steady speed should be."""
        guess = self._motion.pose
        if len(points) < LEAST_POINTS:
            return no_alignment(guess)
        covariance = self._motion.pose_covariance
        known = inverted(covariance)
        placed = self._recent.align(points, guess, guess, known)
        if placed.fit >= SURE_FIT or len(points) < FEW_POINTS:
            return placed
        deviations = np.array(pose_spreads(covariance))
        widths = np.clip(SEARCHED_DEVIATIONS * deviations, LEAST_WIDTH, MOST_WIDTH)
        place = self._recent.search(points, guess, *widths.tolist())
        found = self._recent.align(points, place, guess, known)

        def evidence(one: Alignment) -> float:
            """Log-likelihood of an alignment [nats]."""
            fitting = POINT_NATS * one.fit * len(points)
            return fitting - 0.5 * chi_squared(one.pose, guess, known)

        is_better = evidence(found) > evidence(placed) + NARROW_SEARCH_NATS
        return found if is_better else placed

    def _draw_first(self, speed: FloatArray) -> None:
        """Draw the first scan, again once the speed (3,) is known at which it was taken."""
        if self._first is not None:
            self._recent = RecentScans(self._first.geometry)
            self._recent.draw(self._points(self._first, speed), np.zeros(3))


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
