"""What explorers do: one exploration of each kind, and what each decides along a drive that it doesn't steer.

The drive is the same whatever is decided, so that a decision can't change what is seen later: where a trace differs,
the explorer decides otherwise about the same maps.
"""

import numpy as np
import pytest

from slamgym.agents.registry import EXPLORERS, make_explorer
from slamgym.cad import open_plans
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.slam import SlamConfig

SOURCE = "procedural:home:3"
PLAN = "home_3_00003"
TRUE_POSES = ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer()
KINDS = ("nearest", "rl", "wheels", "random", "simulated_operator")
"""A rule, a network that ranks frontiers, one that drives the wheels, chance, and an imitated person."""
DRIVE = ((0.0, 1.0, 35), (0.4, 0.0, 8), (0.0, -1.0, 15), (-0.4, 0.0, 8), (0.0, 1.0, 30))
"""Shares of the greatest speed and turning rate, and for how many control steps."""


@pytest.fixture(scope="module")
def plan():
    return open_plans(SOURCE).load(PLAN)


@pytest.mark.parametrize("name", KINDS)
def test_an_exploration(golden, plan, name):
    env = ExploreEnv(plan, TRUE_POSES, time_limit=150.0)
    explorer = make_explorer(name, env.explorer_context(), 5)
    observation, info = env.reset(seed=5)
    actions = []
    over = False
    while not (over or explorer.finished):
        action, _ = explorer.predict(observation)
        actions.append(action)
        observation, _, _, over, info = env.step(action)
    measured = {
        "actions": len(actions),
        "finished": explorer.finished,
        "path length": round(info["path_length"], 6),
        "coverage": round(info["coverage"], 6),
        "actions digest": golden.rounded_digest(actions),
    }
    golden.check(f"exploration/{name}", measured)


@pytest.mark.parametrize("name", EXPLORERS)
def test_decisions_along_a_given_drive(golden, plan, name):
    env = ExploreEnv(plan, TRUE_POSES, time_limit=150.0)
    explorer = make_explorer(name, env.explorer_context(), 5)
    observation, info = env.reset(seed=5)
    decisions = []
    for linear, angular, steps in DRIVE:
        for _ in range(steps):
            decisions.append(explorer.predict(observation)[0])
            observation, _, _, _, info = env.step(np.array([linear, angular], np.float32))
    assert info["collisions"] == 0, "the drive is meant to touch nothing"
    mean_linear, mean_angular = np.mean(decisions, axis=0, dtype=np.float64).tolist()
    measured = {
        "mean speed": round(mean_linear, 4),
        "mean turning rate": round(mean_angular, 4),
        "decisions": golden.rounded_digest(decisions),
    }
    golden.check(f"decisions/{name}", measured)
