"""Loop closures: which old submaps may be seen again, and which closures the path allows."""

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
from slamgym.slam.graph.relative import Match, chi_squared, match_with, seen_from
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
EXPECTED_CHI2 = 16.3
"""A closure may disagree so much with the path, its uncertainty and ``WINDOW_FLOOR``: the 0.999 quantile. In 13 drives
through offices and schools without the compass 2 of 104 true ones had more, and 7 of 8 false ones."""


class LoopCloser:
    """Seeks old submaps where the robot may be again.

    Args:
        settings: Of the mode.
    """

    def __init__(self, settings: PoseGraphConfig) -> None:
        self._settings = settings
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
    ) -> Match | None:
        """Search the newest surfaces in old submaps.

        Args:
            graph: The graph.
            submaps: All submaps.
            choose: Makes some of them ready, by number.

        Returns:
            The first match that is accepted; None if none is.
        """
        points, sides = _newest_surfaces(graph, submaps[-1])
        if len(points) < FEW_SURFACES:
            return None
        for number in self._places(graph, submaps):
            closure = self._find(graph, submaps, number, choose, points, sides)
            if closure is None:
                continue
            floor = np.diag(np.square([WINDOW_FLOOR[0], *WINDOW_FLOOR]))
            covariance = graph.relative_covariance(closure.old) + inverted(
                closure.information + np.eye(3)
            )
            expected = seen_from(graph.poses[closure.old], graph.poses[closure.new])
            if (
                chi_squared(closure.measured, expected, inverted(covariance + floor))
                < EXPECTED_CHI2
            ):
                self.closed += 1
                return closure
            self.rejected += 1
        return None

    def _places(self, graph: PoseGraph, submaps: list[Submap]) -> list[int]:
        """Submaps that may be seen again and whose place isn't known to within what an alignment finds."""
        firsts = np.array([submap.first for submap in submaps])
        old = firsts[graph.driven[-1] - graph.driven[firsts] > self._settings.loop_length]
        away = np.hypot(*(graph.poses[old, :2] - graph.poses[-1, :2]).T)
        chosen: list[int] = []
        for number in np.argsort(away, kind="stable")[
            : np.count_nonzero(away <= LOOP_RADIUS)
        ].tolist():
            is_out = submaps[number].is_older_map or any(
                abs(number - other) < SEPARATION for other in chosen
            )
            if len(chosen) < MOST_PLACES and not (is_out or graph.is_tied(submaps[number].first)):
                chosen.append(number)
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
        around = [
            other
            for other in range(
                max(0, number - CONTEXT), min(number + CONTEXT + 1, len(submaps) - 1)
            )
            if not graph.is_tied(submaps[other].first)
        ]
        reach = float(np.hypot(points[:, 0], points[:, 1]).max())
        space, least = (
            SearchWindow(choose(around), here, window, turn, reach),
            CLOSURE_FIT - SCORE_SHORTFALL,
        )
        start, score = space.search(points, sides, least)
        if score <= least:
            return None
        nearest = sorted(around, key=lambda other: abs(other - number))
        shares = [choose([other]).hits(points, sides, start, 1)[0] for other in nearest]
        nearest = [
            nearest[index] for index in np.argsort(-np.array(shares), kind="stable")[:MOST_SUBMAPS]
        ]
        pose, bound, fit = choose(nearest).align(points, sides, start, start, np.zeros((3, 3)))
        if fit < CLOSURE_FIT:
            return None
        is_far, nearly = math.hypot(*(start - here)[:2]) > AMBIGUOUS_METRES, score - AMBIGUOUS_SCORE
        if is_far and space.search(points, sides, nearly, start)[1] > nearly:
            return None
        return match_with(
            graph.poses, old, len(graph) - 1, pose, bound.sums.sum(axis=0) / len(nearest), 1
        )


def _newest_surfaces(graph: PoseGraph, submap: Submap) -> tuple[FloatArray, FloatArray]:
    """Surfaces (n, 2) of the newest submap in the robot frame, and their sides (n, 3)."""
    x, y, turn = seen_from(graph.poses[-1], graph.poses[submap.first]).tolist()
    means, sides = submap.lines()
    turned = transform_points(Pose2D(0.0, 0.0, turn), sides[:, :2])
    return transform_points(Pose2D(x, y, turn), means), np.column_stack([turned, sides[:, 2]])
