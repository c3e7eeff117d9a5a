import contextlib
import dataclasses
import functools
import json

import pytest
import shapely

import slamgym.agents.evaluation.evaluate as evaluation_module
from slamgym.agents.evaluation.evaluate import (
    ORACLE,
    EvaluationConfig,
    TrialLog,
    choose_plans,
    evaluate,
)
from slamgym.agents.evaluation.report import write_report
from slamgym.agents.evaluation.trial import Trial, TrialConfig, run_trial
from slamgym.agents.plan_splits import split_of
from slamgym.cad import FloorPlan
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import Lost
from slamgym.core.parallel.engine import Execution
from slamgym.envs import ExploreConfig
from slamgym.envs.episode import fitted_env
from slamgym.envs.plan_cache import listed_plans
from slamgym.slam import SlamConfig


def main(argv):
    return TABLE.run("slamgym", ["agents", "evaluate", *map(str, argv)])


# 6 s of robot time: long enough to begin, short enough for a test.
TRIAL = TrialConfig(minutes=0.1, env=ExploreConfig(slam=SlamConfig(mode="ground_truth")))


def room(plan_id, width=4.0):
    return FloorPlan(plan_id, shapely.box(0.0, 0.0, width, 3.0))


def source(count=3):
    return listed_plans([room(f"room_{i}", 4.0 + i) for i in range(count)])


def config(**changes):
    settings = {
        "explorers": ("nearest", "explore_lite"),
        "split": None,
        "plans_filter": "none",
        "trial": TRIAL,
    }
    return EvaluationConfig(**{**settings, **changes})


def comparable(trial):
    """A trial without what a clock measured."""
    return dataclasses.replace(trial, decision_cpu=0.0, cpu=0.0)


run = functools.partial(evaluate, execution=Execution(engine="in_process"))


def test_every_explorer_sees_the_same_plans_and_starts(tmp_path):
    result = run(source(), config(), tmp_path)
    assert result.fresh == len(result.trials) == 6
    by_name = {
        n: [t for t in result.trials if t.explorer == n] for n in ("nearest", "explore_lite")
    }
    assert [(t.plan, t.seed) for t in by_name["nearest"]] == [
        (t.plan, t.seed) for t in by_name["explore_lite"]
    ]
    # What the first scan shows depends on the start alone.
    firsts = [{t.plan: t.curve["coverage"][0] for t in trials} for trials in by_name.values()]
    assert firsts[0] == firsts[1]
    assert len(set(firsts[0].values())) == 3
    assert all(0.0 < t.coverage <= 1.0 and t.time <= 6.0 + 1e-9 for t in result.trials)


def test_a_building_larger_than_the_usual_map_is_explored(tmp_path):
    hall = FloorPlan("hall", shapely.box(0.0, 0.0, 90.0, 4.0))
    (trial,) = run(listed_plans([hall]), config(explorers=("nearest",)), tmp_path).trials
    assert trial.coverage > 0.0
    assert trial.time == pytest.approx(6.0)
    # The settings of smaller buildings, and so their hashes, are as before.
    assert fitted_env(room("small", 30.0), TRIAL.env, 0.1).observation == TRIAL.env.observation
    assert fitted_env(hall, TRIAL.env, 0.1).observation.map_size == 180.0


def test_the_reason_is_given_where_no_plan_can_be_used(tmp_path, monkeypatch):
    monkeypatch.setenv("SLAMGYM_MAX_MAP_CELLS", "1000000")  # 50 m wide
    hall = FloorPlan("hall", shapely.box(0.0, 0.0, 90.0, 4.0))
    with pytest.raises(
        ConfigError, match=r"the first, hall: the plan is 90\.0 m long but the map holds 25\.0 m"
    ):
        run(listed_plans([hall]), config(), tmp_path)


def test_an_interrupted_evaluation_keeps_what_is_done_and_goes_on(tmp_path, monkeypatch):
    done = []

    def interrupted(*arguments):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(arguments[0].plan.id)
        return run_trial(*arguments)

    monkeypatch.setattr(evaluation_module, "run_trial", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(source(), config(), tmp_path / "resumed")
    assert len(TrialLog(tmp_path / "resumed" / "trials.jsonl", Trial).trials) == 2
    monkeypatch.setattr(evaluation_module, "run_trial", run_trial)
    resumed = run(source(), config(), tmp_path / "resumed")
    assert resumed.fresh == 4
    at_once = run(source(), config(), tmp_path / "at_once")
    assert [comparable(t) for t in resumed.trials] == [comparable(t) for t in at_once.trials]
    assert run(source(), config(), tmp_path / "resumed").fresh == 0


def test_more_explorers_and_plans_add_to_what_is_there(tmp_path):
    run(source(), config(count=2), tmp_path)
    assert run(source(), config(count=3), tmp_path).fresh == 2
    more = run(source(), config(explorers=("nearest", "explore_lite", "random")), tmp_path)
    assert more.fresh == 3
    # Other settings are other trials.
    other = config(trial=dataclasses.replace(TRIAL, minutes=0.05))
    assert run(source(), other, tmp_path).fresh == 6


class Unlucky:
    """An engine whose workers die of one exploration."""

    def run(self, task, items):
        for item in items:
            is_deadly = item[:1] == ("nearest",) and item.plan.id == "room_1"
            yield (
                Lost(item, "a worker process died", "WorkerLostError") if is_deadly else task(item)
            )


def test_an_exploration_that_crashes_is_noted_and_not_begun_again(tmp_path, monkeypatch):
    open_unlucky = lambda *_, **__: contextlib.nullcontext(Unlucky())  # noqa: E731
    monkeypatch.setattr(Execution, "open", open_unlucky)
    found = run(source(), config(), tmp_path)
    assert (len(found.trials), found.fresh) == (5, 6)
    assert [(t.plan, t.explorer, t.reason) for t in found.failed] == [
        ("room_1", "nearest", "a worker process died")
    ]
    again = run(source(), config(), tmp_path)
    assert (again.trials, again.failed, again.fresh) == (found.trials, found.failed, 0)
    report = write_report(tmp_path, again, config(), "nearest")
    assert (
        "Left out for all explorers: 1 exploration of `nearest` that crashed, hung or failed."
        in report
    )
    assert json.loads((tmp_path / "results.json").read_text())["summary"]["plans"] == 2


FAULTY = """
import os, sys
from slamgym.agents.registry import make_explorer

def fails(fault, at_once):
    def make(context, seed, promise):
        if seed or at_once:  # the seed is 0 where an explorer is only tried out
            fault()
        return make_explorer("nearest", context, seed, promise)
    return make

FAULTS = os.abort, lambda: sys.exit(3), lambda: {}["x"]
aborts, exits, raises = (fails(fault, False) for fault in FAULTS)
aborts_at_once, exits_at_once, raises_at_once = (fails(fault, True) for fault in FAULTS)
"""


@pytest.mark.filterwarnings(
    "ignore:Exception in thread ExecutorManagerThread:pytest.PytestUnhandledThreadExceptionWarning"
)
def test_an_own_explorer_that_fails_costs_its_explorations_alone(tmp_path, monkeypatch):
    (tmp_path / "faulty.py").write_text(FAULTY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("slamgym.core.parallel.backlog.MAX_ATTEMPTS", 1)
    names = ("faulty:aborts", "faulty:exits", "faulty:raises", "nearest")
    found = evaluate(source(1), config(explorers=names), tmp_path, Execution(1))
    assert [trial.explorer for trial in found.trials] == ["nearest"]
    assert [(trial.explorer, trial.error) for trial in found.failed] == [
        ("faulty:aborts", "WorkerLostError"), ("faulty:exits", "SystemExit"), ("faulty:raises", "KeyError"),
    ]  # fmt: skip
    assert found.failed[0].reason == "a worker process died (SIGABRT) at each of 1 attempts"
    assert found.failed[2].reason == "'x' (in faulty.py:12, <lambda>)"
    for fault in ("aborts", "exits", "raises"):
        where = Execution(1, "local" if fault == "aborts" else "in_process")
        with pytest.raises(ConfigError, match=f"'faulty:{fault}_at_once' can't be used"):
            evaluate(
                source(1), config(explorers=(f"faulty:{fault}_at_once",)), tmp_path / "no", where
            )
    assert not (tmp_path / "no").exists()


def test_plans_too_small_for_the_robot_are_skipped_and_counted(tmp_path):
    plans = listed_plans([room("fine"), FloorPlan("closet", shapely.box(0.0, 0.0, 0.3, 3.0))])
    result = run(plans, config(explorers=("nearest",)), tmp_path)
    assert [t.plan for t in result.trials] == ["fine"]
    assert [s.plan for s in result.skipped] == ["closet"]
    assert "wide enough" in result.skipped[0].reason
    with pytest.raises(ConfigError, match="no plan can be used: of 1, "):
        choose_plans(listed_plans([FloorPlan("closet", shapely.box(0.0, 0.0, 0.3, 3.0))]), config())


def test_only_plans_of_the_split_are_explored():
    plans = listed_plans([room(f"r{i}") for i in range(60)])
    chosen, _ = choose_plans(plans, config(split="test"))
    assert chosen
    assert all(split_of(plan.id) == "test" for plan in chosen)


def test_the_privileged_explorer_needs_its_setting(tmp_path):
    with pytest.raises(ConfigError, match="knows the floor plan"):
        config(explorers=("nearest", ORACLE))
    result = run(source(1), config(explorers=("nearest",), oracle=True), tmp_path)
    assert [t.explorer for t in result.trials] == ["nearest", ORACLE]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"explorers": ()}, "at least one explorer"),
        ({"explorers": ("nearest", "nearest")}, "named twice"),
        ({"count": 0}, "at least 1"),
    ],
)
def test_senseless_settings_are_refused(changes, match):
    with pytest.raises(ConfigError, match=match):
        config(**changes)


def test_an_unknown_explorer_is_refused_with_the_nearest_name_before_any_work(tmp_path):
    with pytest.raises(ConfigError, match="did you mean 'nearest'"):
        run(source(), config(explorers=("nearset",)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_writes_tables_figures_and_a_plot(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    argv = [
        "-o",
        str(tmp_path),
        "--count",
        "2",
        "--split",
        "all",
        "--explorers",
        "nearest,explore_lite",
    ]
    argv += [
        "--minutes",
        "0.1",
        "--workers",
        "1",
        "--set",
        "slam.mode=ground_truth",
        "--plans-filter",
        "none",
    ]
    assert main(argv) == 0
    printed = capsys.readouterr().out
    assert "against `explore_lite`" in printed
    assert (tmp_path / "results.md").read_text() in printed
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["summary"]["plans"] == 2
    assert results["config"]["explorers"] == ["nearest", "explore_lite"]
    picture = (tmp_path / "coverage_over_time.png").read_bytes()
    assert picture.startswith(b"\x89PNG")


def test_one_explorer_alone_needs_no_reference(tmp_path):
    alone = config(explorers=("nearest",))
    report = write_report(tmp_path, run(source(1), alone, tmp_path), alone, "nearest")
    assert "`nearest`" in report
    assert "against" not in report.lower()


@pytest.mark.parametrize(
    ("argv", "match"),
    [
        (
            ["--explorers", "nearest", "--against", "explore_lite"],
            "--against explore_lite is not among",
        ),
        (["--explorers", " , "], "name at least one explorer, such as tour"),
        (["--explorers", ""], "name at least one explorer"),
        (["--workers", "-1"], "--workers"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, argv, match):
    with pytest.raises(ConfigError, match=match):
        main(["-o", str(tmp_path / "out"), *argv])
