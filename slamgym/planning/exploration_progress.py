"""Progress of an exploration: its last choice, its map, and the robot on the way to its target."""

import math
from dataclasses import dataclass, field

import numpy as np

from slamgym.core.types import Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, Costmap, cells_inside
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.frontiers import Point, Reachable
from slamgym.planning.grid_path import place_near
from slamgym.planning.navigator import Navigator

_JITTER = 0.5
"""A target that moves less with the map is the same [m]."""
_NEARER = 0.05
"""Less is no progress [m]: a cell of the map."""
_TRAIL_STEP = 0.5
"""Places of a trail are so far apart, and a way back need lead no nearer to them [m]: maps are corrected by less."""
_TRAIL_MISSING = 4
"""So many places in a row without a way back are no place that a corrected map shows inside a wall."""

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

    def note_goal(self, chosen_at: float, is_reached: bool) -> None:
        """Note the end of a goal that was chosen at some time [s]."""
        self.reached += is_reached
        if self.grown_at >= chosen_at:
            self.futile = 0
        else:
            self.futile += 1


@dataclass
class TargetProgress:
    """Progress of the robot towards its target."""

    target: Point = (math.inf, math.inf)
    distance: float = math.inf  # the shortest so far, straight [m]
    path: float = math.inf  # the shortest so far, along the path [m]
    at: float = 0.0  # when the robot last came nearer [s]

    def waited(self, target: Point, navigator: Navigator, pose: Pose2D, time: float) -> float:
        """For how long the robot hasn't come nearer, neither straight nor along its path [s]."""
        if math.dist(target, self.target) > _JITTER:
            self.target = target
            self.distance = math.inf
            self.path = math.inf
        distance = math.dist(target, pose[:2])
        path = navigator.follower.remaining(pose)
        if distance < self.distance - _NEARER or path < self.path - _NEARER:
            self.distance = min(self.distance, distance)
            self.path = min(self.path, path)
            self.at = time
        return time - self.at


@dataclass
class Trail:
    """Places where the robot has been, as it believed then."""

    places: list[Point] = field(default_factory=list)  # [m]
    _found: tuple[Costmap, int, bool] | None = None  # on a map, of so many places

    def note(self, pose: Pose2D) -> None:
        """Note where the robot is, if that is some way from the last place."""
        place = pose.x, pose.y
        if not self.places or math.dist(place, self.places[-1]) > _TRAIL_STEP:
            self.places.append(place)

    def is_cut_off(self, costmap: Costmap, reachable: Reachable) -> bool:
        """True if the map shows no way back to a part of the trail: a door on it is drawn shut."""
        found = self._found
        if found is None or found[0] is not costmap or found[1] != len(self.places):
            is_cut_off = self._misses_places(costmap, reachable)
            found = self._found = (costmap, len(self.places), is_cut_off)
        return found[2]

    def _misses_places(self, costmap: Costmap, reachable: Reachable) -> bool:
        """Look for all places on a map."""
        missing = 0
        if not self.places:
            return False
        row, col, inside = cells_inside(costmap.frame, np.array(self.places))
        is_open = costmap.costs[row, col] < INSCRIBED_COST
        is_reached = np.zeros(len(self.places), np.bool_)
        is_reached[inside] = is_open & reachable.mask[row * costmap.frame.width_px + col]
        for place, was_reached in zip(self.places, is_reached.tolist(), strict=True):
            # Most places need no search for an open cell near by.
            is_there = was_reached or place_near(costmap, place, _TRAIL_STEP, reachable) is not None
            missing = 0 if is_there else missing + 1
            if missing >= _TRAIL_MISSING:
                return True
        return False


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
