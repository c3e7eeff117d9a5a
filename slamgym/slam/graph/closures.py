"""Loop closures: which old submaps may be seen again, and which closures the path allows."""

import math

import numpy as np

from slamgym.core.portable import inverted
from slamgym.core.types import Float32Array, FloatArray
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.graph.alignment import MOST_SUBMAPS, TargetOf
from slamgym.slam.graph.matching import SearchWindow
from slamgym.slam.graph.pose_graph import PoseGraph, drift_covariance
from slamgym.slam.graph.relative import (
    Match,
    chi_squared,
    match_with,
    moved_by,
    pose_spreads,
    seen_from,
)
from slamgym.slam.graph.sight import SEEN_FIT, Sight
from slamgym.slam.graph.submaps import OrientedPoints, Submap

LOOP_METRES = 1.0
"""A loop is sought after so much driving [m]."""
LOOP_RADIUS = 9.0
"""A loop is sought among submaps this near [m]."""
SEPARATION = 5
"""Places that are searched are at least so many submaps apart."""
MOST_LOOP_PLACES = 2
"""So many places are searched at most."""
CONTEXT = 3
"""Submaps on either side of a place in which the surfaces of the newest one are sought."""
FEW_SURFACES = 30
"""With fewer surfaces in the newest submap no loop is sought."""
CLOSURE_FIT = 0.5
"""Share of the newest submap's surfaces that must fit an old place, of those that were in sight of it: that fit, or
that a scan there saw through. With all of them the walls of a cluttered lab turn by 9 degrees, with this by 6. Chosen
on that lab alone; in the 60 cells of the zoo the mean error is 0.055 m instead of 0.060, in none 3 mm worse."""
SCORE_SHORTFALL = 0.15
"""A search's score is lower than the fit after alignment by this at most."""
LOOP_DEVIATIONS = 5.0
"""A search's window reaches so many standard deviations, and ``WINDOW_FLOOR``, from the pose by the graph."""
WINDOW_FLOOR = (0.15, 0.05)
"""Window of a search where the pose is known exactly [m], [rad]."""
LARGEST_LOOP_WINDOW = (6.0, 0.8)
"""Largest window of a search for a loop [m], [rad]."""
AMBIGUOUS_METRES = 0.3
"""A search that leads further than this must find no other place as good [m]."""
AMBIGUOUS_SCORE = 0.08
"""Another place is as good if its score falls so much short of the best one at most."""
USUAL_CHI2 = 4.0
"""A closure that disagrees more with the path, its uncertainty and ``WINDOW_FLOOR``, needs others that say the same.
With a laser cut to 4 m the path through the FHW museum is 0.42 to 0.76 m off by this rule and 1.18 m without; whole
logs stay as they are. An early form of the rule, for every closure, left the last one of ACES out."""
SECOND_CHI2 = 12.3
"""A closure may disagree so much more for each other old submap at which another closure says the same: the first one
takes it to the 0.999 quantile, 16.3. A path is surer of itself than it may be: through FHW to 12 m, closures that are
right to centimetres disagree by 20 to 90. Where only the first one counts, it is 1.3 m off, with this rule 0.15."""
AGREEING_METRES = 15.0
"""Two closures say something of each other if the ways between their ends are no longer [m]."""
AGREEING_CHI2 = 11.3
"""Two closures may disagree so much: the 0.99 quantile."""
MOST_REMEMBERED = 24
"""So many of the latest closures are held against a new one."""


class LoopCloser:
    """Seeks old submaps where the robot may be again.

    Args:
        settings: Of the mode.
        sight: Tells which points scans saw through.
        graph: The graph, which grows.
        submaps: All submaps, which become more.
        target_of: Makes some of them ready, by number.
    """

    def __init__(
        self,
        settings: PoseGraphConfig,
        sight: Sight,
        graph: PoseGraph,
        submaps: list[Submap],
        target_of: TargetOf,
    ) -> None:
        self._settings = settings
        self._sight = sight
        self._graph = graph
        self._submaps = submaps
        self._target_of = target_of
        self._last_sought = 0.0  # distance driven [m]
        self.found: list[Match] = []
        """The latest matches, accepted or not."""
        self.closed = 0
        """Matches that were accepted."""
        self.rejected = 0
        """Matches that were not accepted."""

    def is_due(self) -> bool:
        """Return True if the robot has moved far enough since a loop was last sought."""
        driven = self._graph.driven[-1]
        if self._graph.optimised == 0 or driven - self._last_sought < LOOP_METRES:
            return False
        self._last_sought = driven
        return True

    def close(self, ranges: Float32Array) -> Match | None:
        """Search the newest surfaces in old submaps.

        Args:
            ranges: (N, num_beams) of all scans [m].

        Returns:
            The first match that is accepted; None if none is.
        """
        poses = self._graph.poses
        newest = self._submaps[-1]
        seen = newest.lines().placed(seen_from(poses[-1], poses[newest.first]))
        if len(seen.points) < FEW_SURFACES:
            return None
        for number in self._places():
            closure = self._find(number, ranges, seen)
            if closure is None:
                continue
            is_accepted = self._is_accepted(closure)
            self.found = [*self.found[1 - MOST_REMEMBERED :], closure]
            if is_accepted:
                self.closed += 1
                return closure
            self.rejected += 1
        return None

    def _find(self, number: int, ranges: Float32Array, seen: OrientedPoints) -> Match | None:
        """Search surfaces round an old submap; None if they fit nowhere, or in two places alike."""
        graph = self._graph
        submaps = self._submaps
        here = graph.poses[-1]
        old = submaps[number].first
        deviations = LOOP_DEVIATIONS * pose_spreads(graph.relative_covariance(old))
        window = np.minimum(deviations + WINDOW_FLOOR, LARGEST_LOOP_WINDOW)
        first = max(0, number - CONTEXT)
        end = min(number + CONTEXT + 1, len(submaps) - 1)
        around = [other for other in range(first, end) if not graph.is_tied(submaps[other].first)]
        space = SearchWindow(self._target_of(around), here, window, seen.reach)
        least = CLOSURE_FIT - SCORE_SHORTFALL
        start, score = space.search(seen, least)
        if score <= least:
            return None
        nearest = sorted(around, key=lambda other: abs(other - number))
        nearest.sort(key=lambda other: -self._target_of([other]).hit_shares(seen, start)[0])
        best = nearest[:MOST_SUBMAPS]
        placed = self._target_of(best).align_freely(seen, start)
        fits = placed.fits.sum()
        strange = seen.points[placed.fits < SEEN_FIT]
        clashes = self._most_clashes(strange, placed.pose, best, ranges)
        if fits < CLOSURE_FIT * max(FEW_SURFACES, fits + clashes):
            return None
        dx, dy, _ = start - here
        if math.hypot(dx, dy) > AMBIGUOUS_METRES:
            nearly = score - AMBIGUOUS_SCORE
            _, other_score = space.search(seen, nearly, start)
            if other_score > nearly:
                return None
        sums = placed.total / len(best)
        return match_with(graph.poses, old, len(graph) - 1, placed.pose, sums, 1)

    def _most_clashes(
        self, strange: FloatArray, pose: FloatArray, numbers: list[int], ranges: Float32Array
    ) -> int:
        """The most points (n, 2), given in the frame of a pose (3,), through which one scan of some submaps saw."""
        chosen = [self._submaps[number] for number in numbers]
        nodes = [one.first + number for one in chosen for number in range(len(one.poses))]
        poses = self._graph.poses
        clashes = (self._sight.count(strange, pose, poses[node], ranges[node]) for node in nodes)
        return max(clashes, default=0)

    def _is_accepted(self, closure: Match) -> bool:
        """True if a closure is as the path lets expect, or less so and others say the same."""
        surprise = _surprise(self._graph, closure)
        if surprise < USUAL_CHI2:
            return True
        places = {other.old for other in self.found if agree(self._graph, closure, other)}
        return surprise < USUAL_CHI2 + SECOND_CHI2 * len(places)

    def _places(self) -> list[int]:
        """Submaps that may be seen again and whose place isn't known to within what an alignment finds."""
        graph = self._graph
        firsts = np.array([submap.first for submap in self._submaps])
        since = graph.driven[-1] - graph.driven[firsts]
        old = firsts[since > self._settings.loop_length]
        dx, dy, _ = (graph.poses[old] - graph.poses[-1]).T
        away = np.hypot(dx, dy)
        places: list[int] = []
        for number in np.argsort(away, kind="stable").tolist():
            if away[number] > LOOP_RADIUS or len(places) == MOST_LOOP_PLACES:
                break
            is_apart = all(abs(number - other) >= SEPARATION for other in places)
            if is_apart and not graph.is_tied(int(firsts[number])):
                places.append(number)
        return places


def _surprise(graph: PoseGraph, closure: Match) -> float:
    """Squared Mahalanobis distance of a closure from the path, as far as that is known."""
    measured = inverted(closure.information + np.eye(3))
    covariance = graph.relative_covariance(closure.old) + measured
    expected = seen_from(graph.poses[closure.old], graph.poses[closure.new])
    information = inverted(covariance + _floor())
    return chi_squared(closure.measured, expected, information)


def agree(graph: PoseGraph, closure: Match, other: Match) -> bool:
    """True if two closures correct the path alike (pairwise consistency; Mangelson et al., ICRA 2018).

    Each says where the node of the first closure lies in the frame of the other's old node. Only the short ways between
    their old and between their new nodes add to the uncertainty of that.
    """
    driven = graph.driven
    ways = (
        abs(driven[closure.new] - driven[other.new]),
        abs(driven[closure.old] - driven[other.old]),
    )
    if closure.new == other.new or max(ways) > AGREEING_METRES:
        return False
    poses = graph.poses
    between_old = seen_from(poses[other.old], poses[closure.old])
    between_new = seen_from(poses[other.new], poses[closure.new])
    by_closure = moved_by(between_old, closure.measured)
    by_other = moved_by(other.measured, between_new)
    information = inverted(drift_covariance(sum(ways)) + _floor())
    return chi_squared(by_closure, by_other, information) < AGREEING_CHI2


def _floor() -> FloatArray:
    """Covariance (3, 3) of what is known exactly: that of a search's smallest window."""
    metres, radians = WINDOW_FLOOR
    return np.diag(np.square([metres, metres, radians]))
