"""What it costs to choose each frontier, for one who knows the floor plan. Privileged.

The rule ``tour`` drives the shortest tour through all frontiers that it sees, as if nothing came after them. Here the
tour goes also through the places from which all other unseen floor is seen, which only the plan shows: the length of
the tour that begins with a frontier is what the exploration costs from there on. A policy that doesn't know the plan
does best, as far as looking around isn't a purpose of its own, to choose what costs least in the mean over all plans
that look alike so far (hindsight optimisation: Chong, Givan and Chang, CDC 2000; Yoon et al., AAAI 2008; for
states that are known once an action was taken the same is QMDP: Littman, Cassandra and Kaelbling, ICML 1995).
"""

import numpy as np

from slamgym.agents.coverage_tour import Stop
from slamgym.agents.oracle import TrueBuilding
from slamgym.core.config import Count, NonNegative, Positive, Settings
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.planning.grid_path import straight_turns
from slamgym.planning.open_tour import lengths_by_first


class HindsightConfig(Settings):
    """How costs are reckoned."""

    every: Count = 6
    """The places from which hidden floor is seen are chosen anew at every so many-th choice."""
    least_area: Positive = 0.3
    """A place is visited for so much unseen floor that nothing else on the tour shows [m2]."""
    turn_weight: NonNegative = 0.2
    """What a radian of turning before the first leg counts [m/rad], as in the rule."""
    hold: NonNegative = 0.5
    """What changing the target costs [m]: braking, and that the robot's view is turned to the old one."""


class HindsightCosts:
    """Knows the building of one environment's running episode.

    Args:
        env: After its reset; there has to be a new one for every episode.
        config: Settings.
    """

    def __init__(self, env: ExploreFrontiersEnv, config: HindsightConfig | None = None) -> None:
        self._loop = env.loop
        self._building = TrueBuilding(env.inner)
        self._config = config or HindsightConfig()
        self._stops: list[Stop] = []
        self._count = 0

    def costs(self) -> FloatArray:
        """Length of the tour through all that is left, for each candidate that it begins with, shape (N,) [m]."""
        building, candidates = self._building, self._loop.candidates
        ends = np.array([building.to_world(one.path[-1]) for one in candidates]).reshape(-1, 2)
        hidden = self._hidden_places(ends)
        count = len(candidates)
        lengths = np.full((1 + count + len(hidden), 1 + count + len(hidden)), np.inf)
        lengths[0, 1 : 1 + count] = self._first_legs()
        places = np.vstack([ends, building.planner.places[hidden]])
        cells = np.array([building.paths.place((x, y)) for x, y in places.tolist()])
        for index, cell in enumerate(cells[:count].tolist()):
            lengths[1 + index, 1:] = np.where(cells >= 0, building.paths.lengths_from(cell)[cells], np.inf)
        lengths[1 + count :, 1 : 1 + count] = lengths[1 : 1 + count, 1 + count :].T
        lengths[1 + count :, 1 + count :] = building.planner.lengths[np.ix_(hidden, hidden)]
        return lengths_by_first(lengths)[:count]

    def _first_legs(self) -> FloatArray:
        """Length of the path to each candidate, with the turn towards it, shape (N,) [m]."""
        loop, config = self._loop, self._config
        middles = np.array([one.frontier.middle for one in loop.candidates]).reshape(-1, 2)
        legs: FloatArray = np.array([one.path_length for one in loop.candidates])
        legs += config.turn_weight * straight_turns(loop.pose, middles)
        if loop.target is not None:
            legs += [0.0 if one.target == loop.target.target else config.hold for one in loop.candidates]
        return legs

    def _hidden_places(self, ends: FloatArray) -> IntArray:
        """Places from which the unseen floor is seen that isn't in sight from the candidates, shape (M,)."""
        planner, unseen = self._building.planner, self._building.unseen
        if self._count % self._config.every == 0:
            here, before = self._building.to_world(self._loop.pose[:2]), [stop.place for stop in self._stops]
            self._stops = planner.plan(unseen, here, previous=before)
        self._count += 1
        near = ((planner.places[None] - ends[:, None]) ** 2).sum(axis=2).argmin(axis=1)
        hidden: BoolArray = unseen & ~planner.views[near].any(axis=0)
        least = self._config.least_area / planner.cell_area
        kept = [stop.place for stop in self._stops if np.count_nonzero(hidden[stop.cells]) >= least]
        return np.array(kept, dtype=np.int64)
