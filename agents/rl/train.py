"""Train a policy that chooses frontiers: its environments, its network, and validation."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from slamgym import __version__
from slamgym.agents.pretrained_policy import write_policy
from slamgym.agents.rl.environments import explore_plan, make_env, mean_figures
from slamgym.agents.rl.policy import FrontierPolicy
from slamgym.agents.rl.run import PolicyLearner, learn_policy
from slamgym.agents.rl.train_config import FURNISHED, TrainConfig
from slamgym.cad import FloorPlan
from slamgym.core.config import to_dict
from slamgym.sim import ClutterConfig

_EPISODE = ("time", "path_length", "coverage", "collisions", "map_error", "pose_error")
"""Further columns of the log of episodes."""


def train(config: TrainConfig, out: Path) -> PPO:
    """Train a policy that chooses frontiers; :func:`~slamgym.agents.rl.run.learn_policy` says the rest."""
    return learn_policy(FrontierLearner(config), out)


class FrontierLearner(PolicyLearner[TrainConfig]):
    """Chooses frontiers."""

    unit = "step"
    logged: ClassVar[Mapping[str, str]] = {
        "rollout/episode_seconds": "time",
        "rollout/episode_metres": "path_length",
        "rollout/episode_coverage": "coverage",
    }

    def make(self, plans: Sequence[FloorPlan]) -> PPO:
        """The learner on its environments."""
        config = self.config

        def maker(clutter: ClutterConfig) -> Callable[[], gym.Env[Any, Any]]:
            def make() -> gym.Env[Any, Any]:
                env = make_env(config, list(plans), clutter=clutter)
                return Monitor(env, info_keywords=_EPISODE)

            return make

        furnished = round(config.furnished * config.num_envs)
        makers = [maker(FURNISHED)] * furnished
        makers += [maker(ClutterConfig())] * (config.num_envs - furnished)
        envs = (
            DummyVecEnv(makers)
            if config.workers == 1
            else SubprocVecEnv(makers, start_method="fork")
        )
        envs.seed(config.seed)
        # Decisions last unlike long: without discount their returns are exact, and the reward charges for time.
        return self.ppo(FrontierPolicy, envs, discount=1.0)

    def validate(self, policy: Path, plans: Sequence[FloorPlan]) -> dict[str, float]:
        """Means over validation plans, empty and furnished ones in turns where the run has both.

        The score is the time to 95 and 99 % of the floor.
        """
        config = self.config
        clutters = [ClutterConfig(), FURNISHED] if config.furnished else [ClutterConfig()]
        trials = [
            explore_plan(config, policy, plan, i, clutter=clutters[i % len(clutters)])
            for i, plan in enumerate(plans)
        ]
        means = mean_figures(trials)
        return {**means, "score": means["time_95"] + means["time_99"]}

    def export(self, model: PPO, path: Path) -> None:
        """Write the weights as ``slamgym generate --explorer rl`` reads them."""
        network: Any = model.policy.features_extractor.network
        weights = {
            name: value.detach().cpu().numpy() for name, value in network.state_dict().items()
        }
        about = {
            "version": __version__,
            "steps": model.num_timesteps,
            "training": to_dict(self.config),
        }
        write_policy(path, weights, about)
