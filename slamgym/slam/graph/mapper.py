"""Graph-based SLAM: the mode that closes loops globally, which GMapping can't.

Every processed scan is a node. It is matched with the scans before it, which gives an edge to its
predecessor; when the robot may have come back to a place, it is searched for among the old scans there, which
gives a loop closure. Least squares over all edges corrects the whole path at once, and the map is redrawn.
"""

import dataclasses
import time
from typing import Any

import numpy as np

from slamgym.core.geometry import compose, wrap_angle
from slamgym.core.types import FloatArray, IntArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.graph.loop_closure import (
    LOOP_EDGE_LENGTH,
    Closure,
    LoopCandidate,
    agree,
    find_candidates,
    graph_distances,
)
from slamgym.slam.graph.matching import NodeMatch, NodeMatcher
from slamgym.slam.graph.nodes import GraphNodes
from slamgym.slam.graph.solver import Edges, chi_squared, optimise
from slamgym.slam.hit_counts import HitCountMap
from slamgym.slam.mapper import GatedMapper
from slamgym.slam.motion_model import noise_array

MIN_POINTS = 20
"""A scan with fewer end points isn't matched."""
FIRST_WINDOW = (0.15, 0.05)
"""Smallest search window of a new scan round the odometry's prediction [m], [rad]."""
ODOMETRY_FLOOR = (0.02, 0.01)
"""Odometry is never trusted further than this [m], [rad]."""
NEIGHBOURS = 8
"""A loop is sought in the scans up to so many nodes before and after the candidate."""
URGENT_CHI2 = 20.0
"""A closure that disagrees more than this makes the graph be optimised at once ..."""
OPTIMISE_INTERVAL = 60
"""... the others wait for so many nodes."""
FALSE_CHI2 = 60.0
"""Closures that disagree more than this with the optimised graph are taken out at the end."""
FINAL_WINDOW = (0.4, 0.08)
"""Search window of the first final pass [m], [rad]."""
MOST_CANDIDATES = 2
"""Places that are compared with each scan."""


class PoseGraphMapper(GatedMapper):
    """Mode ``pose_graph``; see :class:`slamgym.slam.mapper.Mapper`."""

    def __init__(
        self, config: SlamConfig, geometry: LaserGeometry, initial_pose: Pose2D, rng: np.random.Generator
    ) -> None:
        del rng  # nothing is random here
        self._settings = config.pose_graph
        gate = dataclasses.replace(
            config,
            linear_update=self._settings.keyframe_distance,
            angular_update=self._settings.keyframe_turn,
            temporal_update=None,  # a node where nothing is new would only cost time
        )
        super().__init__(config, geometry, gate)
        self._matcher = NodeMatcher(self._settings)
        self._noise = noise_array(config.motion)
        self._nodes = GraphNodes(geometry.num_beams)
        self._initial_pose = initial_pose
        self._steps: list[Closure] = []  # edges between successive nodes
        self._closures: list[Closure] = []
        self._pending: list[Closure] = []
        self._rejected = 0
        self._last_optimised = 0
        self._stale = False
        self._drawn_poses: FloatArray = np.zeros((0, 3))
        self._covariance: FloatArray = np.zeros((3, 3))

    @property
    def pose(self) -> Pose2D:
        """The last node's pose, moved on by the odometry since."""
        last = Pose2D(*(float(v) for v in self._nodes.poses[-1])) if len(self._nodes) else self._initial_pose
        return compose(last, self._gate.since_processed)

    @property
    def covariance(self) -> FloatArray:
        """Of the last match, relative to the scans before it; see :class:`slamgym.slam.mapper.Mapper`."""
        return self._covariance

    def _num_bytes(self) -> int:
        return self._nodes.num_bytes

    def report(self) -> dict[str, Any]:
        """What this mode adds to a summary."""
        return {"loop_closures": len(self._closures), "loop_closures_rejected": self._rejected}

    def finish(self) -> None:
        """Match all nodes with their neighbours once more, now that their places are known, and optimise."""
        begin = time.process_time()
        self._optimise()
        for final in range(self._settings.final_passes):
            # The first pass still searches; after it the scans lie so close that alignment alone finds them.
            window = FINAL_WINDOW if final == 0 else (0.0, 0.0)
            self._closures = []
            steps = np.hypot(*np.diff(self._nodes.poses[:, :2], axis=0).T)
            driven = np.concatenate([[0.0], np.cumsum(steps)])
            for node in range(len(self._nodes)):
                for candidate in self._candidates(node, np.abs(driven - driven[node])):
                    closure = self._close(
                        node, LoopCandidate(candidate.node, *window), self._settings.final_fit
                    )
                    if closure is not None:
                        self._closures.append(closure)
            self._stale = True
            self._optimise(iterations=15, tolerance=1e-4)
            self._drop_false_closures()
        self._stats.cpu_seconds += time.process_time() - begin

    # --- one scan ---

    def _process(self, scan: LaserScan) -> None:
        increments = self._gate.take(scan.stamp)
        points = self._end_points(scan)
        if len(self._nodes) == 0:
            self._nodes.append(scan, np.array(self._initial_pose, dtype=np.float64), points)
        else:
            predicted, prior_info, window = self._predict(increments)
            self._nodes.append(scan, self._nodes.poses[-1], points)
            self._match_with_predecessors(predicted, prior_info, window)
            node = len(self._nodes) - 1
            if node % self._settings.loop_interval == 0:
                self._close_loops(node)
            if self._stale and node - self._last_optimised > OPTIMISE_INTERVAL:
                self._optimise()

    def _end_points(self, scan: LaserScan) -> FloatArray:
        b = self._beams
        usable = min(b.usable, self._settings.match_range, float(np.nextafter(b.range_max, 0.0)))
        points = np.empty((len(scan.ranges), 2))
        return points[: usable_end_points(scan.ranges, b, usable, points)]

    def _predict(self, increments: FloatArray) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
        """Motion since the last node by odometry: pose, information and three-sigma search window."""
        motion = Pose2D(0.0, 0.0, 0.0)
        for increment in increments:
            motion = compose(motion, Pose2D(*increment))
        distance = float(np.hypot(increments[:, 0], increments[:, 1]).sum())
        turn = float(np.abs(increments[:, 2]).sum())
        srr, srt, str_, stt = self._noise
        sigma = ODOMETRY_FLOOR[0] + srr * distance + str_ * turn
        sigma_turn = ODOMETRY_FLOOR[1] + srt * distance + stt * turn
        information = np.diag([sigma**-2, sigma**-2, sigma_turn**-2])
        window = (FIRST_WINDOW[0] + 2.0 * sigma, FIRST_WINDOW[1] + 2.0 * sigma_turn)
        return np.array(motion), information, window

    def _match_with_predecessors(
        self, predicted: FloatArray, prior_info: FloatArray, window: tuple[float, float]
    ) -> None:
        """Place the newest node by odometry and its match with the nodes before it; add the edge."""
        node = len(self._nodes) - 1
        members = np.arange(max(0, node - self._settings.local_nodes), node)
        match = self._match(node, node - 1, members, predicted, prior_info, *window, least=0.3)
        if match is None or match.fit < self._settings.minimum_fit:
            match = NodeMatch(predicted, prior_info, 0.0)
            self._stats.refused_matches += 1
        self._steps.append(Closure(node - 1, node, match.pose, match.information))
        self._nodes.poses[node] = _placed(self._nodes.poses[node - 1], match.pose)
        self._covariance = np.asarray(np.linalg.inv(match.information), dtype=np.float64)

    def _match(
        self, node: int, reference: int, members: IntArray, guess: FloatArray, prior_info: FloatArray,
        window: float, turn: float, least: float,
    ) -> NodeMatch | None:  # fmt: skip
        """Search a node's scan in a local map of ``members``, in the frame of ``reference``.

        A window of zero leaves the search out: the scan is aligned from the guess.
        """
        points = self._nodes.end_points(node)
        if len(points) < MIN_POINTS:
            return None
        relative = relative_poses(
            np.broadcast_to(self._nodes.poses[reference], (len(members), 3)), self._nodes.poses[members]
        )
        radius = float(np.hypot(points[:, 0], points[:, 1]).max()) + window
        local = self._matcher.local_map(
            self._nodes.points, self._nodes.counts, members, relative, guess, radius
        )
        start = guess
        if window > 0.0:
            start, score = self._matcher.search(local, points, guess, window, turn, least)
            if score <= least:
                return None
        return self._matcher.align(local, points, start, guess, prior_info)

    # --- loops ---

    def _candidates(self, node: int, distances: FloatArray) -> list[LoopCandidate]:
        return find_candidates(self._nodes.poses, node, distances, self._settings, MOST_CANDIDATES)

    def _close_loops(self, node: int) -> None:
        """Look for places seen before, in windows as large as the drift may be by now."""
        for candidate in self._candidates(node, self._distances(node)):
            closure = self._close(node, candidate, self._settings.loop_fit)
            if closure is None:
                continue
            if candidate.window <= self._settings.trusted_window:
                self._accept([closure])
                continue
            allies = [
                other for other in self._pending if agree(closure, other, self._nodes.poses, self._settings)
            ]
            self._pending.append(closure)
            if len(allies) >= self._settings.agreeing:
                self._accept([closure, *allies])
                self._pending.clear()

    def _close(self, node: int, candidate: LoopCandidate, least_fit: float) -> Closure | None:
        old = candidate.node
        low, high = max(0, old - NEIGHBOURS), min(len(self._nodes), old + NEIGHBOURS + 1)
        members = np.arange(low, high)
        members = members[np.abs(members - node) > self._settings.local_nodes]
        guess = relative_poses(self._nodes.poses[[old]], self._nodes.poses[[node]])[0]
        least = least_fit - 0.15  # the search's score is a little lower than the fit after alignment
        match = self._match(
            node, old, members, guess, np.zeros((3, 3)), candidate.window, candidate.turn, least
        )
        if match is None or match.fit < least_fit:
            return None
        return Closure(old, node, match.pose, match.information)

    def _accept(self, closures: list[Closure]) -> None:
        self._closures += closures
        self._stale = True
        urgent = chi_squared(self._nodes.poses, _edges([], closures)) > URGENT_CHI2
        if urgent.any() and len(self._nodes) - self._last_optimised > 5:
            self._optimise()

    def _distances(self, node: int) -> FloatArray:
        """Length of the shortest path to every node along successive nodes and closed loops [m]."""
        steps = np.hypot(*np.diff(self._nodes.poses[:, :2], axis=0).T) + 1e-3
        first = np.arange(len(steps))
        old = np.array([closure.old for closure in self._closures], dtype=np.int64)
        new = np.array([closure.new for closure in self._closures], dtype=np.int64)
        return graph_distances(
            np.concatenate([first, old]),
            np.concatenate([first + 1, new]),
            np.concatenate([steps, np.full(len(old), LOOP_EDGE_LENGTH)]),
            len(self._nodes),
            node,
        )

    def _optimise(self, iterations: int = 10, tolerance: float = 1e-3) -> None:
        self._last_optimised = len(self._nodes)
        if not self._stale:
            return
        self._stale = False
        self._grid = None
        edges = _edges(self._steps, self._closures)
        poses = self._nodes.poses
        width = float(chi_squared(poses, edges)[edges.robust].max(initial=0.0))
        # Graduated: what may pull shrinks from "anything" to the robust width, so that a large true
        # correction isn't taken for a false one.
        while width > self._settings.robust_width:
            poses = optimise(poses, edges, robust_width=width, iterations=8, tolerance=1e-3)
            width = min(width * 0.1, float(chi_squared(poses, edges)[edges.robust].max(initial=0.0)))
        self._nodes.poses[:] = optimise(
            poses, edges, robust_width=self._settings.robust_width, iterations=iterations, tolerance=tolerance
        )

    def _drop_false_closures(self) -> None:
        if not self._closures:
            return
        chi2 = chi_squared(self._nodes.poses, _edges([], self._closures))
        kept = [closure for closure, value in zip(self._closures, chi2, strict=True) if value < FALSE_CHI2]
        self._rejected += len(self._closures) - len(kept)
        self._closures = kept

    # --- the map ---

    def _draw_path(self) -> None:
        """Draw what is new; redraw everything if the path has moved."""
        known = len(self._drawn_poses)
        poses = self._nodes.poses
        if known and np.abs(poses[:known] - self._drawn_poses).max() > 1e-9:
            self._map = HitCountMap(self._beams, self._config)
            known = 0
        self._map.draw(poses[known:], self._nodes.ranges[known:])
        self._drawn_poses = poses.copy()

    def trajectory(self) -> Trajectory:
        """The nodes' poses after the latest optimisation."""
        return Trajectory(self._nodes.stamps.copy(), self._nodes.poses.copy())


def _edges(steps: list[Closure], closures: list[Closure]) -> Edges:
    together = [*steps, *closures]
    return Edges(
        first=np.array([edge.old for edge in together], dtype=np.int64),
        second=np.array([edge.new for edge in together], dtype=np.int64),
        measured=np.array([edge.measured for edge in together], dtype=np.float64).reshape(-1, 3),
        information=np.array([edge.information for edge in together], dtype=np.float64).reshape(-1, 3, 3),
        robust=np.arange(len(together)) >= len(steps),
    )


def _placed(reference: FloatArray, relative: FloatArray) -> FloatArray:
    """The pose that is seen as ``relative`` from ``reference``."""
    placed = compose(Pose2D(*reference), Pose2D(*relative))
    return np.array([placed.x, placed.y, wrap_angle(placed.theta)])
