"""Explorers by name."""

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError

if TYPE_CHECKING:
    from slamgym.agents.explorer import BatchedExplorer
    from slamgym.planning.context import ExplorerContext

EXPLORERS: Mapping[str, str] = {
    "explore_lite": "frontier:ExploreLite",
    "nearest": "frontier:NearestFrontier",
    "cost_utility": "frontier:CostUtility",
    "next_best_view": "next_best_view:NextBestView",
    "tour": "frontier_tour:FrontierTour",
    "repairman": "frontier_tour:Repairman",
    "rl": "learned:LearnedExplorer",
    "random": "random_walk:RandomWalk",
}
"""Name to ``module:class`` of this package, imported when one is made: names alone are for help pages, too."""

CLASSICAL = ("explore_lite", "nearest", "cost_utility", "next_best_view", "tour", "repairman")
"""Rules by hand: neither learned, nor told the floor plan, nor the random walk."""


def make_explorer(name: str, context: "ExplorerContext", seed: int = 0) -> "BatchedExplorer":
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
        from slamgym.agents.learned import LearnedExplorer

        return LearnedExplorer(context, name.removeprefix("rl:"), seed=seed)
    if name not in EXPLORERS:
        raise ConfigError(f"no explorer {name!r}; {suggest(name, EXPLORERS)}")
    module, maker = EXPLORERS[name].split(":")
    explorer: BatchedExplorer = getattr(importlib.import_module(f"slamgym.agents.{module}"), maker)(
        context, seed=seed
    )
    return explorer
