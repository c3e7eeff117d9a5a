"""Frontiers that an exploration has given up, reached in vain or not reached, and those that it has passed over."""

import math
from collections.abc import Sequence

import numpy as np

from slamgym.planning.costmap import NO_INFORMATION, Costmap
from slamgym.planning.exploration_progress import LEAST_GROWTH
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.frontiers import Frontier, Point

SAME_CENTROID = 0.25
"""A frontier is blacklisted if both coordinates of its centroid are this near to an entry [m]: 5 cells, as in Explore
Lite. A pose that moves so much farther than the robot drives was corrected, and the map with it: the blacklist, and all
else that was noted by its place, is somewhere else now."""

_AROUND = 1.0
"""What lies this near to a frontier's middle, by either coordinate, is around it [m]: doors are as wide."""


class Blacklist:
    """Frontiers that are not offered again.

    Args:
        tolerance: Added to :data:`SAME_CENTROID` [m].
    """

    def __init__(self, tolerance: float) -> None:
        self._within = SAME_CENTROID + tolerance
        self._entries: list[tuple[FrontierCandidate, bool]] = []  # and whether it was reached

    def add(self, candidate: FrontierCandidate, reached: bool) -> None:
        """Give a frontier up."""
        self._entries.append((candidate, reached))

    def holds(self, centroid: Point) -> bool:
        """True if a frontier of a centroid was given up."""
        return any(self._is_same(one, centroid) for one, _ in self._entries)

    def unreached(self, costmap: Costmap, centroids: Sequence[Point]) -> list[FrontierCandidate]:
        """What was not reached and is still on the map, or is taken for one of its frontiers, of some centroids."""
        return [
            one
            for one, reached in self._entries
            if not reached
            and (one.is_still_there(costmap) or any(self._is_same(one, it) for it in centroids))
        ]

    def forgive(self) -> None:
        """Strike out what was not reached."""
        self._entries = [entry for entry in self._entries if entry[1]]

    def clear(self) -> None:
        """Strike everything out."""
        self._entries.clear()

    def _is_same(self, candidate: FrontierCandidate, centroid: Point) -> bool:
        x, y = candidate.frontier.centroid
        return abs(centroid[0] - x) < self._within and abs(centroid[1] - y) < self._within


class PassedOver:
    """Frontiers that were passed over, and what was known around them then."""

    def __init__(self) -> None:
        self._entries: list[tuple[Frontier, float]] = []  # and the known area [m2]

    def add(self, frontier: Frontier, costmap: Costmap) -> None:
        """Pass a frontier over."""
        self._entries.append((frontier, _known_around(costmap, frontier)))

    def holds(self, frontier: Frontier, costmap: Costmap) -> bool:
        """True if a frontier was passed over, and the map hasn't changed around it."""
        return any(
            math.dist(one.centroid, frontier.centroid) < SAME_CENTROID
            and abs(_known_around(costmap, one) - known) < LEAST_GROWTH
            for one, known in self._entries
        )


def _known_around(costmap: Costmap, frontier: Frontier) -> float:
    """Known area around a frontier [m2]."""
    frame = costmap.frame
    row, col = frame.to_cell(*frontier.middle)
    reach = round(_AROUND / frame.resolution)
    rows = slice(max(0, row - reach), row + reach + 1)
    cols = slice(max(0, col - reach), col + reach + 1)
    known = np.count_nonzero(costmap.costs[rows, cols] != NO_INFORMATION)
    return float(known) * frame.resolution**2
