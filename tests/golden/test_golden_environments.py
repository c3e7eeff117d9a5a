"""Observations, rewards and ends of both environments under fixed actions."""

import numpy as np
import pytest

from slamgym.cad import open_plans
from slamgym.envs import ExploreEnv, ExploreFrontiersEnv

HARD = {"odometry": "high", "lidar": "lds01", "clutter": {"furniture": 0.5, "people": 2}}
REWARDS = {"coverage_gain": 10.0, "map_error": 1.0, "shaping": 2.0}
SETTINGS = {
    "defaults": {},
    "hard": HARD,
    "global map": {"observation": {"map": "global"}, "slam": {"mode": "rbpf", "particles": 1}},
    "discrete": {"actions": "discrete", "localization": "ground_truth", "reward": REWARDS},
}


def digest(golden, observations):
    """One digest for each key over all observations."""
    digests = {}
    for key, first in observations[0].items():
        of = golden.digest if first.dtype == np.uint8 else golden.rounded_digest
        digests[key] = golden.digest(" ".join(of(item[key]) for item in observations).encode())
    return digests


@pytest.mark.parametrize("name", SETTINGS)
def test_explore_env(golden, name):
    env = ExploreEnv(open_plans("bundled"), **SETTINGS[name])
    observation, info = env.reset(seed=21)
    env.action_space.seed(3)
    plan, observations, rewards, terms = info["plan"], [observation], [], []
    action = env.action_space.sample()
    for step in range(100):
        action = env.action_space.sample() if step % 5 == 0 else action  # 1 s each
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        terms.append(info["reward_terms"])
        if terminated or truncated:
            break
    measured = {
        "plan": plan,
        "steps": len(rewards),
        "reward": round(float(np.sum(rewards)), 6),
        "rewards": golden.rounded_digest(rewards),
        "terms": {key: round(float(sum(term[key] for term in terms)), 6) for key in terms[0]},
        "observations": digest(golden, observations[::4]),
        "coverage": round(info["coverage"], 6),
        "pose error": round(info["pose_error"], 6),
        "map error": round(env.map_error(), 6),
        "collisions": info["collisions"],
        "last": [round(float(value), 6) for value in info["true_pose"]],
    }
    golden.check(f"environment/{name}", measured)


def test_explore_frontiers_env(golden):
    plans = open_plans("procedural:home:8")
    env = ExploreFrontiersEnv(plans, discount=0.99, localization="ground_truth", time_limit=200.0)
    observation, info = env.reset(seed=4, options={"plan": "home_8_00004"})
    rng = np.random.default_rng(9)
    observations, steps, over = [observation], [], False
    while not over and len(steps) < 6:
        choice = int(rng.choice(np.flatnonzero(observation["mask"])))
        observation, reward, terminated, truncated, info = env.step(choice)
        observations.append(observation)
        steps.append([choice, round(reward, 6), round(info["duration"], 6)])
        over = terminated or truncated
    measured = {
        "choice, reward, duration": steps,
        "observations": digest(golden, observations),
        "coverage": round(info["coverage"], 6),
        "terminated": terminated,
        "truncated": truncated,
        "last": [round(float(value), 6) for value in info["true_pose"]],
    }
    golden.check("environment/frontiers", measured)
