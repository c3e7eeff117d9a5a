"""The folder of a training run: its settings, which a second start must share."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from slamgym import __version__
from slamgym.agents.rl.training_callbacks import write_json
from slamgym.core.config import Settings, from_dict, to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError

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
