"""Cost of choosing each frontier, for one who knows the floor plan. Privileged.

The rule ``tour`` drives the shortest tour through all frontiers that it sees, as if nothing came after them. Here the
tour goes also through the places from which all other unseen floor is seen, which only the plan shows: the length of
the tour that begins with a frontier is what the exploration costs from there on. A policy that doesn't know the plan
does best, as far as looking around isn't a separate purpose, to choose what costs least in the mean over all plans
that look alike so far (hindsight optimisation: Chong, Givan and Chang, CDC 2000; Yoon et al., AAAI 2008; for
states that are known once an action was taken the same is QMDP: Littman, Cassandra and Kaelbling, ICML 1995).
"""

import numpy as np

from slamgym.agents.coverage_tour import TourSearch
from slamgym.agents.oracle import TrueBuilding
from slamgym.core.types import FloatArray, IntArray
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import TURN_WEIGHT
from slamgym.planning.grid_path import straight_turns
from slamgym.planning.open_tour import lengths_by_first

_EVERY = 6
"""The places from which hidden floor is seen are searched again at every so many-th choice."""
_SPARED = 0.005
"""Share of the floor that need not be seen: the last slivers behind corners cost more than they show."""
_ITERATIONS = 10
"""Budget of a search: the tour before is near the shortest, and the first leg is all that is asked for."""
_LEAST_AREA = 0.3
"""A place is visited for so much unseen floor that nothing else on the tour shows [m2]."""
_HOLD = 0.5
"""Cost of changing the target [m]: braking, and that the robot's view is turned to the old one."""


class HindsightCosts:
    """Knows the building of one environment's running episode.

    Args:
        env: After its reset; there has to be a new one for every episode.
    """

    def __init__(self, env: ExploreFrontiersEnv) -> None:
        self._loop = env.loop
        self._building = TrueBuilding(env.inner)
        self._rng = np.random.default_rng(0)
        self._stops: list[int] = []
        self._count = 0

    def costs(self) -> FloatArray:
        """Length of the tour through all that is left, for each candidate that it begins with, shape (N,) [m]."""
        viewpoints, candidates = self._building.viewpoints, self._loop.candidates
        ends = np.array([self._building.to_world(one.path[-1]) for one in candidates]).reshape(-1, 2)
        hidden = self._hidden_places(ends)
        count = len(candidates)
        lengths = np.full((1 + count + len(hidden), 1 + count + len(hidden)), np.inf)
        lengths[0, 1 : 1 + count] = self._first_legs()
        places = np.vstack([ends, viewpoints.places[hidden]])
        cells = np.array([viewpoints.paths.place((x, y)) for x, y in places.tolist()])
        for index, cell in enumerate(cells[:count].tolist()):
            lengths[1 + index, 1:] = np.where(cells >= 0, viewpoints.paths.lengths_from(cell)[cells], np.inf)
        lengths[1 + count :, 1 : 1 + count] = lengths[1 : 1 + count, 1 + count :].T
        lengths[1 + count :, 1 + count :] = viewpoints.lengths[np.ix_(hidden, hidden)]
        return lengths_by_first(lengths)[:count]

    def _first_legs(self) -> FloatArray:
        """Length of the path to each candidate, with the turn towards it, shape (N,) [m]."""
        loop = self._loop
        middles = np.array([one.frontier.middle for one in loop.candidates]).reshape(-1, 2)
        legs: FloatArray = np.array([one.path_length for one in loop.candidates])
        legs += TURN_WEIGHT * straight_turns(loop.pose, middles)
        if loop.target is not None:
            legs += [0.0 if one.target == loop.target.target else _HOLD for one in loop.candidates]
        return legs

    def _hidden_places(self, ends: FloatArray) -> IntArray:
        """Places from which the unseen floor is seen that isn't in sight from the candidates, shape (M,)."""
        viewpoints, unseen = self._building.viewpoints, self._building.unseen
        if self._count % _EVERY == 0:
            here = self._building.to_world(self._loop.pose[:2])
            needed = int(np.count_nonzero(unseen)) - round(_SPARED * len(unseen))
            search = TourSearch(viewpoints, here, unseen, self._rng)
            self._stops = search.shortest(needed, _ITERATIONS, self._stops)
        self._count += 1
        near = [viewpoints.nearest(end) for end in ends]
        hidden = unseen & ~viewpoints.views[near].any(axis=0)
        least, kept = _LEAST_AREA / viewpoints.cell_area, []
        for stop in self._stops:
            own = hidden & viewpoints.views[stop]
            hidden = hidden & ~own
            if np.count_nonzero(own) >= least:
                kept.append(stop)
        return np.array(kept, dtype=np.int64)
