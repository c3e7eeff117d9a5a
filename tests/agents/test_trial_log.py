import dataclasses
import json

import pytest

from slamgym.agents.evaluation.evaluate import TrialLog
from slamgym.agents.evaluation.trial import Trial
from slamgym.core.errors import InputFileError
from slamgym.core.files import StorageError


def test_what_was_appended_is_read_again(tmp_path, make_trial):
    log = TrialLog(tmp_path / "trials.jsonl", Trial)
    trials = [make_trial(plan=f"p{i}") for i in range(3)]
    for trial in trials:
        log.append(trial)
    again = TrialLog(tmp_path / "trials.jsonl", Trial).trials
    assert list(again.values()) == trials
    assert trials[1].key in again


@pytest.mark.parametrize("cut", [1, 40, 200])
def test_a_line_that_a_kill_cut_short_is_dropped_and_the_file_goes_on(tmp_path, make_trial, cut):
    path = tmp_path / "trials.jsonl"
    log = TrialLog(path, Trial)
    for i in range(3):
        log.append(make_trial(plan=f"p{i}"))
    path.write_bytes(path.read_bytes()[:-cut])
    again = TrialLog(path, Trial)
    assert [t.plan for t in again.trials.values()] == ["p0", "p1"]
    again.append(make_trial(plan="p2"))
    assert [json.loads(line)["plan"] for line in path.read_text().splitlines()] == [
        "p0",
        "p1",
        "p2",
    ]


def test_a_first_line_cut_short_leaves_an_empty_log(tmp_path):
    path = tmp_path / "trials.jsonl"
    path.write_text('{"explorer": "near')
    assert TrialLog(path, Trial).trials == {}
    assert path.read_text() == ""


def test_the_same_exploration_with_other_settings_is_another(tmp_path, make_trial):
    log = TrialLog(tmp_path / "trials.jsonl", Trial)
    log.append(make_trial())
    log.append(dataclasses.replace(make_trial(), settings="y"))
    assert len(TrialLog(tmp_path / "trials.jsonl", Trial).trials) == 2


@pytest.mark.parametrize("line", ["no json", "[1, 2]", '{"explorer": "a"}', '{"unknown": 1}'])
def test_a_file_of_something_else_is_refused_with_its_line(tmp_path, make_trial, line):
    path = tmp_path / "trials.jsonl"
    TrialLog(path, Trial).append(make_trial())
    with path.open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputFileError, match=r"trials\.jsonl:2: is no trial"):
        TrialLog(path, Trial)


@pytest.mark.parametrize("change", [{"coverage": 7}, {"time": -5}, {"path_to": {"0.5": 1e308}}])
def test_a_senseless_figure_is_refused_with_its_line(tmp_path, make_trial, change):
    path = tmp_path / "trials.jsonl"
    path.write_text(json.dumps(dataclasses.asdict(make_trial()) | change) + "\n")
    with pytest.raises(
        InputFileError, match=rf"trials\.jsonl:1: is no trial .*{next(iter(change))}.* must be"
    ):
        TrialLog(path, Trial)


def test_a_folder_that_is_not_there_is_one_clear_error(tmp_path, make_trial):
    with pytest.raises((StorageError, InputFileError), match="missing"):
        TrialLog(tmp_path / "missing" / "trials.jsonl", Trial).append(make_trial())
