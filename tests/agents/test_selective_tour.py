"""The explorer ``rl``: what it knows of frontiers, and which it passes over."""

import math

import numpy as np
import pytest

from slamgym.agents.hidden_floor import (
    AREAS,
    DESCRIPTION,
    FLOOR_LAYERS,
    HIDDEN_FLOOR,
    HiddenFloor,
    moments,
)
from slamgym.agents.pretrained_policy import write_weights
from slamgym.agents.registry import make_explorer
from slamgym.agents.selective_tour import SelectiveTour
from slamgym.cad import open_plans
from slamgym.core.errors import InputFileError
from slamgym.core.types import Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps
from slamgym.envs.frontier_table import FRONTIER_FIGURES, describe_frontiers
from slamgym.planning.exploration_loop import ExplorationLoopConfig
from slamgym.planning.promise import Promise
from slamgym.planning.view_history import ViewHistory


@pytest.fixture
def env():
    return ExploreEnv(
        open_plans("procedural:home:3").load("home_3_00003"),
        ExploreConfig().for_explorer(),
        localization="ground_truth",
        time_limit=300.0,
    )


@pytest.fixture
def network(tmp_path):
    """Writes a network that says the same of every frontier."""

    def write(logit, risk=1.0):
        weights = {}
        for name, (inputs, outputs) in FLOOR_LAYERS.items():
            weights |= {
                f"{name}.weight": np.zeros((outputs, inputs)),
                f"{name}.bias": np.zeros(outputs),
            }
        weights["out.bias"] += logit
        path = tmp_path / f"{np.max(logit)}-{risk}.safetensors"
        about = {"risk": risk}
        write_weights(
            path, weights, {"space": DESCRIPTION[0], "network": DESCRIPTION[1], "about": about}
        )
        return path

    return write


def explored(env, explorer):
    """Time [s], coverage and decisions of an exploration."""
    for info in episode_steps(env, explorer, env.reset(seed=5)):
        coverage = info["coverage"]
    assert explorer.finished
    return env.simulation.time, coverage, explorer.decisions


def selective(env, path, promise=None):
    return SelectiveTour(env.explorer_context(), ExplorationLoopConfig(promise=promise), path)


@pytest.mark.parametrize("promise", [None, Promise()])
def test_where_every_frontier_hides_something_it_is_the_rule_tour(env, network, promise):
    tour = explored(env, make_explorer("tour", env.explorer_context(), promise=promise))
    assert explored(env, selective(env, network(20.0), promise)) == tour


def test_where_none_does_it_is_done_as_soon_as_it_may_promise_that(env, network):
    """At 19 m2, the smallest map of which anything is promised; the home has 28.5 m2."""
    time, coverage, _ = explored(env, selective(env, network(-20.0), Promise()))
    assert time < 40.0
    assert coverage < 0.9
    # Without a promise, or with another one, what was passed over comes last.
    assert explored(env, selective(env, network(-20.0), Promise(0.99)))[1] > 0.98
    assert explored(env, selective(env, network(-20.0)))[1] > 0.98


def test_in_large_buildings_only_what_the_map_encloses_is_passed_over(env, network, monkeypatch):
    monkeypatch.setattr("slamgym.agents.selective_tour.LARGEST_SKIPPED", 10.0)
    tour = explored(env, make_explorer("tour", env.explorer_context(), promise=Promise()))
    time, coverage, _ = explored(env, selective(env, network(-20.0), Promise()))
    assert 40.0 < time <= tour[0]  # the rule at home is done by then
    assert coverage > 0.9


def test_a_small_share_of_the_risk_passes_over_nothing(env, network):
    """Each frontier hides something with a probability of 0.018: two may be left at a risk of 0.05, none at 0.015."""
    tour = explored(env, make_explorer("tour", env.explorer_context(), promise=Promise()))
    assert explored(env, selective(env, network(-4.0, risk=0.3), Promise())) == tour
    assert explored(env, selective(env, network(-4.0, risk=1.0), Promise())) != tour


@pytest.mark.parametrize("logit", [-3.0, -4.0, -5.0])
def test_of_frontiers_that_hide_the_same_none_is_left_for_another_and_visited_then(
    env, network, logit
):
    explorer = selective(env, network(logit), Promise())
    targets = []
    for _ in episode_steps(env, explorer, env.reset(seed=5)):
        target = explorer.loops[0].target if explorer.loops else None
        if target and (not targets or math.dist(target.target, targets[-1]) > 0.5):
            targets.append(target.target)
    assert explorer.finished
    assert len(targets) > 5
    for before, _, after in zip(targets, targets[1:], targets[2:], strict=False):
        assert math.dist(before, after) > 0.5


def test_the_network_of_the_package_is_done_sooner_than_the_rule(env):
    tour = explored(env, make_explorer("tour", env.explorer_context(), promise=Promise()))
    mine = explored(env, make_explorer("rl", env.explorer_context(), promise=Promise()))
    assert mine[0] <= tour[0]
    assert mine[1] >= 0.98


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        (0.5, {}),  # something stands before it
        (1.0, {"looks": 1, "met": 1}),
        (3.0, {"looks": 1, "passed": 1}),
        (3.5, {"looks": 1, "lost": 1, "lost_near_by": 1}),
    ],
)
def test_beams_are_counted_by_what_became_of_them(env, read, expected):
    views = ViewHistory(env.explorer_context())
    beams = env.explorer_context().geometry.num_beams
    views.note(Pose2D(0.0, 0.0, 0.5 * math.pi), np.full(beams, read, np.float32))
    views.note(Pose2D(0.01, 0.0, 0.5 * math.pi), np.full(beams, read, np.float32))  # the same place
    points = np.array([[0.0, 1.0], [0.0, -1.0]])  # the other is out of the scanner's field
    found = views.figures(points, np.array([0, 1, 2]), points)
    names = [name for name in FRONTIER_FIGURES[16:] if name != "unseen_share"]
    for name, scale in {
        "looks": 3.0,
        "lost": 3.0,
        "lost_near_by": 2.0,
        "passed": 3.0,
        "met": 3.0,
    }.items():
        assert math.expm1(scale * found[0, names.index(name)]) == pytest.approx(
            expected.get(name, 0)
        )
    assert found[1, names.index("looks")] == 0.0
    if "passed" in expected:
        assert found[0, names.index("passed_by")] == pytest.approx((read - 1.064) / 3.5, abs=0.01)


def test_moments_of_what_a_frontier_hides_follow_from_the_chances(env, network, tmp_path):
    """It surely hides 1 m2 and never 3 m2: in between the chance is a half."""
    logits = np.where(np.array(AREAS) <= 1.0, 50.0, -50.0)
    read = HiddenFloor.read(network(logits))
    explorer = selective(env, network(1.0))
    observation, _ = env.reset(seed=5)
    explorer.predict(observation)
    loop = explorer.loops[0]
    for most, mean, square in (
        (0.05, 0.05, 0.0025),
        (1.0, 1.0, 1.0),
        (2.0, 1.5, 2.5),
        (100.0, 2.0, 5.0),
    ):
        found = moments(read.chances(describe_frontiers(loop, loop.wanted)), most)
        assert found.shape == (2, len(loop.wanted))
        np.testing.assert_allclose(found.T, [(mean, square)] * len(loop.wanted), rtol=1e-12)
    for path, reason in (
        (tmp_path / "nowhere.safetensors", "nowhere"),
        (network(1.0, risk=2.0), "risk"),
    ):
        with pytest.raises(InputFileError, match=reason):
            HiddenFloor.read(path)
    assert HIDDEN_FLOOR.stat().st_size < 100_000
