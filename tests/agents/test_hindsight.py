"""What choices cost for one who knows the plan."""

import contextlib

import numpy as np
import pytest

from slamgym.agents import hindsight
from slamgym.agents.hindsight import HindsightCosts
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES


def decisions(seed, most=15):
    """An exploration that always begins the shortest tour, at its decisions with more than one candidate."""
    env = ExploreFrontiersEnv("procedural:home:loops", localization="ground_truth")
    observation, _ = env.reset(seed=seed)
    for _ in range(most):
        count = len(env.loop.candidates)
        detours = 5.0 * observation["candidates"][:count, CANDIDATE_FEATURES.index("tour_detour")]
        if count > 1:
            yield env, detours
        observation, _, terminated, truncated, _ = env.step(int(detours.argmin()) if count else 0)
        if terminated or truncated:
            break


@contextlib.contextmanager
def everything_seen(env):
    """For a while, as if no floor were hidden."""
    unseen = env.inner.coverage._unseen
    before = unseen.copy()
    unseen[:] = False
    yield
    unseen[:] = before


def test_where_nothing_is_hidden_the_costs_are_those_of_the_tour_through_what_is_offered(monkeypatch):
    monkeypatch.setattr(hindsight, "_HOLD", 0.0)
    regrets = []
    for env, detours in decisions(seed=4):
        with everything_seen(env):
            costs = HindsightCosts(env).costs()
        regrets.append(costs[detours.argmin()] - costs.min())
    # The true plan may show a shorter way between two frontiers than the map does.
    assert len(regrets) > 5
    assert np.median(regrets) < 0.1
    assert np.mean(regrets) < 0.7


def test_hidden_floor_makes_no_tour_shorter_and_no_cost_is_below_the_path():
    longer = 0
    for env, _ in decisions(seed=4):
        hidden = HindsightCosts(env).costs()
        with everything_seen(env):
            costs = HindsightCosts(env).costs()
        assert (hidden >= [one.path_length for one in env.loop.candidates]).all()
        assert (hidden >= costs - 1e-6).all() or len(hidden) > 5  # beyond, tours are only nearly the shortest
        longer += bool((hidden > costs + 1.0).any())
    assert longer > 5


def test_a_change_of_the_target_costs_something(monkeypatch):
    for env, _ in decisions(seed=4):
        target = env.loop.target
        if target is None:
            continue
        held = HindsightCosts(env).costs()
        with monkeypatch.context() as patch:
            patch.setattr(hindsight, "_HOLD", 0.0)
            free = HindsightCosts(env).costs()
        others = [one.target != target.target for one in env.loop.candidates]
        np.testing.assert_allclose(held - free, 0.5 * np.array(others), atol=1e-6)
        return
    pytest.fail("no decision with a target")
