"""Frontiers that an exploration has given up: reached in vain, or not reached."""

from collections.abc import Sequence

from slamgym.planning.costmap import Costmap
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.frontiers import Point

SAME_CENTROID = 0.25
"""A frontier is blacklisted if both coordinates of its centroid are this near to an entry [m]: 5 cells, as in Explore
Lite. A pose that moves so much farther than the robot drives was corrected, and the map with it: the blacklist, and all
else that was noted by its place, is somewhere else now."""


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
