"""The commands of ``slamgym gan``: torch and scikit-learn are imported after the arguments are parsed."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from slamgym.commands.frame import Extra, require
from slamgym.commands.gan.arguments import (
    EvaluateTranslatorsArguments,
    TrainTranslatorArguments,
    TranslateArguments,
)
from slamgym.core.progress import counted, duration, tell

if TYPE_CHECKING:
    from slamgym.gan.config import Stage, TranslatorTrainingConfig


def train_command(arguments: TrainTranslatorArguments, typed: str) -> None:
    """Run ``slamgym gan train``.

    Args:
        arguments: Of the command.
        typed: The command line, for the model card.

    Raises:
        SlamgymError: If an argument, the images or the folder of the run can't be used.
    """
    from slamgym.core.freed_memory import keep_freed_memory
    from slamgym.gan.device import choose_compute
    from slamgym.gan.training.train import RunOptions, train_translator

    keep_freed_memory()
    config = training_config(arguments)
    options = RunOptions(arguments.checkpoint_minutes, command=typed)
    compute = choose_compute(arguments.device, arguments.precision)
    report = train_translator(arguments.images, arguments.out, config, compute, options)
    tell(
        f"{counted(report.steps, 'step')}, {counted(report.images, 'image')}, {duration(report.seconds)}"
    )
    if report.figures:
        figures = "".join(f"  {name}: {value:.4g}\n" for name, value in report.figures.items())
        sys.stdout.write(f"on held-out pairs, not aligned:\n{figures}")


def training_config(arguments: TrainTranslatorArguments) -> TranslatorTrainingConfig:
    """The preset with the options put in their places.

    Raises:
        ConfigError: If a setting is unknown or impossible.
    """
    from slamgym.gan.presets import find_preset, fine_tuning

    options = {
        "seed": arguments.seed,
        "start_from": arguments.start_from,
        "learning_rate": arguments.learning_rate,
    }
    preset = find_preset(arguments.preset)
    config = arguments.settings.configured(preset, options)
    if config.start_from:
        # The settings once more, on top of gentler defaults.
        config = arguments.settings.configured(fine_tuning(preset), options)
    stages = config.stages
    if arguments.epochs is not None:
        stages = scaled_stages(stages, arguments.epochs)
    if arguments.batch_size is not None:
        stages = tuple(stage._replace(batch=arguments.batch_size, fade_batch=0) for stage in stages)
    minutes = arguments.minutes
    if minutes is None and arguments.epochs is None:
        minutes = config.minutes
    return dataclasses.replace(config, stages=stages, minutes=minutes)


def scaled_stages(stages: Sequence[Stage], epochs: float) -> tuple[Stage, ...]:
    """The stages with this many epochs in all, in the same proportions."""
    factor = epochs / sum(stage.epochs for stage in stages)
    return tuple(
        stage._replace(
            epochs=stage.epochs * factor, fade_epochs=stage.fade_epochs * min(1.0, factor)
        )
        for stage in stages
    )


def translate_command(arguments: TranslateArguments) -> None:
    """Run ``slamgym gan translate``."""
    from slamgym.commands.gan.translate import run_translation

    run_translation(arguments)


def evaluate_command(arguments: EvaluateTranslatorsArguments) -> None:
    """Run ``slamgym gan evaluate``."""
    require(Extra("gan", ("sklearn", "matplotlib")), "slamgym gan evaluate")
    from slamgym.commands.gan.evaluate import run_evaluation

    run_evaluation(arguments)
