"""Settings as dataclasses: read from and written to JSON, unknown names refused with a suggestion."""

import dataclasses
import difflib
import hashlib
import json
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from slamgym.core.errors import ConfigError

_T = TypeVar("_T")


def suggest(name: str, known: typing.Iterable[str]) -> str:
    """A sentence part that names the nearest known name, or lists them all."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(sorted(known))}"


def to_dict(config: Any) -> dict[str, Any]:
    """The JSON form of a (nested) settings dataclass: tuples become lists."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config)))
    return plain


def from_dict(cls: type[_T], values: Mapping[str, Any], where: str = "") -> _T:
    """Build a settings dataclass from its JSON form.

    Args:
        cls: The dataclass.
        values: Field names to values; fields left out keep their defaults.
        where: Where the values stand (a file or a section), for the error.

    Raises:
        ConfigError: If a name is unknown; the error suggests the nearest known one.
    """
    hints = typing.get_type_hints(cls)
    fields = {field.name for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    prefix = f"{where}: " if where else ""
    for name in values:
        if name not in fields:
            raise ConfigError(f"{prefix}unknown setting {name!r} of {cls.__name__}; {suggest(name, fields)}")
    return cls(
        **{
            name: _convert(hints[name], value, f"{where}.{name}" if where else name)
            for name, value in values.items()
        }
    )


def replace_setting(config: _T, name: str, value: Any) -> _T:
    """A copy of (nested) settings in which one of them has another value.

    Args:
        config: A settings dataclass.
        name: The setting, with dots between the levels, as in ``slam.motion.srr``.
        value: Its new value, in JSON form or as the field has it.

    Raises:
        ConfigError: If there is no such setting (the error suggests the nearest), or the value is of the wrong
            type or refused by the settings.
    """
    return _replace(config, name, value, name, config)


def _replace(config: _T, path: str, value: Any, name: str, root: Any) -> _T:
    """Replace what lies at ``path``; ``name`` is the whole path from ``root``, for errors."""
    first, _, rest = path.partition(".")
    hints = typing.get_type_hints(type(config))
    current = getattr(config, first) if first in hints else None
    if first not in hints or (rest and not dataclasses.is_dataclass(current)):
        raise ConfigError(f"unknown setting {name!r}; {suggest(name, setting_names(root))}")
    if rest:
        value = _replace(current, rest, value, name, root)
    else:
        value = _convert(hints[first], value, name)
        if not _fits(hints[first], value):
            raise ConfigError(f"{name} can't be {value!r}; {_expectation(hints[first])}")
    return dataclasses.replace(config, **{first: value})  # type: ignore[type-var]


def setting_names(config: Any) -> list[str]:
    """Names of all settings of a (nested) settings dataclass, with dots between the levels."""
    names: list[str] = []
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            names.extend(f"{field.name}.{inner}" for inner in setting_names(value))
        else:
            names.append(field.name)
    return names


def _fits(hint: Any, value: Any) -> bool:
    """Whether a value is of the declared type; a whole number is a float, too."""
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return any(_fits(option, value) for option in options)
    if origin is typing.Literal:
        return any(value == option and type(value) is type(option) for option in options)
    if origin is tuple:
        variadic = len(options) == 2 and options[1] is Ellipsis
        if not isinstance(value, tuple) or not (variadic or len(value) == len(options)):
            return False
        inner = [options[0]] * len(value) if variadic else options
        return all(_fits(option, item) for option, item in zip(inner, value, strict=True))
    if hint is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return value is None if hint in (None, type(None)) else isinstance(value, origin or hint)


def _expectation(hint: Any) -> str:
    options = typing.get_args(hint)
    if typing.get_origin(hint) is typing.Literal:
        return f"known: {', '.join(map(str, options))}"
    return f"it must be of type {getattr(hint, '__name__', hint)}"


def _convert(hint: Any, value: Any, where: str) -> Any:
    """Give a JSON value the type that the field declares."""
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        dataclass_options = [option for option in typing.get_args(hint) if dataclasses.is_dataclass(option)]
        if isinstance(value, Mapping) and dataclass_options:
            return _convert(dataclass_options[0], value, where)
        return value
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return from_dict(typing.cast(type, hint), value, where)
    if isinstance(value, list) and isinstance(hint, type) and issubclass(hint, tuple):
        return hint(*value)
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(value, list) and origin is tuple:
        variadic = len(options) == 2 and options[1] is Ellipsis
        if not variadic and len(options) != len(value):
            return tuple(value)
        inner = [options[0]] * len(value) if variadic else options
        return tuple(_convert(option, item, where) for option, item in zip(inner, value, strict=True))
    if isinstance(value, Mapping) and origin in (dict, Mapping):
        return {name: _convert(options[1], item, f"{where}.{name}") for name, item in value.items()}
    return value


def config_hash(config: Any) -> str:
    """A short stable name for a settings value: the first 12 hex digits of the SHA-256 of its JSON form."""
    text = json.dumps(to_dict(config), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
