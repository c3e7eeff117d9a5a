"""The frame of every training run: its folder, checkpoints, log and validation, and going on after an interruption.

Main path: :func:`learn_policy` saves the settings, draws the plans, lets a :class:`PolicyLearner` make environments and
network (or takes up a checkpoint), and learns to the end. A checkpoint is no pickle.
"""

import csv
import io
import json
import math
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from slamgym import __version__
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.pretrained_policy import write_mean
from slamgym.agents.rl.checkpoint import CHECKPOINT, load_checkpoint, save_checkpoint
from slamgym.agents.rl.learner import algorithm_class, arguments_of
from slamgym.agents.rl.train_config import BEST, POLICY, RunConfig
from slamgym.cad import FloorPlan
from slamgym.core.config import changed_settings, from_dict, to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import append_line, own_folder, read_text, write_text
from slamgym.core.progress import Advance, say, show_progress

CONFIG = "config.json"
"""Name of the settings of a run ..."""
VALIDATION = "validation.csv"
"""... and of its evaluations."""
STATES = "states"
"""Folder of the weights at each evaluation, ``STEPS.safetensors`` ..."""
MEAN = "mean.safetensors"
"""... and name of the mean of the last ones."""

_MAY_CHANGE = ("steps", "workers")
"""Settings that may change when a run continues."""
_CHECKPOINTS = 200
"""So many checkpoints are written in a run, one after an update at most: one takes some hundredths of a second."""
_LAST_STATES = 0.25
"""Weights of the last evaluations, in so much of a run, are averaged at its end, and judged like any others: the mean
varies less than the last ones (stochastic weight averaging; Izmailov et al., UAI 2018)."""
ConfigT = TypeVar("ConfigT", bound=RunConfig)


class PolicyLearner(ABC, Generic[ConfigT]):
    """A kind of policy that a run can learn.

    Args:
        config: The run.
    """

    unit: ClassVar[str]
    """Name of its steps."""
    logged: ClassVar[Mapping[str, str]]
    """Columns of the log that are means over the latest episodes, to the key of an episode's record."""

    def __init__(self, config: ConfigT) -> None:
        self.config = config

    @abstractmethod
    def make(self, plans: Sequence[FloorPlan]) -> OnPolicyAlgorithm:
        """The learner on its environments."""

    @abstractmethod
    def validate(self, policy: Path, plans: Sequence[FloorPlan]) -> dict[str, float]:
        """Figures of a file of weights on plans that it doesn't learn on, with ``score``, of which less is better."""

    @abstractmethod
    def export(self, model: OnPolicyAlgorithm, path: Path) -> None:
        """Write the policy's weights without value and optimiser, as explorers read them."""

    def about(self, model: OnPolicyAlgorithm) -> dict[str, Any]:
        """How weights were trained, for the file that they are written to."""
        training = to_dict(self.config)
        return {"version": __version__, "decisions": model.num_timesteps, "training": training}

    def learner(
        self, policy: Any, envs: Any, mixin: Any = None, **arguments: Any
    ) -> OnPolicyAlgorithm:
        """The algorithm with the hyper-parameters of the run.

        Args:
            policy: The network's class, or its name.
            envs: Environments.
            mixin: Changes how rollouts are collected.
            **arguments: Further arguments of the algorithm's class.

        Raises:
            ConfigError: If it is unknown or takes no such hyper-parameter.
        """
        config = self.config
        kind = algorithm_class(config.learner.algorithm)
        if mixin is not None:
            kind = type(kind.__name__, (mixin, kind), {})
        hyperparameters = arguments_of(config.learner)
        with warnings.catch_warnings():
            # Of whole explorations, which end as they end, no size of minibatches is a factor.
            warnings.filterwarnings("ignore", "You have specified a mini-batch size")
            model: OnPolicyAlgorithm = kind(
                policy, envs, seed=config.seed, device="cpu", **hyperparameters, **arguments
            )
        return model


def learn_policy(learner: PolicyLearner[Any], out: Path) -> OnPolicyAlgorithm:
    """Train a policy; the same command again continues where the run was interrupted, with more steps beyond its end.

    Args:
        learner: What is learned.
        out: Folder of the run: ``config.json``, ``log`` (CSV and TensorBoard events), ``validation.csv``,
            ``checkpoint.safetensors``, ``policy.safetensors`` and, by validation, ``states``, the ``mean.safetensors``
            of the last of these, and ``best.safetensors``.

    Returns:
        The learner.

    Raises:
        ConfigError: If the folder holds a run with other settings or of an older version, or a setting makes no sense.
        InputFileError: If plans or the checkpoint can't be read.
    """
    config = learner.config
    unit = learner.unit
    torch.set_num_threads(1)
    _refuse_other_run(config, out)
    if (out / "checkpoint.pt").is_file():
        raise ConfigError(f"{out} holds a run of an older version; train in another folder")
    with show_progress("floor plans", 0, config.plan_count) as advance:
        plans = draw_plans(
            config.plans, "train", config.plan_count, config.seed, config.largest_area, advance
        )
    settings = {"version": __version__, **to_dict(config)}
    write_text(out / CONFIG, json.dumps(settings, indent=2) + "\n")
    area = sum(plan.area for plan in plans) / len(plans)
    say(f"{len(plans)} floor plans, {area:.0f} m2 on average")
    model = learner.make(plans)
    if (out / CHECKPOINT).is_file():
        load_checkpoint(out, model)
        # Not the plans and the noise of the beginning once more.
        model.set_random_seed(config.seed + model.num_timesteps)
        say(f"going on at {unit} {model.num_timesteps}")
    log = own_folder(own_folder(out / "log") / str(model.num_timesteps))
    # Begun again in any case, and not through a link.
    (log / "progress.csv").unlink(missing_ok=True)
    model.set_logger(configure(str(log), ["csv", "tensorboard"]))
    left = max(0, config.steps - model.num_timesteps)
    try:
        with show_progress(f"{unit}s", model.num_timesteps, config.steps) as advance:
            if left:
                keep = _Keep(learner, out, advance)
                model.learn(left, callback=keep, reset_num_timesteps=False)
    except KeyboardInterrupt:
        save_checkpoint(out, model)
        say(f"interrupted at {unit} {model.num_timesteps}; the same command goes on from there")
        raise
    finally:
        model.env.close()
        model.logger.close()
    learner.export(model, out / POLICY)
    return model


def _refuse_other_run(config: RunConfig, out: Path) -> None:
    """Refuse a folder that holds a run with other settings.

    Raises:
        ConfigError: If it does.
    """
    if (out / CONFIG).exists():
        before = to_dict(read_run(type(config), out))
        kept = {name: value for name, value in before.items() if name in _MAY_CHANGE}
        changes = changed_settings(before, to_dict(config) | kept)
        if changes:
            raise ConfigError(
                f"{out} holds a run with other settings ({changes}); choose another folder"
            )


def read_run(kind: type[ConfigT], folder: Path) -> ConfigT:
    """The settings of a run.

    Raises:
        InputFileError: If the folder holds none.
    """
    path = folder / CONFIG
    values = read_json(path, "choose another folder")
    try:
        values.pop("version", None)
        return from_dict(kind, values)
    except (AttributeError, TypeError, ConfigError) as error:
        raise InputFileError(
            path, f"holds no such training ({error}); choose another folder"
        ) from None


class _Keep(BaseCallback):
    """Logs, validates and saves a run between two updates, keeps its best weights, and advances a bar."""

    def __init__(self, learner: PolicyLearner[Any], out: Path, advance: Advance) -> None:
        super().__init__()
        self._learner = learner
        self._out = out
        self._advance = advance
        self._shown = 0
        config = learner.config
        self._every = config.evaluate_every
        self._plans: list[FloorPlan] = []
        if self._every:
            self._plans = draw_plans(
                config.plans, "validation", config.evaluate_plans, largest_area=config.largest_area
            )
        self._rows = read_validation(out)
        last = self._rows[-1] if self._rows else {}
        # What a run begins with is judged, too.
        self._validate_at = last.get("steps", -self._every) + self._every
        self._spent = last.get("training_cpu_seconds", 0.0)
        self._clock = time.process_time()
        self._save_at = 0.0

    def _on_training_start(self) -> None:
        self._shown = self.model.num_timesteps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        # After an update; during a rollout, steps of who waits would be counted, too.
        steps = self.model.num_timesteps
        for _ in range(steps - self._shown):
            self._advance()
        self._shown = steps
        if self._every and steps >= self._validate_at:
            self._validate_at += self._every
            self._validate()
        if steps >= self._save_at:
            self._save_at = steps + self._learner.config.steps / _CHECKPOINTS
            save_checkpoint(self._out, self.model)

    def _on_rollout_end(self) -> None:
        episodes = list(self.model.ep_info_buffer or [])
        for name, key in self._learner.logged.items():
            if episodes:
                self.logger.record(name, sum(episode[key] for episode in episodes) / len(episodes))
        self.logger.record("time/cpu_seconds", time.process_time())

    def _on_training_end(self) -> None:
        save_checkpoint(self._out, self.model)
        if not self._every:
            return
        steps = self.model.num_timesteps
        if not (self._rows and self._rows[-1]["steps"] >= steps):
            self._validate()
        states = self._last_states()
        if steps >= self._learner.config.steps and states:
            mean = self._out / MEAN
            write_mean(states, mean)
            if len(states) > 1:  # one alone is judged already
                self._judge(mean)

    def _last_states(self) -> list[Path]:
        """Weights of the evaluations at the end of the run, the latest last."""
        first = (1.0 - _LAST_STATES) * self._learner.config.steps
        steps = sorted({round(row["steps"]) for row in self._rows if row["steps"] >= first})
        paths = [self._state(one) for one in steps]
        return [path for path in paths if path.is_file()]

    def _state(self, steps: int) -> Path:
        """The file of the weights at an evaluation."""
        return self._out / STATES / f"{steps}.safetensors"

    def _validate(self) -> None:
        """Keep the weights as they are, and judge them."""
        model: Any = self.model
        self._learner.export(model, self._out / POLICY)
        own_folder(self._out / STATES)
        state = self._state(model.num_timesteps)
        self._learner.export(model, state)
        self._judge(state)

    def _judge(self, weights: Path) -> None:
        """Validate a file of weights, and make it the best one if none before was better."""
        steps = self.model.num_timesteps
        spent = self._spent + time.process_time() - self._clock
        figures = self._learner.validate(weights, self._plans)
        for name, value in figures.items():
            self.logger.record(f"validation/{name}", value)
        shown = ", ".join(f"{name} {value:.3g}" for name, value in figures.items())
        of_mean = " of the mean" if weights.name == MEAN else ""
        say(f"validation{of_mean} at {self._learner.unit} {steps}: {shown}")
        row = {"steps": steps, "training_cpu_seconds": round(spent, 1), **figures}
        _append(self._out / VALIDATION, row)
        scores = [one.get("score", math.inf) for one in self._rows]
        if figures["score"] < min(scores, default=math.inf):
            write_mean([weights], self._out / BEST)  # of one: a copy, with its description
        self._rows.append(row)


def read_validation(folder: Path) -> list[dict[str, float]]:
    """The evaluations of a run so far."""
    path = folder / VALIDATION
    if not path.exists():
        return []
    try:
        rows = csv.DictReader(read_text(path).splitlines())
        return [{name: float(value) for name, value in row.items()} for row in rows]
    except (TypeError, ValueError, csv.Error) as error:
        raise InputFileError(path, f"is damaged ({error}); delete it to begin it again") from None


def _append(path: Path, row: Mapping[str, float]) -> None:
    """Add an evaluation to those of a run."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, row)
    if not path.exists():
        writer.writeheader()
    writer.writerow(row)
    append_line(path, text.getvalue())
