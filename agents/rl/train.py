"""Train a policy by reinforcement learning: plans, environments, learner, and what is kept of the run.

Main path: :func:`train` draws the plans, makes the environments and the learner (or takes up a checkpoint),
lets it imitate an expert first where that is asked for, and learns to the end.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from slamgym import __version__
from slamgym.agents.pretrained_policy import PRETRAINED, read_policy, write_policy
from slamgym.agents.rl.checkpoint import save_checkpoint
from slamgym.agents.rl.imitation import imitate
from slamgym.agents.rl.policy import FrontierPolicy, MaskableFrontierPolicy
from slamgym.agents.rl.run_folder import begin_run, go_on, learn, log_into_run
from slamgym.agents.rl.semi_markov import MaskableSemiMarkovBuffer, SemiMarkovBuffer, SemiMarkovDiscounting
from slamgym.agents.rl.train_config import FURNISHED, POLICY, TrainConfig
from slamgym.agents.rl.training_callbacks import (
    FollowCurriculum,
    LogEpisodes,
    SaveCheckpoints,
    Validate,
)
from slamgym.agents.rl.training_envs import draw_plans, make_env, make_learning_envs
from slamgym.core.config import to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say
from slamgym.envs import RewardFunction

_LOGGED = {
    "rollout/episode_seconds": "time",
    "rollout/episode_metres": "path_length",
    "rollout/episode_coverage": "coverage",
}


def train(
    config: TrainConfig, out: Path, reward_terms: Mapping[str, tuple[float, RewardFunction]] | None = None
) -> BaseAlgorithm:
    """Train a policy; the same command again goes on where the run was interrupted.

    Args:
        config: The run.
        out: Its folder: ``config.json``, ``progress.csv`` and TensorBoard events, ``validation.csv``,
            ``checkpoint.pt``, ``policy.safetensors`` and, by validation, ``best.safetensors``.
        reward_terms: Terms of the reward of the user's own, name to (weight, function).

    Returns:
        The learner.

    Raises:
        ConfigError: If the folder holds a run with other settings, or a setting makes no sense.
        InputFileError: If plans or the checkpoint can't be read.
    """
    torch.set_num_threads(1)
    begin_run(config, out, free=("workers",))
    plans = draw_plans(config.plans, "train", config.plan_count, config.seed, config.largest_area)
    say(f"{len(plans)} floor plans, {sum(plan.area for plan in plans) / len(plans):.0f} m2 on average")
    envs = make_learning_envs(config, plans, reward_terms)
    model = _make_model(config, envs)
    is_resumed = go_on(model, out, config.seed, "step")
    if config.start_from and not is_resumed:
        _begin_with(config.start_from, model)
    if config.imitation.decisions and not is_resumed:
        imitate(model, config, plans, out)
        save_checkpoint(out, model)
    log_into_run(model, out)
    learn(model, envs, out, config.steps, lambda: _callbacks(config, out, model), "step")
    export_policy(config, model, out / POLICY)
    return model


def export_policy(config: TrainConfig, model: BaseAlgorithm, path: Path) -> None:
    """Write a frontier policy's weights without the optimiser, as ``slamgym generate --explorer rl`` reads them."""
    network: Any = model.policy.features_extractor.network
    weights = {name: value.detach().cpu().numpy() for name, value in network.state_dict().items()}
    about = {"version": __version__, "steps": model.num_timesteps, "training": to_dict(config)}
    write_policy(path, network.config, weights, about)


def _make_model(config: TrainConfig, envs: VecEnv) -> BaseAlgorithm:
    """The learner on its environments."""
    settings: dict[str, Any] = {
        **dataclasses.asdict(config.ppo),
        "gamma": config.discount,
        "seed": config.seed,
        "device": "cpu",
    }
    rate = config.ppo.learning_rate
    settings["learning_rate"] = lambda left: rate * left
    kwargs = {"policy_kwargs": {"network": config.network}, **settings}
    if config.algo == "ppo":
        return PPO(FrontierPolicy, envs, rollout_buffer_class=SemiMarkovBuffer, **kwargs)
    return MaskablePPO(MaskableFrontierPolicy, envs, rollout_buffer_class=MaskableSemiMarkovBuffer, **kwargs)


def _begin_with(start_from: str, model: BaseAlgorithm) -> None:
    """Replace the weights of a fresh frontier policy by those of an earlier run.

    Raises:
        ConfigError: If that run's network has other sizes.
        InputFileError: If the file is no frontier policy of this version.
    """
    found = read_policy(PRETRAINED if start_from == "pretrained" else start_from)
    network: Any = model.policy.features_extractor.network
    weights = {name: torch.from_numpy(value.copy()) for name, value in found.weights.items()}
    try:
        network.load_state_dict(weights)
    except RuntimeError:
        raise ConfigError(
            f"start_from {start_from}: its network is {found.network}, not {network.config}; give the same sizes"
        ) from None
    network.prefer_walls()


def _callbacks(config: TrainConfig, out: Path, model: BaseAlgorithm) -> list[BaseCallback]:
    callbacks: list[BaseCallback] = [
        FollowCurriculum(config),
        SaveCheckpoints(out, config.checkpoint_every),
        SemiMarkovDiscounting(),
        LogEpisodes(_LOGGED),
    ]
    if config.evaluate_every:
        plans = draw_plans(
            config.plans, "validation", config.evaluate_plans, largest_area=config.largest_area
        )
        envs = [make_env(config, plans, coverage_goal=None)]
        if config.furnished:
            envs.append(make_env(config, plans, coverage_goal=None, clutter=FURNISHED))
        callbacks.append(
            Validate(envs, plans, config.evaluate_every, out, lambda path: export_policy(config, model, path))
        )
    return callbacks
