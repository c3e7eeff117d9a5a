"""All settings of a command: a file, single ones by name, and the options that people use most."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from slamgym import __version__
from slamgym.core.config import STAMPS, Arguments, from_dict, setting_names, suggest, to_dict
from slamgym.core.documents import json_text, load_json, read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import write_text
from slamgym.core.limits import shown
from slamgym.core.names import is_own_explorer

_T = TypeVar("_T")
_Words = tuple[tuple[str, ...], ...]
CLEARED = object()
"""Value of an option that sets a setting to None."""


class SettingsOptions(Arguments):
    """Settings from a file, then --set, then options: the later overrules the earlier."""

    config: Path | None = None
    """Settings from a JSON file: what --save-config or an earlier run wrote."""
    set: Annotated[_Words, tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME=VALUE")] = ()
    """Any setting by its name or the end of it, as in ``lidar.range_max=8``; ``odometry`` and ``lidar`` also take an
    error level, as in ``odometry=high``. --save-config shows them all."""
    save_config: Path | None = None
    """Write all settings of this run to a JSON file."""

    def configured(self, default: _T, options: Mapping[str, Any]) -> _T:
        """The settings of a run as :meth:`chosen`, written to the file of ``save_config``."""
        config = self.chosen(default, options)
        if self.save_config is not None:
            write_text(self.save_config, json_text({"version": __version__, **to_dict(config)}))
        return config

    def chosen(self, default: _T, options: Mapping[str, Any]) -> _T:
        """The settings of a run.

        Args:
            default: What holds where nothing else is given.
            options: Values of options by the names of their settings; None where one isn't given.

        Raises:
            ConfigError: If a name is unknown or ambiguous, or a value is refused.
            InputFileError: If the file can't be used.
        """
        config = default if self.config is None else settings_from_file(self.config, default)
        values = to_dict(config)
        names = setting_names(config)
        for setting in (one for given in self.set for one in given):
            name, equals, text = setting.partition("=")
            if not equals:
                raise ConfigError(
                    f"--set takes NAME=VALUE, as in lidar.range_max=8, not {shown(setting)}"
                )
            _put(values, _full_name(name, names), _value(text))
        for name, value in options.items():
            if value is not None:
                _put(values, _full_name(name, names), None if value is CLEARED else value)
        return from_dict(type(default), values)


AllSettings = Annotated[SettingsOptions, tyro.conf.arg(name="")]
"""For the field ``settings`` of a command's arguments."""


def settings_from_file(path: Path, default: _T) -> _T:
    """Settings from a file; what it doesn't name keeps its default.

    Raises:
        InputFileError: If the file isn't JSON, names unknown settings or refused values, or names code to run.
    """
    content = read_json(path, "give settings that --save-config wrote")
    if isinstance(content, Mapping):
        content = content.get("config", content)  # summaries of results hold them under this name
    if not isinstance(content, Mapping):
        raise InputFileError(
            path, "holds no settings; give a JSON object, as --save-config writes it"
        )
    known = to_dict(default)
    given = {name: value for name, value in content.items() if name in known or name not in STAMPS}
    try:
        config = from_dict(type(default), _merged(default, known, given))
    except ConfigError as error:
        version = content.get("version", __version__)
        if version == __version__:
            raise InputFileError(path, str(error)) from None
        raise InputFileError(
            path, f"{error} (slamgym {shown(version)} wrote it, this is {__version__})"
        ) from None
    for name, value in _strings(to_dict(config)):
        if name.startswith("explorer") and is_own_explorer(value):
            raise InputFileError(path, f"{shown(value)} is code of your own; name it by an option")
    return config


def _merged(default: Any, known: dict[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The default's JSON form with what is given instead, section by section."""
    merged = dict(known)
    for name, value in given.items():
        section = getattr(default, name, None)
        is_section = isinstance(value, Mapping) and hasattr(section, "__dataclass_fields__")
        merged[name] = _merged(section, known[name], value) if is_section else value
    return merged


def _full_name(typed: str, settings: list[str]) -> str:
    """The only setting or section of that name, or whose last parts these are."""
    names = [*settings, *dict.fromkeys(name.rpartition(".")[0] for name in settings if "." in name)]
    found = [name for name in names if name == typed] or [
        n for n in names if n.endswith(f".{typed}")
    ]
    if len(found) == 1:
        return found[0]
    if found:
        raise ConfigError(f"--set {typed}: there are several; say which: {', '.join(found)}")
    parts = typed.count(".") + 1
    ends = {".".join(name.split(".")[-parts:]) for name in settings}
    raise ConfigError(
        f"--set: unknown setting {shown(typed)}; {suggest(typed, [*settings, *ends])}"
    )


def _put(values: dict[str, Any], name: str, value: Any) -> None:
    *sections, last = name.split(".")
    for section in sections:
        values = values[section]
    if isinstance(values[last], dict) and isinstance(value, str):
        from slamgym.envs.config import ERROR_LEVELS

        if last not in ERROR_LEVELS:
            raise ConfigError(f"--set {last}: is a section; set one of {', '.join(values[last])}")
        value = ERROR_LEVELS[last](value)
    is_whole = (
        isinstance(values[last], float) and isinstance(value, int) and not isinstance(value, bool)
    )
    values[last] = float(value) if is_whole else value


def _value(text: str) -> Any:
    """JSON, or the text itself."""
    try:
        return load_json(text)
    except ValueError:
        return text


def _strings(values: Any, name: str = "") -> list[tuple[str, str]]:
    """All texts in a JSON document, each with the name under which it stands."""
    if isinstance(values, str):
        return [(name, values)]
    if isinstance(values, Mapping):
        return [found for key, value in values.items() for found in _strings(value, str(key))]
    if isinstance(values, list):
        return [found for value in values for found in _strings(value, name)]
    return []
