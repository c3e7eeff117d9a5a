"""Reinforcement learning: your own reward, a policy that learns it, and its evaluation.

Needs the extra `agents`. Run: ``python examples/own_reward.py [STEPS]``
"""

import sys

import gymnasium as gym
from stable_baselines3 import PPO

import slamgym  # noqa: F401 - registers the environments
from slamgym.envs import StepRecord


def keep_moving(step: StepRecord) -> float:
    """Metres driven in this step, less a metre for a step in contact."""
    return step.distance - 1.0 * step.contact


def make_env() -> gym.Env:
    """Three actions (ahead, left, right), known pose, and the reward above beside the usual ones."""
    env = gym.make(
        "slamgym/ExploreDiscrete-v2",
        localization="ground_truth",
        time_limit=60.0,
        reward_terms={"keep_moving": (0.5, keep_moving)},
    )
    return gym.wrappers.FlattenObservation(env)


def explore(model: PPO, seed: int) -> tuple[float, float]:
    """One exploration by the policy: share of the floor seen, metres of the reward's own term."""
    env = make_env()
    observation, info = env.reset(seed=seed)
    moved, ended = 0.0, False
    while not ended:
        action, _ = model.predict(observation, deterministic=False)
        observation, _, terminated, truncated, info = env.step(action)
        moved += info["reward_terms"]["keep_moving"]
        ended = terminated or truncated
    return info["coverage"], moved


def main(steps: int) -> None:
    """Learn, then explore a building that was not learned on."""
    model = PPO("MlpPolicy", make_env(), n_steps=256, batch_size=64, seed=1)
    before = explore(model, seed=7)
    model.learn(steps)
    after = explore(model, seed=7)
    for name, (coverage, moved) in (("before", before), ("after", after)):
        print(f"{name} {steps} steps: {coverage:.0%} seen, {moved:.1f} of keep_moving")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
