"""Train the wheels: PPO on a batch of environments, validated on plans that it doesn't learn on."""

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn

from slamgym import __version__
from slamgym.agents.rl.batch_vec_env import BatchVecEnv
from slamgym.agents.rl.run_folder import begin_run, go_on, learn, log_into_run
from slamgym.agents.rl.train_config import BEST, POLICY
from slamgym.agents.rl.training_callbacks import (
    LogEpisodes,
    SaveCheckpoints,
    append_validation,
    read_validation,
)
from slamgym.agents.rl.training_envs import draw_plans
from slamgym.agents.wheels.config import WheelsConfig
from slamgym.agents.wheels.policy import CLIP, WheelsPolicy, write_wheels
from slamgym.agents.wheels.validation import make_batch, validate_wheels
from slamgym.core.config import to_dict
from slamgym.core.progress import say

_LOGGED = {f"rollout/{key}": key for key in ("coverage", "collisions")}
CONTACT_PRICE = 0.02
"""What a contact in five minutes takes off the coverage when the best weights are chosen."""
_FIRST_SPEED, _FIRST_TURN = 0.9, 0.5
"""Shares of the largest speed and turning rate of the untrained network: it sees more than one that stands."""


class FirstLayer(BaseFeaturesExtractor):
    """The layer that action and value share."""

    def __init__(self, observation_space: Any, units: int) -> None:
        super().__init__(observation_space, units)
        self.layer = nn.Linear(observation_space.shape[0], units)

    def forward(self, observations: Tensor) -> Tensor:
        """Units, shape (B, units)."""
        return torch.relu(self.layer(observations))


def train_wheels(config: WheelsConfig, out: Path) -> PPO:
    """Train; the same command again goes on where the run was interrupted, with more ``steps`` beyond its end.

    Args:
        config: The run.
        out: Its folder: ``config.json``, ``log``, ``validation.csv``, ``checkpoint.pt``, ``policy.safetensors`` and, by
            validation, ``best.safetensors``.

    Raises:
        ConfigError: If the folder holds a run with other settings, or a setting makes no sense.
        InputFileError: If plans or the checkpoint can't be read.
    """
    torch.set_num_threads(1)
    begin_run(config, out, free=("steps",))
    plans = draw_plans(config.plans, "train", config.plan_count, config.seed)
    say(f"{len(plans)} floor plans, {sum(plan.area for plan in plans) / len(plans):.0f} m2 on average")
    batch = BatchVecEnv(
        make_batch(config, plans, config.num_envs), config.network.hold, config.episode_seconds, config.seed
    )
    envs = VecNormalize(batch, clip_obs=CLIP, clip_reward=CLIP, gamma=config.discount)
    model = make_learner(config, envs)
    go_on(model, out, config.seed, "decision")
    log_into_run(model, out)
    learn(model, envs, out, config.steps, lambda: _callbacks(config, out), "decision")
    write_wheels(out / POLICY, exported(config, model))
    return model


def _callbacks(config: WheelsConfig, out: Path) -> list[BaseCallback]:
    callbacks: list[BaseCallback] = [SaveCheckpoints(out, config.checkpoint_every), LogEpisodes(_LOGGED)]
    return [*callbacks, ValidateWheels(config, out)] if config.evaluate_every else callbacks


def make_learner(config: WheelsConfig, envs: VecNormalize) -> PPO:
    """The learner on its environments."""
    ppo, network = config.ppo, config.network
    model = PPO(
        "MlpPolicy",
        envs,
        **(to_dict(ppo) | {"learning_rate": lambda left: ppo.learning_rate * max(0.1, left)}),
        gamma=config.discount,
        seed=config.seed,
        device="cpu",
        policy_kwargs={
            "features_extractor_class": FirstLayer,
            "features_extractor_kwargs": {"units": network.first},
            "net_arch": {"pi": [network.second], "vf": [network.second]},
            "activation_fn": nn.ReLU,
            "log_std_init": math.log(0.5),
        },
    )
    _follow_the_way(model)
    return model


def _follow_the_way(model: PPO) -> None:
    """Let the untrained network drive ahead and turn where the shortest way leaves, its last input.

    Two units of each layer carry what lies left and what lies right to the turning rate.
    """
    policy: Any = model.policy
    layers = policy.features_extractor.layer, policy.mlp_extractor.policy_net[0]
    with torch.no_grad():
        for layer, columns, signs in zip(layers, ((-1, -1), (0, 1)), ((1.0, -1.0), (1.0, 1.0)), strict=True):
            for unit, (column, sign) in enumerate(zip(columns, signs, strict=True)):
                layer.weight[unit], layer.bias[unit] = 0.0, 0.0
                layer.weight[unit, column] = sign
        policy.action_net.bias[0] = _FIRST_SPEED
        policy.action_net.weight[1, 0], policy.action_net.weight[1, 1] = _FIRST_TURN, -_FIRST_TURN


def exported(config: WheelsConfig, model: PPO) -> WheelsPolicy:
    """The policy without value and optimiser, with the normalisation of its observations."""
    policy: Any = model.policy
    parts = {
        "first": policy.features_extractor.layer,
        "second": policy.mlp_extractor.policy_net[0],
        "action": policy.action_net,
    }
    weights = {
        f"{name}.{kind}": getattr(part, kind).detach().cpu().numpy().copy()
        for name, part in parts.items()
        for kind in ("weight", "bias")
    }
    statistics: Any = model.get_vec_normalize_env().obs_rms
    weights |= {"mean": statistics.mean.astype(np.float32), "variance": statistics.var.astype(np.float32)}
    about: Mapping[str, Any] = {
        "version": __version__,
        "decisions": model.num_timesteps,
        "training": to_dict(config),
    }
    return WheelsPolicy(config.network, weights, about)


class ValidateWheels(BaseCallback):
    """Explores validation plans now and then, and keeps the weights of the best result.

    Args:
        config: The run.
        folder: Of the run.
    """

    def __init__(self, config: WheelsConfig, folder: Path) -> None:
        super().__init__()
        self._config, self._folder = config, folder
        self._plans = draw_plans(config.plans, "validation", config.evaluate_plans)
        rows = read_validation(folder)
        self._next = int(rows[-1]["steps"]) + config.evaluate_every if rows else config.evaluate_every
        self._best = max((_score(row) for row in rows), default=-math.inf)
        self._spent = rows[-1]["training_cpu_seconds"] if rows else 0.0
        self._clock = time.process_time()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if self.model.num_timesteps >= self._next:
            self._next += self._config.evaluate_every
            self._validate()

    def _on_training_end(self) -> None:
        self._validate()

    def _validate(self) -> None:
        model: Any = self.model
        policy = exported(self._config, model)
        spent = self._spent + time.process_time() - self._clock
        means = validate_wheels(self._config, policy.act, self._plans)
        for name, value in means.items():
            self.logger.record(f"validation/{name}", value)
        row = {"steps": model.num_timesteps, "training_cpu_seconds": round(spent, 1), **means}
        append_validation(self._folder, row)
        if _score(row) > self._best:
            self._best = _score(row)
            write_wheels(self._folder / BEST, policy)


def _score(row: Mapping[str, float]) -> float:
    return row["coverage"] - CONTACT_PRICE * row["contacts"]
