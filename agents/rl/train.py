"""Train a policy that chooses frontiers: its environments, its network, and validation."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import torch
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from slamgym.agents.pretrained_policy import read_policy, write_policy
from slamgym.agents.rl.environments import explore_plan, make_env, mean_figures
from slamgym.agents.rl.policy import FrontierPolicy
from slamgym.agents.rl.run import PolicyLearner, learn_policy
from slamgym.agents.rl.train_config import FURNISHED, STARTS, TrainConfig
from slamgym.agents.rl.whole_episodes import WholeEpisodeBuffer, WholeEpisodeRollouts, WholeEpisodes
from slamgym.cad import FloorPlan
from slamgym.envs.config import ExploreConfig
from slamgym.envs.plan_cache import PlanCache
from slamgym.envs.rewards import RewardTerms
from slamgym.sim import ClutterConfig

_EPISODE = ("time", "path_length", "coverage", "collisions", "map_error", "pose_error")
"""Further columns of the log of episodes."""


def train(
    config: TrainConfig, out: Path, reward_terms: RewardTerms | None = None
) -> OnPolicyAlgorithm:
    """Train a policy that chooses frontiers; :func:`~slamgym.agents.rl.run.learn_policy` says the rest."""
    return learn_policy(FrontierLearner(config, reward_terms), out)


class FrontierLearner(PolicyLearner[TrainConfig]):
    """Chooses frontiers.

    Args:
        config: The run.
        reward_terms: Terms of the user's own.

    Raises:
        InputFileError: If the weights that it starts from can't be read, or are of another network.
    """

    unit = "decision"
    logged: ClassVar[Mapping[str, str]] = {
        "rollout/episode_seconds": "time",
        "rollout/episode_metres": "path_length",
        "rollout/episode_coverage": "coverage",
    }

    def __init__(self, config: TrainConfig, reward_terms: RewardTerms | None = None) -> None:
        super().__init__(config)
        self._terms = reward_terms
        self._begin = None if config.start in STARTS else read_policy(config.start)[0]

    def make(self, plans: Sequence[FloorPlan]) -> OnPolicyAlgorithm:
        """The learner on its environments."""
        config = self.config
        hyperparameters = config.learner.hyperparameters
        most_decisions = int(hyperparameters.get("n_steps", 250))

        # In one process they share what is computed of a building.
        sites: Any = list(plans)
        if config.workers == 1:
            simulation = ExploreConfig()
            sites = PlanCache(plans, simulation.robot, simulation.lidar.surfaces)

        def maker(clutter: ClutterConfig) -> Callable[[], gym.Env[Any, Any]]:
            def make() -> gym.Env[Any, Any]:
                env = WholeEpisodes(make_env(config, sites, clutter, self._terms), most_decisions)
                return Monitor(env, info_keywords=_EPISODE)

            return make

        groups = config.num_envs // config.copies
        furnished = config.copies * round(config.furnished * groups)
        makers = [maker(FURNISHED)] * furnished
        makers += [maker(ClutterConfig())] * (config.num_envs - furnished)
        envs = (
            DummyVecEnv(makers)
            if config.workers == 1
            else SubprocVecEnv(makers, start_method="fork")
        )
        envs.seed(config.seed)
        discount = float(hyperparameters.get("gamma", 1.0))
        model = self.learner(
            FrontierPolicy,
            envs,
            WholeEpisodeRollouts,
            rollout_buffer_class=WholeEpisodeBuffer,
            rollout_buffer_kwargs={"copies": config.copies, "discount": discount},
        )
        network: Any = model.policy.features_extractor.network
        if config.start == "tour":
            network.follow_the_tour()
        if self._begin is not None:
            weights = {name: torch.tensor(value) for name, value in self._begin.items()}
            network.load_state_dict(weights)
        return model

    def validate(self, policy: Path, plans: Sequence[FloorPlan]) -> dict[str, float]:
        """Means over validation plans, empty and furnished ones in turns where the run has both.

        The score is the time until *done*, where a failure counts as the time limit.
        """
        config = self.config
        clutters = [ClutterConfig(), FURNISHED] if config.furnished else [ClutterConfig()]
        trials = [
            explore_plan(config, policy, plan, i, clutter=clutters[i % len(clutters)])
            for i, plan in enumerate(plans)
        ]
        means = mean_figures(trials)
        return {**means, "score": means["time_done"]}

    def export(self, model: OnPolicyAlgorithm, path: Path) -> None:
        """Write the weights as ``slamgym generate --explorer rl:FILE`` reads them."""
        network: Any = model.policy.features_extractor.network
        weights = {name: value.numpy() for name, value in network.state_dict().items()}
        write_policy(path, weights, self.about(model))
