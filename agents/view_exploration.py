"""Frontier exploration by views: a goal is a place from which a frontier is seen, not the frontier itself.

Driving up to a frontier wastes the range of the scanner: what lies behind it is seen from the first place
that overlooks it. So each frontier's goal is the place nearest to the robot, by path length, that sees the
frontier's middle over free cells. A frontier that is still there after such a look is visited itself.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from slamgym.agents.frontier_exploration import Candidate, ExplorationConfig, FrontierExploration
from slamgym.core.config import Positive, Settings
from slamgym.core.types import Float32Array, Pose2D
from slamgym.planning import ExplorerContext, Reachable
from slamgym.planning.coarse_paths import CoarsePaths
from slamgym.planning.costmap import Costmap
from slamgym.planning.frontiers import Frontier, Point
from slamgym.planning.grid_path import place_near
from slamgym.planning.views import best_view, viewing_places


class ViewConfig(Settings):
    """What all explorers by views share."""

    view_distance: Positive = 0.5
    """A frontier is looked at from no farther than this [m]. From 1.5 m the ways are a little shorter, but the
    robot stops to look where it would have driven on anyway: 12 % more time to 95 % of the floor."""
    scan_range: Positive = 3.0
    """How far the scanner is trusted when a gain is foretold [m]; the usable range of the mapper."""
    min_frontier_size: float = 0.4
    """Frontiers shorter than this are left for the end [m]."""
    progress_timeout: Positive = 30.0
    """A goal that the robot doesn't come nearer to for so long is given up [s]."""
    keeps_goal: bool = True
    """Whether a goal is kept for as long as its frontier exists."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """What all frontier explorers share."""


class Option(NamedTuple):
    """A frontier with the place to look at it from."""

    candidate: Candidate  # its target is the place
    length: float  # of the path there [m]; inf if none leads there
    turn: float  # between the robot's heading and the bearing of the place, 0 to pi [rad]
    gain: float  # unknown area in sight from the place [m2]


class ViewExploration(FrontierExploration):
    """One robot's exploration by views; a subclass orders the options.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
    """

    def __init__(self, context: ExplorerContext, config: ViewConfig) -> None:
        super().__init__(
            context,
            config.exploration,
            interval=context.map_update_interval,
            progress_timeout=config.progress_timeout,
            min_frontier_size=config.min_frontier_size,
            keeps_goal=config.keeps_goal,
        )
        self.views = config
        self._looked_at: list[Point] = []  # middles of frontiers that a view didn't dispose of

    @abstractmethod
    def _order(self, options: Sequence[Option], paths: CoarsePaths) -> Sequence[int]:
        """Indices of the options, the best first."""

    def _rank(self, candidates: list[Candidate]) -> list[Candidate]:
        pose, costmap, space = self._pose, self._navigator.costmap, self._navigator.reachable
        assert costmap is not None
        assert space is not None
        paths = CoarsePaths(costmap, space)
        start = paths.place((pose.x, pose.y))
        lengths = paths.lengths_from(start)
        options = [self._option(candidate, pose, costmap, space, lengths, paths) for candidate in candidates]
        return [options[i].candidate for i in self._order(options, paths)]

    def _option(
        self,
        candidate: Candidate,
        pose: Pose2D,
        costmap: Costmap,
        space: Reachable,
        lengths: Float32Array,
        paths: CoarsePaths,
    ) -> Option:
        """Choose the place for a frontier and measure what it costs and shows."""
        target, length = self._place_for(candidate.frontier, costmap, space, lengths, paths)
        bearing = math.atan2(target[1] - pose.y, target[0] - pose.x)
        turn = abs(math.remainder(bearing - pose.theta, 2.0 * math.pi))
        near = math.hypot(target[0] - pose.x, target[1] - pose.y) < 0.3
        view = best_view(costmap, target, self.views.scan_range, self.context.geometry)
        return Option(Candidate(candidate.frontier, target), length, 0.0 if near else turn, view.gain)

    def _place_for(
        self,
        frontier: Frontier,
        costmap: Costmap,
        space: Reachable,
        lengths: Float32Array,
        paths: CoarsePaths,
    ) -> tuple[Point, float]:
        """The place to look at a frontier from, and the length of the path there [m]."""
        if not self._was_looked_at(frontier):
            cells = viewing_places(costmap, space, frontier.middle, self.views.view_distance)
            if len(cells):
                points = np.column_stack(costmap.frame.to_point(cells[:, 0], cells[:, 1]))
                costs = paths.lengths_to(lengths, points)
                best = int(np.argmin(costs))
                if math.isfinite(costs[best]):
                    return (float(points[best, 0]), float(points[best, 1])), float(costs[best])
        cell = place_near(costmap, frontier.middle, self.config.navigator.plan_tolerance, space)
        if cell is None:
            return frontier.middle, math.inf
        x, y = costmap.frame.to_point(*cell)
        point = float(x), float(y)
        return point, float(paths.lengths_to(lengths, np.array([point]))[0])

    def _was_looked_at(self, frontier: Frontier) -> bool:
        return any(self._passes_by(frontier, point) for point in self._looked_at)

    def _close(self, candidate: Candidate, reached: bool) -> None:
        """A look from afar that left the frontier in place is followed by a visit."""
        if reached and not self._was_looked_at(candidate.frontier):
            self._looked_at.append(candidate.frontier.middle)
        else:
            super()._close(candidate, reached)
