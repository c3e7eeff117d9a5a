"""The trained explorer in the environment of the classical ones, and the decision environment beside it."""

import subprocess
import sys

import numpy as np
import pytest
import shapely

from slamgym.agents.foresight import FORESIGHT_FEATURES, foresee
from slamgym.agents.learned import LearnedExplorer
from slamgym.agents.pretrained_policy import PRETRAINED, read_policy, weight_shapes, write_policy
from slamgym.agents.registry import make_explorer
from slamgym.agents.scoring import NetworkConfig
from slamgym.cad import FloorPlan
from slamgym.core.errors import InputFileError
from slamgym.envs import ExploreConfig, ExploreEnv, ExploreFrontiersEnv

SMALL = {"observation": {"map_size": 24.0}, "localization": "ground_truth"}


@pytest.fixture
def plan():
    left, right = shapely.box(0.0, 0.0, 5.0, 5.0), shapely.box(5.1, 0.0, 10.0, 5.0)
    return FloorPlan("two-rooms", shapely.union_all([left, right, shapely.box(4.9, 2.0, 5.2, 3.0)]))


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


@pytest.fixture
def foreseeing(tmp_path):
    """Weights that also weigh what the network for foresight expects of a candidate."""
    network = NetworkConfig(crop=8, width=16, heads=2, foresight=True)
    rng = np.random.default_rng(0)
    weights = {
        name: rng.normal(0.0, 0.3, shape).astype(np.float32) for name, shape in weight_shapes(network).items()
    }
    path = tmp_path / "foreseeing.safetensors"
    write_policy(path, network, weights, {})
    return path


@pytest.mark.parametrize("weights", [PRETRAINED, "foreseeing"])
def test_it_does_what_the_policy_does_in_the_decision_environment(plan, weights, request):
    """The same network over the same driver: the robot ends at the same place after the same time."""
    weights = request.getfixturevalue(weights) if weights == "foreseeing" else weights
    policy = read_policy(weights)
    decisions = ExploreFrontiersEnv(plan, **SMALL, extra_features=policy.network.extra_features)
    scorer = policy.scorer()
    observation, _ = decisions.reset(seed=4)
    over = False
    while not over:
        assert decisions.observation_space.contains(observation)
        observation, _, terminated, truncated, info = decisions.step(scorer.choose(observation))
        over = terminated or truncated
    env = explorer_env(plan)
    explorer = LearnedExplorer(env.explorer_context(), weights)
    observation, _ = env.reset(seed=4)
    while True:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            break
        observation, *_ = env.step(action)
    assert float(observation["time"][0]) == pytest.approx(info["time"], abs=1e-3)
    np.testing.assert_allclose(env.simulation.true_pose, info["true_pose"], atol=1e-6)


def test_what_is_foreseen_stands_behind_the_other_features(plan):
    env = ExploreFrontiersEnv(plan, **SMALL, extra_features=FORESIGHT_FEATURES)
    plain = ExploreFrontiersEnv(plan, **SMALL)
    observation, _ = env.reset(seed=1)
    expected, _ = plain.reset(seed=1)
    count = expected["candidates"].shape[1]
    np.testing.assert_array_equal(observation["candidates"][:, :count], expected["candidates"])
    rows = len(env.loop.candidates)
    area = foresee(env.loop)
    np.testing.assert_allclose(observation["candidates"][:rows, count], area.in_sight / 10.0, rtol=1e-6)
    np.testing.assert_allclose(observation["candidates"][:rows, -1], area.pocket_doubt / 5.0, rtol=1e-6)
    assert (area.in_sight > 0.0).any()
    assert (observation["candidates"][rows:] == 0.0).all()


def test_weights_of_ones_own_are_named_by_their_file(plan, tmp_path):
    context = explorer_env(plan).explorer_context()
    assert isinstance(make_explorer(f"rl:{PRETRAINED}", context), LearnedExplorer)
    with pytest.raises(InputFileError, match="nowhere"):
        make_explorer(f"rl:{tmp_path / 'nowhere.safetensors'}", context)


def test_the_pretrained_weights_are_small():
    assert PRETRAINED.stat().st_size < 5_000_000
    assert (PRETRAINED.parent / "README.md").is_file()


def test_exploring_needs_no_torch():
    code = (
        "import sys; from slamgym.agents.pretrained_policy import read_policy; import slamgym.agents.learned; "
        "read_policy().scorer(); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
