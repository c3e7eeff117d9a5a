"""The trained explorer in the environment of the classical ones, and the decision environment beside it."""

import subprocess
import sys

import numpy as np
import pytest
import shapely

from slamgym.agents.pretrained_policy import PRETRAINED, LearnedExplorer, read_policy
from slamgym.agents.registry import make_explorer
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


def test_it_does_what_the_policy_does_in_the_decision_environment(plan):
    """The same network over the same driver: the robot ends at the same place after the same time."""
    decisions = ExploreFrontiersEnv(plan, **SMALL)
    scorer = read_policy().scorer()
    observation, _ = decisions.reset(seed=4)
    over = False
    while not over:
        assert decisions.observation_space.contains(observation)
        observation, _, terminated, truncated, info = decisions.step(int(scorer.scores(observation).argmax()))
        over = terminated or truncated
    env = explorer_env(plan)
    explorer = LearnedExplorer(env.explorer_context())
    observation, _ = env.reset(seed=4)
    while True:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            break
        observation, *_ = env.step(action)
    assert float(observation["time"][0]) == pytest.approx(info["time"], abs=1e-3)
    np.testing.assert_allclose(env.simulation.true_pose, info["true_pose"], atol=1e-6)


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
        "import sys; from slamgym.agents.pretrained_policy import read_policy; import slamgym.agents.registry; "
        "read_policy().scorer(); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
