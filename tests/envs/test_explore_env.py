"""What Gymnasium asks of every environment, and what this one promises beyond it."""

import math
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import slamgym  # noqa: F401 - registers the environments
from slamgym.cad import FloorPlan
from slamgym.core.errors import ActionError, ConfigError, PlanError
from slamgym.core.geometry import between
from slamgym.core.types import UNKNOWN, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.sim import ClutterConfig, lidar_level

IDS = ["slamgym/Explore-v4", "slamgym/ExploreDiscrete-v4"]
SETTINGS = [
    {},
    {"localization": "ground_truth", "observation": {"map": "global", "map_size": 64.0}},
    {
        "localization": "dead_reckoning",
        "actions": "discrete",
        "lidar": {"field_of_view_deg": 360.0},
    },
    {"slam": {"particles": 5}, "clutter": {"furniture": 0.5, "people": 1}},
]


def rollout(env: gym.Env, seed: int, steps: int) -> list:
    env.action_space.seed(seed)
    trace = [env.reset(seed=seed)]
    for _ in range(steps):
        trace.append(env.step(env.action_space.sample()))
        if trace[-1][2] or trace[-1][3]:
            trace.append(env.reset())
    return trace


@pytest.mark.parametrize("settings", SETTINGS, ids=["default", "global", "discrete", "clutter"])
def test_gymnasium_finds_nothing_to_complain_about(settings: dict) -> None:
    check_env(ExploreEnv("bundled", **settings), skip_render_check=True)


@pytest.mark.parametrize("env_id", IDS)
def test_the_registered_environments_pass_with_rendering(env_id: str) -> None:
    check_env(gym.make(env_id, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_stable_baselines_finds_nothing_to_complain_about(env_id: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(env_id).unwrapped)


@pytest.mark.parametrize("settings", SETTINGS, ids=["default", "global", "discrete", "clutter"])
def test_two_copies_with_one_seed_live_the_same_life(settings: dict) -> None:
    first = rollout(ExploreEnv("bundled", **settings), seed=7, steps=60)
    second = rollout(ExploreEnv("bundled", **settings), seed=7, steps=60)
    assert all(data_equivalence(a, b, exact=True) for a, b in zip(first, second, strict=True))
    other = rollout(ExploreEnv("bundled", **settings), seed=8, steps=1)
    assert not data_equivalence(first[0][0], other[0][0], exact=True)


def test_an_episode_does_not_depend_on_the_one_before(flat: FloorPlan) -> None:
    used = ExploreEnv(flat)
    rollout(used, seed=1, steps=80)
    again = rollout(used, seed=5, steps=40)
    first = rollout(ExploreEnv(flat), seed=5, steps=40)
    assert all(data_equivalence(a, b, exact=True) for a, b in zip(first, again, strict=True))


def test_every_observation_lies_in_its_space(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, odometry="high", time_limit=20.0, slam={"particles": 3})
    for entry in rollout(env, seed=3, steps=220):
        assert entry[0] in env.observation_space


@pytest.mark.parametrize("env_id", IDS)
def test_the_spec_can_be_pickled(env_id: str) -> None:
    env = gym.make(env_id, localization="ground_truth", config=ExploreConfig(time_limit=10.0))
    spec = pickle.loads(pickle.dumps(env.spec))
    again = gym.make(spec)
    assert again.unwrapped.config == env.unwrapped.config
    assert data_equivalence(env.reset(seed=1)[0], again.reset(seed=1)[0], exact=True)


@pytest.mark.filterwarnings("ignore:.*out of date")
@pytest.mark.parametrize("version", [0, 3])
@pytest.mark.parametrize("name", ["Explore", "ExploreDiscrete", "ExploreFrontiers"])
def test_ids_of_older_versions_name_their_successor(name: str, version: int) -> None:
    with pytest.raises(gym.error.DeprecatedEnv, match=f"use `slamgym/{name}-v4` instead"):
        gym.make(f"slamgym/{name}-v{version}")


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vectors_of_environments_agree_with_single_ones(mode: str) -> None:
    settings = {"localization": "ground_truth", "time_limit": 30.0}
    vector = gym.make_vec("slamgym/Explore-v4", num_envs=2, vectorization_mode=mode, **settings)
    vector.action_space.seed(0)
    observations, _ = vector.reset(seed=4)
    single = gym.make("slamgym/Explore-v4", **settings)
    alone, _ = single.reset(seed=5)  # the vector's second environment has the next seed
    for _ in range(5):
        assert data_equivalence(
            {key: value[1] for key, value in observations.items()}, alone, exact=True
        )
        action = vector.action_space.sample()
        observations, rewards, _, _, infos = vector.step(action)
        alone, reward, *_ = single.step(action[1])
        assert rewards[1] == reward
        assert infos["reward_terms"]["time"].shape == (2,)
    vector.close()


def test_stable_baselines_runs_it_in_processes() -> None:
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    from stable_baselines3.common.env_util import make_vec_env

    env = make_vec_env(
        "slamgym:slamgym/Explore-v4",
        n_envs=2,
        seed=1,
        vec_env_cls=vec_env.SubprocVecEnv,
        vec_env_kwargs={
            "start_method": "fork"
        },  # a fresh process spends seconds on importing torch
        env_kwargs={"localization": "ground_truth", "time_limit": 1.0},
    )
    observation = env.reset()
    assert observation["map"].shape == (2, 1, 84, 84)
    for _ in range(6):
        observation, _, dones, infos = env.step(np.ones((2, 2), np.float32))
        if dones.any():
            break
    assert dones.all()
    assert infos[0]["TimeLimit.truncated"]
    env.close()


def test_a_video_can_be_recorded(tmp_path: Path, flat: FloorPlan) -> None:
    env = gym.wrappers.RecordVideo(
        ExploreEnv(flat, render_mode="rgb_array", time_limit=1.0),
        str(tmp_path / "video"),
        disable_logger=True,
    )
    rollout(env, seed=0, steps=5)
    env.close()
    assert next(tmp_path.glob("video/*.mp4")).stat().st_size > 1000


def test_options_choose_plan_and_start(flat: FloorPlan, hall: FloorPlan) -> None:
    env = ExploreEnv([flat, hall])
    _, info = env.reset(seed=0, options={"plan": "hall", "start": (1.0, 2.0, 0.5)})
    assert info["plan"] == "hall"
    assert info["true_pose"] == pytest.approx((1.0, 2.0, 0.5))
    assert env.simulation.world_from_map == Pose2D(1.0, 2.0, 0.0)
    _, info = env.reset(options={"plan": flat})
    assert env.plan is flat
    plans = {env.reset(seed=seed)[1]["plan"] for seed in range(10)}
    assert plans == {"two_rooms", "hall"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"plna": "hall"}, "did you mean 'plan'"),
        ({"plan": "hal"}, "did you mean 'hall'"),
        ({"plan": 3}, "id or a FloorPlan"),
        ({"start": (1.0, 2.0)}, r"\(x, y, theta\)"),
        ({"start": (9.0, 9.0, 0.0)}, "outside the free space"),
        ({"start": (0.1, 1.0, 0.0)}, "no room for the robot"),
    ],
)
def test_wrong_options_are_refused_with_the_fix(options: dict, says: str, hall: FloorPlan) -> None:
    with pytest.raises(ConfigError, match=says):
        ExploreEnv(hall).reset(options=options)


def test_a_plan_that_reaches_out_of_the_canvas_is_refused(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, observation={"map": "global", "map_size": 10.0})
    with pytest.raises(PlanError, match=r"two_rooms.*set observation.map_size to 14 or more"):
        env.reset(options={"start": (0.5, 2.0, 0.0)})
    env.reset(options={"start": (3.5, 2.0, 0.0)})  # from the middle it fits
    larger = ExploreEnv(flat, observation={"map": "global", "map_size": 14.0})
    larger.reset(options={"start": (0.5, 2.0, 0.0)})


def test_step_before_reset_says_so(flat: FloorPlan) -> None:
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        ExploreEnv(flat).step((0.0, 0.0))


def test_the_time_limit_truncates(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, time_limit=2.0, terminate_when_explored=False)
    env.reset(seed=0)
    ends = [env.step((0.0, 0.0))[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]
    endless = ExploreEnv(flat, time_limit=None, terminate_when_explored=False)
    endless.reset(seed=0)
    assert not any(endless.step((0.0, 0.0))[3] for _ in range(20))


def test_a_coverage_goal_terminates(hall: FloorPlan) -> None:
    env = ExploreEnv(hall, coverage_goal=0.9, terminate_when_explored=False)
    _, info = env.reset(seed=0, options={"start": (1.5, 1.5, 0.0)})
    for _ in range(40):
        *_, terminated, _, info = env.step((0.0, 1.0))
        if terminated:
            break
    assert terminated
    assert info["coverage"] >= 0.9
    assert info["is_success"]
    assert info["reward_terms"]["completion"] == env.config.reward.completion


def test_a_room_seen_from_its_middle_is_explored_by_a_turn(hall: FloorPlan) -> None:
    env = ExploreEnv(hall, lidar="exact", localization="ground_truth")
    env.reset(seed=0, options={"start": (1.5, 1.5, 0.0)})
    for _ in range(100):
        *_, terminated, _, info = env.step((0.0, 0.5))
        if terminated:
            break
    assert terminated
    # Only a newly published map can show it.
    assert env.simulation.steps % env.config.publication_steps == 0
    assert info["coverage"] > 0.97


def test_the_next_room_is_left_to_explore(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, lidar="exact", localization="ground_truth")
    env.reset(seed=0, options={"start": (1.0, 3.0, 0.0)})
    assert not any(env.step((0.0, 0.5))[2] for _ in range(100))


def test_contact_is_reported_and_costs(hall: FloorPlan) -> None:
    env = ExploreEnv(hall)
    env.reset(seed=0, options={"start": (2.6, 1.5, 0.0)})
    contacts = []
    infos = []
    for _ in range(10):
        _, _, _, _, info = env.step((1.0, 0.0))
        infos.append(info)
        contacts.append(info["reward_terms"]["collision"] < 0.0)
    assert not contacts[0]
    assert contacts[-1]
    assert infos[-1]["collisions"] == 1  # one contact, however long it lasts
    assert infos[-1]["true_pose"][0] <= 3.0 - 0.22 + 1e-9


def test_normalized_physical_and_discrete_actions_drive_alike(hall: FloorPlan) -> None:
    start = {"start": (1.5, 1.5, 0.0)}
    ends = []
    for kind, action in (("normalized", (0.0, 1.0)), ("physical", (0.0, 1.82)), ("discrete", 1)):
        env = ExploreEnv(hall, actions=kind)
        env.reset(seed=0, options=start)
        for _ in range(3):
            _, _, _, _, info = env.step(action)
        ends.append(info["true_pose"])
    assert ends[0] == pytest.approx(ends[1])
    assert ends[0] == pytest.approx(ends[2])
    assert ends[0][2] > 0.5  # left is counter-clockwise


def test_ground_truth_localisation_knows_and_dead_reckoning_drifts(flat: FloorPlan) -> None:
    errors = {}
    for mode in ("ground_truth", "dead_reckoning"):
        env = ExploreEnv(flat, localization=mode, odometry="high")
        env.reset(seed=2, options={"start": (2.0, 2.0, 0.0)})
        for i in range(60):
            observation, _, _, _, info = env.step((0.3, 1.0 if i % 20 < 10 else -1.0))
        errors[mode] = info["pose_error"]
        believed = observation["pose"][:2] - (info["true_pose"][:2] - [2.0, 2.0])
        assert np.hypot(*believed) == pytest.approx(info["pose_error"], abs=1e-5)
    # Subtracting the start and adding increments rounds, no more.
    assert errors["ground_truth"] < 1e-9
    assert errors["dead_reckoning"] > 0.01


def test_more_particles_leave_the_sensors_noise_as_it_was(flat: FloorPlan) -> None:
    def live(**settings: object) -> list:
        env = ExploreEnv(flat, **settings)
        trace = [env.reset(seed=11)[0]]
        trace += [env.step((0.5, 0.3))[0] for _ in range(15)]
        return [(observation["scan"], observation["velocity"]) for observation in trace]

    few = live(slam={"particles": 3})
    assert data_equivalence(few, live(slam={"particles": 9}), exact=True)
    assert data_equivalence(few, live(localization="ground_truth"), exact=True)
    # And other odometry leaves the scanner as it was; a scan that takes its time is seen by odometry.
    at_once, noisy = (live(odometry=level, lidar={"sweep": 0.0}) for level in ("low", "high"))
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(at_once, noisy, strict=True))


def test_the_log_holds_every_scan(flat: FloorPlan) -> None:
    at_once = {"sweep": 0.0}
    env = ExploreEnv(flat, ExploreConfig().for_explorer(), slam={"particles": 3}, lidar=at_once)
    env.reset(seed=0)
    infos = [env.step((0.4, 0.2))[4] for _ in range(12)]
    log = env.log
    assert log is not None
    assert len(log) == 13
    assert log.stamps == pytest.approx(0.2 * np.arange(13))
    assert log.true_poses[1:] == pytest.approx(np.array([info["true_pose"] for info in infos]))
    assert log.ranges[-1] == pytest.approx(env.simulation.scan.ranges)
    assert log.odometry[0] == pytest.approx((0.0, 0.0, env.start.theta))
    assert log.estimates[-1] == pytest.approx(env.mapper.pose)
    assert log.true_trajectory(env.start).poses[0] == pytest.approx((0.0, 0.0, env.start.theta))


def test_odometry_without_errors_follows_the_truth(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, odometry="ideal")
    env.reset(seed=0)
    start = env.simulation.true_pose
    for _ in range(20):
        env.step((0.5, 0.4))
    moved = between(start, env.simulation.true_pose)
    believed = between(Pose2D(0.0, 0.0, start.theta), env.simulation.odometry_pose)
    assert believed == pytest.approx(moved, abs=1e-9)


def test_the_global_map_is_shared_only_between_publications(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, ExploreConfig().for_explorer())
    observation, _ = env.reset(seed=0)
    maps = [observation["map"]] + [env.step((0.0, 0.5))[0]["map"] for _ in range(10)]
    assert all(cells is maps[0] for cells in maps[:10])
    assert maps[10] is not maps[0]
    assert not maps[0].flags.writeable
    assert (maps[0] != UNKNOWN).any()
    assert not np.array_equal(maps[0], maps[10])


def test_explorers_get_the_robot_but_not_the_plan(flat: FloorPlan) -> None:
    env = ExploreEnv(flat, ExploreConfig(actions="physical").for_explorer())
    context = env.explorer_context()
    env.reset(seed=0)
    assert (1, *context.frame.shape) == env.observation_space["map"].shape
    assert context.geometry == env.simulation.scan.geometry
    assert context.control_step == 0.2
    assert not context.normalized_actions
    with pytest.raises(ConfigError, match="for_explorer"):
        ExploreEnv(flat).explorer_context()


def test_furniture_stands_in_the_world_but_not_in_the_plan() -> None:
    env = ExploreEnv(
        "bundled", clutter=ClutterConfig(furniture=1.0, people=2), lidar=lidar_level("exact")
    )
    env.reset(seed=1)
    walls = len(env.plan.segments())
    assert len(env.clutter.furniture) > 0
    assert len(env.clutter.people) == 2
    assert len(env.simulation.world.segments()) > walls + len(env.clutter.segments()) > walls
    empty = ExploreEnv("bundled", lidar=lidar_level("exact"))
    empty.reset(options={"plan": env.plan, "start": tuple(env.start)})
    assert (env.simulation.scan.ranges <= empty.simulation.scan.ranges).all()


def test_a_plan_that_can_not_be_explored_is_left_out(
    flat: FloorPlan, caplog: pytest.LogCaptureFixture
) -> None:
    import shapely

    duct = FloorPlan("duct", shapely.box(0, 0, 5, 0.3))
    env = ExploreEnv([duct, flat])
    assert {env.reset(seed=seed)[1]["plan"] for seed in range(8)} == {"two_rooms"}
    assert caplog.text.count("duct") == 1
    with pytest.raises(PlanError, match="duct"):
        env.reset(options={"plan": "duct"})
    with pytest.raises(PlanError, match="100 plans"):
        ExploreEnv(duct).reset(seed=0)


def test_a_map_made_without_errors_has_none_but_its_cells(flat):
    env = ExploreEnv(flat, localization="ground_truth", lidar="exact", reward={"map_error": 1.0})
    _, info = env.reset(seed=0)
    for i in range(50):
        info = env.step((0.3, 1.0 if i % 20 < 10 else -1.0))[4]
    # A hit lies anywhere in its 5 cm cell; the centre is then 1.25 cm away in the mean for a wall parallel to
    # the grid, and the distance field rounds by up to half of its own cell.
    assert 0.0 < info["map_error"] < 0.026


@pytest.mark.parametrize(
    ("kind", "wrong", "expected"),
    [
        ("normalized", [1], r"step\(\) takes two numbers in \[-1, 1\], .*, not \[1\]"),
        ("normalized", 0.5, "two numbers"),
        ("normalized", None, "two numbers"),
        ("normalized", ["fast", 0.0], "two numbers"),
        ("physical", np.zeros(3, np.float32), "the speed .* and the turning rate"),
        ("discrete", 3, r"0 \(ahead\), 1 \(turn left\) or 2 \(turn right\), not 3"),
        ("discrete", -1, "not -1"),
        ("discrete", 1.5, "not 1.5"),
        ("discrete", (1.0, 0.0), "0 .ahead."),
    ],
)
def test_a_wrong_action_is_one_clear_error(
    hall: FloorPlan, kind: str, wrong: object, expected: str
) -> None:
    env = ExploreEnv(hall, localization="ground_truth", actions=kind)
    env.reset(seed=0)
    with pytest.raises(ActionError, match=expected) as caught:
        env.step(wrong)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_a_wrong_choice_of_frontier_is_one_clear_error(hall: FloorPlan) -> None:
    env = gym.make("slamgym/ExploreFrontiers-v4", plans=hall, localization="ground_truth").unwrapped
    env.reset(seed=0)
    for wrong in (32, -1, 1.5, np.array(0.5), [1, 2], "left"):
        with pytest.raises(
            ActionError, match="a whole number from 0 to 31, as the action space has it, not"
        ):
            env.step(wrong)


@pytest.mark.parametrize("name", ["Explore", "ExploreFrontiers"])
def test_success_and_map_error_come_under_gymnasiums_own_time_limit_too(name: str) -> None:
    env = gym.make(f"slamgym/{name}-v4", max_episode_steps=3, localization="ground_truth")
    env.reset(seed=1)
    truncated = False
    while not truncated:
        *_, truncated, info = env.step(env.action_space.sample() * 0)
        assert info["is_success"] is False
    assert info["map_error"] == env.unwrapped.map_error() if name == "Explore" else True
    assert 0.0 < info["map_error"] < 0.5
    assert type(pickle.loads(pickle.dumps(info))) is dict, "no environment goes to other processes"
    with pytest.raises(KeyError):
        info["map_eror"]


@pytest.mark.parametrize("env_id", [*IDS, "slamgym/ExploreFrontiers-v4"])
@pytest.mark.parametrize("mode", [None, "sync"])
def test_vectors_are_made_by_name_and_cut_off_by_gymnasiums_limit(env_id: str, mode) -> None:
    envs = gym.make_vec(
        env_id,
        num_envs=2,
        vectorization_mode=mode,
        max_episode_steps=4,
        localization="ground_truth",
    )
    envs.reset(seed=1)
    for step in range(4):
        observations, rewards, terminations, truncations, _ = envs.step(envs.action_space.sample())
        assert truncations.all() == (step == 3) or terminations.any()
    assert observations in envs.observation_space
    assert rewards.shape == (2,)
    envs.close()


@pytest.mark.parametrize("action", [(math.nan, 0.0), (0.0, math.nan), (0.5,), "ahead", None])
def test_an_action_that_is_none_is_refused(flat: FloorPlan, action) -> None:
    env = ExploreEnv(flat, localization="ground_truth")
    env.reset(seed=0)
    with pytest.raises(ActionError, match="two numbers"):
        env.step(action)
