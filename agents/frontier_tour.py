"""A tour over all frontiers: not the nearest one first, but the first one of the shortest way through all.

Ordering all frontiers by a travelling salesman's tour keeps the robot from leaving small ones behind that it
would have to come back for (Kulich, Faigl and Preucil, "On distance utility in the exploration task", ICRA
2011). The tour is open: the robot needn't return.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from agents.explorer import BatchedExplorer, Exploration
from agents.open_tour import EXACT_PLACES, open_tour, repairman_tour
from agents.view_exploration import Option, ViewConfig, ViewExploration
from slamgym.errors import ConfigError
from slamgym.planning import ExplorerContext
from slamgym.planning.coarse_paths import CoarsePaths


@dataclass(frozen=True)
class FrontierTourConfig(ViewConfig):
    """Settings of the tour."""

    turn_weight: float = 0.2
    """What a radian of turning before the first leg counts [m/rad]: 0.26 m/s over 1.2 rad/s."""
    max_places: int = EXACT_PLACES
    """Only so many frontiers, the nearest, are ordered by the tour; the others come after."""
    gain_weight: float = 0.0
    """What a square metre of unknown in sight weighs when a frontier waits [1/m2]; 0 for the shortest tour."""
    wait_weight: float = 0.0
    """What the waiting of any frontier weighs."""
    length_weight: float = 1.0
    """What the length of the tour weighs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_places < 1:
            raise ConfigError(f"max_places must be at least 1, not {self.max_places}")


class _FrontierTour(ViewExploration):
    """The first frontier of the shortest tour through all."""

    def __init__(self, context: ExplorerContext, config: FrontierTourConfig) -> None:
        super().__init__(context, config)
        self._tour = config

    def _order(self, options: Sequence[Option], paths: CoarsePaths) -> Sequence[int]:
        config = self._tour
        near = sorted(range(len(options)), key=lambda i: options[i].length)
        toured, rest = near[: config.max_places], near[config.max_places :]
        places = np.array([options[i].candidate.target for i in toured])
        lengths = paths.matrix(self._pose, places)
        turns = np.array([options[i].turn for i in toured])
        lengths[0, 1:] += config.turn_weight * turns
        weights = np.array([config.wait_weight + config.gain_weight * options[i].gain for i in toured])
        order = (
            repairman_tour(lengths, weights, config.length_weight) if weights.any() else open_tour(lengths)
        )
        return [*(toured[i - 1] for i in order), *rest]


class FrontierTour(BatchedExplorer):
    """Goes round all frontiers on the shortest tour, planned anew whenever one is done.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: FrontierTourConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or FrontierTourConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _FrontierTour(self.context, self.config)
