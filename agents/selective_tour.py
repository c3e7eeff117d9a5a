"""The explorer ``rl``: the shortest tour through the frontiers that are worth a visit, as learned from floor plans.

Many frontiers hide nothing, and a promise leaves some floor unseen anyway. So those are passed over that hide least, as
long as the probability that together they hide more than may be left is no more than a share of what the promise risks
(Cantelli's bound for independent frontiers, from mean and variance). The others are visited as ``tour`` does. When none
is left the exploration is done, if it has given the promise for which the share was calibrated; else what was passed
over comes last. In large buildings, where the way back is long, nothing is passed over before all frontiers together
probably hide no more than may be left, and only what the map encloses.
"""

from pathlib import Path

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot
from slamgym.agents.hidden_floor import AREAS, HIDDEN_FLOOR, HiddenFloor, moments
from slamgym.agents.pretrained_policy import fingerprint_of
from slamgym.agents.rules import TOUR_LOOP, reached_mates, tour_scores
from slamgym.core.config import config_hash
from slamgym.core.types import BoolArray, FloatArray
from slamgym.envs.frontier_table import FRONTIER_FIGURES, describe_frontiers
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.promise import Promise, is_kept

CALIBRATED = Promise()
"""What is promised by those who stop so."""
LARGEST_SKIPPED = 200.0
"""Known floor, and what frontiers probably hide, up to which they are passed over from the first [m2]. Where that was
300 m2 of known floor alone, ``rl`` took 1.05 [1.00, 1.12] times as long in 23 offices and schools. Beyond,
only what the map encloses is: a door to half a school of 3,980 m2, into a hall deeper than the scanner sees, looked
like one that hides nothing."""


class WorthwhileTour:
    """The rule.

    Args:
        network: Says what frontiers hide.
        promise: What is promised.
    """

    def __init__(self, network: HiddenFloor, promise: Promise | None) -> None:
        self._network = network
        self._promise = promise or CALIBRATED
        self._may_stop = promise == CALIBRATED

    def __call__(self, loop: ExplorationLoop) -> FloatArray:
        """Ranks in the tour through what is worth a visit, negative, shape (N,); all -inf at the end."""
        left = self._left(loop)
        figures = describe_frontiers(loop, loop.wanted)
        chances = self._network.chances(figures)
        hidden = moments(chances, left)
        worth = self._worth_a_visit(hidden, left)
        probable = moments(chances, AREAS[-1])[0].sum()
        is_large = loop.known_area + probable > LARGEST_SKIPPED
        if is_large:
            is_open = figures[:, FRONTIER_FIGURES.index("unknown_enclosed")] == 0.0
            worth |= is_open
        # Frontiers share no cell, so the middle of each is its own.
        index_of = {one.middle: index for index, one in enumerate(loop.wanted)}
        # A robot that this one can't get to stands behind more floor.
        if self._may_stop and reached_mates(loop).all():
            ways_on = loop.ways_on()
            if ways_on is not None:
                ways_on = [one for one in ways_on if worth[index_of[one.middle]]]
            if is_kept(CALIBRATED, ways_on, loop.known_area):
                return np.full(len(loop.candidates), -np.inf)
        may_pass_over = not is_large or (self._may_stop and hidden[0].sum() <= left)
        chosen = [index_of[one.frontier.middle] for one in loop.candidates]
        return tour_scores(loop, worth[chosen] | (not may_pass_over))

    def _left(self, loop: ExplorationLoop) -> float:
        """How much floor the promise leaves unseen [m2]."""
        if self._promise.left is not None:
            return self._promise.left
        seen = self._promise.seen or 0.0
        return (1.0 - seen) * loop.known_area

    def _worth_a_visit(self, hidden: FloatArray, left: float) -> BoolArray:
        """Which frontiers, the nearest first, are worth a visit, by the moments of what they hide, shape (N,).

        Of those that hide the same the farthest is passed over first: were it the nearest, the robot would turn back
        from each that it comes near to.
        """
        mean, square = hidden
        farthest_first = -np.arange(len(mean))
        order = np.lexsort((farthest_first, square))
        spare = np.maximum(left - np.cumsum(mean[order]), 0.0)
        variance = np.cumsum((square - mean**2)[order])
        risk = self._network.risk * (1.0 - self._promise.confidence)
        worth = np.zeros(len(mean), np.bool_)
        worth[order] = variance > risk * (variance + spare**2)
        return worth


class SelectiveTour(BatchedExplorer):
    """Chooses frontiers by what a network says that they hide; without torch.

    Args:
        context: What the environment says about the robot and its map.
        config: How frontiers are offered and driven to, and what is promised.
        network: Weights; by default those that come with the package.
    """

    def __init__(
        self,
        context: ExplorerContext,
        config: ExplorationLoopConfig | None = None,
        network: Path | str = HIDDEN_FLOOR,
    ) -> None:
        loop = config or TOUR_LOOP
        read = HiddenFloor.read(network)
        fingerprint = f"{fingerprint_of(read.weights)}-{read.risk:g}-{config_hash(loop)}"
        rule = WorthwhileTour(read, loop.promise)
        super().__init__(context, fingerprint, lambda _: FrontierPilot(context, loop, rule))
        self.config = loop
