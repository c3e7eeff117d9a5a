"""The losses of a training: noted as they come, drawn as the paper's Figure 4, whole after a kill."""

import dataclasses
import json

import pytest
from tiny_trainings import CPU, PROGRESSIVE, QUIET, RESIDUAL

from slamgym.core.errors import InputFileError
from slamgym.gan.training.history import LossHistory
from slamgym.gan.training.train import train_translator


@pytest.fixture
def images(tmp_path, make_images):
    return make_images(tmp_path / "images", count=6)


def noted(run):
    return [json.loads(line) for line in (run / "losses.jsonl").read_text().splitlines()]


def take_steps(history, steps, resolution=32):
    for step in steps:
        terms = {"total": float(step), "discriminator_domain": 0.5}
        history.add(terms, step, 2 * step, resolution)


def test_each_line_is_the_mean_since_the_line_before(tmp_path):
    history = LossHistory(tmp_path, pairs=40, steps_done=0)
    take_steps(history, [1, 2, 3])
    assert [line["total"] for line in noted(tmp_path)] == [1.5]  # 4 of 40 pairs are a tenth
    history.note()
    assert [line["total"] for line in noted(tmp_path)] == [1.5, 3.0]
    history.note()
    assert [line["steps"] for line in noted(tmp_path)] == [2, 1]
    assert noted(tmp_path)[0]["epoch"] == 0.1


def test_a_new_resolution_begins_a_line(tmp_path):
    history = LossHistory(tmp_path, pairs=1000, steps_done=0)
    take_steps(history, [1, 2], 32)
    take_steps(history, [3, 4], 64)
    history.note()
    assert [(line["resolution"], line["total"]) for line in noted(tmp_path)] == [
        (32, 1.5),
        (64, 3.5),
    ]


def test_steps_that_a_kill_takes_back_are_noted_once(tmp_path):
    take_steps(LossHistory(tmp_path, pairs=10, steps_done=0), range(1, 6))
    with (tmp_path / "losses.jsonl").open("a") as log:
        log.write('{"step": 6, "ima')  # torn
    history = LossHistory(tmp_path, pairs=10, steps_done=3)
    assert [line["step"] for line in noted(tmp_path)] == [1, 2, 3]
    take_steps(history, [4, 5])
    assert [line["step"] for line in noted(tmp_path)] == [1, 2, 3, 4, 5]


def test_a_damaged_log_is_one_clear_error(tmp_path):
    (tmp_path / "losses.jsonl").write_text('{"step": 1}\n')
    with pytest.raises(
        InputFileError, match=r"losses.jsonl:1: is no line of losses; delete the file"
    ):
        LossHistory(tmp_path, pairs=10, steps_done=3)


@pytest.mark.parametrize("config", [PROGRESSIVE, RESIDUAL], ids=["progressive", "residual"])
def test_a_resumed_run_has_the_history_of_a_whole_one(tmp_path, images, config, monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr(
        "slamgym.gan.training.history.plot_losses", lambda *arguments: drawn.append(arguments)
    )
    train_translator(images, tmp_path / "whole", config, CPU, QUIET)
    stopped = dataclasses.replace(QUIET, stop_after_steps=4)
    train_translator(images, tmp_path / "torn", config, CPU, stopped)
    drawn.clear()
    train_translator(images, tmp_path / "torn", config, CPU, QUIET)
    whole, torn = (noted(tmp_path / run) for run in ("whole", "torn"))
    assert whole == torn
    # On resume, and at the end: the second has all.
    assert len(drawn) >= 2
    path, epochs, panels, changes = drawn[-1]
    assert path == tmp_path / "torn" / "losses.png"
    assert len(epochs) == len(whole)
    assert list(panels) == (["loss of G", "loss of D"] if config is PROGRESSIVE else ["loss of G"])
    assert list(changes.values()) == (["32 px"] if config is PROGRESSIVE else [])
    if config is PROGRESSIVE:
        both = whole[0]["discriminator_domain"] + whole[0]["discriminator_real_fake"]
        assert panels["loss of D"][0] == pytest.approx(both)


def test_the_run_has_a_picture_of_its_losses(tmp_path, images):
    pytest.importorskip("matplotlib")
    train_translator(images, tmp_path / "run", PROGRESSIVE, CPU, QUIET)
    assert (tmp_path / "run" / "losses.png").read_bytes().startswith(b"\x89PNG")
