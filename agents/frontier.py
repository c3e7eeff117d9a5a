"""Frontier exploration: choose a frontier, drive there, choose again.

:class:`ExploreLite` follows the ROS package of that name (J. Hörner, "Map-merging for multi-robot system",
2016; wiki.ros.org/explore_lite), :class:`NearestFrontier` Yamauchi ("A frontier-based approach for
autonomous exploration", CIRA 1997), :class:`CostUtility` Burgard et al. ("Coordinated multi-robot
exploration", T-RO 2005) for one robot.
"""

import math
from dataclasses import field

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Exploration
from slamgym.agents.frontier_exploration import Candidate, ExplorationConfig, FrontierExploration
from slamgym.core.config import Settings
from slamgym.core.types import Pose2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.frontiers import expected_gain


class ExploreLiteConfig(Settings):
    """Settings of Explore Lite; defaults are those of its launch file."""

    planner_frequency: float = 0.33
    """How often frontiers are searched and the goal is reconsidered [Hz]."""
    progress_timeout: float = 30.0
    """A goal that the robot doesn't come nearer to for so long is given up [s]."""
    potential_scale: float = 3.0
    """Weight of the distance to a frontier."""
    gain_scale: float = 1.0
    """Weight of the size of a frontier."""
    min_frontier_size: float = 0.75
    """Frontiers shorter than this are left for the end [m]."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """What all frontier explorers share."""


class _ExploreLite(FrontierExploration):
    """Explore Lite's choice: near and large, reconsidered at every tick."""

    def __init__(self, context: ExplorerContext, config: ExploreLiteConfig) -> None:
        super().__init__(
            context,
            config.exploration,
            interval=1.0 / config.planner_frequency,
            progress_timeout=config.progress_timeout,
            min_frontier_size=config.min_frontier_size,
        )
        self._scales = config.potential_scale, config.gain_scale

    def _rank(self, candidates: list[Candidate]) -> list[Candidate]:
        potential, gain = self._scales
        resolution = self.context.frame.resolution

        def cost(candidate: Candidate) -> float:
            frontier = candidate.frontier
            return potential * frontier.min_distance * resolution - gain * frontier.size * resolution

        return sorted(candidates, key=cost)

    def _distance_left(self, pose: Pose2D) -> float:
        """Explore Lite's own measure of progress: straight to the goal, whichever way leads there [m]."""
        return math.dist(self._target.target, pose[:2]) if self._target is not None else math.inf


class ExploreLite(BatchedExplorer):
    """Explore Lite on this package's navigation stack.

    Three weaknesses that its users report are mended: the search climbs over the cost of inflated doorways,
    it doesn't pass gaps that are too narrow for the robot, and a frontier whose centroid is where the robot
    stands is visited at one of its cells.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: ExploreLiteConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or ExploreLiteConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _ExploreLite(self.context, self.config)


class NearestFrontierConfig(Settings):
    """Settings of the nearest-frontier rule."""

    min_frontier_size: float = 0.4
    """Frontiers shorter than this are left for the end [m]; Yamauchi asks for the size of the robot."""
    progress_timeout: float = 30.0
    """A goal that the robot doesn't come nearer to for so long is given up [s]."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """What all frontier explorers share."""


class _Nearest(FrontierExploration):
    """The shortest path first; a goal is kept until its frontier is gone."""

    def __init__(self, context: ExplorerContext, config: NearestFrontierConfig) -> None:
        super().__init__(
            context,
            config.exploration,
            interval=context.map_update_interval,
            progress_timeout=config.progress_timeout,
            min_frontier_size=config.min_frontier_size,
            keeps_goal=True,
        )

    def _rank(self, candidates: list[Candidate]) -> list[Candidate]:
        costs = self._path_costs(candidates, factor=0.0, only_nearest=True)
        return [candidates[i] for i in np.argsort(costs, kind="stable")]


class NearestFrontier(BatchedExplorer):
    """Goes to the frontier with the shortest path, as Yamauchi's robot did.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: NearestFrontierConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or NearestFrontierConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _Nearest(self.context, self.config)


class CostUtilityConfig(Settings):
    """Settings of the cost-utility rule."""

    cost_weight: float = 0.06
    """Beta: what a metre of path takes from the utility, which lies between 0 and 1 [1/m]."""
    min_frontier_size: float = 0.4
    """Frontiers shorter than this are left for the end [m]."""
    progress_timeout: float = 30.0
    """A goal that the robot doesn't come nearer to for so long is given up [s]."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """What all frontier explorers share."""


class _CostUtility(FrontierExploration):
    """The largest utility minus beta times the path cost."""

    def __init__(self, context: ExplorerContext, config: CostUtilityConfig) -> None:
        super().__init__(
            context,
            config.exploration,
            interval=context.map_update_interval,
            progress_timeout=config.progress_timeout,
            min_frontier_size=config.min_frontier_size,
            keeps_goal=True,
        )
        self._beta = config.cost_weight

    def _rank(self, candidates: list[Candidate]) -> list[Candidate]:
        costmap = self._navigator.costmap
        assert costmap is not None
        reach = self.context.geometry.range_max
        utility = [
            expected_gain(costmap, c.frontier.middle, reach) / (math.pi * reach**2) for c in candidates
        ]
        value = np.array(utility) - self._beta * self._path_costs(candidates)
        return [candidates[i] for i in np.argsort(-value, kind="stable")]


class CostUtility(BatchedExplorer):
    """Weighs the unknown area in sight of a frontier against the cost of the path there.

    Burgard's utility of a frontier falls with what other robots will see there; for one robot it would be
    the same everywhere. Here it is the share of the scanner's disc about the frontier that is unknown and in
    sight.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: CostUtilityConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or CostUtilityConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _CostUtility(self.context, self.config)
