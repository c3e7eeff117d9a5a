"""Explorers by name."""

from collections.abc import Callable

from slamgym.agents.explorer import BatchedExplorer
from slamgym.agents.frontier import CostUtility, ExploreLite, NearestFrontier
from slamgym.agents.frontier_tour import FrontierTour, Repairman
from slamgym.agents.learned import LearnedExplorer
from slamgym.agents.next_best_view import NextBestView
from slamgym.agents.random_walk import RandomWalk
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.planning.context import ExplorerContext

EXPLORERS: dict[str, Callable[[ExplorerContext, int], BatchedExplorer]] = {
    "explore_lite": lambda context, seed: ExploreLite(context, seed=seed),
    "nearest": lambda context, seed: NearestFrontier(context, seed=seed),
    "cost_utility": lambda context, seed: CostUtility(context, seed=seed),
    "next_best_view": lambda context, seed: NextBestView(context, seed=seed),
    "tour": lambda context, seed: FrontierTour(context, seed=seed),
    "repairman": lambda context, seed: Repairman(context, seed=seed),
    "rl": lambda context, seed: LearnedExplorer(context, seed=seed),
    "random": lambda context, seed: RandomWalk(context, seed=seed),
}
"""Name to constructor; each takes the context and a seed."""

CLASSICAL = ("explore_lite", "nearest", "cost_utility", "next_best_view", "tour", "repairman")
"""Rules by hand: neither learned, nor told the floor plan, nor the random walk."""


def make_explorer(name: str, context: ExplorerContext, seed: int = 0) -> BatchedExplorer:
    """Build an explorer.

    Args:
        name: One of :data:`EXPLORERS`, or ``rl:FILE`` for weights that ``slamgym agents train`` wrote.
        context: What the environment tells about the robot and its map.
        seed: Of the explorer's own random choices; only the random walk makes any.

    Raises:
        ConfigError: If there is no explorer of that name; the error suggests the nearest.
        InputFileError: If the weights can't be used.
    """
    if name.startswith("rl:"):
        return LearnedExplorer(context, name.removeprefix("rl:"), seed=seed)
    if name not in EXPLORERS:
        raise ConfigError(f"no explorer {name!r}; {suggest(name, EXPLORERS)}")
    return EXPLORERS[name](context, seed)
