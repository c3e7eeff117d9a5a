"""Decisions with the costs of their candidates, and networks that are fitted to them."""

import numpy as np
import pytest

from slamgym.envs.frontier_features import CANDIDATE_FEATURES, CROP_PX, GLOBAL_FEATURES

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from slamgym.agents.rl.imitation import (  # noqa: E402
    LARGEST_REGRET,
    CostedChoice,
    fit_choices,
    mean_regret,
)
from slamgym.agents.rl.policy import FrontierNetwork  # noqa: E402


def made_up(episodes, seed=0):
    """Decisions in which what a candidate costs is its detour, and besides 5 m where a doorway leads to it."""
    rng, found = np.random.default_rng(seed), []
    detour, doorway = (CANDIDATE_FEATURES.index(name) for name in ("tour_detour", "doorway"))
    for _ in range(episodes):
        for _ in range(20):
            count = int(rng.integers(2, 6))
            rows = rng.normal(0.0, 0.3, (7, len(CANDIDATE_FEATURES))).astype(np.float32)
            rows[:, detour] = rng.uniform(0.0, 1.0, 7)
            rows[:, doorway] = rng.random(7) < 0.5
            observation = {
                "candidates": rows,
                "crops": rng.random((7, 2, CROP_PX, CROP_PX)).astype(np.float32),
                "globals": rng.normal(size=len(GLOBAL_FEATURES)).astype(np.float32),
            }
            costs = (5.0 * rows[:, detour] + 5.0 * rows[:, doorway])[:count].astype(np.float64)
            found.append(CostedChoice.of(observation, costs))
    return found


def test_a_fitted_network_regrets_less_than_its_prior_on_decisions_that_it_has_not_seen():
    torch.manual_seed(0)
    network, others = FrontierNetwork(), made_up(10, seed=1)
    before = mean_regret(network, others)
    fit_choices(network, made_up(30), epochs=60, seed=0)
    after = mean_regret(network, others)
    assert before > 0.8
    assert after < 0.5 * before


def test_regrets_are_never_negative_and_one_of_each_decision_is_0():
    observation = {"candidates": np.zeros((3, 2)), "crops": np.zeros((3, 1)), "globals": np.zeros(1)}
    choice = CostedChoice.of(observation, np.array([7.0, 5.0, 1e5]))
    assert choice.regrets.tolist() == [2.0, 0.0, LARGEST_REGRET]
