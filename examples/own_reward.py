"""Reinforcement learning: your own reward, a policy that learns it, and its evaluation.

Needs the extra `agents`. Run: ``python examples/own_reward.py [STEPS] [EPISODES]``
"""

import sys

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO

import slamgym  # noqa: F401 - registers the environments
from slamgym.envs import StepRecord


def keep_moving(step: StepRecord) -> float:
    """Metres driven in this step, less a metre for a step in contact."""
    return step.distance - 1.0 * step.contact


def make_env(plans: str) -> gym.Env:
    """Three actions (ahead, left, right), a vector as observation, and the reward above beside the usual ones."""
    return gym.make(
        "slamgym/ExploreDiscrete-v4",
        plans=plans,
        localization="ground_truth",
        observation={"preset": "compact"},
        time_limit=60.0,
        reward_terms={"keep_moving": (0.5, keep_moving)},
    )


def explore(model: PPO, episodes: int) -> tuple[float, float]:
    """Means over buildings: share of the floor seen, sum of the reward's own term."""
    env, found = make_env("bundled"), []
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        moved, ended = 0.0, False
        while not ended:
            action, _ = model.predict(observation)
            observation, _, terminated, truncated, info = env.step(action)
            moved += info["reward_terms"]["keep_moving"]
            ended = terminated or truncated
        found.append((info["coverage"], moved))
    coverage, moved = np.mean(found, axis=0)
    return coverage, moved


def main(steps: int, episodes: int) -> None:
    """Learn on generated buildings; explore others before and after."""
    model = PPO("MlpPolicy", make_env("procedural"), n_steps=256, batch_size=64, seed=1)
    before = explore(model, episodes)
    model.learn(steps)
    after = explore(model, episodes)
    for name, (coverage, moved) in (("before", before), ("after", after)):
        print(f"{name} {steps} steps: {coverage:.0%} seen, {moved:.1f} of keep_moving")


if __name__ == "__main__":
    given = [int(argument) for argument in sys.argv[1:]]
    main(*given, *(20_000, 10)[len(given) :])
