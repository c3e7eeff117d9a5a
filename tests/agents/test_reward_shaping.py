"""Reward presets, their experiment and its report; learning itself is replaced by writing weights."""

import dataclasses

import numpy as np
import pytest

import slamgym.agents.rl.shaping as shaping_module
from slamgym.agents.rl.learner import LearnerConfig
from slamgym.agents.rl.reward_presets import OWN, REWARD_PRESETS, ShapingConfig, reward_preset
from slamgym.agents.rl.shaping import (
    Experiment,
    ShapingRun,
    own_term,
    run_shaping,
    table,
    verdicts,
    write_shaping_report,
)
from slamgym.agents.rl.train_config import TrainConfig, WheelsConfig
from slamgym.agents.wheels import read_wheels, write_wheels
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import StorageError, exclusive_lock
from slamgym.envs import StepRecord
from slamgym.envs.rewards import Reward

pytest.importorskip("stable_baselines3")

from slamgym.agents.rl.train import train
from slamgym.agents.rl.wheels import train_wheels


def main(argv):
    return TABLE.run("slamgym", ["agents", "shape", *map(str, argv)])


STEP = StepRecord(
    duration=0.2, time=10.0, distance=0.05, contact=True, coverage=0.5, previous_coverage=0.4, pose_error=0.2,
    terminated=True, floor_area=50.0,
)  # fmt: skip


def runs_of(name, shares, contacts):
    outcomes = [
        {"path": 30.0, "coverage": c, "contacts": n} for c, n in zip(shares, contacts, strict=True)
    ]
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
    assert active["path_cost"] - active["coverage"] == {"path_length"}
    assert active["careful"] == active["collision"] == {"coverage_gain", "collision"}
    assert REWARD_PRESETS["careful"].collision > REWARD_PRESETS["collision"].collision
    assert active["potential"] - active["completion"] == {"shaping"}
    assert len({repr(chosen) for chosen in REWARD_PRESETS.values()}) == len(REWARD_PRESETS)


def test_an_unknown_preset_suggests_the_nearest():
    with pytest.raises(ConfigError, match="did you mean 'path_cost'"):
        reward_preset("path_cots")
    with pytest.raises(ConfigError, match="did you mean 'floor'"):
        ShapingConfig(presets=("flor",))
    for presets in (), ("floor", "floor"):
        with pytest.raises(ConfigError, match="at least one preset, and none twice"):
            ShapingConfig(presets=presets)


def test_runs_differ_in_reward_and_seed_alone():
    config = ShapingConfig()
    for name, reward in (*REWARD_PRESETS.items(), (OWN, REWARD_PRESETS["coverage"])):
        assert config.settings(name, 2) == dataclasses.replace(config.train, seed=2, reward=reward)


SHORT = WheelsConfig(evaluate_every=0, evaluate_seconds=2.0)


def fear(step):
    return -1.0 if step.contact else 0.1 * step.distance


def learn_nothing(calls):
    def learn(settings, folder, avoids, reward_terms=None):
        assert not avoids
        calls.append((settings.seed, settings.reward, reward_terms))
        write_wheels(folder / "policy.safetensors", read_wheels())

    return learn


def test_an_experiment_is_run_once_and_reported(tmp_path):
    config = ShapingConfig(presets=("coverage", OWN), seeds=1, test_plans=1, train=SHORT)
    calls = []
    term = own_term("math:sqrt", 0.5)
    runs = run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert [(run.preset, run.seed, len(run.outcomes)) for run in runs] == [
        ("coverage", 0, 1),
        (OWN, 0, 1),
    ]
    assert calls[0][2] is None
    assert calls[1][2]["sqrt"][0] == 0.5
    again = run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert len(calls) == 2
    assert again == runs
    for other, weight in (
        (dataclasses.replace(config, train=dataclasses.replace(SHORT, plan_count=3)), 0.5),
        (dataclasses.replace(config, presets=(OWN,)), 0.6),
    ):
        with pytest.raises(ConfigError, match=r"\((settings.plan_count|term) was .*\); choose"):
            run_shaping(
                Experiment(other, learn_nothing(calls), own_term("math:sqrt", weight)), tmp_path
            )
    (tmp_path / "coverage" / "seed_0" / "shaping.json").write_text('{"settings": ')
    with pytest.raises(InputFileError, match="delete the folder"):
        run_shaping(Experiment(config, learn_nothing(calls), term), tmp_path)
    assert len(calls) == 2


def test_an_interrupted_test_goes_on_with_the_plans_that_are_left(
    tmp_path, monkeypatch, make_trial
):
    explored = []

    def explore_plan(config, policy, plan, seed, avoids):
        assert not avoids
        if len(explored) == 2:
            explored.append("interrupted")
            raise KeyboardInterrupt
        explored.append((plan.id, seed))
        return make_trial(plan=plan.id, seconds=float(1 + seed % 1000))

    monkeypatch.setattr(shaping_module, "explore_plan", explore_plan)
    config = ShapingConfig(presets=("careful",), seeds=1, test_plans=4)
    calls = []
    with pytest.raises(KeyboardInterrupt):
        run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "resumed")
    (resumed,) = run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "resumed")
    seen = [entry for entry in explored if entry != "interrupted"]
    assert len(seen) == len(set(seen)) == 4
    (at_once,) = run_shaping(Experiment(config, learn_nothing(calls)), tmp_path / "at_once")
    assert resumed.outcomes == at_once.outcomes


def test_a_term_of_ones_own_is_learned_from(tmp_path):
    tiny = dataclasses.replace(
        SHORT,
        steps=24,
        plan_count=2,
        num_envs=3,
        learner=LearnerConfig("ppo", {"n_steps": 8, "batch_size": 8, "n_epochs": 1}),
    )
    config = ShapingConfig(presets=("coverage", OWN), seeds=1, test_plans=1, train=tiny)
    run_shaping(Experiment(config, train_wheels, ("fear", 9.0, fear)), tmp_path)
    plain, own = (
        read_wheels(tmp_path / name / "seed_0" / "policy.safetensors").weights
        for name in config.presets
    )
    assert any((plain[name] != own[name]).any() for name in plain)
    with pytest.raises(ConfigError, match=r"'sqrt' failed after .* TypeError"):
        run_shaping(
            Experiment(config, train_wheels, own_term("math:sqrt", 1.0)), tmp_path / "other"
        )


def test_the_report_names_presets_and_compares_them_with_coverage(tmp_path):
    runs = runs_of("coverage", [0.5, 0.8], [2.0, 4.0]) + runs_of(
        "careful", [0.45, 0.72], [1.0, 1.0]
    )
    text = write_shaping_report(runs, tmp_path)
    row = next(line for line in text.splitlines() if line.startswith("| careful"))
    assert "0.90 [0.90, 0.90]" in row  # a tenth less of every plan
    assert "1.0 [1.0, 1.0]" in row
    assert (tmp_path / "shaping.md").read_text() == text


def test_without_the_preset_coverage_the_first_is_the_reference():
    text = table(runs_of("potential", [0.5, 0.8], [2.0, 4.0]))
    assert "coverage / potential" in text
    assert "1.00 [1.00, 1.00]" in text


def test_one_seed_has_no_interval_and_the_report_says_so():
    runs = runs_of("coverage", [0.5, 0.8], [2.0, 4.0])
    assert "No interval" not in table(runs)
    alone = table([run for run in runs if run.seed == 0])
    assert "[" not in alone.replace("[m]", "")
    assert "No interval" in alone


def test_a_pair_is_told_apart_where_the_interval_lies_on_one_side_of_1():
    runs = runs_of("coverage", [0.5, 0.8, 0.6], [2.0, 4.0, 3.0])
    runs += runs_of("careful", [0.45, 0.72, 0.54], [1.0, 1.0, 1.0])
    runs += runs_of("floor", [0.4, 0.9, 0.6], [4.0, 2.0, 3.0])
    lines = verdicts(runs).splitlines()
    careful = next(line for line in lines if line.startswith("| coverage / careful"))
    assert "better: 1.11" in careful  # it sees more
    assert "worse: 3.00" in careful  # and touches more
    floor = next(line for line in lines if line.startswith("| coverage / floor"))
    assert floor.count("can't be told") == 2
    alone = [run for run in runs if run.seed == 0]
    assert "better" not in verdicts(alone)
    rare = runs + runs_of("time", [0.5, 0.8, 0.6], [0.0, 0.0, 1.0])
    assert "nan" not in verdicts(rare)  # drawn again, some have no contact at all


def test_two_processes_on_one_folder_are_refused(tmp_path):
    config = ShapingConfig(presets=("careful",), seeds=1, test_plans=1, train=SHORT)
    with (
        exclusive_lock(tmp_path / "running.lock"),
        pytest.raises(StorageError, match="another run is writing"),
    ):
        run_shaping(Experiment(config, learn_nothing([])), tmp_path)


def learn_alike(settings, folder, reward_terms, avoids):
    write_wheels(folder / "policy.safetensors", read_wheels())


def test_runs_in_processes_give_the_same(tmp_path):
    config = ShapingConfig(presets=("careful", "floor"), seeds=1, test_plans=1, train=SHORT)
    experiment = Experiment(config, learn_alike)
    assert run_shaping(experiment, tmp_path / "two", 2) == run_shaping(experiment, tmp_path / "one")


def test_policies_that_choose_frontiers_are_compared_too(tmp_path):
    tiny = TrainConfig(
        steps=4,
        plan_count=2,
        num_envs=2,
        copies=2,
        time_limit=20.0,
        evaluate_every=0,
        learner=LearnerConfig("ppo", {"n_steps": 2, "batch_size": 4, "n_epochs": 1}),
    )
    config = ShapingConfig("frontiers", ("coverage", OWN), seeds=1, test_plans=1, frontiers=tiny)
    runs = run_shaping(Experiment(config, train, ("fear", 9.0, fear)), tmp_path)
    text = write_shaping_report(runs, tmp_path, "frontiers")
    assert "time until done [s]" in text
    assert "| coverage / own" in text


@pytest.mark.parametrize("spec", ["nothing_here:f", "math:squareroot", "math"])
def test_a_term_that_is_no_function_is_refused(spec):
    with pytest.raises(ConfigError, match="--term"):
        own_term(spec, 1.0)


def test_the_preset_of_ones_own_needs_a_term():
    with pytest.raises(ConfigError, match="needs --term"):
        main(["-o", "nowhere", "--presets", OWN])
