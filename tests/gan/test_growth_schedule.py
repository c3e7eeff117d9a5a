"""Steps, fade-in and learning rate."""

from pathlib import Path

import pytest

from slamgym.commands.gan.arguments import TrainTranslatorArguments
from slamgym.commands.gan.main import scaled_stages, training_config
from slamgym.commands.settings import SettingsOptions
from slamgym.core.errors import ConfigError
from slamgym.gan.config import OptimiserConfig, Stage
from slamgym.gan.presets import TRANSLATOR_PRESETS, find_preset
from slamgym.gan.training.learner import BETA_2
from slamgym.gan.training.schedule import Schedule, Span, plan_schedule

PAPER_PAIRS = 4224
GROWING = (Stage(32, 2.0, 4), Stage(64, 3.0, 2, 1.0, 1))


def test_the_papers_epochs_become_steps():
    schedule = plan_schedule(TRANSLATOR_PRESETS["model32"].stages, PAPER_PAIRS, OptimiserConfig())
    assert schedule.spans == (Span(32, 64, 750 * PAPER_PAIRS // 64, False),)
    spans = plan_schedule(
        TRANSLATOR_PRESETS["modelprog"].stages, PAPER_PAIRS, OptimiserConfig()
    ).spans
    assert [(s.resolution, s.batch, s.fading) for s in spans] == [
        (32, 64, False), (64, 16, True), (64, 32, False), (128, 8, True), (128, 16, False), (256, 2, True),
        (256, 4, False),
    ]  # fmt: skip
    assert sum(s.steps * s.batch for s in spans) == 200 * PAPER_PAIRS


def test_the_fade_in_is_linear_over_its_epoch_and_ends_at_one():
    schedule = plan_schedule(GROWING, 16, OptimiserConfig())
    fades = [schedule.moment(done).fade for done in range(32, 48)]
    assert fades == pytest.approx([(i + 1) / 16 for i in range(16)])
    assert schedule.moment(31).fade == schedule.moment(48).fade == 1.0


def test_the_rate_is_constant_for_seven_tenths_and_falls_to_nothing():
    schedule = Schedule((Span(32, 4, 100, False),), decay=0.3)
    rates = [schedule.moment(4 * step).rate for step in range(100)]
    assert rates[:71] == [1.0] * 71
    assert rates[85] == pytest.approx(0.5)
    assert rates[99] == pytest.approx(1 / 30)
    assert rates == sorted(rates, reverse=True)


def test_the_rate_warms_up():
    schedule = Schedule((Span(32, 1, 100, False),), warm_up=0.1, decay=0.0)
    assert [schedule.moment(step).rate for step in (0, 5, 10)] == pytest.approx([0.01, 0.5, 1.0])


def test_no_moment_beyond_the_end():
    schedule = plan_schedule(GROWING, 16, OptimiserConfig())
    assert schedule.moment(schedule.images - 1e-6).resolution == 64
    with pytest.raises(IndexError):
        schedule.moment(schedule.images)


def test_a_place_between_two_steps_has_its_moment_too():
    schedule = plan_schedule(GROWING, 16, OptimiserConfig())
    assert schedule.moment(31.9).resolution == 32
    assert schedule.moment(40.5).fade == pytest.approx(9.5 / 16)
    assert schedule.moment(47.9).fade == 1.0


def test_epochs_scale_all_stages():
    stages = scaled_stages(GROWING, 10.0)
    assert [stage.epochs for stage in stages] == [4.0, 6.0]
    assert stages[1].fade_epochs == 1.0
    assert scaled_stages(GROWING, 1.0)[1].fade_epochs == pytest.approx(0.2)


def put(*settings):
    return SettingsOptions(set=(settings,)).configured(TRANSLATOR_PRESETS["model32"], {})


def test_settings_are_put_in_by_path():
    config = put("loss.l1=20", "direction=cad2slam", "stages=[[32,5,8]]")
    assert config.loss.l1 == 20
    assert config.translator.direction == "cad2slam"
    assert config.stages == (Stage(32, 5, 8),)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("loss.overlaps=1", "did you mean 'loss.overlap'"),
        ("los.l1=1", "did you mean 'loss.l1'"),
        ("l1", "takes NAME=VALUE"),
        ("loss.l1=-1", r"loss\.l1 must be at least 0, not -1"),
        ("translator.input_size=100", "power of two"),
        ("translator.output_size=64", "last stage has resolution 32"),
        ("generator=1", "must be of type GeneratorConfig"),
        (
            "translator.input_encoding=cmyk",
            "must be 'grey' or 'free_occupied' or 'rgb' or 'layers', not 'cmyk'",
        ),
    ],
)
def test_impossible_settings_are_refused(setting, message):
    with pytest.raises(ConfigError, match=message):
        put(setting)


def test_an_unknown_preset_is_refused_with_a_suggestion():
    with pytest.raises(ConfigError, match="did you mean 'model32'"):
        find_preset("model23")


@pytest.mark.parametrize("name", TRANSLATOR_PRESETS)
def test_presets_know_their_names_and_keep_the_papers_optimiser(name):
    preset = TRANSLATOR_PRESETS[name]
    assert preset.preset == name
    if name in ("model32", "modelprog"):
        assert (preset.optimiser.learning_rate, preset.optimiser.beta1, BETA_2) == (
            2e-4,
            0.55,
            0.99,
        )
        assert preset.loss.l1 == 10.0
        assert preset.translator.input_size == 256


def arguments(**values):
    return TrainTranslatorArguments(images=(Path("images"),), out=Path("run"), **values)


def test_the_cpu_presets_have_their_own_time_unless_one_is_given():
    assert (
        training_config(arguments(preset="model32-cpu")).minutes
        == TRANSLATOR_PRESETS["model32-cpu"].minutes
    )
    assert training_config(arguments(preset="model32-cpu", minutes=3.0)).minutes == 3.0
    assert training_config(arguments(preset="model32-cpu", epochs=2.0)).minutes is None
    for name in ("model32-cpu", "modelprog-cpu"):
        assert 0.0 < TRANSLATOR_PRESETS[name].minutes <= 90.0


def test_options_reach_the_configuration():
    config = training_config(
        arguments(preset="modelprog", seed=3, batch_size=5, learning_rate=0.01, epochs=20.0)
    )
    assert config.seed == 3
    assert {stage.batch for stage in config.stages} == {5}
    assert config.optimiser.learning_rate == 0.01
    assert sum(stage.epochs for stage in config.stages) == pytest.approx(20.0)


@pytest.mark.parametrize("values", [{"epochs": 0.0}, {"batch_size": 0}, {"learning_rate": -1.0}])
def test_impossible_options_are_refused(values):
    with pytest.raises(ConfigError):
        training_config(arguments(**values))
