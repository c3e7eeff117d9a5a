"""Frontiers that an exploration has given up, reached in vain or not reached, and those that it has passed over."""

from collections.abc import Sequence

import numpy as np

from slamgym.planning.costmap import NO_INFORMATION, Costmap
from slamgym.planning.exploration_progress import LEAST_GROWTH
from slamgym.planning.frontier_candidates import FrontierCandidate, FrontierInReach
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
        self._passed_over: list[tuple[FrontierCandidate, float]] = []  # and what was known around

    def add(self, candidate: FrontierCandidate, reached: bool) -> None:
        """Give a frontier up."""
        self._entries.append((candidate, reached))

    def without_given_up(self, found: Sequence[FrontierInReach]) -> list[FrontierInReach]:
        """Those frontiers that weren't given up."""
        given_up = [one for one, _ in self._entries]
        return [one for one in found if not self._holds(given_up, one)]

    def pass_over(self, candidate: FrontierCandidate, costmap: Costmap) -> None:
        """Pass a frontier over for now; that is never struck out, but ends with a change of the map around it."""
        known = _known_around(costmap, candidate.frontier)
        self._passed_over.append((candidate, known))

    def without_passed_over(
        self, found: Sequence[FrontierInReach], costmap: Costmap
    ) -> list[FrontierInReach]:
        """Those frontiers that weren't passed over, or around which the map has changed since."""
        unchanged = [
            one
            for one, known in self._passed_over
            if abs(_known_around(costmap, one.frontier) - known) < LEAST_GROWTH
        ]
        return [one for one in found if not self._holds(unchanged, one)]

    def _holds(self, entries: Sequence[FrontierCandidate], one: FrontierInReach) -> bool:
        return any(self._is_same(entry, one.frontier.centroid) for entry in entries)

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


def _known_around(costmap: Costmap, frontier: Frontier) -> float:
    """Known area around a frontier [m2]."""
    frame = costmap.frame
    row, col = frame.to_cell(*frontier.middle)
    reach = round(_AROUND / frame.resolution)
    rows = slice(max(0, row - reach), row + reach + 1)
    cols = slice(max(0, col - reach), col + reach + 1)
    known = np.count_nonzero(costmap.costs[rows, cols] != NO_INFORMATION)
    return float(known) * frame.resolution**2
