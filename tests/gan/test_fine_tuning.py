"""Training on from trained weights: a gentler rate, and the best pass is what is kept."""

import dataclasses

import pytest
import torch
from safetensors.torch import load_file
from tiny_trainings import CPU, PROGRESSIVE, QUIET, RESIDUAL

from slamgym.commands.gan.arguments import TrainTranslatorArguments
from slamgym.commands.gan.main import training_config
from slamgym.commands.settings import SettingsOptions
from slamgym.core.errors import ConfigError
from slamgym.gan.config import OptimiserConfig, Stage, TranslatorTrainingConfig
from slamgym.gan.presets import find_preset, fine_tuning
from slamgym.gan.training import train
from slamgym.gan.training.stopping import BestPass
from slamgym.gan.training.train import train_translator


@pytest.fixture
def images(tmp_path, make_images):
    return make_images(tmp_path / "images", count=12)


@pytest.fixture(autouse=True)
def some_are_held_out(monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.held_out.VALIDATION_SHARE", 0.25)


def arguments(tmp_path, **changes):
    return TrainTranslatorArguments(images=(tmp_path,), out=tmp_path / "run", **changes)


def test_a_start_takes_a_tenth_of_the_rate_and_stops_early(tmp_path):
    preset = find_preset("slam2cad")
    config = training_config(arguments(tmp_path, start_from="slam2cad"))
    assert config.optimiser.learning_rate == pytest.approx(0.1 * preset.optimiser.learning_rate)
    assert config.patience == 5
    by_set = SettingsOptions(set=(("start_from=slam2cad",),))
    assert training_config(arguments(tmp_path, settings=by_set)) == config
    fresh = training_config(arguments(tmp_path))
    assert fresh.optimiser == preset.optimiser
    assert fresh.patience == 0


def test_what_is_asked_for_overrules_the_tenth(tmp_path):
    given = training_config(arguments(tmp_path, start_from="slam2cad", learning_rate=3e-3))
    assert given.optimiser.learning_rate == 3e-3
    patient = SettingsOptions(set=(("patience=9",),))
    assert training_config(arguments(tmp_path, start_from="x", settings=patient)).patience == 9


def test_walls_stop_no_training_to_slam_maps():
    assert fine_tuning(find_preset("modelprog")).patience == 0
    with pytest.raises(ConfigError, match="patience goes by the walls of CAD maps"):
        dataclasses.replace(find_preset("modelprog"), patience=3)


def test_the_best_pass_is_remembered():
    best = BestPass()
    assert best.judge(0.5, step=0, passes=0)
    assert not best.judge(0.5, step=3, passes=1)
    assert not best.judge(0.4, step=6, passes=2)
    assert best.passes_since == 2
    assert best.judge(0.6, step=9, passes=3)
    assert (best.step, best.passes_since) == (9, 0)


def harmful(config: TranslatorTrainingConfig) -> TranslatorTrainingConfig:
    """A rate that ruins trained weights without making them infinite."""
    optimiser = OptimiserConfig(learning_rate=3e-2, average=0.0, clip_norm=1.0)
    stages = (Stage(32, 60.0, 3),)
    return dataclasses.replace(config, optimiser=optimiser, stages=stages, patience=2)


def test_passes_that_make_it_worse_are_not_kept(tmp_path, images, monkeypatch):
    train_translator(images, tmp_path / "first", RESIDUAL, CPU, QUIET)
    scores = iter([0.9, 0.8, 0.7, 0.6, 0.5])
    validate = train.validate

    def falling(*given):
        figures, grid = validate(*given)
        return figures | {"wall_f1": next(scores)}, grid

    monkeypatch.setattr(train, "validate", falling)
    config = dataclasses.replace(harmful(RESIDUAL), start_from=str(tmp_path / "first"))
    report = train_translator(images, tmp_path / "second", config, CPU, QUIET)
    assert report.finished
    assert report.steps < 10  # two passes and not sixty
    before, after = (
        load_file(tmp_path / run / "weights.safetensors") for run in ("first", "second")
    )
    assert all(torch.equal(before[key], after[key]) for key in before)


def test_a_stopped_training_goes_on_to_the_same_best_weights(tmp_path, images):
    config = dataclasses.replace(harmful(RESIDUAL), patience=3)
    train_translator(images, tmp_path / "whole", config, CPU, QUIET)
    stopped = dataclasses.replace(QUIET, stop_after_steps=5)
    assert not train_translator(images, tmp_path / "torn", config, CPU, stopped).finished
    train_translator(images, tmp_path / "torn", config, CPU, QUIET)
    whole, torn = (load_file(tmp_path / run / "weights.safetensors") for run in ("whole", "torn"))
    assert all(torch.equal(whole[key], torn[key]) for key in whole)


def test_too_few_pairs_to_hold_out_are_said(tmp_path, make_images, monkeypatch, capsys):
    monkeypatch.setattr("slamgym.gan.training.held_out.VALIDATION_SHARE", 0.0)
    monkeypatch.setattr("slamgym.gan.training.held_out.LARGEST_SHARE", 0.0)
    images = make_images(tmp_path / "few", count=4)
    config = dataclasses.replace(RESIDUAL, patience=2)
    assert train_translator(images, tmp_path / "run", config, CPU, QUIET).finished
    assert "4 pairs are too few to hold some out" in capsys.readouterr().err


def test_pairs_of_many_scales_are_said_where_the_network_learns_one(tmp_path, make_images, capsys):
    images = make_images(tmp_path / "images", count=4, manifest=True)
    manifest = images / "manifest.jsonl"
    manifest.write_text(manifest.read_text().replace("0.1", "0.06", 2))
    stopped = dataclasses.replace(QUIET, stop_after_steps=1)
    for name, config, said in (("a", RESIDUAL, True), ("b", PROGRESSIVE, False)):
        train_translator(images, tmp_path / name, config, CPU, stopped)
        assert ("learns at one scale: render them by" in capsys.readouterr().err) == said
