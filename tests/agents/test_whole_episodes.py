"""Rollouts of whole explorations: who waits, what is charged at the end, and the baseline of the copies."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from slamgym.agents.rl.environments import make_env
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.agents.rl.whole_episodes import (
    TRUTH,
    WholeEpisodeBuffer,
    WholeEpisodes,
    copies_baseline,
)
from slamgym.cad import open_plans
from slamgym.envs.rewards import MOST_MISSING
from slamgym.sim import ClutterConfig

CONFIG = TrainConfig(most_frontiers=6)


def make(most_decisions):
    plan = open_plans("procedural:home:3").load("home_3_00003")
    return WholeEpisodes(make_env(CONFIG, plan, ClutterConfig()), most_decisions)


def test_an_environment_waits_before_its_episode_and_after_it():
    env = make(3)
    observation, _ = env.reset()
    assert not any(value.any() for value in observation.values())
    assert env.step(0)[1:4] == (0.0, False, False)
    env.begin(5)
    observation, _ = env.reset()
    assert env.observation_space.contains(observation)
    assert observation["truth"][TRUTH.index("is_running")] == 1.0
    for _ in range(3):
        observation, reward, terminated, truncated, info = env.step(0)
    assert terminated  # after so many decisions
    assert not truncated
    assert reward < -3.0 * MOST_MISSING  # what is missing is charged, and the time of the drive
    assert info["coverage"] < 0.9
    left = observation["truth"][TRUTH.index("share_left")]
    assert left == pytest.approx(1.0 - info["coverage"], abs=1e-6)
    assert not env.step(0)[0]["mask"].any()
    assert not env.reset()[0]["mask"].any()


def test_copies_begin_alike():
    pair = [make(3), make(3)]
    for env in pair:
        env.begin(11)
    (one, _), (other, _) = (env.reset() for env in pair)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def test_the_baseline_is_what_the_others_still_got_where_as_much_was_left():
    left = np.array([[1.0, 1.0, 1.0], [0.5, 0.7, 0.4], [0.1, 0.4, 0.0], [0.0, 0.1, 0.0]])
    returns = np.array(
        [[-9.0, -8.0, -7.0], [-6.0, -7.0, -3.0], [-2.0, -4.0, 0.0], [0.0, -1.0, 0.0]]
    )
    running = np.ones((4, 3), np.bool_)
    running[2:, 2] = False
    baseline = copies_baseline(returns, left, running, 3)
    # Where 0.5 is left the second has 0.4 at first, and the third, too.
    np.testing.assert_allclose(baseline[:2, 0], [(-8.0 - 7.0) / 2, (-4.0 - 3.0) / 2])
    assert not copies_baseline(returns, left, running, 1).any()


def filled(rewards, lengths, values, copies, gae_lambda):
    """A buffer of episodes of some lengths, a second for each decision."""
    env = make(1)
    steps, count = rewards.shape
    buffer = WholeEpisodeBuffer(
        steps, env.observation_space, env.action_space, "cpu", gae_lambda, 1.0, count, copies=copies
    )
    running = np.arange(steps)[:, None] < np.array(lengths)
    truth = np.zeros((steps, count, len(TRUTH)), np.float32)
    truth[..., 0] = running
    truth[..., TRUTH.index("share_left")] = 1.0 - 0.1 * np.arange(steps)[:, None]
    truth[..., TRUTH.index("time")] = np.arange(steps)[:, None] / 600.0
    buffer.observations["truth"] = truth
    buffer.rewards = (rewards * running).astype(np.float32)
    buffer.values = values.astype(np.float32)
    buffer.full = True
    buffer.compute_returns_and_advantage(None, None)
    return buffer, running


def test_advantages_without_a_critic_are_returns_beside_the_others():
    rng = np.random.default_rng(0)
    rewards = rng.normal(size=(6, 4))
    lengths = [6, 4, 5, 6]
    buffer, running = filled(rewards, lengths, np.zeros((6, 4)), 2, 1.0)
    returns = np.cumsum((rewards * running)[::-1], axis=0)[::-1]
    left = buffer.observations["truth"][..., TRUTH.index("share_left")]
    expected = returns - copies_baseline(returns, left, running, 2)
    np.testing.assert_allclose(buffer.advantages[running], expected[running], atol=1e-5)
    assert not buffer.advantages[~running].any()


def test_a_critic_that_is_right_leaves_no_advantage():
    rewards = np.random.default_rng(1).normal(size=(5, 2))
    values = np.cumsum(rewards[::-1], axis=0)[::-1]
    buffer, _ = filled(rewards, [5, 5], values, 1, 0.9)
    np.testing.assert_allclose(buffer.advantages, 0.0, atol=1e-5)
    assert buffer.shares[1] == pytest.approx(0.0, abs=1e-6)


def test_minibatches_hold_every_decision_once_and_nobody_who_waits():
    buffer, running = filled(np.arange(12.0).reshape(6, 2), [6, 3], np.zeros((6, 2)), 1, 1.0)
    sizes = [len(batch.returns) for batch in buffer.get(4)]
    assert sum(sizes) == running.sum() == 9
    assert max(sizes) == 4
    found = np.sort(np.concatenate([batch.observations["truth"][:, 4] for batch in buffer.get(4)]))
    times = np.arange(6) / 600.0
    np.testing.assert_allclose(found, np.sort(np.append(times, times[:3])), atol=1e-6)
