"""The hand-written rules: each scores the frontiers that the exploration loop offers.

A rule is a frozen dataclass of its settings that maps an :class:`~slamgym.planning.exploration_loop.ExplorationLoop`
to one score for each of its candidates; the robot drives to the one with the highest score.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.types import BoolArray, FloatArray
from slamgym.envs.frontier_features import candidate_places, candidate_tour_lengths
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.frontiers import expected_gains, view_gain
from slamgym.planning.grid_path import CoarsePaths
from slamgym.planning.open_tour import open_tour

EXPLORE_LITE_LOOP = ExplorationLoopConfig(
    max_candidates=1000,
    horizon=1.0 / 0.33,
    min_frontier_size=0.75,
    last_frontier_size=0.6,
    split_extent=math.inf,
)
"""Differences of Explore Lite: all frontiers whole, those under 0.75 m left out (``min_frontier_size`` of its
launch file; here those from 0.6 m are left for the end), and the goal reconsidered at 0.33 Hz (``planner_frequency``).

Its time-out of 30 s (``progress_timeout``; straight distances alone in the source) and its blacklist of 5 cells
(``goalOnBlacklist``) are those of the loop. What it lacks, recovery behaviours and a goal that is kept once the map has
stalled, comes from the loop too.
"""


TOUR_LOOP = ExplorationLoopConfig(max_candidates=1000)
"""A tour leads through all frontiers. The ends of one through the nearest 16 change as the robot moves, and it turns
about: in an office of 1,445 m2 ``rl`` took 8,326 s with them, 3,504 s with all."""

WIDE_TOUR_LOOP = replace(TOUR_LOOP, min_frontier_size=0.6, last_frontier_size=0.6)
"""A tour through what has room for the robot, 0.44 m, and some spare: the simplest way to pass over frontiers that hide
little, beside which every learned one has to show its worth. It keeps the promise in 32 of 32 homes."""

BESIDE_MATE = 0.3
"""A robot that others see stands on the map as something of this radius, with what they keep from it [m]."""
_TRUSTED_RANGE = 3.0
"""Range up to which the scanner is trusted when a gain is predicted [m]; the usable range of the mapper."""


@dataclass(frozen=True)
class ExploreLite:
    """Near and large, as the ROS package of that name; defaults are those of its launch file.

    J. Hörner, "Map-merging for multi-robot system", 2016; wiki.ros.org/explore_lite. Three weaknesses that its users
    report are fixed by the loop: the search climbs over the cost of inflated doorways, it doesn't pass gaps that are
    too narrow for the robot, and a frontier whose centroid is where the robot stands is visited at one of its cells.
    """

    potential_scale: float = 3.0
    """Weight of the straight distance to a frontier."""
    gain_scale: float = 1.0
    """Weight of the size of a frontier."""

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        resolution = loop.context.frame.resolution
        distances = np.array([one.frontier.min_distance for one in loop.candidates])
        sizes = np.array([one.frontier.size for one in loop.candidates]) * resolution
        # Explore Lite multiplies distances in metres by the cell size once more.
        cost = self.potential_scale * distances * resolution
        return self.gain_scale * sizes - cost


@dataclass(frozen=True)
class Nearest:
    """The shortest path first (Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997)."""

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        return -path_lengths(loop)


@dataclass(frozen=True)
class CostUtility:
    """The unknown area in sight of a frontier against the cost of the path there, for one robot.

    Burgard et al., "Coordinated multi-robot exploration", T-RO 2005. Their utility of a frontier falls with what
    other robots will see there; for one robot it would be the same everywhere. Here it is the share of the scanner's
    disc about the frontier that is unknown and in sight.
    """

    cost_weight: float = 0.06
    """Beta: what a metre of path takes from the utility, which lies between 0 and 1 [1/m]."""

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        costmap = loop.navigator.costmap
        assert costmap is not None
        max_range = loop.context.geometry.range_max
        middles = [one.frontier.middle for one in loop.candidates]
        areas = expected_gains(costmap, middles, max_range)
        utilities = areas / (math.pi * max_range**2)
        costs = np.array([one.path_cost for one in loop.candidates])
        return utilities - self.cost_weight * costs


@dataclass(frozen=True)
class NextBestView:
    """The largest information gain for its path: A(q) exp(-lambda L(q)).

    Eq. (2) of Gonzalez-Banos and Latombe, "Navigation strategies for exploring indoor environments", IJRR 21(10-11),
    2002. A is the unknown area within the scanner's usable range and field that may be seen from where the path to
    the frontier ends, L the length of that path.
    """

    path_weight: float = 0.5
    """Lambda: how fast the worth of a view falls with the path [1/m]; 0.2 in the paper, which is for rooms and
    ranges three times as large."""

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        costmap = loop.navigator.costmap
        assert costmap is not None
        laser = loop.context.geometry
        scores = []
        for x, y in candidate_places(loop).tolist():
            gain = view_gain(costmap, (x, y), _TRUSTED_RANGE, laser)
            # The logarithm orders alike, and distinguishes far views that the exponential rounds to 0.
            scores.append(math.log(max(gain, 1e-3)))
        return np.array(scores) - self.path_weight * path_lengths(loop)


@dataclass(frozen=True)
class FrontierTour:
    """The first frontier of the shortest open tour through all, a travelling salesman's.

    It keeps the robot from leaving small frontiers behind that it would have to come back for (Kulich, Faigl and
    Preucil, "On distance utility in the exploration task", ICRA 2011).
    """

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        return tour_scores(loop, np.ones(len(loop.candidates), np.bool_))


@dataclass(frozen=True)
class Auction:
    """Robots that hear each other bid their ways to frontiers, the lowest bid of all first; each wins one.

    Sequential single-item auctions (Zlot et al., "Multi-robot exploration controlled by a market economy", ICRA 2002).
    A robot alone is :class:`Nearest`.
    """

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Score the loop's candidates, shape (N,)."""
        return auctioned(path_lengths(loop), mate_lengths(loop))


def auctioned(own: FloatArray, mates: FloatArray) -> FloatArray:
    """Scores (N,) of places by path lengths (N,) [m] to them: 1 for what is won, else the nearest first.

    Mates bid theirs, shape (K, N) [m].
    """
    bids = np.vstack([own, mates])
    scores = -own
    for _ in range(min(bids.shape)):
        bidder, place = divmod(int(np.argmin(bids)), len(own))
        if bidder == 0:
            scores[place] = 1.0
            break
        bids[bidder] = np.inf
        bids[:, place] = np.inf
    return scores


def tour_scores(loop: ExplorationLoop, wanted: BoolArray) -> FloatArray:
    """Ranks in the shortest open tour through the wanted candidates, or through all if none is wanted.

    Robots that hear each other share them out, see :func:`shared_out`.

    Args:
        loop: The exploration.
        wanted: Which candidates are to be visited, shape (N,).

    Returns:
        At most 1, and -inf for candidates that are left out, shape (N,).
    """
    visited = wanted | ~wanted.any()
    scores: FloatArray = np.full(len(wanted), -np.inf)
    if len(loop.belief.mates) > 0:
        scores[visited] = shared_out(path_lengths(loop)[visited], mate_lengths(loop)[:, visited])
        return scores
    stops = np.flatnonzero(np.append(True, visited))  # the robot, and the candidates after it
    lengths = candidate_tour_lengths(loop, loop.navigator.lengths)[np.ix_(stops, stops)]
    scores[visited] = -np.argsort(open_tour(lengths))
    return scores


def shared_out(own: FloatArray, mates: FloatArray) -> FloatArray:
    """Scores (N,) of places by path lengths (N,) [m] to them: the nearest that no mate is nearer to comes first.

    With mates' lengths of shape (K, N) [m]. One that is nearest to none bids for one. Positions change less than what
    frontiers seem to hide: robots don't cross the building for each other's (Bautin et al., "MinPos: A novel frontier
    allocation algorithm for multi-robot exploration", ICIRA 2012).
    """
    is_own = own <= mates.min(axis=0, initial=np.inf)
    if not is_own.any():
        return auctioned(own, mates)
    return -np.argsort(np.lexsort((own, ~is_own))).astype(np.float64)


def mate_lengths(loop: ExplorationLoop) -> FloatArray:
    """Length of the path of each robot that is heard to each candidate, shape (K, N) [m].

    inf where none leads, and of robots that the map shows no path to: they have other candidates.
    """
    costmap = loop.navigator.costmap
    space = loop.navigator.reachable
    lengths: FloatArray = np.full((len(loop.belief.mates), len(loop.candidates)), np.inf)
    is_met = reached_mates(loop)
    if costmap is not None and space is not None and is_met.any():
        paths = CoarsePaths(costmap, space)
        places = paths.places(candidate_places(loop))
        stands = paths.places(loop.belief.mates[is_met, :2])
        lengths[is_met] = [paths.lengths_from(cell, places) for cell in stands.tolist()]
    return lengths


def reached_mates(loop: ExplorationLoop) -> BoolArray:
    """Which of the robots that are heard stand within :data:`BESIDE_MATE` of where this one can get to, shape (K,)."""
    costmap = loop.navigator.costmap
    space = loop.navigator.reachable
    is_met = np.zeros(len(loop.belief.mates), np.bool_)
    if costmap is None or space is None:
        return is_met
    is_open = space.mask.reshape(costmap.costs.shape)
    reach = round(BESIDE_MATE / costmap.frame.resolution)
    rows, cols = costmap.frame.to_cell(*loop.belief.mates[:, :2].T)
    for mate, (row, col) in enumerate(zip(rows.tolist(), cols.tolist(), strict=True)):
        top, left = max(row - reach, 0), max(col - reach, 0)
        is_met[mate] = is_open[top : max(row + reach + 1, 0), left : max(col + reach + 1, 0)].any()
    return is_met


def path_lengths(loop: ExplorationLoop) -> FloatArray:
    """Length of the path to each candidate, shape (N,) [m]."""
    return np.array([candidate.path_length for candidate in loop.candidates])
