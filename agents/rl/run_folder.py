"""The folder of a training run: its settings, which a second start must share, its checkpoint, its log."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv

from slamgym import __version__
from slamgym.agents.rl.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from slamgym.agents.rl.training_callbacks import ShowProgress, write_json
from slamgym.core.config import Settings, from_dict, to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import own_folder
from slamgym.core.progress import say, show_progress

CONFIG = "config.json"
_SettingsT = TypeVar("_SettingsT", bound=Settings)


def begin_run(config: Settings, out: Path, free: Sequence[str] = ()) -> None:
    """Save the settings of a run in its folder.

    Args:
        config: The settings.
        out: The folder.
        free: Settings that may be others when a run goes on.

    Raises:
        ConfigError: If it holds a run with other settings.
    """
    if (out / CONFIG).exists():
        old = read_run(type(config), out)
        for entry in dataclasses.fields(config):
            mine, theirs = getattr(config, entry.name), getattr(old, entry.name)
            if mine != theirs and entry.name not in free:
                raise ConfigError(
                    f"{out} holds a run with {entry.name} = {theirs}, not {mine}; choose another folder"
                )
    values: dict[str, Any] = to_dict(config)
    write_json(out / CONFIG, {"version": __version__, **values})


def read_run(kind: type[_SettingsT], folder: Path) -> _SettingsT:
    """The settings of a run.

    Raises:
        InputFileError: If the folder holds none.
    """
    path = folder / CONFIG
    values = read_json(path, "choose another folder")
    if not isinstance(values, dict):
        raise InputFileError(path, "holds no settings of a training run; choose another folder")
    values.pop("version", None)
    return from_dict(kind, values, str(path))


def go_on(model: BaseAlgorithm, out: Path, seed: int, unit: str) -> bool:
    """Load the checkpoint of a run; whether there is one.

    Args:
        model: The learner, fresh.
        out: The folder.
        seed: Of the run.
        unit: What its steps are called.

    Raises:
        InputFileError: If the checkpoint can't be read.
    """
    if not has_checkpoint(out):
        return False
    load_checkpoint(out, model)
    model.set_random_seed(
        seed + model.num_timesteps
    )  # not the plans and the noise of the beginning once more
    say(f"going on at {unit} {model.num_timesteps}")
    return True


def log_into_run(model: BaseAlgorithm, out: Path) -> None:
    """Let a learner log into the folder of its run, as CSV and for TensorBoard."""
    log = own_folder(own_folder(out / "log") / str(model.num_timesteps))
    (log / "progress.csv").unlink(missing_ok=True)  # begun again in any case, and not through a link
    model.set_logger(configure(str(log), ["csv", "tensorboard"]))


def learn(
    model: BaseAlgorithm,
    envs: VecEnv,
    out: Path,
    steps: int,
    callbacks: Callable[[], Sequence[BaseCallback]],
    unit: str,
) -> None:
    """Learn until so many steps are made; interrupted, save what was learned. Environments and log are closed.

    Args:
        model: The learner.
        envs: Where it learns.
        out: The folder.
        steps: Of the whole run.
        callbacks: Makes what happens beside the learning.
        unit: What steps are called.
    """
    left = max(0, steps - model.num_timesteps)
    try:
        with show_progress(f"{unit}s", model.num_timesteps, steps) as advance:
            beside = [*callbacks(), ShowProgress(advance)]
            if left:
                model.learn(left, callback=beside, reset_num_timesteps=False)
    except KeyboardInterrupt:
        save_checkpoint(out, model)
        say(f"interrupted at {unit} {model.num_timesteps}; the same command goes on from there")
        raise
    finally:
        envs.close()
        model.logger.close()
