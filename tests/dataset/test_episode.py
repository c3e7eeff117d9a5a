import numpy as np
import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError, PlanError
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.envs.episode import time_limit
from slamgym.sim import odometry_level
from slamgym.slam import SlamConfig

FLAT = FloorPlan("flat", box(0, 0, 3.0, 2.4).difference(box(1.4, 0.0, 1.6, 1.4)))
QUICK = EpisodeConfig(minutes=0.1, env=ExploreConfig(slam=SlamConfig(particles=3)))


def test_a_small_flat_is_explored_to_the_end():
    config = EpisodeConfig(env=ExploreConfig(slam=SlamConfig(mode="ground_truth")))
    episode = run_episode(FLAT, 0, config, make_explorer)
    assert episode.finished == "explored"
    assert episode.coverage > 0.95
    assert 0.0 < episode.robot_seconds < episode.time_limit


def test_time_ends_it():
    episode = run_episode(FLAT, 0, QUICK, make_explorer)
    assert episode.finished == "time_limit"
    assert episode.robot_seconds == pytest.approx(6.0)
    assert len(episode.truth) == len(episode.odometry) == len(list(episode.records)) == 31


def test_a_seed_decides_everything():
    first, again, other = (run_episode(FLAT, seed, QUICK, make_explorer) for seed in (1, 1, 2))
    assert np.array_equal(first.truth.poses, again.truth.poses)
    assert np.array_equal(first.log.ranges, again.log.ranges)
    assert np.array_equal(first.slam_map.cells, again.slam_map.cells)
    assert first.start != other.start


def test_trajectories_begin_together_in_the_map_frame():
    episode = run_episode(FLAT, 3, QUICK, make_explorer)
    for trajectory in (episode.truth, episode.odometry, episode.estimate):
        assert trajectory.poses[0] == pytest.approx([0.0, 0.0, episode.start.theta])


def test_ideal_odometry_is_the_truth():
    env = ExploreConfig(slam=SlamConfig(particles=3), odometry=odometry_level("ideal"))
    episode = run_episode(FLAT, 3, EpisodeConfig(minutes=0.1, env=env), make_explorer)
    assert episode.odometry.poses == pytest.approx(episode.truth.poses, abs=1e-9)


def test_the_automatic_limit_grows_with_the_area_and_a_fixed_one_does_not():
    large = FloorPlan("large", box(0, 0, 12, 12))
    assert time_limit(large, "auto") > time_limit(FLAT, "auto") > 300.0
    assert time_limit(large, 7) == time_limit(FLAT, 7) == 420.0


def test_the_saved_settings_say_what_is_done():
    env = EpisodeConfig(
        env=ExploreConfig(time_limit=10.0, actions="discrete", coverage_goal=0.5)
    ).env
    assert env.time_limit is None
    assert env.coverage_goal is None
    assert env.observation.map == "global"
    assert env.record


@pytest.mark.parametrize("minutes", [0, -1.0, float("nan"), float("inf")])
def test_senseless_minutes_are_refused(minutes):
    with pytest.raises(ConfigError, match="minutes"):
        EpisodeConfig(minutes=minutes)


def test_a_plan_without_room_for_the_robot_is_named():
    with pytest.raises(PlanError, match="closet"):
        run_episode(FloorPlan("closet", box(0, 0, 0.3, 0.3)), 0, QUICK, make_explorer)
