"""The arithmetic of rewards."""

import math
from dataclasses import fields
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.envs import BatchExploreEnv, ExploreEnv, RewardConfig, StepRecord
from slamgym.envs.records import FIGURES
from slamgym.envs.rewards import FUNCTIONS, MOST_MISSING, Reward, missing_cost, potential_shaping
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
    map_error=share,
    previous_map_error=share,
    entropy=st.floats(0.0, 1e5),
    previous_entropy=st.floats(0.0, 1e5),
    clearance=st.floats(0.0, 5.0),
    turning=st.floats(-1.0, 1.0),
    revisits=st.integers(0, 20),
    covariance=st.just(np.eye(3)),
)
configs = st.builds(
    RewardConfig,
    **dict.fromkeys(
        {entry.name for entry in fields(RewardConfig)} - {"discount", "promised"}, number
    ),
    discount=share,
    promised=share,
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
    floor_area=20.0,
    map_error=0.0,
    previous_map_error=0.0,
    entropy=500.0,
    previous_entropy=500.0,
    clearance=1.0,
    turning=0.0,
    revisits=0,
    covariance=np.zeros((3, 3)),
)


@given(records, configs)
def test_the_reward_is_the_sum_of_its_terms(record, config):
    total, terms = Reward(config)(record)
    assert total == pytest.approx(sum(terms.values()), abs=1e-9)
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
    steps = [AT_REST.but(previous_coverage=a, coverage=b) for a, b in pairwise(coverages)]
    steps[-1] = steps[-1].but(terminated=True)
    total = sum(discount**i * potential_shaping(step, discount) for i, step in enumerate(steps))
    assert total == pytest.approx(1.0 - coverages[0], abs=1e-9)


def test_costs_are_negative_and_gains_positive():
    step = AT_REST.but(
        distance=0.1,
        contact=True,
        coverage=0.6,
        terminated=True,
        floor_area=50.0,
        previous_map_error=0.03,
        map_error=0.05,
        entropy=460.0,
        clearance=0.15,
        turning=-0.3,
        revisits=2,
        covariance=np.diag([0.09, 0.16, 1.0]),
    )
    expected = {
        "coverage_gain": 0.1,
        "floor_gain": 5.0,
        "time": -0.2,
        "path_length": -0.1,
        "collision": -1.0,
        "map_error": -0.02,
        "information_gain": 40.0,
        "clearance": -0.05,
        "turning": -0.3,
        "revisits": -2.0,
        "uncertainty": -0.5,
        "completion": 1.0,
    }
    assert expected.keys() == FUNCTIONS.keys()
    for name, value in expected.items():
        assert FUNCTIONS[name](step) == pytest.approx(value), name


def test_every_weight_has_its_function():
    weights = {entry.name for entry in fields(RewardConfig)}
    assert weights - FUNCTIONS.keys() == {"shaping", "discount", "missing", "promised"}


@pytest.mark.parametrize(
    ("coverage", "missing"), [(0.99, 0.0), (0.975, 0.5), (0.95, 3.0), (0.4, MOST_MISSING)]
)
def test_missing_floor_is_charged_at_the_end_alone_and_up_to_a_limit(coverage, missing):
    step = StepRecord(coverage=coverage, terminated=True)
    assert missing_cost(step, 0.98) == pytest.approx(-missing)
    assert missing_cost(step.but(terminated=False), 0.98) == 0.0


def test_a_record_of_arrays_gives_the_rewards_of_each():
    config = RewardConfig(**dict.fromkeys(FUNCTIONS, 1.5), shaping=2.0, discount=0.9)
    contact = {"distance": 0.1, "contact": True, "coverage": 0.6, "clearance": 0.1, "revisits": 3}
    done = {"coverage": 0.9, "terminated": True, "entropy": 20.0, "covariance": np.eye(3)}
    given = [{**vars(AT_REST)["_figures"], **one} for one in (contact, done)]
    steps = StepRecord(**{name: np.array([one[name] for one in given]) for name in given[0]})
    totals, terms = Reward(config)(steps)
    for i, one in enumerate(given):
        total, parts = Reward(config)(StepRecord(**one))
        assert totals[i] == pytest.approx(total, abs=1e-12)
        assert {name: value[i] for name, value in terms.items()} == pytest.approx(parts)
        assert Reward(config)(steps.of_robot(i))[0] == pytest.approx(total, abs=1e-12)


def test_what_a_record_has_not_is_an_error_and_never_0():
    record = StepRecord(coverage=0.5)
    with pytest.raises(AttributeError, match="made without 'clearance'"):
        _ = record.clearance
    with pytest.raises(AttributeError, match="did you mean 'clearance'"):
        _ = record.clearence
    with pytest.raises(TypeError, match="did you mean 'coverage'"):
        StepRecord(covrage=0.5)


@pytest.mark.parametrize("settings", [{"localization": "ground_truth"}, {"slam": {"particles": 2}}])
def test_every_figure_can_be_read_and_is_the_same_in_a_batch(flat: FloorPlan, settings):
    """Of each kind of environment, at a step at which something was driven."""

    def collect(step: StepRecord) -> float:
        found.append({name: getattr(step, name) for name in FIGURES})
        return 0.0

    seen = []
    for make, action in ((ExploreEnv, (0.5, 0.3)), (partial(BatchExploreEnv, 2), [(0.5, 0.3)] * 2)):
        found: list[dict] = []
        env = make(flat, reward_terms={"collect": (1.0, collect)}, **settings)
        env.reset(seed=0)
        for _ in range(12):
            env.step(action)
        seen.append(found[:: len(found) // 12])
    for single, batch in zip(*seen, strict=True):
        for name in FIGURES:
            if name == "map":
                assert single[name].frame == batch[name].frame
                assert np.array_equal(single[name].cells, batch[name].cells)
            else:
                assert np.array_equal(single[name], batch[name]), name
    last = seen[0][-1]
    assert last["scan"].shape == (180,)
    assert last["turning"] > 0.0
    assert last["known_area"] >= last["previous_known_area"] > 1.0
    assert last["entropy"] <= last["previous_entropy"]
    assert 0.0 < last["frontier_distance"] < 8.0
    assert last["clearance"] > 0.0


def test_a_figure_is_read_in_its_own_step_alone(flat: FloorPlan):
    kept: list[StepRecord] = []

    def keep(step: StepRecord) -> float:
        kept.append(step)
        return step.coverage

    env = ExploreEnv(flat, localization="ground_truth", reward_terms={"keep": (1.0, keep)})
    env.reset(seed=0)
    env.step((0.5, 0.0))
    env.step((0.5, 0.0))
    assert kept[0].coverage <= kept[1].coverage
    with pytest.raises(LookupError, match="in its own step"):
        _ = kept[0].clearance


def test_places_are_counted_when_the_robot_comes_again(hall: FloorPlan):
    env = ExploreEnv(hall, localization="ground_truth", reward={"revisits": 1.0})
    env.reset(seed=0, options={"start": (1.0, 1.5, 0.0)})
    out = [env.step((1.0, 0.0))[4]["reward_terms"]["revisits"] for _ in range(20)]
    back = [env.step((-1.0, 0.0))[4]["reward_terms"]["revisits"] for _ in range(20)]
    assert set(out) == {0.0}, "all places are new"
    assert min(back) == -1.0
    assert back.count(-1.0) >= 2, "once for each place, not for each step in it"
    assert back.count(-1.0) < 5


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
    with pytest.raises(LookupError, match="in its own step"):
        _ = kept[0].known_area


@pytest.mark.parametrize(
    ("term", "complaint"),
    [
        (
            lambda step: 1.0 / (step.coverage - step.previous_coverage),
            r"'mine' failed .* ZeroDivisionError",
        ),
        (lambda step: None, r"'mine' failed .* TypeError"),
        (lambda step: "1.5", r"'mine' failed .* must be real number, not str"),
        (lambda step: math.nan, "'mine' gave nan"),
        (lambda step: step.frontier_distance, "'mine' failed .* without 'frontier_distance'"),
    ],
)
def test_an_own_term_that_fails_is_named_in_one_sentence(term, complaint):
    reward = Reward(RewardConfig(), {"mine": (1.0, term)})
    with pytest.raises(ConfigError, match=complaint):
        reward(AT_REST)
    figures = vars(AT_REST)["_figures"]
    many = StepRecord(**{name: np.array([value] * 2) for name, value in figures.items()})
    with pytest.raises(ConfigError, match=complaint):
        reward(many)


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
