"""Policies that were trained in the decision environment, in the environment of the classical explorers."""

import subprocess
import sys

import numpy as np
import pytest
import shapely

from slamgym.agents.pretrained_policy import (
    LearnedExplorer,
    policy_loop,
    read_policy,
    weight_shapes,
    write_policy,
)
from slamgym.agents.registry import make_explorer
from slamgym.agents.scoring import FrontierScorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import InputFileError
from slamgym.envs import ExploreConfig, ExploreEnv, ExploreFrontiersEnv
from slamgym.planning.promise import Promise

SMALL = {"observation": {"map_size": 24.0}, "localization": "ground_truth"}


@pytest.fixture
def plan():
    left, right = shapely.box(0.0, 0.0, 5.0, 5.0), shapely.box(5.1, 0.0, 10.0, 5.0)
    return FloorPlan("two-rooms", shapely.union_all([left, right, shapely.box(4.9, 2.0, 5.2, 3.0)]))


@pytest.fixture
def policy(tmp_path):
    """The file of a policy with small random weights, so that its choices are no rule's."""
    rng, path = np.random.default_rng(0), tmp_path / "policy.safetensors"
    weights = {name: 0.1 * rng.standard_normal(shape) for name, shape in weight_shapes().items()}
    write_policy(path, {name: value.astype(np.float32) for name, value in weights.items()}, {})
    return path


def explorer_env(plan):
    config = ExploreConfig().for_explorer()
    return ExploreEnv(
        plan, config, observation={"map": "global", "map_size": 24.0, "shared_map": True},
        localization="ground_truth", time_limit=1200.0,
    )  # fmt: skip


def test_it_explores_the_building_and_knows_when_it_is_done(plan):
    env = explorer_env(plan)
    explorer = make_explorer("rl", env.explorer_context())
    observation, info = env.reset(seed=0)
    truncated = False
    while not truncated:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            break
        assert env.action_space.contains(action)
        observation, _, _, truncated, info = env.step(action)
    assert explorer.finished
    assert info["coverage"] > 0.99
    assert explorer.decisions > 3


@pytest.mark.parametrize("promise", [None, Promise()])
def test_it_does_what_the_policy_does_in_the_decision_environment(plan, policy, promise):
    """The same network over the same driver: the robot ends at the same place after the same time."""
    loop = {"promise": promise} if promise else {}
    decisions = ExploreFrontiersEnv(plan, loop=loop, **SMALL)
    scorer = FrontierScorer(read_policy(policy)[0])
    observation, _ = decisions.reset(seed=4)
    over = False
    while not over:
        assert decisions.observation_space.contains(observation)
        decision = scorer.decide(observation)
        says_done = promise and decision.done > 0.0 and decisions.action_masks()[-1]
        action = decisions.action_space.n - 1 if says_done else int(decision.scores.argmax())
        observation, _, terminated, truncated, info = decisions.step(action)
        over = terminated or truncated
    env = explorer_env(plan)
    explorer = LearnedExplorer(env.explorer_context(), policy, policy_loop(promise))
    observation, _ = env.reset(seed=4)
    while True:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            break
        observation, *_ = env.step(action)
    assert float(observation["time"][0]) == pytest.approx(info["time"], abs=1e-3)
    np.testing.assert_allclose(env.simulation.true_pose, info["true_pose"], atol=1e-6)


def test_done_is_said_at_the_promise_that_it_was_learned_with_alone(plan, tmp_path):
    weights = {name: np.zeros(shape, np.float32) for name, shape in weight_shapes().items()}
    weights["done.bias"][:] = 1.0  # says so whatever it sees
    path = tmp_path / "done.safetensors"
    write_policy(path, weights, {})
    shares = {}
    for promise in (Promise(), Promise(seen=0.9), None):
        env = explorer_env(plan)
        explorer = LearnedExplorer(env.explorer_context(), path, policy_loop(promise))
        observation, info = env.reset(seed=4)
        while True:
            action, _ = explorer.predict(observation)
            if explorer.finished:
                break
            observation, _, _, _, info = env.step(action)
        shares[str(promise)] = info["coverage"]
    assert shares["98%:95%"] < 0.9
    assert min(shares["90%:95%"], shares["None"]) > 0.97


def test_weights_of_ones_own_are_named_by_their_file(plan, policy, tmp_path):
    context = explorer_env(plan).explorer_context()
    assert isinstance(make_explorer(f"rl:{policy}", context), LearnedExplorer)
    with pytest.raises(InputFileError, match="nowhere"):
        make_explorer(f"rl:{tmp_path / 'nowhere.safetensors'}", context)


def test_exploring_needs_no_torch():
    code = (
        "import sys; from slamgym.agents.hidden_floor import HiddenFloor; import slamgym.agents.registry; "
        "HiddenFloor.read(); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
