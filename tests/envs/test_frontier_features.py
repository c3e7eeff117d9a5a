import numpy as np
import pytest

from slamgym.agents.rules import FrontierTour
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, TURN_WEIGHT
from slamgym.envs.frontier_table import (
    FRONTIER_FIGURES,
    SHARED_FIGURES,
    describe_frontiers,
    expected_unseen_share,
)
from slamgym.planning.grid_path import straight_turns
from slamgym.planning.open_tour import EXACT_PLACES


def column(rows, name):
    return rows[:, CANDIDATE_FEATURES.index(name)]


@pytest.fixture(scope="module")
def decisions():
    """Observations of an exploration by the shortest tour, and what the loop and the table said then."""
    env = ExploreFrontiersEnv(
        "procedural:home:loops", localization="ground_truth", drive="path", loop={"promise": {}}
    )
    observation, _ = env.reset(seed=4)
    found = []
    over = False
    while not over and len(found) < 25:
        loop = env.loop
        order = env.order
        count = len(order)
        table = describe_frontiers(loop, [loop.candidates[i].frontier for i in order])
        found.append(
            {
                "observation": observation,
                "rows": observation["frontiers"][:count],
                "table": table,
                "tour": int(np.argmax(FrontierTour()(loop)[order])),
                "straight": [loop.candidates[i].frontier.min_distance for i in order],
                "unseen": expected_unseen_share(loop),
                "turns": straight_turns(
                    loop.pose, np.array([loop.candidates[i].frontier.middle for i in order])
                ),
            }
        )
        observation, _, over, *_ = env.step(found[-1]["tour"])
    return found


def test_the_table_that_the_explorer_reads_is_what_a_policy_observes(decisions):
    for one in decisions:
        for name in set(FRONTIER_FIGURES) - set(SHARED_FIGURES):
            expected = one["table"][:, FRONTIER_FIGURES.index(name)]
            np.testing.assert_allclose(
                column(one["rows"], name), np.clip(expected, -10.0, 10.0), atol=1e-6
            )


def test_the_first_of_the_tour_is_what_the_rule_chooses(decisions):
    several = [one for one in decisions if len(one["rows"]) > 1]
    assert len(several) > 5
    for one in several:
        rows = one["rows"]
        assert int(column(rows, "tour").argmax()) == one["tour"]
        np.testing.assert_allclose(
            np.sort(1.0 / column(rows, "tour")), np.arange(1, len(rows) + 1), rtol=1e-6
        )
        assert (column(rows, "tour_detour") >= 0.0).all()
        if len(rows) <= EXACT_PLACES:
            assert column(rows, "tour_detour")[one["tour"]] == pytest.approx(0.0, abs=1e-6)


def test_lengths_are_a_metric_no_shorter_than_a_straight_line(decisions):
    """But for the robot's first turn, which counts in its own row alone, and cells of 0.15 m."""
    for one in decisions:
        count = len(one["rows"])
        lengths = 10.0 * one["observation"]["lengths"][: count + 1, : count + 1].astype(np.float64)
        between = lengths[1:, 1:]
        np.testing.assert_allclose(between, between.T, atol=1e-5)
        assert (np.diag(between) == 0.0).all()
        by_way = between[:, :, None] + between[None]
        assert (between[:, None] <= by_way.transpose(0, 2, 1) + 1e-4).all()
        # A frontier is looked at from up to 0.6 m away.
        slack = 0.6 + 0.3 + np.pi * TURN_WEIGHT
        assert (lengths[0, 1:] >= np.array(one["straight"]) - slack).all()
        assert not one["observation"]["lengths"][count + 1 :].any()


def test_the_unseen_share_of_the_whole_is_that_of_the_table(decisions):
    for one in decisions:
        measured = one["observation"]["globals"][GLOBAL_FEATURES.index("unseen_share")]
        expected = 1.0 + 0.25 * np.log10(max(one["unseen"], 1e-4))
        assert measured == pytest.approx(expected, abs=1e-5)
