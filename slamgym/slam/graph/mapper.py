"""Graph-based SLAM: the mode that closes loops globally, which GMapping can't.

Every processed scan is a node. It is matched with the scans before it, which gives an edge to its
predecessor; when the robot may have come back to a place, it is searched for among the old scans there, which
gives a loop closure. Least squares over all edges corrects the whole path at once, and the map is redrawn.
"""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from slamgym.core.geometry import compose, wrap_angle
from slamgym.core.types import FloatArray, IntArray, LaserGeometry, LaserScan, Pose2D
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import farthest
from slamgym.slam.graph.loop_closure import (
    LOOP_EDGE_LENGTH,
    Closure,
    LoopCandidate,
    agree,
    find_candidates,
    graph_distances,
)
from slamgym.slam.graph.matching import NodeMatch, align_node, search
from slamgym.slam.graph.solver import Edges, chi_squared, optimise, turned_covariance
from slamgym.slam.graph.surface_map import make_local_map
from slamgym.slam.graph.wheels import WheelTurns
from slamgym.slam.motion_model import poses_between
from slamgym.slam.particle_filter import FEW_POINTS, MATCH_MARGIN, ParticleFilter
from slamgym.slam.uncertainty import ODOMETRY_FLOOR

MATCH_RANGE = 25.0
"""Longer returns are not matched with local maps, but drawn [m]."""
LOOP_INTERVAL = 2
"""A loop is sought at every so many nodes."""
LOOP_FIT, FINAL_FIT = 0.7, 0.5
"""A loop closure needs this share of fitting points, and the second at the end, when the places are known."""
TRUSTED_WINDOW, AGREEING = 0.6, 2
"""Within this uncertainty one match is enough; beyond it, a closure waits for so many others that agree [m]."""
ROBUST_WIDTH = 8.0
"""Chi-squared beyond which a loop closure loses its pull (dynamic covariance scaling)."""
EXPECTED_CHI2, AGREEING_CHI2 = 12.0, 25.0
"""A closure may disagree so much with the path and its uncertainty: one alone, and one of several that agree."""
CLOSURE_FLOOR = (0.05, 0.05, 0.03)
"""Tolerated difference between a closure and the path [m], [m], [rad]: not each slip of a wheel is noticed."""
AGREEING_METRES = 2.0
"""Closures that agree were found over so much driving: seen from one spot, a like room agrees with itself [m]."""
AMBIGUOUS_METRES, AMBIGUOUS_SCORE = 0.3, 0.08
"""A search that leads further than this must find no other place whose score is so near [m]."""
WIDE_WINDOW = (0.3, 0.15)
"""Least half width of the search for a scan that fits poorly [m], [rad]."""
BETTER_SHARE = 0.1
"""A search's result counts if the share of points that fit is larger by this than where the path says."""
MATCH_FLOOR = (0.01, 0.01, 0.003)
"""Nor is a match as an edge of the graph [m], [m], [rad]."""
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
SHORT_RANGE = 5.0
"""A laser that sees this far finds old walls with nearly every scan: its matches hardly drift, and the turns by
odometry would only add their errors [m]."""
MOST_CANDIDATES = 2
"""Places that are compared with each scan."""


class PoseGraphMapper(ParticleFilter):
    """Mode ``pose_graph``: a filter of one particle whose path and map are corrected by loop closures.

    See :class:`slamgym.slam.mapper.Mapper` for the methods.
    """

    def __init__(
        self, config: SlamConfig, geometry: LaserGeometry, initial_pose: Pose2D, rng: np.random.Generator
    ) -> None:
        super().__init__(config, geometry, initial_pose, rng)
        self._settings = config.pose_graph
        # Pose, end points and their number, and which processed scan each node is.
        self._nodes = Columns(
            {"counts": np.int64, "steps": np.int64}, poses=(3,), points=(geometry.num_beams, 2), counts=(), steps=()
        )  # fmt: skip
        self._steps: list[Closure] = []  # edges between successive nodes
        self._wheels = WheelTurns()
        self._closures: list[Closure] = []
        self._pending: list[Closure] = []
        self._rejected = 0
        self._last_optimised = 0
        self._stale = False

    def _num_bytes(self) -> int:
        return super()._num_bytes() + self._nodes.num_bytes

    def report(self) -> dict[str, Any]:
        """Entries that this mode adds to a summary."""
        return {"loop_closures": len(self._closures), "loop_closures_rejected": self._rejected}

    def finish(self) -> None:
        """Match all nodes with their neighbours once more, now that their places are known, and optimise."""
        begin = time.process_time()
        self._optimise()
        for final in range(self._settings.final_passes):
            # The first pass still searches; after it the scans lie so close that alignment alone finds them.
            window = FINAL_WINDOW if final == 0 else (0.0, 0.0)
            self._closures = []
            driven = np.concatenate([[0.0], np.cumsum(_lengths(self._places))])
            for node in range(len(self._nodes)):
                for candidate in self._candidates(node, np.abs(driven - driven[node])):
                    closure = self._close(node, LoopCandidate(candidate.node, *window), FINAL_FIT)
                    if closure is not None:
                        self._closures.append(closure)
            self._stale = True
            self._optimise(iterations=15, tolerance=1e-4)
            self._drop_false_closures()
        self._grid = None
        self._stats.cpu_seconds += time.process_time() - begin

    @property
    def _places(self) -> FloatArray:
        """Poses of the nodes (N, 3); they may be written to."""
        return self._nodes["poses"]

    def _seen_from(self, node: int, pose: FloatArray) -> FloatArray:
        """A pose (3,) in the frame of a node."""
        return relative_poses(self._places[[node]], pose[None])[0]

    # --- one scan ---

    def _predict(self, increments: FloatArray) -> tuple[float, float]:
        self._wheels.move(increments)
        return super()._predict(increments)

    def _resettle(
        self, increments: FloatArray, predicted: FloatArray, points: FloatArray, share: float
    ) -> float:
        """Search a wide window round the prediction for a scan that fits poorly where it was matched.

        Odometry may have lied: wheels that slip, a robot that was lifted, lost messages. Then its learned errors say
        nothing, and the window is that of GMapping's generous motion noise.
        """
        if len(self._nodes) == 0:
            return share
        distance = float(np.hypot(increments[:, 0], increments[:, 1]).sum())
        turn = float(np.abs(increments[:, 2]).sum())
        srr, srt, str_, stt = self._noise
        sigma, sigma_turn = srr * distance + str_ * turn, srt * distance + stt * turn
        window = (WIDE_WINDOW[0] + 2.0 * sigma, WIDE_WINDOW[1] + 2.0 * sigma_turn)
        last = len(self._nodes) - 1
        members = np.arange(max(0, last + 1 - self._settings.local_nodes), last + 1)
        guess = self._seen_from(last, predicted)
        prior = np.diag(1.0 / np.square([sigma + 0.05, sigma + 0.05, sigma_turn + 0.02]))
        match = self._match(points, last, members, guess, prior, *window, least=0.3)
        if match is None:
            return share
        placed = np.array(compose(Pose2D(*self._places[last]), Pose2D(*match.pose)))
        free = self._align_freely(placed, points)
        if free[3] / len(points) < share + BETTER_SHARE:
            return share
        self._poses[0] = free[:3]
        self._stats.recovered_matches += 1
        return float(free[3] / len(points))

    def _add_node(self, scan: LaserScan, pose: FloatArray) -> None:
        """Make the scan just processed a node, bound to the one before by matching and by odometry."""
        node = len(self._nodes)
        if node > 0:
            variances = self._uncertainty.variances
            information = np.diag(1.0 / (variances[[0, 0, 1]] + np.square(ODOMETRY_FLOOR)))
            if self._match_covariance is not None:
                covariance = turned_covariance(self._match_covariance, -float(self._places[-1, 2]))
                information = information + np.linalg.inv(covariance + np.diag(np.square(MATCH_FLOOR)))
            self._steps.append(Closure(node - 1, node, self._seen_from(node - 1, pose), information))
        self._wheels.append()
        points = self._usable_points(scan.ranges, MATCH_RANGE)
        self._nodes.append(poses=pose, counts=len(points), steps=len(self._tree) - 1)
        self._nodes["points"][-1, : len(points)] = points
        self._uncertainty.append(pose, self._match_covariance)
        if node % LOOP_INTERVAL == 0:
            self._close_loops(node)
        if self._stale and node - self._last_optimised > OPTIMISE_INTERVAL:
            self._optimise()

    def _match(
        self,
        points: FloatArray,
        reference: int,
        members: IntArray,
        guess: FloatArray,
        prior_info: FloatArray,
        window: float,
        turn: float,
        least: float,
    ) -> NodeMatch | None:
        """Search a scan's end points in a local map of ``members``, in the frame of ``reference``.

        A window of zero skips the search: the scan is aligned from the guess. So it is where the search finds
        nothing that fits clearly better. None if two places fit alike.
        """
        if len(points) < FEW_POINTS:
            return None
        poses = self._places
        relative = relative_poses(np.broadcast_to(poses[reference], (len(members), 3)), poses[members])
        radius = float(np.hypot(points[:, 0], points[:, 1]).max()) + window
        local = make_local_map(self._nodes["points"], self._nodes["counts"], members, relative, guess, radius)
        near = align_node(local, points, guess, guess, prior_info)
        if window == 0.0:
            return near
        start, score = search(local, points, guess, window, turn, least)
        if score <= least:
            return near
        far = align_node(local, points, start, guess, prior_info)
        if far.fit < near.fit + BETTER_SHARE:
            return near
        if np.hypot(*(start - guess)[:2]) > AMBIGUOUS_METRES:
            nearly = score - AMBIGUOUS_SCORE
            _, second = search(local, points, guess, window, turn, nearly, start)
            if second > nearly:
                return None
        return far

    # --- loops ---

    def _candidates(self, node: int, distances: FloatArray) -> list[LoopCandidate]:
        return find_candidates(self._places, node, distances, self._settings, MOST_CANDIDATES)

    def _close_loops(self, node: int) -> None:
        """Look for places seen before, in windows as large as the drift may be by now."""
        for candidate in self._candidates(node, self._distances(node)):
            closure = self._close(node, candidate, LOOP_FIT)
            if closure is None:
                continue
            chi2 = self._disagreement(closure)
            if chi2 > AGREEING_CHI2:
                self._rejected += 1
                continue
            if candidate.window <= TRUSTED_WINDOW and chi2 < EXPECTED_CHI2:
                self._accept([closure])
                continue
            allies = [other for other in self._pending if agree(closure, other, self._places)]
            self._pending.append(closure)
            if len(allies) >= AGREEING and self._driven_since(allies) >= AGREEING_METRES:
                self._accept([closure, *allies])
                self._pending.clear()

    def _ties(self) -> Iterator[tuple[int, int, FloatArray]]:
        """The closures with their covariances in the map frame."""
        for closure in self._closures:
            covariance = np.linalg.inv(closure.information + np.eye(3)) + np.diag(np.square(MATCH_FLOOR))
            yield closure.old, closure.new, turned_covariance(covariance, float(self._places[closure.old, 2]))

    def _driven_since(self, closures: list[Closure]) -> float:
        """Distance that the robot drove since the first of some closures was found [m]."""
        first = min(closure.new for closure in closures)
        return float(_lengths(self._places[first:]).sum())

    def _disagreement(self, closure: Closure) -> float:
        """Chi-squared of a closure with the newest node, given how far off the path may be."""
        error = closure.measured - self._seen_from(closure.old, self._places[closure.new])
        error[2] = wrap_angle(error[2])
        between = self._uncertainty.between(closure.old, closure.new)
        covariance = turned_covariance(between, -float(self._places[closure.old, 2]))
        covariance += np.linalg.inv(closure.information + np.eye(3)) + np.diag(np.square(CLOSURE_FLOOR))
        return float(error @ np.linalg.solve(covariance, error))

    def _close(self, node: int, candidate: LoopCandidate, least_fit: float) -> Closure | None:
        old = candidate.node
        low, high = max(0, old - NEIGHBOURS), min(len(self._nodes), old + NEIGHBOURS + 1)
        members = np.arange(low, high)
        members = members[np.abs(members - node) > self._settings.local_nodes]
        guess = self._seen_from(old, self._places[node])
        points = self._nodes["points"][node, : self._nodes["counts"][node]]
        least = least_fit - 0.15  # the search's score is a little lower than the fit after alignment
        match = self._match(points, old, members, guess, np.zeros((3, 3)), *candidate[1:], least)
        if match is None or match.fit < least_fit:
            return None
        return Closure(old, node, match.pose, match.information)

    def _accept(self, closures: list[Closure]) -> None:
        self._closures += closures
        self._stale = True
        self._uncertainty.follow(self._places, self._ties())
        urgent = chi_squared(self._places, _edges([], closures)) > URGENT_CHI2
        if urgent.any() and len(self._nodes) - self._last_optimised > 5:
            self._optimise()

    def _distances(self, node: int) -> FloatArray:
        """Length of the shortest path to every node along successive nodes and closed loops [m]."""
        steps = _lengths(self._places) + 1e-3
        first = np.arange(len(steps))
        ends = np.array([closure[:2] for closure in self._closures], dtype=np.int64).reshape(-1, 2)
        first, second = np.vstack([np.column_stack([first, first + 1]), ends]).T
        lengths = np.concatenate([steps, np.full(len(ends), LOOP_EDGE_LENGTH)])
        return graph_distances(first, second, lengths, len(self._nodes), node)

    def _optimise(self, iterations: int = 10, tolerance: float = 1e-3) -> None:
        self._last_optimised = len(self._nodes)
        if not self._stale:
            return
        self._stale = False
        edges = _edges([*self._steps, *self._wheel_edges()], self._closures)
        poses = self._places
        width = float(chi_squared(poses, edges)[edges.robust].max(initial=0.0))
        # Graduated: what may pull shrinks from "anything" to the robust width, so that a large true
        # correction isn't taken for a false one.
        while width > ROBUST_WIDTH:
            poses = optimise(poses, edges, width, 8, 1e-3)
            width = min(width * 0.1, float(chi_squared(poses, edges)[edges.robust].max(initial=0.0)))
        self._relocate(optimise(poses, edges, ROBUST_WIDTH, iterations, tolerance))

    def _wheel_edges(self) -> list[Closure]:
        """Turns between nodes by the odometry as the whole path shows it; none where they'd be no help."""
        if self._calibration is None or self._beams.usable >= SHORT_RANGE or not self._steps:
            return []
        matched = np.array([edge.measured[2] for edge in self._steps])
        variances = np.linalg.inv(np.array([edge.information for edge in self._steps]))[:, 2, 2]
        turns, information = self._wheels.between(self._places, matched, variances)
        return [
            Closure(node, node + 1, np.array([0.0, 0.0, turn]), np.diag([0.0, 0.0, known]))
            for node, (turn, known) in enumerate(zip(turns.tolist(), information.tolist(), strict=True))
        ]

    def _drop_false_closures(self) -> None:
        chi2 = chi_squared(self._places, _edges([], self._closures))
        kept = [closure for closure, value in zip(self._closures, chi2, strict=True) if value < FALSE_CHI2]
        self._rejected += len(self._closures) - len(kept)
        self._closures = kept

    # --- path and map ---

    def _relocate(self, poses: FloatArray) -> None:
        """Move the nodes to ``poses``, the scans between them along, and make the map again from there."""
        old = self._tree.poses_along(np.zeros(len(self._tree), dtype=np.int64))
        self._places[:] = poses
        self._uncertainty.follow(self._places, self._ties())
        corrected = poses_between(poses, self._nodes["steps"], old)
        self._tree["poses"][:, 0] = corrected
        self._poses[0] = corrected[-1]
        self._new_particle_maps()
        for step, ranges in enumerate(self._tree["ranges"]):
            points = self._usable_points(ranges)
            self._maps.cover(corrected[step : step + 1], farthest(points) + MATCH_MARGIN)
            self._maps.register(corrected[step : step + 1], points)
        self._new_map()
        self._lineage = np.zeros(0, dtype=np.int64)
        self._drawn_poses = np.zeros((0, 3))
        self._grid = None


def _lengths(poses: FloatArray) -> FloatArray:
    """Distances between successive poses (N, 3), (N - 1,) [m]."""
    return np.asarray(np.hypot(*np.diff(poses[:, :2], axis=0).T), dtype=np.float64)


def _edges(steps: list[Closure], closures: list[Closure]) -> Edges:
    together = [*steps, *closures]
    return Edges(
        first=np.array([edge.old for edge in together], dtype=np.int64),
        second=np.array([edge.new for edge in together], dtype=np.int64),
        measured=np.array([edge.measured for edge in together], dtype=np.float64).reshape(-1, 3),
        information=np.array([edge.information for edge in together], dtype=np.float64).reshape(-1, 3, 3),
        robust=np.arange(len(together)) >= len(steps),
    )
