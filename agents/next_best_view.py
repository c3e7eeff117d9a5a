"""Information gain: go where much of the unknown is seen for little driving.

Gonzalez-Banos and Latombe ("Navigation strategies for exploring indoor environments", IJRR 21(10-11), 2002)
score a view q by A(q) exp(-lambda L(q)), their eq. (2): A is the unknown area that may be seen from q through
the borders of the known free space, L the length of the path there.
"""

from collections.abc import Sequence

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Exploration
from slamgym.agents.view_exploration import Option, ViewConfig, ViewExploration
from slamgym.planning import ExplorerContext
from slamgym.planning.coarse_paths import CoarsePaths


class NextBestViewConfig(ViewConfig):
    """Settings of the next best view."""

    path_weight: float = 0.5
    """Lambda: how fast the worth of a view falls with the path [1/m]; 0.2 in the paper, which is for rooms and
    ranges three times as large."""


class _NextBestView(ViewExploration):
    """The largest gain, discounted by the path."""

    def __init__(self, context: ExplorerContext, config: NextBestViewConfig) -> None:
        super().__init__(context, config)
        self._lambda = config.path_weight

    def _order(self, options: Sequence[Option], paths: CoarsePaths) -> Sequence[int]:  # noqa: ARG002
        # The logarithm orders alike, and tells far views apart that the exponential rounds to 0.
        worth = [np.log(max(option.gain, 1e-3)) - self._lambda * option.length for option in options]
        return [int(i) for i in np.argsort(-np.array(worth), kind="stable")]


class NextBestView(BatchedExplorer):
    """Takes the view with the largest information gain for its path.

    The views are those from which a frontier is seen, one of each frontier; their gain is measured within the
    scanner's usable range and field.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.
        seed: Unused: nothing here is random.
    """

    def __init__(
        self, context: ExplorerContext, config: NextBestViewConfig | None = None, seed: int = 0
    ) -> None:
        super().__init__(context, seed)
        self.config = config or NextBestViewConfig()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _NextBestView(self.context, self.config)
