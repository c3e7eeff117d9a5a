"""The trained explorer: the decisions of ``slamgym/ExploreFrontiers-v1`` made by a network, without torch."""

from pathlib import Path

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot, Pilot
from slamgym.agents.pretrained_policy import PRETRAINED, read_policy
from slamgym.core.config import config_hash
from slamgym.envs.frontier_features import FrontierFeatures
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoopConfig


class LearnedExplorer(BatchedExplorer):
    """Chooses frontiers by a trained network, on the loop and the features that it learned with.

    Args:
        context: What the environment says about the robot and its map.
        policy: Weights, as ``slamgym agents train`` writes them; by default those that come with the package.
        config: How frontiers are offered and driven to.

    Raises:
        InputFileError: If the weights are missing, damaged, or made for other observations.
    """

    def __init__(
        self,
        context: ExplorerContext,
        policy: Path | str = PRETRAINED,
        config: ExplorationLoopConfig | None = None,
    ) -> None:
        self.config = config or ExplorationLoopConfig()
        file = read_policy(policy)
        self._scorer, self._extra = file.scorer(), file.network.extra_features
        super().__init__(context, f"{file.fingerprint}-{config_hash(self.config)}")

    def _begin(self, index: int) -> Pilot:  # noqa: ARG002 - every environment begins alike
        features = FrontierFeatures(self.config.max_candidates, self._extra)
        return FrontierPilot(
            self.context, self.config, lambda loop: self._scorer.scores(features.observe(loop))
        )
