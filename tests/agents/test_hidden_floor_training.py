"""The training of the network that says what frontiers hide: a small one from the log to the calibrated file."""

import numpy as np
import pytest

pytest.importorskip("torch")

from slamgym.agents.hidden_floor import AREAS, HiddenFloor
from slamgym.agents.rl import hidden_floor as training
from slamgym.agents.rl.frontier_log import hidden_areas, log_exploration
from slamgym.agents.rl.train_config import HiddenFloorConfig
from slamgym.cad import open_plans
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_table import FRONTIER_FIGURES


@pytest.fixture(scope="module")
def home():
    return open_plans("procedural:home:3").load("home_3_00003")


def test_frontiers_hide_no_more_than_all_that_is_unseen(home):
    env = ExploreFrontiersEnv(home, localization="ground_truth", drive="path")
    env.reset(seed=0)
    seen = []
    for _ in range(6):
        areas = hidden_areas(env.inner, env.loop)
        coverage = env.inner.coverage
        unseen = float(np.count_nonzero(coverage.unseen)) * coverage.frame.resolution**2
        assert len(areas) == len(env.loop.wanted)
        assert areas.sum() <= unseen + 1e-9
        seen.append(areas.sum() / unseen)
        env.step(0)
    assert max(seen) > 0.8  # what is unseen lies behind frontiers


def test_a_network_is_fitted_to_a_log_and_calibrated(home, tmp_path, monkeypatch):
    logged = log_exploration(home, np.random.default_rng(0))
    assert logged["figures"].shape == (len(logged["areas"]), len(FRONTIER_FIGURES))
    monkeypatch.setattr(training, "logged", lambda config, folder: iter([logged]))
    kept = []
    monkeypatch.setattr(
        training, "is_kept_often_enough", lambda path, risk, *_: kept.append(risk) or risk < 0.2
    )
    config = HiddenFloorConfig(epochs=40)
    training.train_hidden_floor(config, tmp_path)
    assert kept == [0.25, 0.1]
    network = HiddenFloor.read(tmp_path / training.WEIGHTS)
    assert network.risk == 0.1
    chances = network.chances(logged["figures"])
    for column, area in enumerate(AREAS[:4]):
        hides = logged["areas"] >= area
        if hides.any() and not hides.all():
            assert chances[hides, column].mean() > chances[~hides, column].mean()
