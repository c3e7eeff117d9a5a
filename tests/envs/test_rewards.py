"""The arithmetic of rewards."""

import math
from dataclasses import fields, replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.envs import BatchExploreEnv, ExploreEnv, RewardConfig, StepRecord
from slamgym.envs.rewards import FUNCTIONS, Reward, potential_shaping
from slamgym.metrics.map_error import ObstacleDistance

number = st.floats(-100.0, 100.0)
share = st.floats(0.0, 1.0)
records = st.builds(
    StepRecord,
    duration=st.floats(0.0, 1.0),
    time=st.floats(0.0, 500.0),
    distance=st.floats(0.0, 1.0),
    contact=st.booleans(),
    coverage=share,
    previous_coverage=share,
    pose_error=st.floats(0.0, 5.0),
    terminated=st.booleans(),
    floor_area=st.floats(0.0, 300.0),
    map_errors=st.tuples(share, share).map(lambda errors: lambda: errors),
)
configs = st.builds(
    RewardConfig,
    **{entry.name: number for entry in fields(RewardConfig) if entry.name != "discount"},
    discount=share,
)
AT_REST = StepRecord(
    duration=0.2,
    time=0.2,
    distance=0.0,
    contact=False,
    coverage=0.5,
    previous_coverage=0.5,
    pose_error=0.0,
    terminated=False,
)


@given(records, configs)
def test_the_reward_is_the_sum_of_its_terms(record, config):
    total, terms = Reward(config)(record)
    assert total == pytest.approx(sum(terms.values()))
    for name, function in FUNCTIONS.items():
        weight = getattr(config, name)
        assert terms.get(name, 0.0) == pytest.approx(weight * function(record))


@given(records)
def test_weights_of_zero_leave_nothing(record):
    nothing = RewardConfig(**{entry.name: 0.0 for entry in fields(RewardConfig)})
    assert Reward(nothing)(record) == (0.0, {})


@given(st.lists(share, min_size=2, max_size=30), st.floats(0.9, 1.0))
def test_shaping_telescopes_to_the_potential_of_the_start(coverages, discount):
    """Discounted shaping adds minus the first potential, whatever the path (Ng et al. 1999, theorem 1)."""
    steps = [replace(AT_REST, previous_coverage=a, coverage=b) for a, b in pairwise(coverages)]
    steps[-1] = replace(steps[-1], terminated=True)
    total = sum(discount**i * potential_shaping(step, discount) for i, step in enumerate(steps))
    assert total == pytest.approx(1.0 - coverages[0], abs=1e-9)


def test_costs_are_negative_and_gains_positive():
    step = replace(
        AT_REST,
        distance=0.1,
        contact=True,
        coverage=0.6,
        terminated=True,
        floor_area=50.0,
        map_errors=lambda: (0.03, 0.05),
    )
    expected = {
        "coverage_gain": 0.1,
        "floor_gain": 5.0,
        "time": -0.2,
        "path_length": -0.1,
        "collision": -1.0,
        "map_error": -0.02,
        "completion": 1.0,
    }
    for name, value in expected.items():
        assert FUNCTIONS[name](step) == pytest.approx(value), name


def test_every_weight_has_its_function():
    weights = {entry.name for entry in fields(RewardConfig)}
    assert weights - FUNCTIONS.keys() == {"shaping", "discount"}


def test_a_record_of_arrays_gives_the_rewards_of_each():
    config = RewardConfig(floor_gain=1.0, path_length=0.5, shaping=2.0, discount=0.9)
    contact = replace(AT_REST, distance=0.1, contact=True, coverage=0.6, floor_area=50.0)
    done = replace(AT_REST, coverage=0.9, floor_area=20.0, terminated=True)
    values = {
        entry.name: np.array([getattr(one, entry.name) for one in (contact, done)])
        for entry in fields(StepRecord)
    }
    totals, terms = Reward(config).of_many(StepRecord(**values))
    for i, one in enumerate((contact, done)):
        total, parts = Reward(config)(one)
        assert totals[i] == total
        assert {name: value[i] for name, value in terms.items()} == parts


@pytest.mark.parametrize("make", [ExploreEnv, partial(BatchExploreEnv, 1)])
def test_the_map_is_measured_where_a_term_reads_its_error_alone(flat: FloorPlan, make, monkeypatch):
    measured: list[float] = []
    measure = ObstacleDistance.mean_error

    def count(self, *given):
        measured.append(measure(self, *given))
        return measured[-1]

    def reads_late(step: StepRecord) -> float:
        if step.time < 0.5:
            return 0.0
        return step.previous_map_error - step.map_error

    monkeypatch.setattr(ObstacleDistance, "mean_error", count)
    env = make(flat, localization="ground_truth", reward_terms={"mine": (1.0, reads_late)})
    env.reset(seed=0)
    action = (0.5, 0.0) if make is ExploreEnv else [(0.5, 0.0)]
    for _ in range(2):
        env.step(action)
    assert not measured
    paid = [float(np.squeeze(env.step(action)[4]["reward_terms"]["mine"])) for _ in range(3)]
    # The first map at the first look, then that of each step if it is a new one: what is paid adds up.
    assert len(measured) >= 2
    assert sum(paid) == pytest.approx(measured[0] - measured[-1], abs=1e-12)


def test_what_is_read_is_what_the_terms_of_the_package_read(flat: FloorPlan):
    """Until the next step, in which the map is another one."""
    kept: list[StepRecord] = []

    def mine(step: StepRecord) -> float:
        kept.append(step)
        return step.previous_map_error - step.map_error

    env = ExploreEnv(
        flat, reward={"map_error": 1.0}, reward_terms={"mine": (1.0, mine)}, slam={"particles": 4}
    )
    env.reset(seed=0)
    for _ in range(20):
        info = env.step((0.5, 0.3))[4]
        assert info["reward_terms"]["mine"] == info["reward_terms"]["map_error"]
        assert kept[-1].map_error == info["map_error"] == env.map_error()
    assert math.isnan(kept[0].map_error)


@pytest.mark.parametrize(
    ("term", "complaint"),
    [
        (
            lambda step: 1.0 / (step.coverage - step.previous_coverage),
            r"'mine' failed .* ZeroDivisionError",
        ),
        (lambda step: None, r"'mine' failed .* TypeError"),
        (lambda step: "1.5", r"'mine' failed .* must be real number, not str"),
        (lambda step: step.map_error, "'mine' gave nan"),
    ],
)
def test_an_own_term_that_fails_is_named_in_one_sentence(term, complaint):
    reward = Reward(RewardConfig(), {"mine": (1.0, term)})
    with pytest.raises(ConfigError, match=complaint):
        reward(AT_REST)
    many = {entry.name: np.full(2, getattr(AT_REST, entry.name)) for entry in fields(StepRecord)}
    with pytest.raises(ConfigError, match=complaint):
        reward.of_many(StepRecord(**many))


def test_own_terms_without_names_are_refused_in_one_sentence():
    with pytest.raises(ConfigError, match=r"reward_terms must be a mapping of names"):
        Reward(RewardConfig(), [(1.0, lambda step: step.distance)])


@pytest.mark.parametrize("mode", ["rbpf", "ground_truth"])
def test_over_an_episode_the_gains_add_up(flat: FloorPlan, mode: str):
    env = ExploreEnv(
        flat,
        localization=mode,
        slam={"particles": 4},
        time_limit=20.0,
        reward={"coverage_gain": 1.0, "map_error": -1.0, "path_length": -1.0},
    )
    _, first = env.reset(seed=3)
    sums: dict[str, float] = {}
    truncated = False
    while not truncated:
        _, reward, _, truncated, info = env.step((0.4, 0.3))
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
        for name, value in info["reward_terms"].items():
            sums[name] = sums.get(name, 0.0) + value
    assert sums["coverage_gain"] == pytest.approx(info["coverage"] - first["coverage"])
    assert sums["map_error"] == pytest.approx(info["map_error"] - first["map_error"])
    assert sums["path_length"] == pytest.approx(info["path_length"])


@pytest.mark.parametrize(
    ("terms", "says"),
    [
        ({"time": (1.0, lambda step: 0.0)}, "reward.time"),
        ({"mine": 1.0}, r"\(weight, function\)"),
        ({"mine": (1.0, "coverage_gian")}, "did you mean 'coverage_gain'"),
        ({"mine": ("much", lambda step: 0.0)}, r"\(weight, function\)"),
    ],
)
def test_unusable_terms_are_refused(terms, says):
    with pytest.raises(ConfigError, match=says):
        Reward(RewardConfig(), terms)


def test_weights_must_be_numbers():
    with pytest.raises(ConfigError, match=r"reward.time"):
        RewardConfig(time=math.nan)
    with pytest.raises(ConfigError, match="discount"):
        RewardConfig(discount=1.5)
