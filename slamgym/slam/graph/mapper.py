"""Graph SLAM: scans aligned with submaps, and least squares over all of them.

Every processed scan is a node. It is aligned with the submaps that it overlaps: the newest two, and older ones whose
place is known to within what an alignment finds. Each alignment is an edge of the graph, so is the odometry, and the
wheels' systematic errors are unknowns. When the robot may have come back to a place whose relative pose is uncertain,
the surfaces of the newest submaps are searched there. Least squares corrects the whole path at once; submaps are drawn
again where their scans moved, and so is the map.
"""

import math
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from slamgym.core.geometry import compose, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.alignment import ALIGN_WIDTH, MOST_SUBMAPS, POINT_SHARE, Chosen, Placed
from slamgym.slam.graph.closures import LoopCloser
from slamgym.slam.graph.compass import Compass
from slamgym.slam.graph.consistency import Consistency
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import (
    Match,
    chi_squared,
    match_with,
    moved_by,
    seen_from,
    turned_matrix,
)
from slamgym.slam.graph.submaps import Submap, known_submap, known_surfaces, sides_of
from slamgym.slam.graph.wheels import WheelStep
from slamgym.slam.mapper import Mapper

MATCH_RANGE = 25.0
"""Longer returns are not matched, but drawn [m]."""
SUBMAP_METRES, SUBMAP_RADIANS, SUBMAP_SCANS = 2.0, 1.5, 8
"""A submap spans so much driving or turning, and at least so many scans."""
FEW_POINTS = 20
"""A scan with fewer points says nothing of its place: it is neither searched nor in doubt ..."""
LEAST_POINTS = 5
"""... and with fewer than these not even aligned."""
OVERLAP, OVERLAP_STRIDE, MOST_TRIED = 0.3, 4, 8
"""An old submap is matched with if this share of every so many points is near its surfaces; so many are looked at."""
GOOD_FIT, POOR_FIT = 0.8, 0.5
"""An alignment of a smaller share of fitting points is compared with a search where the odometry may err, and one of
less than the second with a search where it lies."""
POINT_NATS = 0.5 * POINT_SHARE * ALIGN_WIDTH**2
"""Log-likelihood of a point that fits over one that doesn't ..."""
LIE_NATS = 9.2
"""... which must make up for that of the odometry, or of its lying, once in 10,000 scans ..."""
SUSPICION = 60.0
"""What several scans in a row must have against the odometry: one alone may see a new wall next to an old one."""
SEARCH_NATS = (2.0, 9.0)
"""... and for the number of places that were searched, by narrow and wide window."""
LEAST_SCORE = 0.3
"""Score of a search below which nothing was found."""
DEVIATIONS, LEAST_WINDOW, LARGEST_WINDOW = 6.0, (0.1, 0.05), (1.0, 0.6)
"""Window of a search about the place by odometry, in deviations of it, and its bounds [m], [rad]."""
OPTIMISE_INTERVAL, OPTIMISE_SHARE = 10, 0.005
"""The graph is optimised after so many nodes, or such a share of all: the time for a scan stays bounded."""
STALE_METRES = 0.004
"""A submap is drawn again once one of its scans has moved so far [m], half a radian counting as a metre."""
DRAWN_LATTICE = np.array([0.004, 0.004, 0.002])
"""Steps in which poses are drawn into the map [m, m, rad]: what moves less isn't drawn again."""


class PoseGraphMapper(Mapper):
    """Mode ``pose_graph``; see :class:`slamgym.slam.mapper.Mapper` for the methods."""

    def __init__(
        self,
        config: SlamConfig,
        geometry: LaserGeometry,
        initial_pose: Pose2D,
        rng: np.random.Generator,
    ) -> None:
        del rng  # nothing is random here
        super().__init__(config, geometry)
        self._start = np.array(initial_pose, dtype=np.float64)
        beams = geometry.num_beams
        self._scans = Columns(
            {"counts": np.int64, "ranges": np.float32},
            stamps=(), counts=(), points=(beams, 2), sides=(beams, 3), ranges=(beams,),
        )  # fmt: skip
        self._reach = min(self._beams.usable, MATCH_RANGE) + SUBMAP_METRES + 1.0
        self._submaps: list[Submap] = []
        self._closed = Columns(
            {"first": np.int64}, first=(), centre=(2,)
        )  # of all submaps but the newest
        self._submap_bytes = 0  # of the closed ones
        self._graph = PoseGraph()
        self._loops, self._compass = LoopCloser(config.pose_graph), Compass()
        self._consistency = Consistency(geometry)
        self._drawn_poses = np.zeros((0, 3))
        self._suspicion = 0.0  # against the odometry, of the scans since one fitted well

    # --- what others ask ---

    @property
    def pose(self) -> Pose2D:
        """The newest node's pose, moved on by the odometry since."""
        newest = self._graph.poses[-1] if len(self._graph) else self._start
        return compose(Pose2D(*newest.tolist()), self._gate.since_processed)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of the newest node relative to the first."""
        return self._graph.covariance

    def trajectory(self) -> Trajectory:
        """The path, as corrected until now."""
        return Trajectory(self._scans["stamps"].copy(), self._graph.poses.copy())

    def report(self) -> dict[str, Any]:
        """Entries that this mode adds to a summary."""
        return {"loop_closures": self._loops.closed, "loop_closures_rejected": self._loops.rejected}

    def _num_bytes(self) -> int:
        return self._scans.num_bytes + self._graph.num_bytes + self._submap_bytes

    def finish(self) -> None:
        """Optimise once more, and judge the whole map."""
        begin = time.process_time()
        if len(self._graph) > 1:
            self._optimise(15)
            self._judge(range(len(self._submaps)))
        self._grid = None
        self._stats.cpu_seconds += time.process_time() - begin

    # --- one scan ---

    def _process(self, scan: LaserScan) -> None:
        increments = self._gate.take(scan.stamp)
        step = self._graph.wheels.step(increments)
        points = usable_end_points(scan.ranges, plain(self._beams), MATCH_RANGE)
        sides = sides_of(points, np.array(self._beams.mount[:2]))
        if len(self._graph) == 0:
            self._begin(step, points, sides)
        elif len(points) < LEAST_POINTS:
            self._graph.append(self._predicted(step), step, self._information(step))
        else:
            self._place(step, points, sides)
        self._remember(scan, step, points, sides)
        if self._loops.is_due(self._graph):
            closure = self._loops.close(self._graph, self._submaps, self._choose)
            if closure is not None:
                self._graph.tie(closure)
                self._optimise(4, is_closing=True)
        interval = max(OPTIMISE_INTERVAL, OPTIMISE_SHARE * len(self._graph))
        if len(self._graph) - self._graph.optimised >= interval:
            self._optimise(2)

    def _begin(self, step: WheelStep, points: FloatArray, sides: FloatArray) -> None:
        """Make the first node, on an older map if there is one."""
        if self._known is not None:
            surfaces, unknown = known_surfaces(self._known), np.zeros((3, 3))
            older = Chosen([known_submap(surfaces, self._start)], self._start[None])
            self._start = older.align(points, sides, self._start, self._start, unknown).pose
            self._submaps.append(known_submap(surfaces, self._start))
            self._closed.append(first=0, centre=self._submaps[0].centre)
        self._submaps.append(Submap(0, self._reach))
        self._graph.append(self._start, step, np.zeros((3, 3)))

    def _predicted(self, step: WheelStep) -> FloatArray:
        return moved_by(self._graph.poses[-1], self._graph.wheels.expected(step))

    def _information(self, step: WheelStep) -> FloatArray:
        """Information (3, 3) of the predicted pose, in the map frame."""
        return turned_matrix(self._graph.wheels.information(step), float(self._graph.poses[-1, 2]))

    def _place(self, step: WheelStep, points: FloatArray, sides: FloatArray) -> None:
        """Find where a scan was taken, and make it a node with its edges."""
        predicted, known = self._predicted(step), self._information(step)
        newest = list(range(max(0, len(self._submaps) - 2), len(self._submaps)))
        numbers = newest + self._overlapping(
            predicted, points, sides, newest[0], MOST_SUBMAPS - len(newest)
        )
        chosen = self._choose(numbers)
        placed = chosen.align(points, sides, predicted, predicted, known)
        if len(points) >= FEW_POINTS:
            placed = self._second_opinion(chosen, points, sides, predicted, known, placed)
        matches = self._matches(len(self._graph), numbers, placed)
        information = known
        for match in matches:
            heading = float(self._graph.poses[match.old, 2])
            information = information + turned_matrix(match.information, heading)
        self._graph.append(placed.pose, step, information)
        for match in matches:
            self._graph.tie(match, is_sure=match.old >= self._submaps[newest[0]].first)

    def _overlapping(
        self, pose: FloatArray, points: FloatArray, sides: FloatArray, count: int, most: int
    ) -> list[int]:
        """Those of the first ``count`` submaps whose surfaces a scan at a pose sees, the best first."""
        firsts, centres = self._closed["first"][:count], self._closed["centre"][:count]
        frames = self._graph.poses[firsts]
        cos, sin = np.cos(frames[:, 2]), np.sin(frames[:, 2])
        x = frames[:, 0] + cos * centres[:, 0] - sin * centres[:, 1]
        y = frames[:, 1] + sin * centres[:, 0] + cos * centres[:, 1]
        middle = moved_by(pose, np.array([*points.mean(axis=0), 0.0]))
        away = np.hypot(x - middle[0], y - middle[1])
        nearest = np.argsort(away, kind="stable")[:MOST_TRIED]
        known = [
            n
            for n in nearest[away[nearest] < self._reach].tolist()
            if self._graph.is_tied(int(firsts[n]))
        ]
        found: list[tuple[float, int]] = []
        for begin in range(0, len(known), MOST_SUBMAPS):
            some = known[begin : begin + MOST_SUBMAPS]
            shares = self._choose(some).hits(points, sides, pose, OVERLAP_STRIDE).tolist()
            found += [
                (-share, number)
                for share, number in zip(shares, some, strict=True)
                if share > OVERLAP
            ]
        return [number for _, number in sorted(found)[:most]]

    def _choose(self, numbers: list[int]) -> Chosen:
        """Submaps as they are now: drawn again where their scans have moved."""
        for number in numbers:
            submap = self._submaps[number]
            if submap.checked < self._graph.optimisations and not submap.is_older_map:
                submap.checked = self._graph.optimisations
                self._draw_again(submap)
        poses = self._graph.poses
        submaps = [self._submaps[number] for number in numbers]
        return Chosen(submaps, poses[[submap.first for submap in submaps]])

    def _draw_again(self, submap: Submap) -> None:
        """Draw a submap again if its scans have moved in its frame."""
        first, count = submap.first, len(submap.poses)
        poses = self._graph.poses[first : first + count]
        now = relative_poses(np.broadcast_to(poses[0], poses.shape), poses)
        if (
            float((np.abs(now - np.array(submap.poses)) * (1.0, 1.0, 2.0)).sum(axis=1).max())
            < STALE_METRES
        ):
            return
        submap.clear()
        for node, pose in enumerate(now, first):
            submap.add(pose, *self._scan(node))

    def _scan(self, node: int) -> tuple[FloatArray, FloatArray]:
        count = self._scans["counts"][node]
        return self._scans["points"][node, :count], self._scans["sides"][node, :count]

    def _second_opinion(
        self,
        chosen: Chosen,
        points: FloatArray,
        sides: FloatArray,
        predicted: FloatArray,
        known: FloatArray,
        placed: Placed,
    ) -> Placed:
        """Search round the predicted pose for a place that explains a scan better than where it was aligned."""
        if placed.fit >= GOOD_FIT:
            self._suspicion = 0.0
        covariance = inverted(known)
        spreads = math.sqrt(max(covariance[0, 0], covariance[1, 1])), math.sqrt(covariance[2, 2])
        reach = float(np.hypot(points[:, 0], points[:, 1]).max())
        last = self._graph.poses[-1]
        for centre, is_wide in ((predicted, False), (predicted, True), (last, True)):
            if placed.fit >= (POOR_FIT if is_wide else GOOD_FIT):
                break
            window, turn = (
                most if is_wide else min(max(DEVIATIONS * spread, fine), most)
                for spread, fine, most in zip(spreads, LEAST_WINDOW, LARGEST_WINDOW, strict=True)
            )
            start, score = centre, 1.0
            if (window, turn) != LEAST_WINDOW:  # else an alignment finds it by itself
                start, score = SearchWindow(chosen, centre, window, turn, reach).search(
                    points, sides, LEAST_SCORE
                )
            if score <= LEAST_SCORE:
                continue
            far = chosen.align(points, sides, start, predicted, 0.0 * known)
            x, y, angle = np.abs(far.pose - centre)
            strays = (
                max(x, y) > window + LEAST_WINDOW[0]
                or abs(wrap_angle(angle)) > turn + LEAST_WINDOW[1]
            )
            gain = (far.fit - placed.fit) * len(points) * POINT_NATS - SEARCH_NATS[is_wide]
            self._suspicion += max(gain, 0.0)
            lie = LIE_NATS if is_wide else max(LIE_NATS, SUSPICION - self._suspicion)
            if not strays and gain > min(0.5 * chi_squared(far.pose, predicted, known), lie):
                placed = far
                self._stats.recovered_matches += 1
        return placed

    def _matches(self, node: int, numbers: list[int], placed: Placed) -> list[Match]:
        """What each submap says of a node's place."""
        poses, bound, count = self._graph.poses, placed.bound, len(numbers)
        return [
            match_with(
                poses, self._submaps[number].first, node, placed.pose, bound.sums[index], count
            )
            for index, number in enumerate(numbers)
            if bound.hits[index] >= 2 * LEAST_POINTS
        ]

    def _remember(
        self, scan: LaserScan, step: WheelStep, points: FloatArray, sides: FloatArray
    ) -> None:
        """Keep the newest node's scan, and draw it into the newest submap."""
        node, count = len(self._graph) - 1, len(points)
        submap = self._submaps[-1]
        submap.size += float(np.hypot(step.moved[0], step.moved[1])) / SUBMAP_METRES
        submap.size += abs(float(step.moved[2])) / SUBMAP_RADIANS
        if submap.size > 1.0 and len(submap.poses) >= SUBMAP_SCANS:
            submap.close()
            self._compass.read(submap, self._graph)
            self._closed.append(first=submap.first, centre=submap.centre)
            self._submap_bytes += submap.grid.nbytes + submap.pieces.nbytes
            self._judge([len(self._submaps) - 1])
            submap = Submap(node, self._reach)
            self._submaps.append(submap)
        if self._stats.doubtful[-1:] == [self._stats.last_stamp]:
            self._stats.doubtful.append(scan.stamp)  # until this submap is judged, too
        submap.add(
            seen_from(self._graph.poses[submap.first], self._graph.poses[node]), points, sides
        )
        self._scans.append(stamps=scan.stamp, counts=count, ranges=scan.ranges)
        self._scans["points"][-1, :count], self._scans["sides"][-1, :count] = points, sides

    def _judge(self, numbers: Iterable[int]) -> None:
        """Say which scans are in doubt, after some submaps were held against those before."""
        for number in numbers:
            self._consistency.judge(number, self._submaps, self._graph, self._scans["ranges"])
        self._stats.doubtful, self._stats.broken = self._consistency.stamps(self._scans["stamps"])

    # --- the whole path ---

    def _optimise(self, iterations: int, is_closing: bool = False) -> None:
        anchors = sorted({submap.first for submap in self._submaps})
        self._graph.optimise(anchors, iterations, is_closing)

    def _draw_path(self) -> None:
        """Draw the scans that are new, and again those that have moved."""
        # On a lattice, so that the map follows from the path, however often it was drawn before.
        poses = np.round(self._graph.poses / DRAWN_LATTICE) * DRAWN_LATTICE
        drawn, ranges = len(self._drawn_poses), self._scans["ranges"]
        moved = np.flatnonzero((poses[:drawn] != self._drawn_poses).any(axis=1))
        self._map.draw(self._drawn_poses[moved], ranges[moved], sign=-1)
        again = np.concatenate([moved, np.arange(drawn, len(poses))])
        self._map.draw(poses[again], ranges[again])
        self._drawn_poses = poses
