"""The trained explorer: the decisions of ``slamgym/ExploreFrontiers-v0`` made by a network, without torch."""

from pathlib import Path

from slamgym.agents.explorer import BatchedExplorer, Exploration, Observation
from slamgym.agents.pretrained_policy import PRETRAINED, read_policy
from slamgym.agents.scoring import FrontierScorer
from slamgym.core.types import Twist2D
from slamgym.envs.frontier_features import FrontierFeatures
from slamgym.planning.context import ExplorerContext
from slamgym.planning.frontier_driver import DriverConfig, FrontierDriver


class _Learned(Exploration):
    """One exploration; what it learned on and what it does here go through the same driver and features."""

    def __init__(self, context: ExplorerContext, config: DriverConfig, scorer: FrontierScorer) -> None:
        self._driver = FrontierDriver(context, config)
        self._features = FrontierFeatures(config.max_candidates)
        self._scorer = scorer

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Exploration.act`."""
        driver = self._driver
        is_due = driver.observe(observation)
        while is_due:
            choice = self._scorer.choose(self._features.observe(driver))
            self.decisions += 1
            is_due = not driver.choose(choice) and bool(driver.candidates)
        self.finished = driver.finished
        return driver.command()


class LearnedExplorer(BatchedExplorer):
    """Chooses frontiers by a trained network.

    Args:
        context: What the environment tells about the robot and its map.
        policy: Weights, as ``slamgym agents train`` writes them; by default those that come with the package.
        config: How frontiers are offered and driven to.
        seed: Unused: the best score is taken.

    Attributes:
        fingerprint: Short hash of the weights.

    Raises:
        InputFileError: If the weights are missing, damaged, or made for other observations.
    """

    def __init__(
        self,
        context: ExplorerContext,
        policy: Path | str = PRETRAINED,
        config: DriverConfig | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(context, seed)
        self.config = config or DriverConfig()
        file = read_policy(policy)
        self.fingerprint = file.fingerprint
        self._scorer = file.scorer()

    def _begin(self, index: int) -> Exploration:  # noqa: ARG002 - every environment begins alike
        return _Learned(self.context, self.config, self._scorer)
