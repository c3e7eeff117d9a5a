"""Tours over all frontiers: not the nearest one first, but the first one of the best way through all.

:class:`FrontierTour` takes the shortest open tour, a travelling salesman's, which keeps the robot from leaving
small frontiers behind that it would have to come back for (Kulich, Faigl and Preucil, "On distance utility in
the exploration task", ICRA 2011). :class:`Repairman` takes the tour on which the unknown waits least: each
frontier waits until the robot gets there, weighted by the unknown area in sight from it. So small frontiers on
the way are taken along, and those that hide little and lie aside are left for the end.
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Exploration
from slamgym.agents.open_tour import EXACT_PLACES, open_tour, repairman_tour
from slamgym.agents.view_exploration import Option, ViewConfig, ViewExploration
from slamgym.core.config import Count, NonNegative, Positive, Within
from slamgym.core.types import FloatArray, IntArray
from slamgym.planning import ExplorerContext
from slamgym.planning.coarse_paths import CoarsePaths


class FrontierTourConfig(ViewConfig):
    """Settings of the tour."""

    turn_weight: float = 0.2
    """What a radian of turning before the first leg counts [m/rad]: the speed of 0.26 m/s over 1.2 rad/s."""
    max_places: Count = EXACT_PLACES
    """Only so many frontiers, the nearest, are ordered by the tour; the others come after."""


class RepairmanConfig(FrontierTourConfig):
    """Settings of the repairman's tour."""

    area_weight: NonNegative = 1.0
    """What a square metre of unknown in sight weighs while it waits [1/m2]."""
    wait_weight: Positive = 0.5
    """What any frontier weighs while it waits, however little it hides."""

    max_places: Annotated[int, Within(ge=1, le=EXACT_PLACES)] = EXACT_PLACES
    """Its tours are exact, so that there can be no more places."""


class _Tour(ViewExploration):
    """The first frontier of a tour through all."""

    def __init__(self, context: ExplorerContext, config: FrontierTourConfig) -> None:
        super().__init__(context, config)
        self._tour = config

    def _order(self, options: Sequence[Option], paths: CoarsePaths) -> Sequence[int]:
        config = self._tour
        near = sorted(range(len(options)), key=lambda i: options[i].length)
        toured, rest = near[: config.max_places], near[config.max_places :]
        places = np.array([options[i].candidate.target for i in toured])
        lengths = paths.matrix(self._pose, places)
        lengths[0, 1:] += config.turn_weight * np.array([options[i].turn for i in toured])
        order = self._through(lengths, [options[i] for i in toured])
        return [*(toured[i - 1] for i in order), *rest]

    def _through(self, lengths: FloatArray, options: Sequence[Option]) -> IntArray:  # noqa: ARG002 - for subclasses
        """Order of the options, 1 to N, by the lengths between robot and options."""
        return open_tour(lengths)


class _RepairmanTour(_Tour):
    """The first frontier of the tour on which the unknown waits least."""

    def __init__(self, context: ExplorerContext, config: RepairmanConfig) -> None:
        super().__init__(context, config)
        self._weights = config

    def _through(self, lengths: FloatArray, options: Sequence[Option]) -> IntArray:
        config = self._weights
        weights = np.array([config.wait_weight + config.area_weight * option.gain for option in options])
        return repairman_tour(lengths, weights)


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
        return _Tour(self.context, self.config)


class Repairman(BatchedExplorer):
    """Goes round all frontiers such that the unknown waits least, planned anew whenever one is done.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: RepairmanConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or RepairmanConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _RepairmanTour(self.context, self.config)
