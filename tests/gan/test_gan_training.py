"""Training goes on bit for bit, stops at NaN with the last good state kept, and learns."""

import dataclasses
import itertools
import json
import signal
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny_trainings import CPU, PROGRESSIVE, QUIET, RESIDUAL

from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.interruption import Terminated, deferred_interrupt
from slamgym.gan.config import LossConfig, OptimiserConfig, Stage
from slamgym.gan.data import load_pairs
from slamgym.gan.device import choose_compute
from slamgym.gan.training.learner import Learner, load_training_state
from slamgym.gan.training.monitoring import ProgressLines
from slamgym.gan.training.sampler import BatchSampler
from slamgym.gan.training.schedule import Moment
from slamgym.gan.training.train import TrainingDivergedError, train_translator
from slamgym.gan.translation.translate import load_translator


def main(argv):
    return TABLE.run("slamgym", ["gan", "train", *map(str, argv)])


@pytest.fixture
def images(tmp_path, make_images):
    return make_images(tmp_path / "images", count=6, manifest=True)


def test_several_folders_make_one_training(tmp_path, images, make_images):
    others = make_images(tmp_path / "others", count=4)
    report = train_translator([images, others], tmp_path / "run", RESIDUAL, CPU, QUIET)
    assert report.steps == 10  # two passes over ten pairs, two a step
    assert json.loads((tmp_path / "run" / "config.json").read_text())["images"].endswith(
        "), others"
    )
    larger = make_images(tmp_path / "larger", side=64)
    with pytest.raises(InputFileError, match="larger: has images of 64 px but"):
        train_translator([images, larger], tmp_path / "other", RESIDUAL, CPU, QUIET)
    with pytest.raises(ConfigError, match="at least one folder"):
        train_translator([], tmp_path / "none", RESIDUAL, CPU, QUIET)


def state(run):
    return load_file(run / "checkpoint.safetensors")


@pytest.mark.parametrize("config", [PROGRESSIVE, RESIDUAL], ids=["progressive", "residual"])
def test_an_interrupted_training_goes_on_bit_for_bit(tmp_path, images, config):
    whole = train_translator(images, tmp_path / "whole", config, CPU, QUIET)
    # In the middle of a pass, in the middle of the fade-in, and twice.
    for stop in (2, 5):
        stopped = dataclasses.replace(QUIET, stop_after_steps=stop)
        report = train_translator(images, tmp_path / "torn", config, CPU, stopped)
        assert not report.finished
        assert report.steps == stop
    resumed = train_translator(images, tmp_path / "torn", config, CPU, QUIET)
    assert resumed.finished
    assert resumed.steps == whole.steps
    expected, found = state(tmp_path / "whole"), state(tmp_path / "torn")
    assert expected.keys() == found.keys()
    assert any(key.startswith("optimiser.") for key in found)
    assert (tmp_path / "torn" / "registration.safetensors").exists() == config.register
    for key, value in expected.items():
        assert torch.equal(value, found[key]), key
    weights = [load_file(tmp_path / run / "weights.safetensors") for run in ("whole", "torn")]
    assert all(torch.equal(weights[0][key], weights[1][key]) for key in weights[0])


def test_a_finished_training_is_left_as_it_is(tmp_path, images):
    train_translator(images, tmp_path / "run", RESIDUAL, CPU, QUIET)
    before = (tmp_path / "run" / "checkpoint.safetensors").read_bytes()
    report = train_translator(images, tmp_path / "run", RESIDUAL, CPU, QUIET)
    assert report.finished
    assert (tmp_path / "run" / "checkpoint.safetensors").read_bytes() == before


def test_equal_seeds_learn_equal_weights_and_others_differ(tmp_path, images):
    stopped = dataclasses.replace(QUIET, stop_after_steps=2)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        train_translator(
            images, tmp_path / name, dataclasses.replace(PROGRESSIVE, seed=seed), CPU, stopped
        )
    a, b, c = (state(tmp_path / name) for name in "abc")
    assert all(torch.equal(a[key], b[key]) for key in a)
    assert not all(torch.equal(a[key], c[key]) for key in a)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"seed": 5}, "another configuration"), ({"preset": "other"}, "another preset")],
)
def test_another_training_in_the_same_folder_is_refused(tmp_path, images, change, message):
    stopped = dataclasses.replace(QUIET, stop_after_steps=1)
    train_translator(images, tmp_path / "run", PROGRESSIVE, CPU, stopped)
    with pytest.raises(ConfigError, match=message):
        train_translator(
            images, tmp_path / "run", dataclasses.replace(PROGRESSIVE, **change), CPU, QUIET
        )


def test_other_images_in_the_same_folder_are_refused(tmp_path, images, make_images):
    train_translator(
        images, tmp_path / "run", PROGRESSIVE, CPU, dataclasses.replace(QUIET, stop_after_steps=1)
    )
    others = make_images(tmp_path / "others", count=6, first=30)
    with pytest.raises(ConfigError, match="another set of images"):
        train_translator(others, tmp_path / "run", PROGRESSIVE, CPU, QUIET)


def test_a_checkpoint_of_another_version_is_one_clear_error(tmp_path):
    save_file(
        {"x": torch.zeros(1)},
        tmp_path / "old.safetensors",
        metadata={"format": "slamgym-gan-checkpoint-1"},
    )
    with pytest.raises(InputFileError, match=r"not a checkpoint of this version .*another folder"):
        load_training_state(tmp_path / "old.safetensors")


def test_a_damaged_checkpoint_is_one_clear_error(tmp_path, images):
    run = tmp_path / "run"
    train_translator(images, run, PROGRESSIVE, CPU, dataclasses.replace(QUIET, stop_after_steps=1))
    file = run / "checkpoint.safetensors"
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(InputFileError, match="is damaged or not a safetensors file"):
        train_translator(images, run, PROGRESSIVE, CPU, QUIET)


def test_nan_stops_with_the_last_good_state_kept(tmp_path, images, monkeypatch):
    run = tmp_path / "run"
    train_translator(images, run, PROGRESSIVE, CPU, dataclasses.replace(QUIET, stop_after_steps=2))
    before = state(run)
    step = Learner.step

    def poisoned(self, batch, moment):
        terms = step(self, batch, moment)
        return terms | {"total": float("nan")} if self.steps_done == 4 else terms

    monkeypatch.setattr(Learner, "step", poisoned)
    with pytest.raises(
        TrainingDivergedError, match=r"became nan at step 4 .*last good state is .*checkpoint"
    ):
        train_translator(images, run, PROGRESSIVE, CPU, QUIET)
    kept = state(run)
    assert all(torch.equal(before[key], kept[key]) for key in before)


def test_a_rate_far_too_large_diverges_with_an_error(tmp_path, images):
    optimiser = OptimiserConfig(learning_rate=1e9)
    config = dataclasses.replace(RESIDUAL, optimiser=optimiser, stages=(Stage(32, 10.0, 2),))
    with pytest.raises(TrainingDivergedError, match="nothing was kept"):
        train_translator(images, tmp_path / "run", config, CPU, QUIET)


def test_too_few_pairs_are_refused(tmp_path, make_images):
    with pytest.raises(ConfigError, match="at least 2 pairs beside the held-out ones, not 1"):
        train_translator(
            make_images(tmp_path / "one", count=1), tmp_path / "run", PROGRESSIVE, CPU, QUIET
        )


def test_a_budget_of_time_ends_the_training_early_and_is_shared_by_the_stages(
    tmp_path, images, monkeypatch
):
    ticks = itertools.count()
    clock = SimpleNamespace(monotonic=lambda: 0.02 * next(ticks))
    monkeypatch.setattr("slamgym.gan.training.train.time", clock)
    stages = (Stage(16, 1e6, 2), Stage(32, 1e6, 1))
    config = dataclasses.replace(PROGRESSIVE, stages=stages, minutes=1 / 60)
    report = train_translator(images, tmp_path / "run", config, CPU, QUIET)
    assert report.finished
    assert report.steps < 1e5  # of millions
    assert report.steps < report.images < 2 * report.steps  # pairs at 16 px, one by one at 32


def test_the_residual_network_learns(tmp_path, make_images, monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.held_out.VALIDATION_SHARE", 0.25)
    images = make_images(tmp_path / "images", count=16)
    config = dataclasses.replace(RESIDUAL, augment=False, stages=(Stage(32, 40.0, 6),))
    report = train_translator(images, tmp_path / "run", config, CPU, QUIET)
    # The walls are a pixel too thick and have gaps; copying the map scores 1.
    assert report.figures["mse_ratio"] < 0.7
    samples = list((tmp_path / "run" / "samples").iterdir())
    assert len(samples) == 1
    line = json.loads((tmp_path / "run" / "figures.jsonl").read_text().splitlines()[-1])
    assert line["step"] == report.steps
    assert line["loss_dice"] < 0.5
    cells = load_pairs(images, "train", 32).slam[0]
    assert load_translator(tmp_path / "run").translate(cells).shape == (32, 32)


def test_a_training_goes_on_from_finished_weights(tmp_path, images):
    train_translator(images, tmp_path / "first", RESIDUAL, CPU, QUIET)
    config = dataclasses.replace(RESIDUAL, start_from=str(tmp_path / "first"))
    # No rate, no movement: what comes out is what went in, to half precision, but for batch norms' statistics.
    config = dataclasses.replace(
        config, optimiser=dataclasses.replace(config.optimiser, learning_rate=1e-12)
    )
    train_translator(images, tmp_path / "second", config, CPU, QUIET)
    before, after = (
        load_file(tmp_path / run / "weights.safetensors") for run in ("first", "second")
    )
    for key, value in before.items():
        if "running_" not in key and "num_batches" not in key:
            assert torch.equal(value, after[key]), key


def test_weights_of_another_preset_are_no_start(tmp_path, images):
    train_translator(images, tmp_path / "first", RESIDUAL, CPU, QUIET)
    config = dataclasses.replace(PROGRESSIVE, start_from=str(tmp_path / "first"))
    with pytest.raises(
        ConfigError, match=r"its input_encoding is .*choose the preset it was trained with \(tiny\)"
    ):
        train_translator(images, tmp_path / "second", config, CPU, QUIET)


def test_the_command_names_missing_starting_weights(tmp_path, images):
    with pytest.raises(ConfigError, match="no weights are called 'slam2cat'"):
        main(
            [
                str(images),
                "-o",
                str(tmp_path / "run"),
                "--start-from",
                "slam2cat",
                "--device",
                "cpu",
            ]
        )


@pytest.mark.parametrize("resolution", [16, 32])
def test_slam_maps_as_targets_have_three_values_and_keep_thin_walls(resolution):
    translator = dataclasses.replace(
        PROGRESSIVE.translator, direction="cad2slam", output_encoding="free_occupied"
    )
    learner = Learner(dataclasses.replace(PROGRESSIVE, translator=translator), CPU)
    slam = np.full((1, 32, 32), 205, np.uint8)
    slam[0, 4:28, 4:28] = 254
    slam[0, 4:28, 15] = 0  # a wall one cell thick
    target = learner._target(slam, resolution)
    assert set(target.unique().tolist()) == {-1.0, 1.0}
    middle = resolution // 2
    assert (target[0, 1, middle, :] > 0.0).sum() == 1


def test_all_terms_are_reported_and_every_network_moves(images):
    loss = LossConfig(overlap=1.0)
    learner = Learner(dataclasses.replace(RESIDUAL, loss=loss), CPU)
    before = {name: [p.clone() for p in n.parameters()] for name, n in learner.networks().items()}
    sampler = BatchSampler(
        load_pairs(images, "train", 32), learner.config, np.random.default_rng(0)
    )
    terms = learner.step(sampler.draw(2), Moment(32, 2, 1.0, 1.0))
    names = {"domain", "real_fake", "feature_matching", "l1", "cross_entropy", "dice", "total"}
    names |= {"discriminator_domain", "discriminator_real_fake", "input_consistency"}
    assert terms.keys() == names
    weighed = (
        terms[name] * (loss.l1 if name == "l1" else 1.0)
        for name in names
        if "discriminator" not in name
    )
    assert 2.0 * terms["total"] == pytest.approx(sum(weighed), rel=1e-4)  # the total is among them
    for name, network in learner.networks().items():
        assert any(
            not torch.equal(a, b) for a, b in zip(before[name], network.parameters(), strict=True)
        ), name


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_cpus_get_the_layout_that_is_faster_on_them(precision):
    assert choose_compute("cpu", precision).channels_last


def test_a_step_is_the_same_in_both_memory_layouts(images):
    terms = []
    for last in (False, True):
        learner = Learner(
            RESIDUAL, dataclasses.replace(choose_compute("cpu", "float32"), channels_last=last)
        )
        sampler = BatchSampler(load_pairs(images, "train", 32), RESIDUAL, np.random.default_rng(0))
        terms.append([learner.step(sampler.draw(2), Moment(32, 2, 1.0, 1.0)) for _ in range(2)])
    for plain, other in zip(*terms, strict=True):
        assert other == pytest.approx(plain, rel=1e-3)  # sums in another order


def test_unassociated_targets_are_drawn_for_discriminators_alone(images):
    pairs = load_pairs(images, "train", 32)
    with_discriminators = BatchSampler(pairs, PROGRESSIVE, np.random.default_rng(0)).draw(2)
    without = BatchSampler(pairs, RESIDUAL, np.random.default_rng(0)).draw(2)
    assert with_discriminators.other_cad is not None
    assert without.other_cad is None


def test_the_generators_step_leaves_the_discriminators_alone(images):
    learner = Learner(PROGRESSIVE, CPU)
    for name in ("domain", "real_fake"):
        # One that its own optimiser does not move must not move at all, nor get a gradient from the generator's step.
        learner.optimisers[name] = torch.optim.SGD(learner.discriminators[name].parameters(), 0.0)
    seen = []
    descend = Learner._descend

    def watched(self, name, loss):
        descend(self, name, loss)
        if name == "generator":
            seen.extend(p.grad for p in self.discriminators.parameters())

    learner._descend = watched.__get__(learner)
    sampler = BatchSampler(
        load_pairs(images, "train", 32), learner.config, np.random.default_rng(0)
    )
    learner.step(sampler.draw(2), Moment(32, 2, 1.0, 1.0))
    assert seen
    assert all(grad is None for grad in seen)
    assert all(p.requires_grad for p in learner.discriminators.parameters())


def test_the_first_ctrl_c_is_noted_and_the_second_breaks_off():
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupt() as interruption:
        signal.raise_signal(signal.SIGINT)
        assert interruption.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    with deferred_interrupt() as interruption:
        signal.raise_signal(signal.SIGTERM)
    with pytest.raises(Terminated):
        interruption.conclude()


def test_ctrl_c_saves_a_state_to_go_on_from(tmp_path, images, monkeypatch):
    train_translator(images, tmp_path / "whole", PROGRESSIVE, CPU, QUIET)
    step = Learner.step

    def interrupted(self, batch, moment):
        terms = step(self, batch, moment)
        if self.steps_done == 3:
            signal.raise_signal(signal.SIGINT)
        return terms

    monkeypatch.setattr(Learner, "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train_translator(images, tmp_path / "torn", PROGRESSIVE, CPU, QUIET)
    assert load_training_state(tmp_path / "torn" / "checkpoint.safetensors")[1]["steps_done"] == 3
    monkeypatch.undo()
    train_translator(images, tmp_path / "torn", PROGRESSIVE, CPU, QUIET)
    expected, found = state(tmp_path / "whole"), state(tmp_path / "torn")
    assert all(torch.equal(expected[key], found[key]) for key in expected)


def test_the_command_trains_from_options(tmp_path, images, capsys):
    arguments = [
        str(images), "-o", str(tmp_path / "run"), "--preset", "model32-cpu", "--epochs", "1", "--batch-size", "3",
        "--device", "cpu", "--set", "translator.input_size=32", "translator.generator.width=2",
        "discriminator.width=8", "discriminator.patch_width=8",
    ]  # fmt: skip
    assert main(arguments) == 0
    assert "2 steps, 6 images" in capsys.readouterr().out
    assert (tmp_path / "run" / "weights.safetensors").exists()


def test_a_line_says_how_far_it_is_and_how_long_it_takes(capsys, monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.monitoring.LINE_INTERVAL", 0.0)
    monkeypatch.setattr(
        "slamgym.gan.training.monitoring.time.monotonic", iter([0.0, 0.0, 600.0]).__next__
    )
    lines = ProgressLines()
    lines.show(0.5, 1.0)
    lines.show(0.6, 0.25)
    assert capsys.readouterr().err == "60.0 %, loss 0.25, 40 min left\n"
