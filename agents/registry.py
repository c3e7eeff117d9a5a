"""Explorers by name: a rule, and settings of the exploration loop where its source has its own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from slamgym.agents.explorer import BatchedExplorer, FrontierExplorer, Rule
from slamgym.agents.learned import LearnedExplorer
from slamgym.agents.random_walk import RandomWalk
from slamgym.agents.rules import (
    EXPLORE_LITE_LOOP,
    CostUtility,
    ExploreLite,
    FrontierTour,
    Nearest,
    NextBestView,
    Repairman,
)
from slamgym.agents.teleop import Teleop
from slamgym.agents.wheels.explorer import WheelsExplorer
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoopConfig


@dataclass(frozen=True)
class HandWritten:
    """An explorer by a hand-written rule."""

    rule: Rule
    loop: ExplorationLoopConfig = ExplorationLoopConfig()  # settings of the loop

    def __call__(self, context: ExplorerContext, seed: int) -> BatchedExplorer:  # noqa: ARG002 - no rule draws
        """Make the explorer."""
        return FrontierExplorer(context, self.rule, self.loop)


CLASSICAL: dict[str, HandWritten] = {
    "explore_lite": HandWritten(ExploreLite(), EXPLORE_LITE_LOOP),
    "nearest": HandWritten(Nearest()),
    "cost_utility": HandWritten(CostUtility()),
    "next_best_view": HandWritten(NextBestView()),
    "tour": HandWritten(FrontierTour()),
    "repairman": HandWritten(Repairman()),
}
"""Hand-written rules: neither learned, nor the oracle, nor the random walk."""

EXPLORERS: Mapping[str, Callable[[ExplorerContext, int], BatchedExplorer]] = {
    **CLASSICAL,
    "rl": lambda context, seed: LearnedExplorer(context),  # noqa: ARG005 - the best score is taken
    "wheels": lambda context, seed: WheelsExplorer(context),  # noqa: ARG005 - the best action is taken
    "random": RandomWalk,
    "teleop": Teleop,
}
"""Name to constructor; each takes the context and a seed, which only the random walk and the teleop driver use."""


def make_explorer(name: str, context: "ExplorerContext", seed: int = 0) -> "BatchedExplorer":
    """Build an explorer.

    Args:
        name: One of :data:`EXPLORERS`, ``rl:FILE`` or ``wheels:FILE`` for weights that ``slamgym agents train``
            wrote.
        context: What the environment says about the robot and its map.
        seed: Of the explorer's own random choices; only the random walk and the teleop driver make any.

    Raises:
        ConfigError: If there is no explorer of that name; the error suggests the nearest.
        InputFileError: If the weights can't be used.
    """
    if name.startswith("rl:"):
        return LearnedExplorer(context, name.removeprefix("rl:"))
    if name.startswith("wheels:"):
        return WheelsExplorer(context, name.removeprefix("wheels:"))
    if name not in EXPLORERS:
        raise ConfigError(f"no explorer {name!r}; {suggest(name, EXPLORERS)}")
    return EXPLORERS[name](context, seed)
