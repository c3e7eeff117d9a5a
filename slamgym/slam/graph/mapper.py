"""Graph SLAM: scans aligned with submaps, and least squares over all of them.

Every processed scan is a node. It is aligned with the submaps that it overlaps: the newest two, and older ones whose
place is known to within what an alignment finds. Each alignment is an edge of the graph, so is the odometry, and the
wheels' systematic errors are unknowns. When the robot may have come back to a place whose relative pose is uncertain,
the surfaces of the newest submap are searched there. Least squares corrects the whole path at once; submaps are drawn
again where their scans moved, and so is the map.
"""

import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.alignment import MOST_SUBMAPS, AlignmentTarget, nearest_within, overlapping
from slamgym.slam.graph.closures import LoopCloser
from slamgym.slam.graph.compass import Compass
from slamgym.slam.graph.consistency import Consistency
from slamgym.slam.graph.map_graph import DriveScans, MapGraph, drawn_poses
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.recovery import POOR_FIT, Recovery
from slamgym.slam.graph.relative import moved_by, placed_points, seen_from, turned_matrix
from slamgym.slam.graph.sight import ScanView, Sight
from slamgym.slam.graph.submaps import OrientedPoints, Submap, oriented_scan
from slamgym.slam.graph.wheels import WheelStep
from slamgym.slam.laser_changes import seen_after
from slamgym.slam.laser_check import median_change
from slamgym.slam.mapper import Mapper

MATCH_RANGE = 25.0
"""Longer returns are not matched, but drawn [m]."""
SUBMAP_METRES = 2.0
"""A submap of a robot that doesn't turn spans so much driving [m]."""
SUBMAP_RADIANS = 1.5
"""A submap of a robot that turns on the spot spans so much turning [rad]."""
SUBMAP_SCANS = 8
"""A submap holds at least so many scans."""
FEW_POINTS = 20
"""A scan with fewer points says nothing of its place: it is neither searched nor in doubt."""
LEAST_POINTS = 5
"""A scan with fewer points is not even aligned."""
CARRIED_FIT = 0.5
"""A scan that fits worse, and half of whose readings differ from the scan before and from what that lets expect at the
place that was found, may have been taken where the robot was carried to."""
CARRIED_METRES = 0.6
"""Half of the readings of such a scan differ so much [m]: by 0.07 and less in four right drives of the zoo, and by 0.6
and more where a robot with a view all round was carried through a home. Of six public logs FHW has such scans, after
two pauses and in a crowd."""
OVERLAP_STRIDE = 4
"""Every so many points of a scan are looked at to find its overlap with a submap."""
OPTIMISE_INTERVAL = 10
"""The graph is optimised after so many nodes at the earliest."""
OPTIMISE_SHARE = 0.005
"""The graph is optimised after such a share of its nodes is new, too: the time for a scan stays bounded."""
STEPS_AFTER_NODES = 2
"""Steps of least squares after some new nodes."""
STEPS_AFTER_CLOSURE = 4
"""Steps of least squares after a loop closure."""
STEPS_AT_THE_END = 15
"""Steps of least squares once the log is complete."""
STALE_METRES = 0.004
"""A submap is drawn again once one of its scans has moved so far [m], half a radian counting as a metre."""


class PoseGraphMapper(Mapper):
    """Mode ``pose_graph``; see :class:`slamgym.slam.mapper.Mapper` for the methods."""

    def __init__(
        self,
        config: SlamConfig,
        geometry: LaserGeometry,
        initial_pose: Pose2D,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(config, geometry, initial_pose, rng)
        beams = geometry.num_beams
        self._scans = Columns(
            {"counts": np.int64, "ranges": np.float32},
            stamps=(),
            fits=(),
            counts=(),
            points=(beams, 2),
            sides=(beams, 3),
            ranges=(beams,),
        )
        self._reach = min(self._beams.usable, MATCH_RANGE) + SUBMAP_METRES + 1.0
        self._submaps: list[Submap] = []
        # Of all submaps but the newest.
        self._closed = Columns({"first": np.int64}, first=(), centre=(2,))
        self._submap_bytes = 0  # of the closed ones
        self._graph = PoseGraph()
        sight = Sight(geometry, self._beams.usable)
        self._loops = LoopCloser(config.pose_graph, sight, self._graph, self._submaps, self._target)
        self._compass = Compass()
        self._consistency = Consistency(geometry)
        self._last_scan: LaserScan | None = None  # that was processed
        self._last_view: ScanView | None = None
        self._recovery = Recovery(sight)

    # --- what others ask ---

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of the newest node relative to the first."""
        return self._graph.covariance

    def trajectory(self) -> Trajectory:
        """The path, as corrected until now."""
        return Trajectory(self._scans["stamps"].copy(), self._graph.poses.copy())

    def graph(self) -> MapGraph | None:
        """What was measured, with the scans; None before the first scan."""
        if self._last_scan is None:
            return None
        first = np.array([submap.first for submap in self._submaps])
        drive = DriveScans(
            first=0,
            stamps=self._scans["stamps"].copy(),
            ranges=self._scans["ranges"].copy(),
            geometry=self._last_scan.geometry,
            config=self._config,
        )
        return MapGraph(
            poses=self._graph.poses.copy(),
            edges=self._graph.corrected_edges(),
            submaps=np.column_stack([first, np.append(first[1:], len(self._graph))]),
            drives=(drive,),
        )

    def report(self) -> dict[str, Any]:
        """Entries that this mode adds to a summary."""
        return {"loop_closures": self._loops.closed, "loop_closures_rejected": self._loops.rejected}

    def _sweep_motion(self, scan: LaserScan) -> Pose2D:
        """The motion during a scan without what was learned of the wheels' systematic errors."""
        wheels = self._graph.wheels
        step = wheels.step(np.array([scan.motion]))
        return Pose2D(*wheels.expected(step).tolist())

    def _num_bytes(self) -> int:
        return self._scans.num_bytes + self._graph.num_bytes + self._submap_bytes

    def finish(self) -> None:
        """Optimise once more, and judge the whole map."""
        begin = time.process_time()
        if len(self._graph) > 1:
            self._optimise(STEPS_AT_THE_END)
            self._last_pose = Pose2D(*self._graph.poses[-1].tolist())
            self._judge(range(len(self._submaps)))
        self._grid = None
        self._stats.cpu_seconds += time.process_time() - begin

    # --- one scan ---

    def _process(self, scan: LaserScan) -> None:
        increments = self._gate.take(scan.stamp)
        step = self._graph.wheels.step(increments)
        view = ScanView(oriented_scan(scan.ranges, self._beams, MATCH_RANGE), scan.ranges)
        fit = 1.0
        if len(self._graph) == 0:
            self._submaps.append(Submap(0, self._reach))
            nothing = np.zeros((3, 3))
            self._graph.append(np.array(self._last_pose), step, nothing, nothing)
        elif len(view.seen.points) < LEAST_POINTS:
            known = self._information(step)
            self._graph.append(self._predicted(step), step, known, np.zeros((3, 3)))
        else:
            fit = self._place(step, view)
            if fit < CARRIED_FIT and self._is_carried(scan):
                fit = 0.0
        self._remember(scan.stamp, step, view, fit)
        self._last_scan = scan
        self._last_view = view
        if self._loops.is_due():
            self._close_loop()
        interval = max(OPTIMISE_INTERVAL, OPTIMISE_SHARE * len(self._graph))
        if len(self._graph) - self._graph.optimised >= interval:
            self._optimise(STEPS_AFTER_NODES)
        self._last_pose = Pose2D(*self._graph.poses[-1].tolist())

    def _is_carried(self, scan: LaserScan) -> bool:
        """True if the view is neither that of the scan before nor what it lets expect at the place that was found."""
        assert self._last_scan is not None
        before, found = self._graph.poses[-2:]
        step = Pose2D(*seen_from(before, found).tolist())
        expected = seen_after(self._last_scan, step)
        views = (self._last_scan.ranges, expected)
        return min(median_change(view, scan.ranges) for view in views) > CARRIED_METRES

    def _predicted(self, step: WheelStep) -> FloatArray:
        """Pose (3,) by odometry from the newest node."""
        expected = self._graph.wheels.expected(step)
        return moved_by(self._graph.poses[-1], expected)

    def _information(self, step: WheelStep) -> FloatArray:
        """Information (3, 3) of the predicted pose, in the map frame."""
        information = self._graph.wheels.information(step)
        heading = self._graph.poses[-1, 2]
        return turned_matrix(information, heading)

    def _place(self, step: WheelStep, scan: ScanView) -> float:
        """Find where a scan was taken, and make it a node with its edges.

        Returns:
            Share of its points that fit what was seen before; 1 if it has few.
        """
        graph = self._graph
        seen = scan.seen
        predicted = self._predicted(step)
        known = self._information(step)
        count = len(self._submaps)
        older = max(0, count - 2)  # than the newest two
        newest = list(range(older, count))
        most = MOST_SUBMAPS - len(newest)
        taken = seen.every(OVERLAP_STRIDE)
        middle = moved_by(predicted, np.array([*seen.points.mean(axis=0), 0.0]))
        near = self._near(middle, older)
        numbers = newest + overlapping(self._target, near, taken, predicted)[:most]
        target = self._target(numbers)
        placed = target.align(seen, predicted, predicted, known)
        if len(seen.points) >= FEW_POINTS:
            last = graph.poses[-1]
            before = self._last_view
            assert before is not None
            placed = self._recovery.check(target, scan, predicted, known, placed, before, last)
            self._stats.recovered_matches = self._recovery.recovered
        matches = target.matches(placed, graph.poses, len(graph))
        bound = np.zeros((3, 3))
        # A scan that fits poorly lies where the wheels say, and shows nothing of their errors.
        for match in matches if placed.fit >= POOR_FIT else ():
            heading = graph.poses[match.old, 2]
            bound += turned_matrix(match.information, heading)
        graph.append(placed.pose, step, known, bound)
        first_sure = self._submaps[older].first
        for match in matches:
            graph.tie(match, is_sure=match.old >= first_sure)
        return placed.fit if len(seen.points) >= FEW_POINTS else 1.0

    def _near(self, place: FloatArray, count: int) -> list[int]:
        """Those of the first ``count`` submaps that are in reach of a place and tied to the newest node."""
        firsts = self._closed["first"][:count]
        centres = self._closed["centre"][:count]
        middles = np.column_stack(placed_points(self._graph.poses[firsts], centres))
        near = nearest_within(middles, place, self._reach)
        return [number for number in near if self._graph.is_tied(int(firsts[number]))]

    def _target(self, numbers: list[int]) -> AlignmentTarget:
        """Submaps as they are now: drawn again where their scans have moved."""
        submaps = [self._submaps[number] for number in numbers]
        for submap in submaps:
            if submap.checked < self._graph.optimisations:
                submap.checked = self._graph.optimisations
                self._draw_again(submap)
        firsts = [submap.first for submap in submaps]
        return AlignmentTarget(submaps, self._graph.poses[firsts])

    def _draw_again(self, submap: Submap) -> None:
        """Draw a submap again if its scans have moved in its frame."""
        first = submap.first
        count = len(submap.poses)
        poses = self._graph.poses[first : first + count]
        now = relative_poses(np.broadcast_to(poses[0], poses.shape), poses)
        moved = np.abs(now - np.array(submap.poses)) * (1.0, 1.0, 2.0)
        if moved.sum(axis=1).max() < STALE_METRES:
            return
        submap.clear()
        counts = self._scans["counts"]
        points = self._scans["points"]
        sides = self._scans["sides"]
        for node, pose in enumerate(now, first):
            size = counts[node]
            submap.add(pose, OrientedPoints(points[node, :size], sides[node, :size]))

    def _remember(self, stamp: float, step: WheelStep, scan: ScanView, fit: float) -> None:
        """Keep the newest node's scan, and draw it into the newest submap."""
        seen, ranges = scan
        node = len(self._graph) - 1
        count = len(seen.points)
        submap = self._submaps[-1]
        x, y, turn = step.moved
        submap.size += np.hypot(x, y) / SUBMAP_METRES
        submap.size += abs(turn) / SUBMAP_RADIANS
        if submap.size > 1.0 and len(submap.poses) >= SUBMAP_SCANS:
            self._close_submap(submap)
            submap = Submap(node, self._reach)
            self._submaps.append(submap)
        if self._stats.is_doubtful:
            self._stats.doubtful.append(stamp)  # until this submap is judged, too
        pose = seen_from(self._graph.poses[submap.first], self._graph.poses[node])
        submap.add(pose, seen)
        self._scans.append(stamps=stamp, fits=fit, counts=count, ranges=ranges)
        self._scans["points"][-1, :count] = seen.points
        self._scans["sides"][-1, :count] = seen.sides

    def _close_submap(self, submap: Submap) -> None:
        """Finish the newest submap: no more scans are added to it."""
        submap.close()
        self._compass.read(submap, self._graph)
        self._closed.append(first=submap.first, centre=submap.centre)
        self._submap_bytes += submap.grid.nbytes + submap.pieces.nbytes
        self._judge([len(self._submaps) - 1])

    def _judge(self, numbers: Iterable[int]) -> None:
        """Say which scans are in doubt, after some submaps were held against those before."""
        stamps = self._scans["stamps"]
        ranges = self._scans["ranges"]
        for number in numbers:
            self._consistency.judge(number, self._submaps, self._graph, ranges)
        doubtful, broken = self._consistency.stamps(stamps, self._scans["fits"])
        self._stats.doubtful = doubtful
        self._stats.broken = broken

    # --- the whole path ---

    def _close_loop(self) -> None:
        """Seek a loop closure, and correct the path by what was found."""
        closure = self._loops.close(self._scans["ranges"])
        if closure is not None:
            self._graph.tie(closure)
            self._optimise(STEPS_AFTER_CLOSURE, is_closing=True)

    def _optimise(self, iterations: int, is_closing: bool = False) -> None:
        anchors = sorted({submap.first for submap in self._submaps})
        self._graph.optimise(anchors, iterations, is_closing)

    def _draw_path(self) -> None:
        self._map.follow(drawn_poses(self._graph.poses), self._scans["ranges"])
