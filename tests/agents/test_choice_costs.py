"""Decisions with the costs of their candidates, and networks that are fitted to them."""

import numpy as np
import pytest

from slamgym.agents.scoring import NetworkConfig
from slamgym.core.errors import InputFileError
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, CROP_PX, GLOBAL_FEATURES

torch = pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from slamgym.agents.rl.choice_costs import (  # noqa: E402
    LARGEST_REGRET,
    ChoiceCosts,
    choice_loss,
    fit_choices,
    fit_value,
    mean_regret,
)
from slamgym.agents.rl.policy import FrontierNetwork  # noqa: E402

NETWORK = NetworkConfig(crop=4, width=16, prior_feature="tour_detour", prior_weight=-5.0)


def made_up(episodes, seed=0):
    """Decisions in which what a candidate costs is its detour, and besides 5 m where a doorway leads to it."""
    rng, found = np.random.default_rng(seed), ChoiceCosts()
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
            found.add(
                observation, (5.0 * rows[:, detour] + 5.0 * rows[:, doorway])[:count].astype(np.float64)
            )
        found.end_episode([(-0.05, 2.0)] * 40, range(0, 40, 2), 1.0, is_whole=True)
    return found


def test_a_fitted_network_regrets_less_than_its_prior_on_decisions_that_it_has_not_seen():
    torch.manual_seed(0)
    network, others = FrontierNetwork(NETWORK), made_up(10, seed=1)
    before = mean_regret(network, others, np.arange(len(others)))
    fit_choices(network, made_up(40), epochs=100, seed=0)
    after = mean_regret(network, others, np.arange(len(others)))
    assert before > 0.8
    assert after < 0.5 * before


def test_the_value_is_fitted_to_the_returns_and_leaves_the_scores_alone():
    torch.manual_seed(0)
    network, known = FrontierNetwork(NETWORK), made_up(20)
    observations, _ = known.batch(np.arange(50))
    with torch.no_grad():
        scores, values = network(observations)
    fit_value(network, known, seed=0, epochs=60)
    with torch.no_grad():
        same, fitted = network(observations)
    returns = torch.tensor(known.returns[:50])
    assert torch.equal(scores, same)
    assert ((fitted - returns) ** 2).mean() < 0.5 * ((values - returns) ** 2).mean()


def test_returns_are_those_from_each_decision_on_and_unknown_where_the_episode_was_cut_off():
    known = made_up(1)
    assert known.returns[:3] == pytest.approx([-2.0, -1.9, -1.8])
    known.add(
        {"candidates": np.zeros((2, 3)), "crops": np.zeros((2, 1)), "globals": np.zeros(1)}, np.zeros(2)
    )
    known.end_episode([(-1.0, 2.0)], [0], 0.5, is_whole=False)
    assert np.isnan(known.returns[-1])
    assert known.episodes[-1] == known.episodes[0] + 1


def test_regrets_are_never_negative_and_one_of_each_decision_is_0():
    known = ChoiceCosts()
    observation = {"candidates": np.zeros((3, 2)), "crops": np.zeros((3, 1)), "globals": np.zeros(1)}
    known.add(observation, np.array([7.0, 5.0, 1e5]))
    assert known.regrets[0].tolist() == [2.0, 0.0, LARGEST_REGRET]


def test_decisions_come_back_from_a_file_and_damaged_ones_are_refused(tmp_path):
    known, path = made_up(2), tmp_path / "choices.npz"
    known.write(path)
    again = ChoiceCosts.read(path)
    again.extend(known)
    assert again.episodes == [0] * 20 + [1] * 20 + [2] * 20 + [3] * 20
    assert again.returns == known.returns * 2
    for name in ("candidates", "crops", "overall", "regrets"):
        for index, value in enumerate(getattr(known, name) * 2):
            np.testing.assert_array_equal(getattr(again, name)[index], value)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(InputFileError, match="delete it to collect it again"):
        ChoiceCosts.read(path)


def test_the_loss_is_least_for_scores_that_are_the_costs_and_padding_does_not_count():
    regrets = torch.tensor([[0.0, 1.0, 4.0, 0.0]])
    mask = torch.tensor([[1.0, 1.0, 1.0, 0.0]])
    hidden = torch.tensor([[0.0, 0.0, 0.0, -1e8]])
    right, wrong = (choice_loss(sign * regrets + hidden, regrets, mask).item() for sign in (-1.0, 1.0))
    assert right < 0.4 < wrong
    shifted = choice_loss(3.0 - regrets + hidden, regrets, mask).item()
    assert shifted == pytest.approx(right, abs=1e-5)
