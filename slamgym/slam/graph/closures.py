"""Loop closures: which old submaps may be seen again, and which closures agree with each other."""

import math
from collections.abc import Callable

import numpy as np

from slamgym.core.geometry import transform_points
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.graph.alignment import MOST_SUBMAPS, Chosen
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import Match, chi_squared, match_with, moved_by, seen_from
from slamgym.slam.graph.submaps import Submap

LOOP_METRES = 1.0
"""A loop is sought after so much driving [m]."""
LOOP_RADIUS = 9.0
"""... among submaps this near [m]."""
SEPARATION, MOST_PLACES = 5, 2
"""Places are so many submaps apart, and so many are searched."""
CONTEXT = 3
"""Submaps on either side of a place in which the surfaces of the newest one are sought."""
FEW_SURFACES = 30
CLOSURE_FIT, SCORE_SHORTFALL = 0.5, 0.15
"""Share of the surfaces that must fit; a search's score is a little lower than the fit after alignment."""
LOOP_DEVIATIONS, WINDOW_FLOOR, LARGEST_WINDOW = 5.0, (0.15, 0.05), (6.0, 0.8)
"""Window of a search in deviations, what is added to it, and its bound [m], [rad]."""
AMBIGUOUS_METRES, AMBIGUOUS_SCORE = 0.3, 0.08
"""A search that leads further than this must find no other place whose score is so near [m]."""
EXPECTED_CHI2 = 12.0
"""A closure may disagree so much with the path and its uncertainty; several that agree may lie anywhere in the window.
Where those up to 60 were taken, false ones closed a loop in 2 of 12 offices with rows of like rooms, now in 1."""
ALLIES, ALLIED_METRES = 2, 2.0
"""Others that agree, and driving since the first of them [m]: seen from one spot, a like room agrees with itself."""
CLOSURE_FLOOR = (0.03, 0.02)
"""Tolerated difference between a closure and the path [m], [rad]."""
AGREEING, AGREEING_TURN = 0.1, 0.03
"""Two closures may differ by so much of the way driven between them [m/m], [rad/m] ..."""
AGREEING_FLOOR = (0.25, 0.1)
"""... and so much [m], [rad]."""


def agree(a: Match, b: Match, poses: FloatArray) -> bool:
    """Return True if two closures agree, given the motion between their ends (Mangelson et al. 2018).

    The path old_a -> new_a -> new_b -> old_b -> old_a must lead back to where it began, up to the drift of the
    two stretches driven.
    """
    old, new = seen_from(poses[a.old], poses[b.old]), seen_from(poses[a.new], poses[b.new])
    error = seen_from(old, moved_by(moved_by(a.measured, new), seen_from(b.measured, np.zeros(3))))
    way = math.hypot(old[0], old[1]) + math.hypot(new[0], new[1])
    near = math.hypot(error[0], error[1]) < AGREEING_FLOOR[0] + AGREEING * way
    return near and abs(error[2]) < AGREEING_FLOOR[1] + AGREEING_TURN * way


class LoopCloser:
    """Seeks old submaps where the robot may be again, and holds what it found until others agree.

    Args:
        settings: Of the mode.
    """

    def __init__(self, settings: PoseGraphConfig) -> None:
        self._settings = settings
        self._pending: list[Match] = []
        self._last_sought = 0.0  # distance driven [m]
        self.closed = self.rejected = 0
        """Matches that were accepted, and that were not."""

    def is_due(self, graph: PoseGraph) -> bool:
        """Return True if the robot has moved far enough since a loop was last sought."""
        if graph.optimised == 0 or graph.driven[-1] - self._last_sought < LOOP_METRES:
            return False
        self._last_sought = float(graph.driven[-1])
        return True

    def close(
        self, graph: PoseGraph, submaps: list[Submap], choose: Callable[[list[int]], Chosen]
    ) -> list[Match]:
        """Search the newest surfaces in old submaps.

        Args:
            graph: The graph.
            submaps: All submaps.
            choose: Makes some of them ready, by number.

        Returns:
            Matches that are accepted now; none or one, and those that it agrees with.
        """
        points, sides = _newest_surfaces(graph, submaps[-1])
        if len(points) < FEW_SURFACES:
            return []
        for number in self._places(graph, submaps):
            closure = self._find(graph, submaps, number, choose, points, sides)
            if closure is None:
                continue
            is_expected = _disagreement(graph, closure, CLOSURE_FLOOR) < EXPECTED_CHI2
            if not is_expected and _disagreement(graph, closure, WINDOW_FLOOR) > LOOP_DEVIATIONS**2:
                self.rejected += 1
                continue
            allies = [other for other in self._pending if agree(closure, other, graph.poses)]
            if is_expected:
                allies = []
            elif len(allies) < ALLIES or graph.driven[-1] - graph.driven[allies[0].new] < ALLIED_METRES:
                self._pending.append(closure)
                continue
            else:
                self._pending = []
            self.closed += 1 + len(allies)
            return [*allies, closure]
        return []

    def _places(self, graph: PoseGraph, submaps: list[Submap]) -> list[int]:
        """Submaps that may be seen again and whose place isn't known to within what an alignment finds."""
        firsts = np.array([submap.first for submap in submaps])
        old = firsts[graph.driven[-1] - graph.driven[firsts] > self._settings.loop_length]
        away = np.hypot(*(graph.poses[old, :2] - graph.poses[-1, :2]).T)
        chosen: list[int] = []
        for number in np.argsort(away, kind="stable").tolist():
            is_beside = any(abs(number - other) < SEPARATION for other in chosen)
            is_far = away[number] > LOOP_RADIUS or submaps[number].is_older_map
            if is_far or is_beside or graph.is_tied(submaps[number].first):
                continue
            chosen.append(number)
            if len(chosen) == MOST_PLACES:
                break
        return chosen

    def _find(
        self,
        graph: PoseGraph,
        submaps: list[Submap],
        number: int,
        choose: Callable[[list[int]], Chosen],
        points: FloatArray,
        sides: FloatArray,
    ) -> Match | None:
        """Search surfaces (n, 2) round an old submap; None if they fit nowhere, or in two places alike."""
        here, old = graph.poses[-1], submaps[number].first
        covariance = graph.relative_covariance(old)
        spreads = math.sqrt(max(covariance[0, 0], covariance[1, 1])), math.sqrt(covariance[2, 2])
        window, turn = (
            min(LOOP_DEVIATIONS * spread + floor, most)
            for spread, floor, most in zip(spreads, WINDOW_FLOOR, LARGEST_WINDOW, strict=True)
        )
        last = len(submaps) - 2
        around = [
            other
            for other in range(max(0, number - CONTEXT), min(number + CONTEXT, last) + 1)
            if not graph.is_tied(submaps[other].first)
        ]
        reach = float(np.hypot(points[:, 0], points[:, 1]).max())
        space, least = SearchWindow(choose(around), here, window, turn, reach), CLOSURE_FIT - SCORE_SHORTFALL
        start, score = space.search(points, sides, least)
        if score <= least:
            return None
        nearest = sorted(around, key=lambda other: abs(other - number))
        shares = [choose([other]).hits(points, sides, start, 1)[0] for other in nearest]
        nearest = [nearest[index] for index in np.argsort(-np.array(shares), kind="stable")[:MOST_SUBMAPS]]
        pose, bound, fit = choose(nearest).align(points, sides, start, start, np.zeros((3, 3)))
        if fit < CLOSURE_FIT:
            return None
        is_far, nearly = math.hypot(*(start - here)[:2]) > AMBIGUOUS_METRES, score - AMBIGUOUS_SCORE
        if is_far and space.search(points, sides, nearly, start)[1] > nearly:
            return None
        return match_with(graph.poses, old, len(graph) - 1, pose, bound.sums.sum(axis=0) / len(nearest), 1)


def _newest_surfaces(graph: PoseGraph, submap: Submap) -> tuple[FloatArray, FloatArray]:
    """Surfaces (n, 2) of the newest submap in the robot frame, and their sides (n, 3)."""
    x, y, turn = seen_from(graph.poses[-1], graph.poses[submap.first]).tolist()
    means, sides = submap.lines()
    turned = transform_points(Pose2D(0.0, 0.0, turn), sides[:, :2])
    return transform_points(Pose2D(x, y, turn), means), np.column_stack([turned, sides[:, 2]])


def _disagreement(graph: PoseGraph, closure: Match, floor: tuple[float, float]) -> float:
    """Chi-squared of a closure with the newest node, given how far off the path may be, and a floor [m], [rad]."""
    covariance = graph.relative_covariance(closure.old) + np.diag(np.square([floor[0], *floor]))
    known = inverted(covariance + inverted(closure.information + np.eye(3)))
    return chi_squared(closure.measured, seen_from(graph.poses[closure.old], graph.poses[closure.new]), known)
