"""Explorers by name: a rule, and settings of the exploration loop where its source has its own."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from slamgym.agents.explorer import BatchedExplorer, FrontierExplorer, Rule
from slamgym.agents.pretrained_policy import FRONTIER_POLICY, LearnedExplorer, policy_loop
from slamgym.agents.random_walk import RandomWalk
from slamgym.agents.rules import (
    EXPLORE_LITE_LOOP,
    TOUR_LOOP,
    WIDE_TOUR_LOOP,
    Auction,
    CostUtility,
    ExploreLite,
    FrontierTour,
    Nearest,
    NextBestView,
)
from slamgym.agents.selective_tour import SelectiveTour
from slamgym.agents.simulated_operator import SimulatedOperator
from slamgym.agents.wheels import WheelsExplorer
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.names import is_own_explorer, own_function
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoopConfig
from slamgym.planning.promise import Promise, split_promise

Make = Callable[[ExplorerContext, int, Promise | None], BatchedExplorer]
"""Makes an explorer of the context, a seed and a promise."""


def by_rule(rule: Rule, loop: ExplorationLoopConfig | None = None) -> Make:
    """Explorers by a hand-written rule, with their own settings of the loop."""

    def make(context: ExplorerContext, seed: int, promise: Promise | None) -> BatchedExplorer:  # noqa: ARG001 - no rule draws
        return FrontierExplorer(
            context, rule, replace(loop or ExplorationLoopConfig(), promise=promise)
        )

    return make


CLASSICAL: dict[str, Make] = {
    "explore_lite": by_rule(ExploreLite(), EXPLORE_LITE_LOOP),
    "nearest": by_rule(Nearest()),
    "auction": by_rule(Auction()),
    "cost_utility": by_rule(CostUtility()),
    "next_best_view": by_rule(NextBestView()),
    "tour": by_rule(FrontierTour(), TOUR_LOOP),
    "tour_wide": by_rule(FrontierTour(), WIDE_TOUR_LOOP),
}
"""Hand-written rules: neither learned, nor the oracle, nor the random walk."""

OWN_END = ("explore_lite", "wheels", "random", "simulated_operator")
"""Explorers that end as their source does: they promise nothing."""

EXPLORERS: Mapping[str, Make] = {
    **CLASSICAL,
    "rl": lambda context, seed, promise: SelectiveTour(  # noqa: ARG005 - it draws nothing
        context, replace(TOUR_LOOP, promise=promise)
    ),
    "frontier_policy": lambda context, seed, promise: LearnedExplorer(  # noqa: ARG005 - the best is chosen
        context, FRONTIER_POLICY, policy_loop(promise)
    ),
    "wheels": lambda context, seed, promise: WheelsExplorer(context),  # noqa: ARG005 - the best action is taken
    "random": lambda context, seed, promise: RandomWalk(context, seed),  # noqa: ARG005 - it never ends
    "simulated_operator": lambda context, seed, promise: SimulatedOperator(context, seed),  # noqa: ARG005 - a person ends it
}
"""Name to constructor; each takes the context, a seed, which only the random walk and the simulated operator use, and a
promise."""


def make_explorer(
    name: str, context: "ExplorerContext", seed: int = 0, promise: Promise | None = None
) -> "BatchedExplorer":
    """Build an explorer.

    Args:
        name: One of :data:`EXPLORERS`, or ``rl:FILE`` or ``wheels:FILE`` for weights that ``slamgym agents train``
            wrote, or ``module:function`` for your own constructor, called as those of :data:`EXPLORERS`. What
            follows an ``@`` is a promise, as in ``rl@98%:95%``: the explorer stops when the map keeps it.
        context: What the environment says about the robot and its map.
        seed: Of the explorer's own random choices; only the random walk and the simulated operator make any.
        promise: For a name without one; those of :data:`OWN_END` pass it over.

    Raises:
        ConfigError: If there is no explorer of that name, the error suggests the nearest, or it can't promise anything.
        InputFileError: If the weights can't be used.
    """
    base, own = split_promise(name)
    promise = own or promise
    if base in OWN_END:
        if own is not None:
            raise ConfigError(
                f"{base} ends as its source does and promises nothing; leave {name[len(base) :]!r} out"
            )
        promise = None
    kind, _, path = base.partition(":")
    if path and kind == "rl":
        return LearnedExplorer(context, path, policy_loop(promise))
    if path and kind == "wheels":
        return WheelsExplorer(context, path)
    if is_own_explorer(base):
        return _own(base, context, seed, promise)
    if base not in EXPLORERS:
        raise ConfigError(f"no explorer {base!r}; {suggest(base, EXPLORERS)}")
    return EXPLORERS[base](context, seed, promise)


def _own(
    spec: str, context: ExplorerContext, seed: int, promise: Promise | None
) -> BatchedExplorer:
    """An explorer that a function of the user's own makes."""
    try:
        explorer: BatchedExplorer = own_function(spec, "the explorer")(context, seed, promise)
    except TypeError as error:
        raise ConfigError(
            f"the explorer {spec!r} can't be made ({error}); its function takes context, seed and promise"
        ) from error
    for name in ("predict", "finished", "decisions", "fingerprint"):
        if not hasattr(explorer, name):
            raise ConfigError(
                f"the explorer {spec!r} makes a {type(explorer).__name__}, which has no {name!r}"
            )
    return explorer
