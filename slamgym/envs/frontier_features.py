"""Observations of the frontiers that a policy may choose from, and of the whole exploration.

All of it is belief: map, believed pose, scans and clock, as the
:class:`~slamgym.planning.exploration_loop.ExplorationLoop` has them. Neither the floor plan, nor the true pose, nor
the true coverage can get in here.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from slamgym.core.geometry import between
from slamgym.core.types import FloatArray, Observation, Pose2D
from slamgym.envs.frontier_table import (
    AREA_SCALE,
    DISTANCE_SCALE,
    FRONTIER_FIGURES,
    SHARED_FIGURES,
    TIME_SCALE,
    describe_frontiers,
)
from slamgym.planning.costmap import Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.frontiers import fits_through
from slamgym.planning.grid_path import CoarsePaths, PathLengths
from slamgym.planning.open_tour import lengths_by_first, open_tour

FEATURE_VERSION = 4
"""Raised whenever a feature changes its meaning: weights trained on another version are refused."""
MOST_FRONTIERS = 32
"""So many frontiers are offered by default; homes of up to 260 m2 hardly ever have more."""

_STRETCH = 0.7
"""The direction of a path is taken over so much of it [m]."""
TURN_WEIGHT = 0.2
"""Cost of a radian of turning before the first leg of a tour [m/rad]: the speed of 0.26 m/s over 1.2 rad/s."""
LIMIT = 10.0
"""Features are cut off here."""
_WINDOW = 20.0
"""Growth of the map is taken over so long [s]."""

_WAY_FIGURES = (
    "path_length", "path_detour", "ahead", "left", "heading_change", "is_target", "is_way_on", "tour", "tour_detour",
)  # fmt: skip
"""Figures of the way to a frontier."""
CANDIDATE_FEATURES = (
    *(name for name in FRONTIER_FIGURES if name not in SHARED_FIGURES),
    *_WAY_FIGURES,
)
"""Features of each frontier that is offered: those of the table that the explorer ``rl`` reads, and of the way."""
_OWN = [
    index for index, name in enumerate(FRONTIER_FIGURES) if CANDIDATE_FEATURES.count(name)
]  # columns of the table
_IS_WAY_ON = CANDIDATE_FEATURES.index("is_way_on")

GLOBAL_FEATURES = (
    "time", "known_area", "growth", "time_since_growth", "last_duration", "frontiers", "ways_on", "known_width",
    "known_height", "known_share", "round", "unseen_share",
)  # fmt: skip
"""Features of the exploration as a whole."""


class FrontierFeatures:
    """Makes the observations of one exploration.

    Args:
        max_candidates: K; rows beyond the candidates at hand are zero and masked.

    Attributes:
        space: Of the observations.
    """

    def __init__(self, max_candidates: int) -> None:
        k = max_candidates
        self.space = spaces.Dict(
            {
                "frontiers": spaces.Box(-LIMIT, LIMIT, (k, len(CANDIDATE_FEATURES)), np.float32),
                "lengths": spaces.Box(0.0, LIMIT, (k + 1, k + 1), np.float32),
                "globals": spaces.Box(-LIMIT, LIMIT, (len(GLOBAL_FEATURES),), np.float32),
                "mask": spaces.Box(0.0, 1.0, (k,), np.float32),
            }
        )
        self._shapes = {name: box.shape or () for name, box in self.space.items()}
        # Time and known area at decisions.
        self._history: deque[tuple[float, float]] = deque([(0.0, 0.0)])
        self._grown_at = 0.0

    def observe(self, loop: ExplorationLoop, order: Sequence[int] | None = None) -> Observation:
        """The observation at a decision.

        Args:
            loop: The exploration.
            order: Which candidate each row holds; by default they keep their order, the shortest path first.
        """
        observation = {name: np.zeros(shape, np.float32) for name, shape in self._shapes.items()}
        costmap = loop.navigator.costmap
        if costmap is None:
            return observation
        unseen_share = 1.0
        if loop.candidates:
            rows = np.array(range(len(loop.candidates)) if order is None else order, np.int64)
            table, unseen_share, lengths = _measure(loop, costmap)
            count = len(rows)
            observation["frontiers"][:count] = np.clip(table[rows], -LIMIT, LIMIT)
            places = np.append(0, 1 + rows)
            observation["lengths"][: count + 1, : count + 1] = np.minimum(
                lengths[np.ix_(places, places)] / DISTANCE_SCALE, LIMIT
            )
            observation["mask"][:count] = 1.0
        ways_on = float(observation["frontiers"][:, _IS_WAY_ON].sum())
        whole = self._measure_whole(loop, costmap, unseen_share, ways_on)
        observation["globals"][:] = np.clip(
            [whole[name] for name in GLOBAL_FEATURES], -LIMIT, LIMIT
        )
        return observation

    def _measure_whole(
        self, loop: ExplorationLoop, costmap: Costmap, unseen_share: float, ways_on: float
    ) -> dict[str, float]:
        """Features of the whole, given the expected unseen share of the floor and the number of ways on."""
        time = loop.time
        area = loop.known_area
        last_time, last_area = self._history[-1]
        if area > last_area + 0.05:
            self._grown_at = time
        self._history.append((time, area))
        while len(self._history) > 2 and self._history[1][0] <= time - _WINDOW:
            self._history.popleft()
        since, before = self._history[0]
        height, width = _known_size(costmap)
        return {
            "time": math.log1p(time / TIME_SCALE),
            "known_area": math.log1p(area / AREA_SCALE),
            "growth": (area - before) / max(time - since, 1.0),
            "time_since_growth": (time - self._grown_at) / _WINDOW,
            "last_duration": (time - last_time) / 10.0,
            "frontiers": loop.num_frontiers / 16.0,
            "ways_on": ways_on / 4.0,
            "known_width": math.log1p(width / 15.0),
            "known_height": math.log1p(height / 15.0),
            "known_share": area / (width * height),
            "round": float(loop.round),
            "unseen_share": 1.0 + 0.25 * math.log10(max(unseen_share, 1e-4)),
        }


def _known_size(costmap: Costmap) -> tuple[float, float]:
    """Height and width of the known part, without the margin that a costmap has about it [m]."""
    height, width = costmap.frame.shape
    resolution = costmap.frame.resolution
    return max(0.1, height * resolution - 1.0), max(0.1, width * resolution - 1.0)


def _measure(loop: ExplorationLoop, costmap: Costmap) -> tuple[FloatArray, float, FloatArray]:
    """Features of the candidates (N, features), expected unseen share, and path lengths (N + 1, N + 1) [m]."""
    candidates = loop.candidates
    figures = describe_frontiers(loop, [one.frontier for one in candidates])
    lengths = candidate_tour_lengths(loop, loop.navigator.lengths)
    ranks = np.argsort(open_tour(lengths))
    by_first = lengths_by_first(lengths)
    detours = by_first - by_first.min()
    target = loop.target
    ways = []
    for index, one in enumerate(candidates):
        ahead, left, _ = between(loop.pose, Pose2D(*one.frontier.middle, 0.0))
        straight = max(one.frontier.min_distance, 0.5)
        ways.append(
            {
                "path_length": one.path_length / DISTANCE_SCALE,
                "path_detour": one.path_length / straight / 3.0,
                "ahead": ahead / DISTANCE_SCALE,
                "left": left / DISTANCE_SCALE,
                "heading_change": abs(_first_turn(one, loop.pose)) / math.pi,
                "is_target": float(target is not None and one.target == target.target),
                "is_way_on": float(fits_through(costmap, one.frontier, loop.context.robot_radius)),
                "tour": 1.0 / (1.0 + int(ranks[index])),
                "tour_detour": min(float(detours[index]) / 5.0, LIMIT),
            }
        )
    way_rows = np.array([[one[name] for name in _WAY_FIGURES] for one in ways])
    unseen_share = float(figures[0, FRONTIER_FIGURES.index("unseen_share")])
    return np.hstack([figures[:, _OWN], way_rows]), unseen_share, lengths


def candidate_places(loop: ExplorationLoop) -> FloatArray:
    """Where the paths to the candidates end, map frame, shape (N, 2) [m]."""
    costmap = loop.navigator.costmap
    assert costmap is not None
    rows, cols = np.array([candidate.place for candidate in loop.candidates]).T
    return np.column_stack(costmap.frame.to_point(rows, cols))


def candidate_tour_lengths(loop: ExplorationLoop, known: PathLengths) -> FloatArray:
    """Path lengths between the robot and the candidates, shape (N + 1, N + 1) [m]; turning to the first counts, too.

    Args:
        loop: An exploration with a map.
        known: Lengths that were found before, to which these are added.
    """
    costmap = loop.navigator.costmap
    space = loop.navigator.reachable
    assert costmap is not None
    assert space is not None
    paths = CoarsePaths(costmap, space)
    return known.matrix(paths, loop.pose, candidate_places(loop), TURN_WEIGHT)


def _first_turn(candidate: FrontierCandidate, pose: Pose2D) -> float:
    """Turn of the robot at the beginning of the path [rad]."""
    path = candidate.path
    ahead = np.array(candidate.frontier.middle)
    if len(path) > 2:
        step = math.dist(path[0], path[1])
        ahead = path[min(len(path) - 1, max(1, round(_STRETCH / max(step, 0.01))))]
    heading = math.atan2(ahead[1] - pose.y, ahead[0] - pose.x)
    return math.remainder(heading - pose.theta, 2.0 * math.pi)
