"""The reproduction: its steps resume, its verdicts follow from the intervals, its report is whole."""

import json
from types import SimpleNamespace
from typing import get_args

import pytest
from help_pages import help_pages, options_of

from slamgym.commands import cli
from slamgym.commands.reproduce import steps
from slamgym.commands.reproduce.claims import (
    ClaimVerdict,
    judge,
    judge_claims,
    judge_error,
    table_one_beside,
)
from slamgym.commands.reproduce.steps import REDRAWN, REPRODUCTION_SCALES, STEPS, Reproduction
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.intervals import Interval
from slamgym.dataset.realism.comparison import MIN_MAPS


def interval(value, low, high):
    return {"value": value, "low": low, "high": high}


def improvement(share, ratio, count=200):
    return {
        "count": count, "share_improved": share, "ratio_of_means": ratio, "sign_p": 0.01, "wilcoxon_p": 0.02,
        "mean_mse1": interval(0.04, 0.03, 0.05), "mean_mse2": interval(0.05, 0.04, 0.06),
    }  # fmt: skip


def network(share, ratio):
    return {
        "improvement": improvement(share, ratio),
        "improvement_table_one": improvement(interval(0.6, 0.4, 0.8), ratio, 21),
    }


EVALUATION = {
    "methods": {
        "model32": network(interval(0.55, 0.48, 0.62), interval(0.9, 0.85, 0.95)),
        "slam2cad": network(interval(0.9, 0.85, 0.95), interval(0.6, 0.5, 0.7)),
    },
    "realism": {
        "tests": [
            {
                "first": "simulated",
                "second": second,
                "is_null": second == "simulated",
                "accuracy": accuracy,
            }
            for second, accuracy in (
                ("simulated", interval(0.49, 0.45, 0.53)),
                ("modelprog", interval(0.97, 0.95, 0.99)),
                ("modelprog, bent", interval(0.9, 0.8, 0.99)),
                ("generator", interval(0.55, 0.5, 0.6)),
                ("parametric", interval(0.59, 0.54, 0.64)),
            )
        ]
    },
}
STATISTICS = {"whole": {"cpu_seconds": 3.6, "kept": 0.2, "pairs": 100}}


@pytest.fixture
def run(tmp_path):
    return Reproduction(
        tmp_path / "out", REPRODUCTION_SCALES["smoke"], train=False, seed=1, workers=1
    )


@pytest.fixture
def commands(monkeypatch):
    """Commands are noted, not run; the one named by ``broken`` fails."""
    lines = []
    broken = [""]
    monkeypatch.setattr("slamgym.dataset.images.format.read_images", lambda *_: [])

    def note(step, line):
        if step == broken[0]:
            raise SlamgymError("broken")
        lines.append(line)
        return f"output of {step}\n"

    monkeypatch.setattr(steps, "_run_command", note)
    return lines, broken


def test_every_step_runs_once_and_an_interrupted_run_goes_on(run, commands):
    lines, broken = commands
    broken[0] = "translators"
    with pytest.raises(SlamgymError, match="broken"):
        run.run_steps()
    done = len(lines)
    assert list(json.loads((run.out / "state.json").read_text())["steps"]) == [
        "explorations",
        "cleaning",
        "training",
    ]
    broken[0] = ""
    again = Reproduction(run.out, run.scale, train=False, seed=1, workers=1)
    again.run_steps()
    assert list(again.steps) == list(STEPS)
    assert lines[done][:2] == ["gan", "evaluate"]
    assert (run.out / "logs" / "cleaning.txt").read_text() == "output of cleaning\n" * 4
    assert all(line[0] != "train" for line in lines)
    count = len(lines)
    Reproduction(run.out, run.scale, train=False, seed=1, workers=1).run_steps()
    assert len(lines) == count


def test_with_enough_test_maps_they_are_drawn_anew_and_compared(run, commands, monkeypatch):
    lines, _ = commands
    records = [SimpleNamespace(name=f"{n}") for n in range(MIN_MAPS)]
    monkeypatch.setattr("slamgym.dataset.images.format.read_images", lambda *_: records)
    run.run_steps()
    evaluate = next(line for line in lines if line[:2] == ["gan", "evaluate"])
    for method in REDRAWN:
        folder = run.out / "redrawn" / method
        deform = next(
            line
            for line in lines
            if line[:2] == ["deform", str(run.out / "pairs")] and method in line
        )
        assert str(folder) in deform
        assert lines.index(deform) < lines.index(evaluate)
        assert f"{method}={folder / 'episodes'}" in evaluate[evaluate.index("--generated") :]


def test_another_seed_needs_another_folder(run, commands, tmp_path):
    run.run_steps()
    with pytest.raises(ConfigError, match="choose a new folder"):
        Reproduction(run.out, run.scale, train=False, seed=2, workers=1)


def test_training_makes_a_translator_that_is_measured(run, commands):
    lines, _ = commands
    Reproduction(run.out, run.scale, train=True, seed=1, workers=1).run_steps()
    assert ["gan", "train"] in [line[:2] for line in lines]
    evaluate = next(line for line in lines if line[:2] == ["gan", "evaluate"])
    assert f"trained={run.out / 'run'}" in evaluate


def test_the_commands_know_their_options(commands, tmp_path):
    pages = help_pages()
    for scale in REPRODUCTION_SCALES.values():
        run = Reproduction(tmp_path, scale, train=True, seed=1, workers=1)
        for line in (line for name in STEPS for line in run.commands(name)):
            page = pages.get(line[0]) or pages[" ".join(line[:2])]
            assert {word for word in line if word.startswith("--")} <= set(options_of(page)), line
            assert "{" not in " ".join(line)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.85, 0.95, "better than the paper"),
        (0.55, 0.95, "reproduced"),
        (0.55, 0.6, "less than the paper"),
        (0.3, 0.9, "too few maps to say"),
        (0.45, 0.6, "worse than the paper"),
        (0.3, 0.4, "worse than the paper"),
    ],
)
def test_each_verdict_says_where_an_interval_lies(low, high, verdict):
    middle = 0.5 * (low + high)
    paper = Interval(0.7, 0.65, 0.8)
    assert judge(Interval(middle, low, high), paper, bound=0.5) == verdict
    mirrored = Interval(-middle, -high, -low)
    assert judge_error(mirrored, Interval(-0.7, -0.8, -0.65), bound=-0.5) == verdict
    assert verdict in get_args(ClaimVerdict)


def test_the_paper_reproduces_itself():
    paper = Interval(0.7, 0.65, 0.8)
    assert judge(paper, paper, bound=0.5) == "reproduced"


def test_verdicts_follow_from_the_figures():
    times = "0_flat: 9.1 m driven, 90 scans, ekf_schur took 0.5 s\n1_flat: 8.0 m driven, two_phase took 0.1 s, walls\n"
    assert {"ekf_schur", "two_phase"} <= {
        line.split("/")[-1].split()[0] for line in STEPS["deformed"]
    }
    claims = judge_claims(EVALUATION, STATISTICS, times)
    better, same, less, few, worse = get_args(ClaimVerdict)
    assert [claim.verdict for claim in claims] == [
        few, less, better, better, worse, same, less, same, better, better,
    ]  # fmt: skip
    assert claims[2].own.startswith("180 of 200: 90 % [85, 95]")
    assert claims[2].paper == "14 of 21: 67 % [45, 83]"
    assert claims[8].own == "1,000 on one core"


def test_slower_or_fewer_is_worse_than_the_paper():
    whole = {"cpu_seconds": 60.0, "kept": 0.0, "pairs": 1000}
    times = "ekf_schur took 0.1 s\ntwo_phase took 0.5 s\n"
    claims = judge_claims({"methods": {}, "realism": None}, {"whole": whole}, times)
    assert {claim.verdict for claim in claims} == {"worse than the paper"}


def test_table_one_stands_beside_the_papers():
    headings, rows = table_one_beside(EVALUATION["methods"])
    assert {len(row) for row in rows} == {len(headings)}
    assert rows[0][1:] == ["21", "0.114", "0.087", "0.763", "14 of 21: 67 % [45, 83]"]
    assert [row[1] for row in rows] == ["21", "21", "200", "21", "200"]
    assert rows[2][2:] == [
        "0.050 [0.040, 0.060]", "0.040 [0.030, 0.050]", "0.900 [0.850, 0.950]", "110 of 200: 55 % [48, 62]",
    ]  # fmt: skip
    four = improvement(interval(0.5, 0.1, 0.9), interval(0.6, 0.5, 0.7), 4)
    few = {"slam2cad": {"improvement": four, "improvement_table_one": four}}
    assert [row[1] for row in table_one_beside(few)[1]] == ["21", "4"]


def test_without_houseexpo_the_command_says_where_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reproduce", "--scale", "laptop", "--out", "out"]) == 2
    assert "slamgym plans fetch houseexpo" in capsys.readouterr().err
