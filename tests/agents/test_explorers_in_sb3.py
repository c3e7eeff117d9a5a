"""Explorers under Stable-Baselines3's own evaluation, on the real environment."""

import dataclasses

import numpy as np
import pytest

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.slam import SlamConfig

evaluation = pytest.importorskip("stable_baselines3.common.evaluation")


def test_evaluate_policy_takes_an_explorer_and_a_vectorised_environment():
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    plans = open_plans("bundled")
    config = dataclasses.replace(
        ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer(), time_limit=20.0
    )
    context = ExploreEnv(plans, config).explorer_context()
    vector = VecMonitor(DummyVecEnv([lambda: ExploreEnv(plans, config)] * 2))
    vector.seed(1)
    explorer = make_explorer("nearest", context)
    rewards, lengths = evaluation.evaluate_policy(
        explorer, vector, n_eval_episodes=4, return_episode_rewards=True
    )
    assert len(rewards) == 4
    assert all(np.isfinite(rewards))
    assert (
        lengths == [100] * 4
    )  # 20 s of 0.2 s: the explorer doesn't end an episode, the environment does
