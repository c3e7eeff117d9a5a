import dataclasses

import numpy as np
import pytest

from slamgym.agents.evaluation.report import describe_evaluation
from slamgym.agents.evaluation.summary import censored, compare, succeeded, summarise_trials
from slamgym.core.errors import ConfigError
from slamgym.core.text import markdown


@pytest.fixture
def many(make_trial):
    def make(explorer, factor, **changes):
        return [
            make_trial(explorer, f"p{i}", factor * (100.0 + 10.0 * i), **changes) for i in range(12)
        ]

    return make


def test_a_faster_explorer_is_faster_in_every_ratio(many):
    comparison = compare(many("fast", 0.8), many("slow", 1.0))
    for to in (comparison.time_to, comparison.path_to):
        level = to["0.95"]
        assert level.both == 12
        assert level.ratio == level.where_both
        assert level.ratio.value == pytest.approx(0.8)
        assert level.ratio.high < 1.0


def test_unreached_levels_count_as_the_time_limit_but_where_both_reach_them(many, make_trial):
    ours, reference = many("ours", 0.5), many("reference", 1.0)
    ours[0] = make_trial("ours", "p0", 50.0, reached=0.9)
    level = compare(ours, reference).time_to["0.95"]
    assert level.both == 11
    assert level.where_both.value == pytest.approx(0.5)
    times = [700.0, *(t.time_to["0.95"] for t in ours[1:])]
    theirs = [t.time_to["0.95"] for t in reference]
    assert level.ratio.value == pytest.approx(np.sum(times) / np.sum(theirs))
    mean = summarise_trials([*ours, *reference], "reference").explorers[0].time_to["0.95"]
    assert mean.value == pytest.approx(np.mean(times))


def test_giving_up_early_makes_no_short_path(make_trial):
    given_up = make_trial(seconds=50.0, reached=0.4)
    # At its mean speed of 0.2 m/s it would have driven 140 m until the limit of 700 s.
    assert censored(given_up, "path", "0.95") == pytest.approx(140.0)
    assert censored(given_up, "time", "0.95") == 700.0
    assert censored(make_trial(seconds=99.0), "time", "0.99") == pytest.approx(99.0)


def test_success_asks_for_an_end_in_time_with_most_seen(make_trial):
    assert succeeded(make_trial())
    assert not succeeded(make_trial(reached=0.9))
    assert not succeeded(make_trial(finished=False))


def test_repetitions_on_one_plan_are_one_draw(many):
    once = compare(many("ours", 0.8), many("reference", 1.0))
    ours = [dataclasses.replace(t, seed=s) for t in many("ours", 0.8) for s in (1, 2)]
    reference = [dataclasses.replace(t, seed=s) for t in many("reference", 1.0) for s in (1, 2)]
    twice = compare(ours, reference)
    assert twice.time_to["0.5"].ratio == once.time_to["0.5"].ratio
    assert twice.time_to["0.5"].both == 24


def test_only_explorations_that_all_explorers_did_are_compared(many):
    trials = [*many("ours", 0.8), *many("reference", 1.0)[:5]]
    summary = summarise_trials(trials, "reference")
    assert summary.plans == 5
    assert [e.trials for e in summary.explorers] == [5, 5]


def test_wrong_references_and_unlike_explorations_are_refused(many, make_trial):
    with pytest.raises(ConfigError, match="did you mean 'reference'"):
        summarise_trials(many("reference", 1.0), "referense")
    with pytest.raises(ConfigError, match="share no exploration"):
        summarise_trials([make_trial("a", "p0"), make_trial("b", "p1")], "a")


def test_a_level_that_nobody_reached_leaves_a_dash(many):
    trials = [*many("ours", 0.8, reached=0.96), *many("reference", 1.0, reached=0.96)]
    text = describe_evaluation(summarise_trials(trials, "reference"))
    row = next(line for line in text.splitlines() if line.startswith("| `ours`") and "n=" in line)
    assert "-" in [cell.strip() for cell in row.split("|")]
    assert "0.80 [0.80, 0.80] n=12" in row


def test_tables_have_as_many_cells_in_each_row():
    table = markdown(["a", "b"], [["x", "1"], ["longer", "22"]]).splitlines()
    assert len({line.count("|") for line in table}) == 1
    assert len({len(line) for line in table}) == 1
