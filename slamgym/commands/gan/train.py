"""``slamgym gan train``: learn a translator from rendered pairs."""

from __future__ import annotations

import dataclasses
import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.progress import duration
from slamgym.gan.config import DeviceName, Layout, Precision, Stage, TrainConfig
from slamgym.gan.presets import PRESETS, find_preset

if TYPE_CHECKING:
    from slamgym.gan.training.train import TrainingReport


@dataclass(frozen=True)
class TrainArguments:
    """Train a translator between SLAM maps and CAD maps on rendered pairs.

    Ctrl-C and kill -9 lose at most the minutes since the last checkpoint: the same command goes on from there, bit for
    bit on the same device.
    """

    images: Annotated[Path, tyro.conf.Positional]
    """Folder of pairs: what `slamgym dataset render` writes, or any folder with A (CAD) and B (SLAM) images of equal
    names."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the run: settings, checkpoint, weights, samples, curves."""
    preset: str = "slam2cad"
    """model32 and modelprog (the paper's), slam2cad (the default translator), slam2cad-fold4, slam2cad-gan,
    slam2cad-cpu, model32-cpu, modelprog-cpu."""
    minutes: float | None = None
    """Wall-clock time for the whole training: the schedule is stretched so that it ends then. The CPU presets have
    some by default."""
    epochs: float | None = None
    """Passes over the data instead of the preset's; several stages are scaled alike."""
    batch_size: int | None = None
    """Pairs a step, in all stages, instead of the preset's."""
    learning_rate: float | None = None
    """Instead of the preset's."""
    start_from: str = ""
    """Train on from these weights instead of random ones: a shipped name (slam2cad, ...), a .safetensors file, or a
    run's folder. For maps of your own, or for more hours."""
    seed: int = 0
    """Of weights, order and augmentation."""
    device: DeviceName = "auto"
    """``auto`` takes CUDA, else MPS, else the CPU."""
    precision: Precision = "auto"
    """``bfloat16`` mixes precisions; ``auto`` does where the hardware gains by it."""
    layout: Layout = "auto"
    """In memory: ``auto`` takes channels_last on CUDA and for bfloat16 on CPUs (benchmarks/gan_step.py)."""
    threads: int = 0
    """CPU threads of torch; 0 leaves torch's choice (OMP_NUM_THREADS)."""
    compile: bool = False
    """Let torch compile the networks: minutes at the start, faster steps on CUDA. Long trainings gain."""
    checkpoint_minutes: float = 2.0
    """Time between two checkpoints."""
    set: tuple[str, ...] = ()
    """Any other setting as ``path=value``, e.g. ``--set loss.l1=20 translator.generator.width=16``."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(TrainArguments, args=argv, prog="slamgym gan train")
    from slamgym.gan.device import choose_compute
    from slamgym.gan.training.train import RunOptions, train

    if arguments.minutes is not None and not 0.0 < arguments.minutes <= 1e5:
        raise ConfigError(f"--minutes must be positive, not {arguments.minutes}")
    if arguments.checkpoint_minutes < 0.0:
        raise ConfigError(f"--checkpoint-minutes must be 0 or more, not {arguments.checkpoint_minutes}")
    if arguments.threads > 0:
        import torch

        torch.set_num_threads(arguments.threads)
    config = train_config(arguments)
    options = RunOptions(
        minutes=config.minutes,
        compile=arguments.compile,
        checkpoint_minutes=arguments.checkpoint_minutes,
        command=shlex.join(["slamgym", "gan", "train", *argv]),
    )
    compute = choose_compute(arguments.device, arguments.precision, arguments.layout)
    report = train(arguments.images, arguments.out, config, compute, options)
    sys.stdout.write(describe(report))
    return 0


def train_config(arguments: TrainArguments) -> TrainConfig:
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


def apply_settings(config: TrainConfig, settings: Sequence[str]) -> TrainConfig:
    """Put ``path=value`` settings into a configuration; values are JSON, or text.

    Raises:
        ConfigError: If a setting is malformed or unknown.
    """
    values = to_dict(config)
    for setting in settings:
        path, found, text = setting.partition("=")
        if not found or not path:
            raise ConfigError(f"--set takes path=value, e.g. loss.l1=20, not {setting!r}")
        *sections, name = path.split(".")
        place: Any = values
        for section in sections:
            place = place.get(section) if isinstance(place, dict) else None
        if not isinstance(place, dict):
            raise ConfigError(f"--set {setting}: there is no section {'.'.join(sections)!r}")
        place[name] = _value(text)
    try:
        return from_dict(TrainConfig, values, "--set")
    except TypeError as error:
        raise ConfigError(f"--set: a value has the wrong type ({error})") from error


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def describe(report: TrainingReport) -> str:
    """What a run came to, in words."""
    figures = "".join(f"  {name}: {value:.4g}\n" for name, value in report.figures.items())
    return (
        f"{report.steps:,} steps, {report.images:,} images, {duration(report.seconds)}\n"
        f"on held-out pairs, not aligned:\n{figures}"
        if figures
        else f"{report.steps:,} steps, {report.images:,} images, {duration(report.seconds)}\n"
    )


__all__ = ["PRESETS", "TrainArguments", "apply_settings", "main", "scaled_stages", "train_config"]
