"""Driving the wheels: Stable-Baselines3's face of a batch, a small training, its weights, the explorer, the example."""

import dataclasses
import importlib.util
import json
import math

import numpy as np
import pytest
from source_tree import ROOT

from slamgym.agents import make_explorer
from slamgym.agents.pretrained_policy import write_mean
from slamgym.agents.rl.learner import LearnerConfig
from slamgym.agents.rl.train_config import WheelsConfig
from slamgym.agents.wheels import (
    WheelsExplorer,
    WheelsPolicy,
    read_wheels,
    wheels_shapes,
    write_wheels,
)
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.envs import BatchExploreEnv, ExploreConfig, ExploreEnv
from slamgym.envs.compact import MapTiles
from slamgym.envs.episode import EpisodeConfig, run_episode

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from slamgym.agents.rl.batch_vec_env import BatchVecEnv  # noqa: E402
from slamgym.agents.rl.run import read_validation  # noqa: E402
from slamgym.agents.rl.wheels import train_wheels  # noqa: E402

TINY = WheelsConfig(
    plan_count=2,
    steps=48,
    num_envs=3,
    learner=LearnerConfig("ppo", {"n_steps": 8, "batch_size": 8, "n_epochs": 1}),
    evaluate_every=24,
    evaluate_plans=2,
    evaluate_seconds=3.0,
)
SETTINGS = {"localization": "ground_truth", "observation": {"preset": "compact"}}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A policy that drives straight ahead, whatever it sees."""
    values = {name: np.zeros(shape, dtype=np.float32) for name, shape in wheels_shapes().items()}
    values["variance"][:] = 1.0
    values["action.bias"][0] = 0.5
    path = tmp_path_factory.mktemp("wheels") / "ahead.safetensors"
    write_wheels(path, WheelsPolicy(values, {}))
    return path


def test_actions_are_held_and_their_rewards_added_up():
    settings = {
        **SETTINGS,
        "reward": {"floor_gain": 1.0},
        "time_limit": None,
        "terminate_when_explored": False,
    }
    plain = BatchExploreEnv(2, "bundled", autoreset_mode="same_step", **settings)
    plain.reset(seed=4)
    face = BatchVecEnv(
        BatchExploreEnv(2, "bundled", autoreset_mode="same_step", **settings), hold=3, seed=4
    )
    face.reset()
    actions = np.array([(0.8, 0.3), (0.5, -0.3)], dtype=np.float32)
    for _ in range(5):
        total = np.zeros(2)
        for _ in range(3):
            expected, reward, *_ = plain.step(actions)
            total += reward
        observations, rewards, dones, _ = face.step(actions)
        np.testing.assert_array_equal(observations, expected)
        np.testing.assert_allclose(rewards, total, rtol=1e-6)
        assert not dones.any()


def test_episodes_are_cut_off_at_different_times_and_say_so():
    env = BatchExploreEnv(
        4,
        "bundled",
        autoreset_mode="same_step",
        time_limit=None,
        terminate_when_explored=False,
        **SETTINGS,
    )
    face = BatchVecEnv(env, hold=2, seconds=(4.0, 8.0), seed=0)
    face.reset()
    lengths = [[] for _ in range(4)]
    for _ in range(50):
        _, _, dones, infos = face.step(np.zeros((4, 2), dtype=np.float32))
        for i in np.flatnonzero(dones):
            assert infos[i]["TimeLimit.truncated"]
            assert infos[i]["terminal_observation"] in face.observation_space
            assert 0.0 < infos[i]["episode"]["coverage"] < 1.0
            lengths[i].append(infos[i]["episode"]["l"] * 0.4)
    assert len({each[0] for each in lengths}) > 1
    assert all(4.0 <= length <= 8.4 for each in lengths for length in each[1:])


def test_an_end_within_a_hold_is_kept():
    env = BatchExploreEnv(2, "bundled", autoreset_mode="same_step", time_limit=0.8, **SETTINGS)
    face = BatchVecEnv(env, hold=3)
    face.reset()
    dones = [face.step(np.ones((2, 2), dtype=np.float32))[2].tolist() for _ in range(2)]
    assert dones == [[False, False], [True, True]]
    with pytest.raises(ConfigError, match="same_step"):
        BatchVecEnv(BatchExploreEnv(2, "bundled", **SETTINGS))


def test_a_run_is_validated_saved_and_goes_on(tmp_path):
    model = train_wheels(TINY, tmp_path)
    assert model.num_timesteps == 48
    for name in (
        "config.json",
        "checkpoint.safetensors",
        "policy.safetensors",
        "states/48.safetensors",
        "mean.safetensors",
        "best.safetensors",
        "validation.csv",
    ):
        assert (tmp_path / name).is_file(), name
    policy = read_wheels(tmp_path / "policy.safetensors")
    # numpy drives as torch does
    observations = (
        np.random.default_rng(0)
        .uniform(0.0, 1.0, (5, len(policy.weights["mean"])))
        .astype(np.float32)
    )
    envs = model.get_vec_normalize_env()
    expected, _ = model.predict(envs.normalize_obs(observations.copy()), deterministic=True)
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)

    longer = train_wheels(TINY, tmp_path)  # nothing is left to do, and nothing is lost
    assert longer.num_timesteps == 48
    np.testing.assert_array_equal(longer.get_vec_normalize_env().obs_rms.mean, envs.obs_rms.mean)
    np.testing.assert_array_equal(
        read_wheels(tmp_path / "policy.safetensors").weights["first.weight"],
        policy.weights["first.weight"],
    )
    assert train_wheels(dataclasses.replace(TINY, steps=72), tmp_path).num_timesteps == 72
    with pytest.raises(ConfigError, match="seed was 0, now 1"):
        train_wheels(dataclasses.replace(TINY, seed=1), tmp_path)


def test_the_mean_of_the_last_quarter_is_judged_like_any_weights(tmp_path):
    train_wheels(dataclasses.replace(TINY, steps=96), tmp_path)
    assert read_wheels(tmp_path / "mean.safetensors").about["mean_of"] == ["72", "96"]
    steps = [row["steps"] for row in read_validation(tmp_path)]
    assert steps == [0, 24, 48, 72, 96, 96]


def test_the_mean_of_weights_says_which_it_is_of(tmp_path, weights):
    policy = read_wheels(weights)
    doubled = {name: 2.0 * value for name, value in policy.weights.items()}
    paths = [tmp_path / "24.safetensors", tmp_path / "48.safetensors"]
    write_wheels(paths[0], policy)
    write_wheels(paths[1], dataclasses.replace(policy, weights=doubled))
    write_mean(paths, tmp_path / "mean.safetensors")
    mean = read_wheels(tmp_path / "mean.safetensors")
    for name, value in policy.weights.items():
        np.testing.assert_allclose(mean.weights[name], 1.5 * value, rtol=1e-6)
    assert mean.about == {**policy.about, "mean_of": ["24", "48"]}
    write_mean(paths[:1], tmp_path / "same.safetensors")
    assert (tmp_path / "same.safetensors").read_bytes() == paths[0].read_bytes()


def test_the_explorer_sees_what_it_was_trained_on(weights):
    """Its observation of the published map is that of the environment's preset, and an action holds for its steps."""
    env = ExploreEnv("bundled", ExploreConfig().for_explorer(), localization="ground_truth")
    twin = ExploreEnv(
        "bundled",
        localization="ground_truth",
        observation={"preset": "compact_far", "map": "global"},
    )
    explorer = make_explorer(f"wheels:{weights}", env.explorer_context())
    observation, _ = env.reset(seed=3)
    twin_observation, _ = twin.reset(seed=3)
    for _ in range(15):
        action, _ = explorer.predict(observation)
        assert action == pytest.approx([0.5, 0.0])
        pilot = explorer._pilots[0]
        pose, velocity = observation["pose"], observation["velocity"]
        shown = MapTiles.of_grid(observation["map"][0], explorer.context.frame)
        seen = pilot._observer.observe(shown, observation["scan"], pose, velocity)
        np.testing.assert_allclose(
            seen, twin_observation, atol=0.07
        )  # single precision moves a point across a border
        assert np.count_nonzero(np.abs(seen - twin_observation) > 1e-5) < 5
        observation, *_ = env.step(action)
        twin_observation, *_ = twin.step(action)
    assert explorer.decisions == 5


@pytest.mark.parametrize("avoids", [True, False])
def test_who_drives_straight_ahead_touches_nothing_if_it_avoids(weights, avoids):
    env = ExploreEnv("bundled", ExploreConfig().for_explorer(), localization="ground_truth")
    explorer = WheelsExplorer(env.explorer_context(), weights, avoids)
    observation, _ = env.reset(seed=3)
    for _ in range(200):
        observation, *_, info = env.step(explorer.predict(observation)[0])
    batch = BatchExploreEnv(3, "bundled", autoreset_mode="same_step", time_limit=None, **SETTINGS)
    face = BatchVecEnv(batch, avoids=avoids)
    face.reset()
    for _ in range(150):
        face.step(np.tile(np.float32([1.0, 0.0]), (3, 1)))
    *_, infos = batch.step(np.zeros((3, 2), dtype=np.float32))
    assert (info["collisions"] == 0) == (infos["collisions"] == 0).all() == avoids


def test_it_explores_whole_episodes(weights, tmp_path):
    from slamgym.cad import open_plans

    source = open_plans("bundled")
    config = EpisodeConfig(explorer=f"wheels:{weights}", minutes=0.1)
    episode = run_episode(source.load(source.ids[0]), 0, config, make_explorer)
    assert episode.finished == "time_limit"
    assert episode.coverage > 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"space": {"blocks": 7}}, "another observation space .blocks 7"),
        ({"network": {"second": 7}}, "another observation space .second 7"),
    ],
)
def test_weights_of_something_else_are_refused(weights, tmp_path, change, message):
    from safetensors.numpy import load_file, save_file

    description = json.loads(weights.with_suffix(".json").read_text())
    for name, values in change.items():
        description[name] |= values
    path = tmp_path / "other.safetensors"
    save_file(load_file(weights), path, {"slamgym": json.dumps(description)})
    with pytest.raises(InputFileError, match=message):
        read_wheels(path)


def test_too_few_beams_are_refused(weights):
    env = ExploreEnv("bundled", ExploreConfig().for_explorer(), lidar={"num_beams": 30})
    with pytest.raises(ConfigError, match="60 beams"):
        make_explorer(f"wheels:{weights}", env.explorer_context())


def load_example():
    spec = importlib.util.spec_from_file_location("ppo_wheels", ROOT / "examples" / "ppo_wheels.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


@pytest.mark.parametrize("recurrent", [False, True])
def test_the_example_learns_a_few_updates(recurrent):
    example = load_example()
    args = example.Args(
        total_timesteps=3 * 4 * 20,
        num_envs=4,
        num_steps=20,
        episode_seconds=3.0,
        num_minibatches=2,
        recurrent=recurrent,
    )
    coverages = example.main(args)
    assert len(coverages) == 3
    assert all(0.0 < coverage < 1.0 and math.isfinite(coverage) for coverage in coverages)
    lines = (ROOT / "examples" / "ppo_wheels.py").read_text().splitlines()
    assert len(lines) <= 220


def test_the_memory_of_the_example_ends_with_an_episode():
    example = load_example()
    envs = BatchExploreEnv(1, "bundled", **SETTINGS)
    agent = example.Agent(envs, recurrent=True)
    seen = torch.rand(2, 1, *envs.single_observation_space.shape)
    empty, begins = torch.zeros(1, 1, 128), torch.ones(2, 1)
    alone, _ = agent.remember(seen[1:], empty, begins[1:])
    after_an_end, _ = agent.remember(seen, empty, begins)
    within, _ = agent.remember(seen, empty, torch.zeros(2, 1))
    torch.testing.assert_close(after_an_end[1:], alone)
    assert not torch.equal(within[1:], alone)
