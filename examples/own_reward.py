"""Reinforcement learning: your own reward, a policy that learns it, and its test against a random walk.

Needs the extra `agents`. Run: ``python examples/own_reward.py [DECISIONS] [HOMES]``
"""

import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from slamgym.agents import make_explorer
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.rl.batch_vec_env import BatchVecEnv
from slamgym.cad import FloorPlan
from slamgym.core.intervals import mean_interval
from slamgym.envs import ExploreConfig, ExploreEnv, StepRecord
from slamgym.envs.batch.env import BatchExploreEnv

HOLD = 3
"""An action holds for so many control steps: 0.6 s."""
LOOKED_AT = 89
"""The policy sees so many numbers, the last of the observation: 60 ranges of the scan, speed and turning rate, and 27
on which ways lead to unknown floor. The map's picture before them takes longer to learn."""


def keep_moving(step: StepRecord) -> float:
    """Metres driven in this step, less a metre for a step in contact."""
    return step.distance - 1.0 * step.contact


ENVIRONMENT = {
    "localization": "ground_truth",
    "time_limit": 60.0,
    "reward_terms": {"keep_moving": (0.5, keep_moving)},
}
"""Poses are true, and the reward above counts beside the usual one."""
DRIVING = {**ENVIRONMENT, "actions": "discrete", "observation": {"preset": "compact_far"}}
"""Three actions (ahead, left, right), and a vector as observation."""


class Look(BaseFeaturesExtractor):
    """What the policy sees."""

    def __init__(self, space: gym.Space) -> None:
        super().__init__(space, LOOKED_AT)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Shape (batch, LOOKED_AT)."""
        return observations[:, -LOOKED_AT:]


def explore(
    env: ExploreEnv, act: Callable[[Any], Any], seed: int, hold: int
) -> tuple[float, float]:
    """Share of the floor seen in a minute, and the sum of the reward's own term."""
    observation, info = env.reset(seed=seed)
    moved, is_over, step = 0.0, False, 0
    while not is_over:
        if step % hold == 0:
            action = act(observation)
        observation, _, terminated, truncated, info = env.step(action)
        moved += info["reward_terms"]["keep_moving"]
        is_over = terminated or truncated
        step += 1
    return info["coverage"], moved


def drive(model: PPO, plans: list[FloorPlan]) -> np.ndarray:
    """What a policy reaches in each building, shape (buildings, 2)."""
    return np.array(
        [
            explore(ExploreEnv(plan, **DRIVING), lambda seen: model.predict(seen)[0], seed, HOLD)
            for seed, plan in enumerate(plans)
        ]
    )


def walk(plans: list[FloorPlan]) -> np.ndarray:
    """The same by a random walk: straight on, and to a random heading where something is near."""
    found = []
    for seed, plan in enumerate(plans):
        env = ExploreEnv(plan, ExploreConfig().for_explorer(), **ENVIRONMENT)
        explorer = make_explorer("random", env.explorer_context(), seed)
        found.append(explore(env, lambda seen, by=explorer: by.predict(seen)[0], seed, 1))
    return np.array(found)


def main(decisions: int, homes: int) -> None:
    """Learn in generated homes; explore others before and after, and by a random walk."""
    torch.set_num_threads(1)
    envs = BatchExploreEnv(
        16, draw_plans(["procedural:home"], "train", 200), autoreset_mode="same_step", **DRIVING
    )
    model = PPO(
        "MlpPolicy",
        BatchVecEnv(envs, HOLD),
        n_steps=128,
        batch_size=256,
        n_epochs=5,
        learning_rate=1e-3,
        gamma=0.98,
        ent_coef=0.01,
        policy_kwargs={"features_extractor_class": Look},
        seed=1,
        device="cpu",
    )
    plans = draw_plans(["procedural:home"], "test", homes)
    before = drive(model, plans)
    model.learn(decisions)
    results = {"random walk": walk(plans), "before": before, "after": drive(model, plans)}
    for name, found in results.items():
        seen, moved = found.mean(axis=0)
        print(f"{name}: {seen:.0%} seen, {moved:.1f} of keep_moving")
    more = mean_interval(100.0 * (results["after"] - results["random walk"])[:, 0])
    print(
        f"{more.value:.0f} [{more.low:.0f}, {more.high:.0f}] points more than the random walk "
        f"after {decisions} decisions"
    )


if __name__ == "__main__":
    given = [int(argument) for argument in sys.argv[1:]]
    main(*given, *(50_000, 40)[len(given) :])
