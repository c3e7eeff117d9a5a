"""Train a translator: from a folder of pairs to weights.

A run is a folder::

    RUN/
      config.json             settings and where the images came from
      checkpoint.safetensors  the state, from which the same command continues bit for bit
      weights.safetensors     the translator, written at the end (and weights.md, its model card)
      registration.safetensors  how each SLAM map was moved onto its CAD map (presets that do so)
      figures.jsonl           one line per checkpoint: validation figures, terms of the loss
      losses.jsonl            mean losses, a line every tenth of a pass; losses.png draws them
      samples/                input, translation and target of held-out pairs
"""

import dataclasses
import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from slamgym import __version__
from slamgym.core.config import to_dict
from slamgym.core.documents import json_text
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.files import append_line, own_folder, write_bytes, write_text
from slamgym.core.interruption import Interruption, deferred_interrupt
from slamgym.core.pictures import encode_png
from slamgym.core.progress import counted, duration, say
from slamgym.gan.config import TranslatorConfig, TranslatorTrainingConfig
from slamgym.gan.data import PairSet, describe_data
from slamgym.gan.device import Compute, make_deterministic
from slamgym.gan.networks.factory import Generator
from slamgym.gan.training.held_out import checksum, training_pairs
from slamgym.gan.training.history import LossHistory
from slamgym.gan.training.learner import Learner, load_training_state
from slamgym.gan.training.monitoring import ProgressLines, validate
from slamgym.gan.training.sampler import BatchSampler
from slamgym.gan.training.schedule import plan_schedule
from slamgym.gan.training.stopping import BestPass
from slamgym.gan.weights import ModelCard, load_weights, save_translator


class TrainingDivergedError(SlamgymError):
    """The loss is not a number any more; the last good checkpoint is kept."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a run that don't change what is learned."""

    checkpoint_minutes: float = 2.0
    """Time between two checkpoints; 0 writes one after every step."""
    stop_after_steps: int | None = None
    """Stop there, with a checkpoint, as an interruption would."""
    command: str = ""
    """For the model card."""


@dataclass(frozen=True)
class TrainingReport:
    """Result of a run."""

    finished: bool
    steps: int
    images: int
    seconds: float
    figures: dict[str, float]


def train_translator(
    images: Path | str | Sequence[Path],
    run: Path | str,
    config: TranslatorTrainingConfig,
    compute: Compute,
    options: RunOptions = RunOptions(),
) -> TrainingReport:
    """Train a translator, or continue a training that was interrupted.

    Args:
        images: Folder of rendered pairs (:mod:`slamgym.gan.data`), or several, which are learned from together.
        run: Folder of the run; if it holds a checkpoint of the same settings the training continues from there.
        config: What to learn and how.
        compute: Device and precision.
        options: Time, checkpoints, logs.

    Raises:
        InputFileError: If the images or a checkpoint can't be used.
        ConfigError: If the folder holds another training, there are too few pairs or no folder of them.
        TrainingDivergedError: If the loss becomes NaN or infinite.
    """
    make_deterministic()
    folders = [Path(images)] if isinstance(images, (str, Path)) else list(images)
    training = _Training(folders, Path(run), config, compute, options)
    return training.run()


class _Training:
    """A run in progress: data, networks, schedule and clock."""

    def __init__(
        self,
        images: Sequence[Path],
        run: Path,
        config: TranslatorTrainingConfig,
        compute: Compute,
        options: RunOptions,
    ) -> None:
        self.folder = run
        self.options = options
        self.compute = compute
        # Weights that don't fit are refused before minutes go into reading and registering the pairs.
        start = None
        if config.start_from and not self.checkpoint.exists():
            start = _starting_generator(config)
        self.images = describe_data(images)
        self.pairs, self.held_out = training_pairs(images, run, config)
        scales = self.pairs.scale_percentiles()
        if scales is not None:
            translator = dataclasses.replace(config.translator, metres_per_px=scales)
            config = dataclasses.replace(config, translator=translator)
        self.config = config
        self.learner = Learner(config, compute)
        if start is not None:
            self.learner.adopt(start)
        # Nothing here draws from torch's own generator; any later use shall start from the seed.
        torch.manual_seed(config.seed)
        rng = np.random.default_rng(config.seed)
        self.sampler = BatchSampler(self.pairs, config, rng)
        self.schedule = plan_schedule(config.stages, len(self.pairs), config.optimiser)
        self.seconds_used = 0.0
        self.identity = _identity(config, compute, self.pairs)
        self.figures: dict[str, float] = {}
        self.best = BestPass()
        if self.checkpoint.exists():
            self._resume()
        else:
            self._begin()
        self.history = LossHistory(run, len(self.pairs), self.learner.steps_done)
        self.history.draw()

    def run(self) -> TrainingReport:
        """Train to the end of the schedule, to the step to stop at, or to an interruption."""
        learner = self.learner
        if not self._is_over():
            with deferred_interrupt() as interruption:
                self._loop(interruption)
            if interruption.requested:
                say(f"interrupted; the same command goes on at step {learner.steps_done:,}")
                interruption.conclude()
        finished = self._is_over()
        if finished:
            self._finish()
        return TrainingReport(
            finished, learner.steps_done, learner.images_done, self.seconds_used, self.figures
        )

    def _place(self) -> float:
        """Place on the schedule: pairs drawn, or as many as the time used is worth."""
        if self.config.minutes is None:
            return self.learner.images_done
        return self.schedule.images * self.seconds_used / (60.0 * self.config.minutes)

    @property
    def checkpoint(self) -> Path:
        """The file of the state."""
        return self.folder / "checkpoint.safetensors"

    def _is_over(self) -> bool:
        """True at the schedule's end, or if the last passes made nothing better."""
        patience = self.config.patience
        stopped = 0 < patience <= self.best.passes_since
        return stopped or self._place() >= self.schedule.images

    def _loop(self, interruption: Interruption) -> None:
        learner = self.learner
        options = self.options
        began = time.monotonic() - self.seconds_used
        last_save = time.monotonic()
        lines = ProgressLines()
        if learner.steps_done == 0:
            self._judge_pass()
        while not self._is_over():
            if interruption.requested or learner.steps_done == options.stop_after_steps:
                break
            moment = self.schedule.moment(self._place())
            terms = learner.step(self.sampler.draw(moment.batch), moment)
            self._require_finite(terms)
            self.history.add(terms, learner.steps_done, learner.images_done, moment.resolution)
            self._judge_pass()
            self.seconds_used = time.monotonic() - began
            lines.show(self._place() / self.schedule.images, terms["total"])
            if time.monotonic() - last_save >= 60.0 * options.checkpoint_minutes:
                self._validate(moment.resolution, terms)
                self.seconds_used = time.monotonic() - began
                self._save()
                last_save = time.monotonic()
        if self._is_over():
            self._validate(self.config.translator.output_size, terms)
        self._save()

    def _judge_pass(self) -> None:
        """At the end of a pass, keep the weights if none before drew better walls."""
        learner = self.learner
        passes = learner.images_done // len(self.pairs)
        is_due = learner.steps_done == 0 or passes > self.best.passes
        if self.config.patience == 0 or not is_due or len(self.held_out) == 0:
            return
        translator = self.config.translator
        side = translator.output_size
        figures, _ = validate(learner.best_generator, self.held_out, translator, self.compute, side)
        if self.best.judge(figures["wall_f1"], learner.steps_done, passes):
            learner.keep()

    def _require_finite(self, terms: dict[str, float]) -> None:
        for name, value in terms.items():
            if not math.isfinite(value):
                raise TrainingDivergedError(
                    f"the loss became {value} at step {self.learner.steps_done} (term {name!r}); {self._kept()}; "
                    "train again with a smaller --learning-rate or in float32"
                )

    def _kept(self) -> str:
        """What is left of a training that diverged, in words."""
        if self.checkpoint.exists():
            return f"the last good state is {self.checkpoint}"
        return "nothing was kept"

    def _validate(self, resolution: int, terms: dict[str, float]) -> None:
        self.history.note()
        self.history.draw()
        if len(self.held_out) == 0:
            return
        generator = self._result() if self._is_over() else self.learner.best_generator
        translator = self.config.translator
        self.figures, grid = validate(
            generator, self.held_out, translator, self.compute, resolution
        )
        step = self.learner.steps_done
        samples = own_folder(self.folder / "samples")
        write_bytes(samples / f"{step:07d}.png", encode_png(grid))
        line = {"step": step, "seconds": round(self.seconds_used, 1), "resolution": resolution}
        measured = self.figures | {f"loss_{name}": value for name, value in terms.items()}
        line |= {name: round(value, 5) for name, value in measured.items()}
        append_line(self.folder / "figures.jsonl", json.dumps(line) + "\n")

    def _begin(self) -> None:
        """A new run: write the settings."""
        minutes = self.config.minutes
        passes = self.schedule.images / len(self.pairs)
        length = f"{passes:.1f} passes" if minutes is None else duration(60.0 * minutes)
        say(
            f"{counted(len(self.pairs), 'training pair')}, {len(self.held_out)} held out; {length} "
            f"on {self.compute.device} in {self.compute.precision}"
        )
        facts = {"version": __version__, "images": self.images, "config": to_dict(self.config)}
        write_text(self.folder / "config.json", json_text(facts))

    def _resume(self) -> None:
        tensors, facts = load_training_state(self.checkpoint)
        identity = facts.get("identity")
        for name, value in self.identity.items():
            if not isinstance(identity, dict) or identity.get(name) != value:
                raise ConfigError(
                    f"{self.folder} holds a training with another {name}; repeat its own command, "
                    "or choose another folder with -o"
                )
        try:
            self._restore(tensors, facts)
        except (
            KeyError,
            TypeError,
            ValueError,
            AttributeError,
            RuntimeError,
            OverflowError,
        ) as error:
            raise InputFileError(
                self.checkpoint, f"is damaged ({error}); delete it to begin again"
            ) from None
        say(f"resuming at step {self.learner.steps_done:,}")

    def _restore(self, tensors: dict[str, torch.Tensor], facts: dict[str, Any]) -> None:
        self.learner.restore(tensors, facts)
        self.sampler.restore(facts["sampler"])
        self.seconds_used = float(facts["seconds_used"])
        self.figures = dict(facts["figures"])
        self.best = BestPass(**facts["best"])

    def _save(self) -> None:
        for name, network in self.learner.networks().items():
            if not all(bool(torch.isfinite(value).all()) for value in network.parameters()):
                raise TrainingDivergedError(
                    f"the weights of the {name} are not finite after step {self.learner.steps_done}; {self._kept()}; "
                    "train again with a smaller --learning-rate or in float32"
                )
        facts: dict[str, Any] = {
            "identity": self.identity,
            "sampler": self.sampler.state(),
            "seconds_used": self.seconds_used,
            "figures": self.figures,
            "best": asdict(self.best),
        }
        self.history.note()
        self.learner.save(self.checkpoint, facts)

    def _result(self) -> Generator:
        """The generator of the best pass, where passes were compared, or as it is now."""
        if self.learner.kept is None or self.best.wall_f1 < 0.0:
            return self.learner.best_generator
        return self.learner.kept

    def _finish(self) -> None:
        path = self.folder / "weights.safetensors"
        best = self.best
        if best.wall_f1 >= 0.0:
            say(f"best after step {best.step:,}: wall F1 {best.wall_f1:.3f} on held-out pairs")
        card = ModelCard(
            preset=self.config.preset,
            pairs=len(self.pairs),
            images=self.learner.images_done,
            seconds=round(self.seconds_used, 1),
            seed=self.config.seed,
            command=self.options.command,
            data=self.images,
            figures=self.figures,
            device=f"{self.compute.device.type}, {self.compute.precision}",
        )
        save_translator(path, self._result(), self.config.translator, card)
        say(f"trained for {duration(self.seconds_used)}; weights: {path}")


def _starting_generator(config: TranslatorTrainingConfig) -> Generator:
    """The trained generator to start with.

    Raises:
        InputFileError: If the file can't be used.
        ConfigError: If it holds a generator of other settings.
    """
    weights = load_weights(config.start_from, config.translator.direction)
    theirs = _shape_settings(weights.config)
    ours = _shape_settings(config.translator)
    for name, value in theirs.items():
        if value != ours[name]:
            raise ConfigError(
                f"{config.start_from} can't be trained on with the preset {config.preset!r}: its {name} is {value}, "
                f"not {ours[name]}; choose the preset it was trained with ({weights.card.preset})"
            )
    return weights.generator


def _shape_settings(translator: TranslatorConfig) -> dict[str, Any]:
    """The settings that decide what fits a network, by name."""
    return {
        "input_size": translator.input_size,
        "output_size": translator.output_size,
        "input_encoding": translator.input_encoding,
        "output_encoding": translator.output_encoding,
        "generator": translator.generator,
    }


def _identity(config: TranslatorTrainingConfig, compute: Compute, pairs: PairSet) -> dict[str, Any]:
    """Values that must be the same for a training to continue."""
    return {
        "preset": config.preset,
        "set of images": f"{len(pairs)} pairs, checksum {checksum(pairs)}",
        "configuration": to_dict(config),
        "device": compute.device.type,
        "precision": compute.precision,
    }
