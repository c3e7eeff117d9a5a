"""Teams among the explorers that are evaluated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slamgym.agents import rules
from slamgym.agents.bench.manifest import TEAMS, read_bench
from slamgym.agents.evaluation.team_trial import TeamName, run_team_trial
from slamgym.agents.evaluation.trial import Task, TrialConfig, run_trial
from slamgym.agents.registry import make_explorer
from slamgym.agents.rules import Auction, mate_lengths, reached_mates, shared_out, tour_scores
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D
from slamgym.envs import ExploreEnv
from slamgym.envs.episode import fitted_env

CORRIDOR = FloorPlan("corridor", shapely.box(0.0, 0.0, 9.0, 2.0))
CONFIG = TrialConfig(promise=None)
QUICK = replace(CONFIG, env=replace(CONFIG.env, slam=replace(CONFIG.env.slam, mode="ground_truth")))


def test_a_name_says_how_many_robots_there_are():
    assert TeamName.read("rl@98%:95%*3") == ("rl@98%:95%", 3)
    assert TeamName.read("rl") == ("rl", 1)
    assert [str(TeamName.read(name)) for name in ("rl*1", "rl*2")] == ["rl", "rl*2"]
    for name in ("rl*0", "rl*", "rl*9", "rl*two"):
        with pytest.raises(ConfigError, match="a number from 1 to 4"):
            TeamName.read(name)


def test_two_robots_see_a_corridor_sooner_than_one():
    starts = Pose2D(4.5, 1.0, 0.0)
    alone = run_trial(Task("tour", CORRIDOR, 3, starts), QUICK)
    pair = run_team_trial(Task("tour*2", CORRIDOR, 3, starts), QUICK)
    assert pair.explorer == "tour*2"
    assert pair.finished
    assert pair.coverage > 0.98
    assert pair.time_to["0.98"] < alone.time_to["0.98"]


def test_a_team_of_one_does_what_a_robot_alone_does():
    alone = run_trial(Task("nearest", CORRIDOR, 1), QUICK)
    team = run_team_trial(Task("nearest*1", CORRIDOR, 1), QUICK)
    assert (team.time, team.path, team.coverage) == (alone.time, alone.path, alone.coverage)


class _Offered:
    """A loop in the middle of the corridor, whose ends are frontiers, with a mate right of it."""

    def __init__(self, mates):
        env = ExploreEnv(CORRIDOR, fitted_env(CORRIDOR, QUICK.env, "auto"))
        observation, _ = env.reset(seed=0, options={"plan": CORRIDOR, "start": (4.5, 1.0, 0.0)})
        rows = np.array([[1.0, *mate] for mate in mates]).reshape(-1, 4)
        explorer = make_explorer("tour", env.explorer_context())
        explorer.predict({**observation, "mates": rows})
        (self.loop,) = explorer.loops


def targets(loop, scores):
    """x of the candidates, the best first."""
    return [loop.candidates[k].frontier.middle[0] for k in np.argsort(-scores)]


def test_robots_that_hear_each_other_go_to_different_ends():
    loop = _Offered([(0.8, 0.0, 0.0)]).loop
    everything = np.ones(len(loop.candidates), np.bool_)
    first, *others = targets(loop, tour_scores(loop, everything))
    assert first < 0.0
    assert min(others) > 0.0


def test_in_an_auction_the_lowest_bid_wins_first(monkeypatch):
    loop = SimpleNamespace(
        candidates=[SimpleNamespace(path_length=2.0), SimpleNamespace(path_length=3.0)]
    )
    monkeypatch.setattr(rules, "mate_lengths", lambda _: np.array([[1.0, 9.0]]))
    assert np.argmax(Auction()(loop)) == 1, "the mate has won the frontier that is nearest to both"
    monkeypatch.setattr(rules, "mate_lengths", lambda _: np.zeros((0, 2)))
    assert np.argmax(Auction()(loop)) == 0


def test_a_robot_that_hears_nothing_chooses_as_alone():
    loop = _Offered([]).loop
    assert len(loop.belief.mates) == 0
    own = [one.path_length for one in loop.candidates]
    assert np.argmax(Auction()(loop)) == np.argmin(own)


def test_a_robot_that_is_left_without_a_frontier_goes_to_the_nearest():
    loop = _Offered([(-0.8, 0.0, 0.0), (0.8, 0.0, 0.0)]).loop
    scores = tour_scores(loop, np.ones(len(loop.candidates), np.bool_))
    assert np.isfinite(scores).all()


@given(
    own=hnp.arrays(np.float64, 6, elements=st.floats(0.0, 50.0)),
    mates=hnp.arrays(np.float64, (2, 6), elements=st.floats(0.0, 50.0)),
)
def test_a_robot_visits_first_the_nearest_that_no_mate_is_nearer_to(own, mates):
    scores = shared_out(own, mates)
    is_own = own <= mates.min(axis=0)
    best = int(np.argmax(scores))
    assert np.isfinite(scores).all()
    if is_own.any():
        assert is_own[best]
        assert own[best] == own[is_own].min()
        assert scores[is_own].min() > scores[~is_own].max(initial=-np.inf)


def test_a_robot_behind_a_wall_leaves_the_frontiers_on_this_side_alone():
    beside, behind = (0.8, 0.0, 0.0), (0.8, 1.8, 0.0)
    loop = _Offered([beside, behind]).loop
    assert reached_mates(loop).tolist() == [True, False]
    lengths = mate_lengths(loop)
    assert np.isfinite(lengths[0]).all()
    assert np.isinf(lengths[1]).all()


def test_the_benchs_track_for_teams_has_the_buildings_of_loops():
    bench = read_bench()
    assert bench.track(TEAMS).buildings == bench.track("loops").buildings
