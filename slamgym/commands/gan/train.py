"""``slamgym gan train``: learn a translator from rendered pairs."""

import dataclasses
import json
import shlex
import sys
from collections.abc import Sequence
from typing import Any

import torch

from slamgym.commands.gan.arguments import TrainTranslatorArguments
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.progress import counted, duration, tell
from slamgym.gan.config import Stage, TranslatorTrainingConfig
from slamgym.gan.device import choose_compute, keep_freed_memory
from slamgym.gan.presets import find_preset
from slamgym.gan.training.train import RunOptions, train_translator


def run_training(arguments: TrainTranslatorArguments, argv: Sequence[str]) -> int:
    """Run the command; returns the exit code.

    Args:
        arguments: Of the command.
        argv: The same as typed, for the model card.

    Raises:
        SlamgymError: If an argument, the images or the folder of the run can't be used.
    """
    if arguments.minutes is not None and not 0.0 < arguments.minutes <= 1e5:
        raise ConfigError(f"--minutes must be positive, not {arguments.minutes}")
    if arguments.checkpoint_minutes < 0.0:
        raise ConfigError(f"--checkpoint-minutes must be 0 or more, not {arguments.checkpoint_minutes}")
    chosen = arguments.compute
    keep_freed_memory()
    if chosen.threads > 0:
        torch.set_num_threads(chosen.threads)
    config = training_config(arguments)
    options = RunOptions(
        compile=chosen.compile,
        checkpoint_minutes=arguments.checkpoint_minutes,
        command=shlex.join(["slamgym", "gan", "train", *argv]),
    )
    compute = choose_compute(chosen.device, chosen.precision, chosen.layout)
    report = train_translator(arguments.images, arguments.out, config, compute, options)
    tell(f"{counted(report.steps, 'step')}, {counted(report.images, 'image')}, {duration(report.seconds)}")
    if report.figures:
        figures = "".join(f"  {name}: {value:.4g}\n" for name, value in report.figures.items())
        sys.stdout.write(f"on held-out pairs, not aligned:\n{figures}")
    return 0


def training_config(arguments: TrainTranslatorArguments) -> TranslatorTrainingConfig:
    """The preset with the options put in their places.

    Raises:
        ConfigError: If a setting is unknown or impossible.
    """
    config = dataclasses.replace(
        find_preset(arguments.preset), seed=arguments.seed, start_from=arguments.start_from
    )
    if arguments.learning_rate is not None:
        optimiser = dataclasses.replace(config.optimiser, learning_rate=arguments.learning_rate)
        config = dataclasses.replace(config, optimiser=optimiser)
    config = apply_settings(config, arguments.set)
    stages = config.stages
    if arguments.epochs is not None:
        if not arguments.epochs > 0.0:
            raise ConfigError(f"--epochs must be positive, not {arguments.epochs}")
        stages = scaled_stages(stages, arguments.epochs)
    if arguments.batch_size is not None:
        if arguments.batch_size < 1:
            raise ConfigError(f"--batch-size must be 1 or more, not {arguments.batch_size}")
        stages = tuple(stage._replace(batch=arguments.batch_size, fade_batch=0) for stage in stages)
    minutes = arguments.minutes
    if minutes is None and arguments.epochs is None:
        minutes = config.minutes
    return dataclasses.replace(config, stages=stages, minutes=minutes)


def scaled_stages(stages: Sequence[Stage], epochs: float) -> tuple[Stage, ...]:
    """The stages with this many epochs in all, in the same proportions."""
    factor = epochs / sum(stage.epochs for stage in stages)
    return tuple(
        stage._replace(epochs=stage.epochs * factor, fade_epochs=stage.fade_epochs * min(1.0, factor))
        for stage in stages
    )


def apply_settings(config: TranslatorTrainingConfig, settings: Sequence[str]) -> TranslatorTrainingConfig:
    """Put ``path=value`` settings into a configuration; values are JSON, or text.

    Raises:
        ConfigError: If a setting is malformed or unknown.
    """
    values = to_dict(config)
    for setting in settings:
        path, found, text = setting.partition("=")
        if not found or not path:
            raise ConfigError(
                f"--set takes path=value, e.g. loss.l1=20, not {setting!r}; name folders of images before --set"
            )
        *sections, name = path.split(".")
        place: Any = values
        for section in sections:
            place = place.get(section) if isinstance(place, dict) else None
        if not isinstance(place, dict):
            raise ConfigError(f"--set {setting}: there is no section {'.'.join(sections)!r}")
        place[name] = _value(text)
    try:
        return from_dict(TranslatorTrainingConfig, values, "--set")
    except TypeError as error:
        raise ConfigError(f"--set: a value has the wrong type ({error})") from error


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
