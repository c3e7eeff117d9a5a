"""Settings as dataclasses: read from and written to JSON, unknown names refused with a suggestion."""

import dataclasses
import difflib
import hashlib
import json
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from slamgym.errors import ConfigError

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
    if isinstance(value, list) and typing.get_origin(hint) is tuple:
        return tuple(value)
    return value


def config_hash(config: Any) -> str:
    """A short stable name for a settings value: the first 12 hex digits of the SHA-256 of its JSON form."""
    text = json.dumps(to_dict(config), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
