"""A batch of environments is the same as single ones, to the byte."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import slamgym
from slamgym.core.errors import ActionError, ConfigError
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.parallel.local import SINGLE_THREADED
from slamgym.envs import BatchExploreEnv, ExploreEnv
from slamgym.envs.batch.threads import usable_threads

COUNT = 3


def assert_same(single, batch, where):
    if isinstance(single, dict):
        assert single.keys() == batch.keys(), where
        for key in single:
            assert_same(single[key], batch[key], f"{where}/{key}")
    else:
        np.testing.assert_array_equal(single, batch, where)


def assert_same_infos(single, batch, where):
    """Compare infos where their masks say that they mean something."""
    assert single.keys() == batch.keys(), where
    for name, value in single.items():
        if name.startswith("_"):
            np.testing.assert_array_equal(value, batch[name], f"{where}/{name}")
            continue
        mask = single[f"_{name}"]
        if isinstance(value, dict):
            assert_same_infos(value, batch[name], f"{where}/{name}")
        elif name == "final_obs":
            for i in np.flatnonzero(mask):
                assert_same(value[i], batch[name][i], f"{where}/{name}")
        else:
            np.testing.assert_array_equal(value[mask], batch[name][mask], f"{where}/{name}")


def drive_both(mode, steps, **settings):
    """Step both with the same actions and compare all that they give; returns contacts and ends."""
    single = SyncVectorEnv([lambda: ExploreEnv("bundled", **settings)] * COUNT, autoreset_mode=mode)
    batch = BatchExploreEnv(COUNT, "bundled", autoreset_mode=mode, threads=2, **settings)
    assert_same_reset(single.reset(seed=5), batch.reset(seed=5), "first")
    rng = np.random.default_rng(0)
    turn = np.zeros(COUNT)
    over = np.zeros(COUNT, dtype=np.bool_)
    contacts = 0
    ends = 0
    for step in range(steps):
        turn = 0.9 * turn + 0.2 * rng.standard_normal(COUNT)
        actions = np.stack([np.full(COUNT, 0.8), turn], axis=1).astype(np.float32)
        if mode == AutoresetMode.DISABLED and over.any():
            theirs = single.reset(options={"reset_mask": over})
            assert_same_reset(theirs, batch.reset(options={"reset_mask": over}), f"{step}/reset")
        theirs = single.step(actions)
        ours = batch.step(actions)
        for name, one, other in zip(("seen", "reward", "over", "late"), theirs, ours, strict=False):
            assert_same(one, other, f"{step}/{name}")
        *_, terminations, truncations, infos = theirs
        assert_same_infos(infos, ours[4], str(step))
        over = terminations | truncations
        ends += over.sum()
        contacts += infos["collisions"].sum()
    return contacts, ends


def assert_same_reset(theirs, ours, where):
    assert_same(theirs[0], ours[0], where)
    assert_same_infos(theirs[1], ours[1], where)


def early(step):
    """A term of one's own that branches, as only a single transition can."""
    return step.coverage - step.previous_coverage if step.time < 2.0 else -step.map_error


CASES = {
    "far": (
        AutoresetMode.SAME_STEP,
        {"localization": "ground_truth", "observation": {"preset": "compact_far", "map": "global"}},
    ),
    "far and newest": (
        AutoresetMode.NEXT_STEP,
        {
            "localization": "dead_reckoning",
            "observation": {"preset": "compact_far"},
            "reward_terms": {"early": (3.0, early)},
        },
    ),
    "far with scan matching": (
        AutoresetMode.DISABLED,
        {"slam": {"mode": "rbpf", "particles": 1}, "observation": {"preset": "compact_far"}},
    ),
    "dictionary": (
        AutoresetMode.SAME_STEP,
        {"localization": "ground_truth", "lidar": "real", "reward": {"map_error": 1.0}},
    ),
    "wheels believed": (
        AutoresetMode.NEXT_STEP,
        {"localization": "dead_reckoning", "observation": {"preset": "map"}, "lidar": "gazebo"},
    ),
    "scan matching": (
        AutoresetMode.SAME_STEP,
        {
            "localization": "dead_reckoning",
            "observation": {"preset": "compact"},
            "odometry": "high",
        },
    ),
    "particles": (
        AutoresetMode.SAME_STEP,
        {"localization": "rbpf", "slam": {"particles": 3}, "odometry": "ideal", "lidar": "exact"},
    ),
    "coarse cells": (
        AutoresetMode.SAME_STEP,
        {
            "localization": "ground_truth",
            "observation": {"preset": "compact", "crop_resolution": 0.4},
        },
    ),
    "a sweep, and things that move": (
        AutoresetMode.SAME_STEP,
        {
            "localization": "ground_truth",
            "lidar": {"sweep": 0.1},
            "clutter": {"furniture": 1.0, "people": 3, "changes": 30.0},
        },
    ),
    "a sweep that is mapped by wheels": (
        AutoresetMode.DISABLED,
        {
            "localization": "dead_reckoning",
            "lidar": {"num_beams": 360, "field_of_view_deg": 360.0},
            "observation": {"preset": "compact"},
        },
    ),
    "people and the whole map": (
        AutoresetMode.NEXT_STEP,
        {
            "localization": "ground_truth",
            "clutter": {"people": 2},
            "observation": {"map": "global", "map_resolution": 0.2},
        },
    ),
    "furniture": (
        AutoresetMode.NEXT_STEP,
        {
            "localization": "ground_truth",
            "clutter": {"furniture": 1.0},
            "observation": {"preset": "compact"},
        },
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_batch_is_the_same_as_single_environments(name):
    mode, settings = CASES[name]
    contacts, ends = drive_both(mode, 60, time_limit=8.0, **settings)
    assert contacts > 0
    assert ends > 0


def test_explorations_end_at_the_same_step():
    settings = {
        "localization": "ground_truth",
        "observation": {"preset": "compact"},
        "coverage_goal": 0.25,
    }
    _, ends = drive_both(
        AutoresetMode.SAME_STEP, 120, **settings, reward={"shaping": 1.0, "floor_gain": 1.0}
    )
    assert ends > 0


def test_any_number_of_threads_gives_the_same_and_so_does_a_copy():
    settings = {"localization": "ground_truth", "observation": {"preset": "compact_far"}}
    batches = [
        BatchExploreEnv(COUNT, "bundled", threads=threads, **settings)
        for threads in (1, 2, COUNT + 1)
    ]
    for batch in batches:
        batch.reset(seed=5)
    batches.append(copy.deepcopy(batches[1]))
    for _ in range(12):  # the map is published at the tenth step
        first, *others = [batch.step(np.full((COUNT, 2), 0.6)) for batch in batches]
        for other in others:
            assert_same(first[0], other[0], "seen")
            assert_same_infos(first[4], other[4], "info")


def test_threads_are_those_of_the_process(monkeypatch):
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    for given, expected in (
        ("1", 1),
        ("0", 1),
        ("99999", available_cores()),
        ("many", available_cores()),
    ):
        monkeypatch.setenv("OMP_NUM_THREADS", given)
        assert usable_threads() == expected
    for name, count in SINGLE_THREADED.items():
        monkeypatch.setenv(name, count)
    assert usable_threads() == 1, "workers compute on one thread"


def test_an_explored_room_ends_the_episode(hall):
    settings = {"lidar": "exact", "localization": "ground_truth"}
    middle = {"start": (1.5, 1.5, 0.0)}
    batch = BatchExploreEnv(2, hall, autoreset_mode="same_step", **settings)
    single = ExploreEnv(hall, **settings)
    batch.reset(seed=0, options=middle)
    single.reset(seed=0, options=middle)
    for _ in range(100):
        *_, terminated, _, _ = single.step((0.0, 0.5))
        _, _, terminations, _, infos = batch.step(np.array([(0.0, 0.5)] * 2))
        assert terminations[0] == terminated
        if terminated:
            assert infos["final_info"]["is_success"][0]
            return
    pytest.fail("the room wasn't explored")


def test_gymnasium_makes_it_by_name():
    assert slamgym.__version__
    envs = gym.make_vec(
        "slamgym/ExploreDiscrete-v4",
        num_envs=2,
        vectorization_mode="vector_entry_point",
        localization="ground_truth",
        observation={"preset": "compact"},
    )
    observations, _ = envs.reset(seed=1)
    assert observations in envs.observation_space
    observations, rewards, *_ = envs.step(np.array([0, 1]))
    assert observations in envs.observation_space
    assert rewards.shape == (2,)
    with pytest.raises(ActionError, match="turn left"):
        envs.step(np.array([0, 7]))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"record": True}, "record=False"),
        ({"render_mode": "rgb_array"}, "render_mode"),
        ({"autoreset_mode": "same_stp"}, "same_step"),
        ({"num_envs": 0}, "num_envs"),
        ({"threads": 0}, "threads"),
        ({"localisation": "ground_truth"}, "localization"),
    ],
)
def test_what_a_batch_has_not_is_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        BatchExploreEnv(**{"num_envs": 2, **settings})


def test_resets_are_checked(hall):
    batch = BatchExploreEnv(2, hall, autoreset_mode="disabled", time_limit=0.2)
    with pytest.raises(gym.error.ResetNeeded):
        batch.step(np.zeros((2, 2)))
    with pytest.raises(ConfigError, match="first reset"):
        batch.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ConfigError, match="seed"):
        batch.reset(seed=[1])
    batch.reset(seed=0, options={"start": (1.5, 1.5, 0.0)})
    with pytest.raises(ConfigError, match="reset_mask"):
        batch.reset(options={"reset_mask": np.array([1, 0])})
    with pytest.raises(ActionError, match="speed"):
        batch.step(np.array([[0.0, 0.0], [np.nan, 0.0]]))
    for count in (1, 3):
        with pytest.raises(ActionError, match="2 actions, one for each environment"):
            batch.step(np.zeros((count, 2)))
    batch.step(np.zeros((2, 2)))
    with pytest.raises(gym.error.ResetNeeded):
        batch.step(np.zeros((2, 2)))
