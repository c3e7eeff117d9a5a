"""Reward presets, their experiment and its report; learning itself is replaced by writing weights."""

import dataclasses

import numpy as np
import pytest

import slamgym.agents.rl.shaping as shaping_module
from slamgym.agents.pretrained_policy import PRETRAINED, read_policy, write_policy
from slamgym.agents.rl.reward_presets import (
    OWN,
    REWARD_PRESETS,
    ShapingConfig,
    reward_preset,
)
from slamgym.agents.rl.shaping import (
    Experiment,
    ShapingRun,
    own_term,
    run_shaping,
    table,
    write_shaping_report,
)
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.envs.rewards import Reward, StepRecord


def main(argv):
    return TABLE.run("slamgym", ["agents", "shape", *map(str, argv)])


STEP = StepRecord(
    duration=0.2, time=10.0, distance=0.05, contact=True, coverage=0.5, previous_coverage=0.4, pose_error=0.2,
    terminated=True, map_error=0.05, previous_map_error=0.04, floor_area=50.0,
)  # fmt: skip


def outcome(time=100.0, map_error=0.02):
    return {"time_99": 90.0, "time": time, "path": 30.0, "coverage": 1.0, "map_error": map_error}


def settings(config, preset, seed):
    return config.settings(preset, seed)


def runs_of(name, times, errors):
    outcomes = [outcome(t, e) for t, e in zip(times, errors, strict=True)]
    return [ShapingRun(name, seed, outcomes) for seed in range(2)]


@pytest.mark.parametrize("name", REWARD_PRESETS)
def test_every_preset_rewards_what_its_weights_say(name):
    reward = Reward(REWARD_PRESETS[name])
    total, terms = reward(STEP)
    assert np.isfinite(total)
    assert terms
    assert total == pytest.approx(sum(terms.values()))


def test_the_presets_differ_in_what_they_pay_for():
    active = {name: set(Reward(chosen).terms) for name, chosen in REWARD_PRESETS.items()}
    assert active["path_cost"] == {"coverage_gain", "path_length"}
    assert active["map_error"] - active["time"] == {"map_error"}
    assert active["floor"] == {"floor_gain", "collision"}
    assert active["potential"] == {"time", "shaping"}
    assert active["completion"] == {"time", "completion"}
    assert len({frozenset(terms) for terms in active.values()}) == len(REWARD_PRESETS)


def test_an_unknown_preset_suggests_the_nearest():
    with pytest.raises(ConfigError, match="did you mean 'map_error'"):
        reward_preset("map_eror")
    with pytest.raises(ConfigError, match="did you mean 'time'"):
        ShapingConfig(presets=("tme",))


def test_with_a_preset_about_errors_all_train_with_the_filter():
    config = ShapingConfig(presets=("time", "map_error"))
    for name in ("time", "map_error"):
        chosen = settings(config, name, 1)
        assert chosen.localization == "rbpf"
        differing = dataclasses.replace(chosen, reward=config.train.reward, localization="ground_truth")
        assert differing == dataclasses.replace(config.train, seed=1)
    without = ShapingConfig(presets=("time", "path_cost"))
    assert settings(without, "time", 1).localization == "ground_truth"
    assert settings(without, "time", 1).reward == REWARD_PRESETS["time"]


def test_a_term_of_ones_own_is_added_to_time_and_trained_with_the_filter():
    config = ShapingConfig(presets=("time", OWN))
    own, time = settings(config, OWN, 2), settings(config, "time", 2)
    assert own == time
    assert own.localization == "rbpf"
    assert own.reward == REWARD_PRESETS["time"]


def learn_nothing(calls):
    def learn(settings, folder, reward_terms=None):
        calls.append((settings.seed, settings.reward, reward_terms))
        write_policy(folder / "policy.safetensors", read_policy(PRETRAINED).weights, {})

    return learn


def test_an_experiment_is_run_once_and_reported(tmp_path):
    train = TrainConfig(time_limit=30.0, evaluate_every=0)
    config = ShapingConfig(presets=("time", OWN), seeds=1, test_plans=1, train=train)
    calls = []
    term = own_term("math:sqrt", 0.5)
    runs = run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert [(run.preset, run.seed, len(run.outcomes)) for run in runs] == [("time", 0, 1), (OWN, 0, 1)]
    assert calls[0][2] is None
    assert calls[1][2]["sqrt"][0] == 0.5
    again = run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert len(calls) == 2
    assert again == runs
    for other in (
        dataclasses.replace(config, train=dataclasses.replace(train, plan_count=3)),
        dataclasses.replace(config, presets=(OWN,)),
    ):
        with pytest.raises(ConfigError, match="other settings"):
            run_shaping(Experiment(other, learn_nothing(calls), own_term("math:sqrt", 0.6)), tmp_path)
    (tmp_path / "time" / "seed_0" / "shaping.json").write_text('{"settings": ')
    with pytest.raises(InputFileError, match="delete the folder"):
        run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert len(calls) == 2


def test_an_interrupted_test_goes_on_with_the_plans_that_are_left(tmp_path, monkeypatch, make_trial):
    explored = []

    def explore_plan(config, policy, plan, seed, **changes):
        if len(explored) == 2:
            explored.append("interrupted")
            raise KeyboardInterrupt
        explored.append((plan.id, seed))
        return make_trial(plan=plan.id, seconds=float(1 + seed % 1000))

    monkeypatch.setattr(shaping_module, "explore_plan", explore_plan)
    config = ShapingConfig(presets=("map_error",), seeds=1, test_plans=4)
    calls = []
    with pytest.raises(KeyboardInterrupt):
        run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "resumed")
    (resumed,) = run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "resumed")
    seen = [entry for entry in explored if entry != "interrupted"]
    assert len(seen) == len(set(seen)) == 4
    (at_once,) = run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "at_once")
    assert resumed.outcomes == at_once.outcomes


def test_the_report_names_presets_and_compares_them_with_time(tmp_path):
    runs = runs_of("time", [100.0, 200.0], [0.02, 0.04]) + runs_of("map_error", [110.0, 220.0], [0.01, 0.02])
    text = write_shaping_report(runs, tmp_path)
    row = next(line for line in text.splitlines() if line.startswith("| map_error"))
    assert "1.10 [1.10, 1.10]" in row  # every plan takes a tenth longer
    assert "0.50 [0.50, 0.50]" in row  # and has half the error
    assert (tmp_path / "shaping.md").read_text() == text


def test_without_the_preset_time_the_first_is_the_reference():
    text = table(runs_of("potential", [100.0, 200.0], [0.02, 0.04]))
    assert "time until done / potential" in text
    assert "1.00 [1.00, 1.00]" in text


def test_one_seed_has_no_interval_and_the_report_says_so():
    runs = runs_of("time", [100.0, 200.0], [0.02, 0.04])
    assert "No interval" not in table(runs)
    alone = table([run for run in runs if run.seed == 0])
    assert "[" not in alone.replace("[s]", "").replace("[m]", "")
    assert "No interval" in alone


@pytest.mark.parametrize("spec", ["nothing_here:f", "math:squareroot", "math"])
def test_a_term_that_is_no_function_is_refused(spec):
    with pytest.raises(ConfigError, match="--term"):
        own_term(spec, 1.0)


def test_the_preset_of_ones_own_needs_a_term():
    with pytest.raises(ConfigError, match="needs --term"):
        main(["-o", "nowhere", "--presets", OWN])
