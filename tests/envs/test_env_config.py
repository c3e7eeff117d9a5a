"""Settings of the environment."""

import gymnasium as gym
import pytest

from slamgym.cad import FloorPlan
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.envs import ExploreConfig, ExploreEnv, ObservationConfig
from slamgym.envs.config import resolve_config
from slamgym.sim import lidar_level, odometry_level
from slamgym.slam import SlamConfig


def test_keywords_change_what_they_name_and_nothing_else():
    base = ExploreConfig(slam=SlamConfig(particles=7), time_limit=60.0)
    config = resolve_config(
        base,
        {
            "localization": "dead_reckoning",
            "odometry": "high",
            "lidar": "exact",
            "observation": {"map": "global"},
            "coverage_goal": 0.9,
        },
    )
    assert config.slam == SlamConfig(particles=7, mode="dead_reckoning")
    assert config.odometry == odometry_level("high")
    assert config.lidar == lidar_level("exact")
    assert config.observation == ObservationConfig(map="global")
    assert (config.time_limit, config.coverage_goal) == (60.0, 0.9)
    assert resolve_config(None, {}) == ExploreConfig()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"time_limits": 3.0}, "did you mean 'time_limit'"),
        ({"localisation": "rbpf"}, "did you mean 'localization'"),
        ({"slam": {"particle": 3}}, "did you mean 'particles'"),
        ({"odometry": "hihg"}, "did you mean 'high'"),
        ({"robot": "burger"}, "RobotConfig"),
        ({"actions": "normalised"}, "did you mean 'normalized'"),
        ({"time_limit": 0.0}, "time_limit must be above 0 or None, not 0"),
        ({"coverage_goal": 95}, r"coverage_goal must be in \(0, 1\] or None, not 95"),
        ({"observation": {"map": "local"}}, "egocentric"),
        ({"observation": {"crop_px": 0}}, "crop_px"),
        ({"render_mode": "rgb_aray"}, "did you mean 'rgb_array'"),
    ],
)
def test_mistakes_are_refused_with_the_fix(settings: dict, says: str, flat: FloorPlan):
    with pytest.raises(ConfigError, match=says):
        ExploreEnv(flat, **settings)


def test_an_unknown_localisation_is_refused(flat: FloorPlan):
    with pytest.raises(ConfigError, match="did you mean 'rbpf'"):
        ExploreEnv(flat, localization="rbfp").reset()


def test_plans_that_are_no_plans_are_refused():
    with pytest.raises(InputFileError, match="no such file"):
        ExploreEnv("nowhere/plans.json")
    with pytest.raises(ConfigError, match="a list of plans must hold FloorPlans, not 'bundled'"):
        ExploreEnv(["bundled"])  # type: ignore[list-item]
    with pytest.raises(ConfigError, match="plans must"):
        ExploreEnv(42)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="at least one"):
        ExploreEnv([])


def test_the_canvas_is_centred_on_the_start():
    frame = ObservationConfig(map="global", map_size=10.0, map_resolution=0.1).frame()
    assert frame.shape == (100, 100)
    assert frame.bounds == pytest.approx((-5.0, -5.0, 5.0, 5.0))
    # An odd number of cells is made even, so that the origin stays a corner of cells.
    assert ObservationConfig(map_size=0.5, map_resolution=0.1).frame().width_px % 2 == 0


def test_steps_follow_the_scanner():
    config = resolve_config(None, {"lidar": {"rate": 10.0}, "time_limit": 30.0})
    assert config.control_step == pytest.approx(0.1)
    assert config.max_steps == 300
    assert config.publication_steps == 20


def test_the_config_survives_json():
    config = ExploreConfig(
        observation=ObservationConfig(map="global"), coverage_goal=0.5
    ).for_explorer()
    assert from_dict(ExploreConfig, to_dict(config)) == config


def test_gym_make_passes_settings_on(flat: FloorPlan):
    env = gym.make(
        "slamgym/ExploreDiscrete-v4", plans=flat, localization="ground_truth", time_limit=7.0
    )
    assert isinstance(env.action_space, gym.spaces.Discrete)
    assert env.unwrapped.config.slam.mode == "ground_truth"
    assert env.unwrapped.config.time_limit == 7.0
