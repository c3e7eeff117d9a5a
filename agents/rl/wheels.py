"""Train a policy that drives the wheels: PPO on a batch of environments with normalised observations."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn

from slamgym.agents.rl.batch_vec_env import BatchVecEnv
from slamgym.agents.rl.environments import explore_plan, make_batch, mean_figures
from slamgym.agents.rl.run import PolicyLearner, learn_policy
from slamgym.agents.rl.train_config import DISCOUNT, HOLD, LAYER_UNITS, WheelsConfig
from slamgym.agents.wheels import CLIP, WHEELS_LAYERS, WheelsPolicy, write_wheels
from slamgym.cad import FloorPlan
from slamgym.envs.rewards import RewardTerms

EPISODE_SECONDS = (60.0, 600.0)
"""Shortest and longest episode [s]; each is cut off at a time drawn evenly between, and the value of what would have
followed counts."""
_CONTACT_PRICE = 10.0
"""Cost of a contact in five minutes when the best weights are chosen [s]."""
_FIRST_SPEED = 0.9
"""Speed of the untrained network, as a share of the largest: it sees more than one that stands."""
_FIRST_TURN = 0.5
"""Its turning rate towards the way, as a share of the largest."""


class FirstLayer(BaseFeaturesExtractor):
    """The layer that action and value share."""

    def __init__(self, observation_space: Any) -> None:
        super().__init__(observation_space, LAYER_UNITS[0])
        self.layer = nn.Linear(observation_space.shape[0], LAYER_UNITS[0])

    def forward(self, observations: Tensor) -> Tensor:
        """Units, shape (B, units)."""
        return torch.relu(self.layer(observations))


def train_wheels(
    config: WheelsConfig, out: Path, reward_terms: RewardTerms | None = None, avoids: bool = True
) -> OnPolicyAlgorithm:
    """Train a policy that drives the wheels; :func:`~slamgym.agents.rl.run.learn_policy` says the rest."""
    return learn_policy(WheelsLearner(config, reward_terms, avoids), out)


class WheelsLearner(PolicyLearner[WheelsConfig]):
    """Drives the wheels.

    Args:
        config: The run.
        reward_terms: Terms of the user's own.
        avoids: True if what the scan shows in the way is driven round, whatever the policy says.
    """

    unit = "decision"
    logged: ClassVar[Mapping[str, str]] = {
        "rollout/coverage": "coverage",
        "rollout/collisions": "collisions",
    }

    def __init__(
        self, config: WheelsConfig, reward_terms: RewardTerms | None = None, avoids: bool = True
    ) -> None:
        super().__init__(config)
        self._terms = reward_terms
        self._avoids = avoids

    def make(self, plans: Sequence[FloorPlan]) -> OnPolicyAlgorithm:
        """The learner on its environments."""
        config = self.config
        batch = make_batch(config, plans, self._terms)
        envs = BatchVecEnv(batch, HOLD, EPISODE_SECONDS, config.seed, self._avoids)
        discount = float(config.learner.hyperparameters.get("gamma", DISCOUNT))
        normalised = VecNormalize(envs, clip_obs=CLIP, clip_reward=CLIP, gamma=discount)
        layers = {
            "features_extractor_class": FirstLayer,
            "net_arch": {"pi": [LAYER_UNITS[1]], "vf": [LAYER_UNITS[1]]},
            "activation_fn": nn.ReLU,
            "log_std_init": math.log(0.5),
        }
        model = self.learner("MlpPolicy", normalised, policy_kwargs=layers)
        if config.start == "way":
            _follow_the_way(model)
        return model

    def validate(self, policy: Path, plans: Sequence[FloorPlan]) -> dict[str, float]:
        """Means over validation plans; the score is the time to 99 %, a contact costs :data:`_CONTACT_PRICE`."""
        trials = [
            explore_plan(self.config, policy, plan, seed, self._avoids)
            for seed, plan in enumerate(plans)
        ]
        means = mean_figures(trials)
        return {**means, "score": _CONTACT_PRICE * means["contacts"] + means["time_99"]}

    def export(self, model: OnPolicyAlgorithm, path: Path) -> None:
        """Write the weights as the explorer ``wheels`` reads them, with the normalisation of the observations."""
        statistics: Any = model.get_vec_normalize_env().obs_rms
        weights = {
            "mean": statistics.mean.astype(np.float32),
            "variance": statistics.var.astype(np.float32),
        }
        for name, layer in zip(WHEELS_LAYERS, _layers(model.policy), strict=True):
            for part, value in layer.state_dict().items():
                weights[f"{name}.{part}"] = value.numpy()
        write_wheels(path, WheelsPolicy(weights, self.about(model)))


def _layers(policy: Any) -> tuple[Any, Any, Any]:
    return policy.features_extractor.layer, policy.mlp_extractor.policy_net[0], policy.action_net


def _follow_the_way(model: OnPolicyAlgorithm) -> None:
    """Let the untrained network drive ahead and turn to the first leg of the shortest way, its last input.

    Two units of each layer carry what lies left and what lies right to the turning rate.
    """
    first, second, action = _layers(model.policy)
    with torch.no_grad():
        for layer in (first, second):
            layer.weight[:2] = 0.0
            layer.bias[:2] = 0.0
        first.weight[:2, -1] = torch.tensor([1.0, -1.0])
        second.weight[:2, :2] = torch.eye(2)
        action.bias[0] = _FIRST_SPEED
        action.weight[1, :2] = torch.tensor([_FIRST_TURN, -_FIRST_TURN])
