"""The environments of a training run."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from slamgym.agents.rl.learning_plans import StagedPlans
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.cad import FloorPlan
from slamgym.envs import ExploreEnv, RewardFunction
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

EPISODE_INFO = ("time", "path_length", "coverage", "collisions", "map_error", "pose_error")
"""What the log of episodes holds beside reward and length."""


class Staged(gym.Wrapper[Any, Any, Any, Any]):
    """Lets a curriculum change the plans of an environment; other processes are told by method calls.

    Args:
        env: The environment.
        plans: Its plans.
    """

    def __init__(self, env: gym.Env[Any, Any], plans: StagedPlans) -> None:
        super().__init__(env)
        self._plans = plans

    def set_stage(self, stage: int) -> None:
        """Draw the plans of the next episodes from a stage of the curriculum."""
        self._plans.set_stage(stage)

    def action_masks(self) -> Any:
        """What sb3-contrib asks for; only ``explore_frontiers`` has it."""
        return self.env.get_wrapper_attr("action_masks")()


def make_env(config: TrainConfig, plans: Any, **changes: Any) -> ExploreFrontiersEnv | ExploreEnv:
    """The environment that a configuration names, without wrappers.

    Args:
        config: The run.
        plans: Floor plans.
        **changes: Settings of the environment that differ from the run's.
    """
    settings: dict[str, Any] = {
        "localization": config.localization,
        "odometry": config.odometry,
        "slam": {"particles": config.particles},
        "reward": config.reward,
        "coverage_goal": config.coverage_goal,
        "time_limit": config.time_limit,
        **changes,
    }
    if config.env == "explore":
        return ExploreEnv(plans, **settings)
    settings["slam"] |= {"resolution": config.resolution}
    settings["observation"] = {"map_resolution": config.resolution}
    return ExploreFrontiersEnv(plans, **{"discount": config.discount, **settings})


def make_learning_envs(
    config: TrainConfig,
    plans: Sequence[FloorPlan],
    reward_terms: Mapping[str, tuple[float, RewardFunction]] | None = None,
) -> VecEnv:
    """All environments of a run, each with a seed of its own.

    Args:
        config: The run.
        plans: What to learn on.
        reward_terms: Terms of the user's own, name to (weight, function).
    """

    def maker() -> Callable[[], gym.Env[Any, Any]]:
        def make() -> gym.Env[Any, Any]:
            staged = StagedPlans(plans, config.curriculum)
            wrapped = Staged(make_env(config, staged, reward_terms=reward_terms), staged)
            keywords = EPISODE_INFO if config.env == "explore_frontiers" else EPISODE_INFO[1:]
            return Monitor(wrapped, info_keywords=keywords)

        return make

    makers = [maker() for _ in range(config.num_envs)]
    envs: VecEnv = DummyVecEnv(makers) if config.workers == 1 else SubprocVecEnv(makers, start_method="fork")
    envs.seed(config.seed)
    return envs
