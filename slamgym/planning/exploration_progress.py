"""Progress of an exploration: its last choice, its map, and the robot on the way to its target."""

import math
from dataclasses import dataclass

from slamgym.planning.costmap import Costmap
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.frontiers import Point

LEAST_GROWTH = 0.5
"""Less than this is no growth of the map [m2]: noise opens pinholes for ever."""


@dataclass
class MapGrowth:
    """Growth of the map, and goals that add to it or not."""

    known_area: float = 0.0  # [m2]
    grown_to: float = 0.0  # known area when it last grew [m2]
    grown_at: float = 0.0  # [s]
    reached: int = 0  # goals
    futile: int = 0  # goals in a row that added nothing

    def note(self, known_area: float, time: float) -> None:
        """Take over the known area of a new map."""
        self.known_area = known_area
        if known_area > self.grown_to + LEAST_GROWTH:
            self.grown_to = known_area
            self.grown_at = time

    def note_goal(self, chosen_at: float) -> None:
        """Note the end of a goal that was chosen at some time [s]."""
        if self.grown_at >= chosen_at:
            self.futile = 0
        else:
            self.futile += 1


@dataclass
class TargetProgress:
    """Progress of the robot towards its target."""

    target: Point = (math.inf, math.inf)
    distance: float = math.inf  # the shortest so far [m]
    at: float = 0.0  # when it was reached [s]

    def waited(self, target: Point, distance: float, time: float) -> float:
        """For how long the robot hasn't come nearer [s]."""
        # A target that only jitters with the map is not a new one.
        if math.dist(target, self.target) > 0.5 or distance < self.distance - 0.05:
            self.target = target
            self.distance = distance
            self.at = time
        return time - self.at


@dataclass
class LastChoice:
    """The last choice, and when the next one may be due."""

    made_at: float = -math.inf  # [s]
    settles_at: float = -math.inf  # when the map shows what the last goal brought [s]
    is_outdated: bool = False  # a newer map has come since the candidates were searched
    _still_there: tuple[Costmap, FrontierCandidate] | None = None  # known to be so

    def is_still_there(self, costmap: Costmap, candidate: FrontierCandidate) -> bool:
        """True if enough cells of a frontier are still unknown on a map; checked once for each map."""
        known = self._still_there
        if known is not None and known[0] is costmap and known[1] is candidate:
            return True
        is_there = candidate.is_still_there(costmap)
        self._still_there = (costmap, candidate) if is_there else None
        return is_there
