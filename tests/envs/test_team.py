"""Robots of one building that tell each other what they have mapped."""

import builtins
import math
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
import shapely

from slamgym.agents import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.config import resolve_config
from slamgym.envs.episode import EpisodeConfig
from slamgym.envs.plan_cache import ResetOptions
from slamgym.envs.team import maps as team_maps
from slamgym.envs.team import parallel_env
from slamgym.envs.team.config import TeamConfig
from slamgym.envs.team.episode import merged_map, run_team_episode
from slamgym.envs.team.exploration import TeamExploration
from slamgym.envs.team.maps import SharedMap, TeamMaps

APART = {"start": [(1.0, 2.0, 0.0), (6.2, 1.0, 0.0)]}
"""One robot in each room of the flat."""


def explored(plan, options=APART, steps=12, **team):
    """A pair that has driven about in a flat."""
    config = resolve_config(None, {"team": {"robots": 2, **team}, "localization": "ground_truth"})
    pair = TeamExploration(plan, config)
    pair.begin(np.random.default_rng(0), ResetOptions.read(options))
    for _ in range(steps):
        pair.step(np.array([[0.2, 0.5], [0.2, -0.5]]))
    return pair


def known(pair, index):
    grid = pair.maps.shared[index].occupancy_grid()
    return np.count_nonzero(grid.cells != UNKNOWN)


def test_pettingzoos_own_test_passes(flat):
    pettingzoo = pytest.importorskip("pettingzoo.test")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pettingzoo.parallel_api_test(parallel_env(flat, robots=3), num_cycles=30)


def test_robots_that_know_their_starts_share_one_map(flat):
    pair = explored(flat)
    alone = [np.count_nonzero(one.mapper.occupancy_grid().cells != UNKNOWN) for one in pair.robots]
    assert known(pair, 0) > 1.2 * alone[0]
    x, y, theta = pair.maps.place(0, 1)
    assert (x, y, theta) == pytest.approx((5.2, -1.0, 0.0))
    mates = pair.maps.mates(0)
    true = pair.robots[1].true_pose
    assert mates[1][:2] == pytest.approx((true.x - 1.0, true.y - 2.0), abs=0.2)


@pytest.mark.parametrize("team", [{"exchange": "range", "reach": 3.0}, {"exchange": "meeting"}])
def test_robots_that_hear_nothing_are_alone(flat, team):
    pair = explored(flat, **team)
    own = pair.robots[0].mapper.occupancy_grid()
    assert pair.maps.shared[0].occupancy_grid() is own
    assert pair.maps.mates(0) == {}


def test_robots_that_meet_tell_each_other_once_they_see_each_other(flat):
    in_sight = {"start": [(1.0, 2.0, 0.0), (3.9, 2.0, 0.0)]}
    assert explored(flat, in_sight, steps=0, exchange="meeting").maps.is_heard.tolist() == [
        [False, True],
        [True, False],
    ]


def test_what_one_has_heard_it_passes_on():
    links = np.zeros((3, 3), dtype=bool)
    links[0, 1] = links[1, 0] = links[1, 2] = links[2, 1] = True
    mappers = [_Still(at) for at in range(3)]
    maps = TeamMaps(mappers, [Pose2D(10.0 * at, 0.0, 0.0) for at in range(3)])
    maps.exchange(links, [Pose2D(0.0, 0.0, 0.0)] * 3, 2.0)
    assert maps.mates(0) == {1: (10.0, 0.0, 0.0), 2: (20.0, 0.0, 0.0)}
    maps.exchange(np.zeros((3, 3), dtype=bool), [Pose2D(0.0, 0.0, 0.0)] * 3, 4.0)
    assert maps.mates(0) == {}
    told = maps.shared[0].occupancy_grid()
    row, col = told.frame.to_cell(20.01, 0.01)
    assert told.cells[row, col] == FREE, "what was heard once stays known"


class _Still:
    """A mapper of one free cell."""

    def __init__(self, _at):
        self._grid = OccupancyGrid(np.array([[FREE]], np.uint8), GridFrame(0.05, 0.0, 0.0, 1, 1))

    def occupancy_grid(self):
        return self._grid

    def lattice(self):
        return self._grid.cells[::-1], (0, 0)

    def graph(self):
        return None


def test_the_own_map_wins_where_it_knows_anything():
    shared = SharedMap(_Still(0))
    cells = np.full((3, 4), OCCUPIED, np.uint8)
    shared.told = OccupancyGrid(cells, GridFrame(0.05, -0.05, -0.05, 3, 4))
    grid = shared.occupancy_grid()
    assert grid.frame == shared.told.frame
    assert grid.cells.tolist() == [[0, 0, 0, 0], [0, FREE, 0, 0], [0, 0, 0, 0]]
    canvas = GridFrame(0.05, -0.1, -0.1, 4, 4)
    assert np.count_nonzero(shared.render(canvas) == OCCUPIED) == 8


def test_coverage_is_the_teams(flat):
    pair = explored(flat)
    shares = pair.explorations.fleet.shares
    assert shares[0] == shares[1] == pair.coverage
    each = []
    for one in range(2):
        config = replace(ExploreConfig(), team=TeamConfig(robots=1))
        single = TeamExploration(flat, config)
        single.begin(np.random.default_rng(0), ResetOptions.read({"start": APART["start"][one]}))
        each.append(single.coverage)
    assert max(each) < pair.coverage


def test_one_robot_is_the_single_environment(flat):
    env = ExploreEnv(flat)
    env.reset(seed=4)
    team = TeamExploration(flat, ExploreConfig())
    team.begin(np.random.Generator(np.random.PCG64(np.random.SeedSequence(4))), ResetOptions())
    for _ in range(20):
        env.step(np.array([0.5, 0.2], np.float32))
        team.step(np.array([[0.5 * 0.26, np.float64(np.float32(0.2)) * 1.82]]))
    assert team.robots[0].true_pose == pytest.approx(env.simulation.true_pose)
    np.testing.assert_array_equal(team.robots[0].scan.ranges, env.simulation.scan.ranges)


def test_maps_of_unknown_starts_wait_until_it_is_sure_where_they_lie(flat):
    pair = explored(flat, starts="unknown")
    assert pair.maps.place(0, 1) is None
    assert pair.maps.shared[0].told is None


def test_a_place_found_by_two_is_passed_on(monkeypatch, flat):
    monkeypatch.setattr(team_maps, "placed", lambda *_: Pose2D(1.0, 0.0, 0.5 * math.pi))
    mappers = [_Still(at) for at in range(3)]
    for mapper in mappers:
        mapper.graph = lambda: flat
    maps = TeamMaps(mappers, None)
    everyone = np.ones((3, 3), dtype=bool)
    maps.exchange(everyone, [Pose2D(0.0, 0.0, 0.0)] * 3, team_maps.ALIGN_INTERVAL)
    assert maps.place(1, 0) == pytest.approx((0.0, 1.0, -0.5 * math.pi))


def test_the_merged_map_holds_all_rooms(flat):
    config = resolve_config(None, {"team": {"robots": 2}})
    pair = TeamExploration(flat, config)
    pair.begin(np.random.default_rng(0), ResetOptions.read(APART))
    for _ in range(30):
        pair.step(np.array([[0.2, 0.5], [0.2, -0.5]]))
    grid = merged_map(pair)
    left, _, right, _ = grid.frame.bounds
    assert left < -0.8
    assert right > 6.0


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"robots": 0}, "robots"),
        ({"robots": 5}, "robots"),
        ({"team": {"exchange": "shout"}}, "exchange"),
        ({"render_mode": "human"}, "render_mode"),
    ],
)
def test_settings_without_sense_are_refused(settings, sentence):
    pytest.importorskip("pettingzoo")
    with pytest.raises(ConfigError, match=sentence):
        parallel_env(**settings)


def test_a_start_inside_another_robot_is_refused(flat):
    with pytest.raises(ConfigError, match="is on another robot; choose another"):
        explored(flat, {"start": [(1.0, 2.0, 0.0), (1.2, 2.0, 0.0)]})


def test_a_single_environment_refuses_a_team(flat):
    with pytest.raises(ConfigError, match="parallel_env"):
        ExploreEnv(flat, team={"robots": 2})


def test_without_pettingzoo_one_sentence_names_the_extra(monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.partition(".")[0] == "pettingzoo":
            raise ImportError("no module", name="pettingzoo")
        return real(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "slamgym.envs.team.env", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"pip install 'slamgym\[teams\]'"):
        parallel_env()


def test_a_picture_shows_all_robots(flat):
    pytest.importorskip("pettingzoo")
    env = parallel_env(flat, render_mode="rgb_array")
    env.reset(seed=1)
    both = env.render()
    assert both.shape == (720, 1280, 3)
    colours = {tuple(pixel) for pixel in both.reshape(-1, 3).tolist()}
    assert (230, 119, 0) in colours


def test_a_wide_hall_is_split_between_robots_in_sight_only():
    """A robot behind a wall isn't in sight, however near it is."""
    rooms = shapely.union_all(
        [shapely.box(0, 0, 3, 3), shapely.box(3.2, 0, 6, 3), shapely.box(2.9, 2.0, 3.3, 2.9)]
    )
    plan = FloorPlan("two", rooms)
    near = {"start": [(2.6, 0.6, 0.0), (3.6, 0.6, 0.0)]}
    pair = explored(plan, near, steps=0, exchange="meeting")
    assert not pair.maps.is_heard.any()


def test_a_team_maps_a_building_as_one_episode(flat):
    env = resolve_config(None, {"team": {"robots": 2}, "localization": "ground_truth"})
    config = EpisodeConfig("nearest", 0.3, env=env)
    episode = run_team_episode(flat, 3, config, make_explorer)
    assert episode.finished == "time_limit"
    assert episode.robot_seconds == pytest.approx(18.0, abs=0.2)  # the stamp of the last scan
    left, _, right, _ = episode.slam_map.frame.bounds
    assert right - left > 5.0, "both rooms are on it"
    with pytest.raises(ConfigError, match="stuck_after watches one robot"):
        run_team_episode(flat, 3, replace(config, stuck_after=1.0), make_explorer)
