"""Settings as dataclasses: bounds that hold from construction on, and a JSON form that refuses unknown names."""

import dataclasses
import difflib
import functools
import hashlib
import itertools
import json
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

from typing_extensions import dataclass_transform

from slamgym.core.bounds import ValueFault, ValueTest, Within, value_test
from slamgym.core.errors import ConfigError
from slamgym.core.limits import MAX_SHOWN, shown

_T = TypeVar("_T")
STAMPS = ("format_version", "edition", "version", "plans")
"""Entries of files of settings that are none, unless a setting has that name."""
_MOST_LISTED = 40
"""More names than that are no help in a sentence."""
_MOST_CHANGES = 3
"""So many changes are named in an error."""


LARGEST = 1e9
"""Settings without an upper bound of their own are no larger in size."""
_OF_SETTINGS = Within(most=LARGEST)
Positive = Annotated[float, Within(gt=0.0)]
NonNegative = Annotated[float, Within(ge=0.0)]
Share = Annotated[float, Within(ge=0.0, le=1.0)]
PositiveShare = Annotated[float, Within(gt=0.0, le=1.0)]
ShareBelowOne = Annotated[float, Within(ge=0.0, lt=1.0)]
Count = Annotated[int, Within(ge=1)]
CountOrZero = Annotated[int, Within(ge=0)]
Seed = Annotated[int, Within(ge=0, le=2**63 - 1)]
"""Of a random number generator."""
Measured = Annotated[float, Within(ge=0.0, le=1e9)]
"""A figure of a record, which can't be below 0: more than 1e9 s are 30 years, and sums stay finite."""
Counted = Annotated[int, Within(ge=0, le=10**9)]
"""A number of things in a record."""


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
class Settings:
    """Base of the classes of settings: each subclass is a frozen dataclass that refuses wrong values.

    A value must be of its field's type, one of its choices (``Literal``) and within its :class:`Within`.

    Args of a subclass:
        section: What names its settings in errors, as in ``slam.particles``.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]
    _section: ClassVar[str]

    def __init_subclass__(cls, section: str = "") -> None:
        super().__init_subclass__()
        cls._section = section
        dataclasses.dataclass(frozen=True)(cls)

    def __post_init__(self) -> None:
        for name, field in _fields(typing.cast(Any, type(self))).items():
            fault = field.test(getattr(self, name))
            if fault is not None:
                raise field.error(fault, self._called(name))
        self._check()

    def _called(self, name: str) -> str:
        """The name of a setting in errors."""
        return f"{self._section}.{name}" if self._section else name

    def _check(self) -> None:
        """Refuse what single bounds can't say: rules between settings."""


class Arguments(Settings):
    """Base of the arguments of commands, which errors call as they are typed: ``--map-size``."""

    def _called(self, name: str) -> str:
        return f"--{name.replace('_', '-')}"


_Conversion = Callable[[Any, str], Any]


class _Field(NamedTuple):
    """A setting, or a field of a record: what its type says, looked up once because records come by the million."""

    hint: Any
    convert: _Conversion | None
    test: ValueTest

    def error(self, fault: ValueFault, name: str) -> ConfigError:
        """The sentence about a value that doesn't fit what the field declares."""
        choices = [str(choice) for choice in _choices(self.hint)]
        close = difflib.get_close_matches(shown(fault.value).strip("'"), choices, n=1)
        advice = f"; did you mean {close[0]!r}?" if close else ""
        return ConfigError(
            f"{name}{fault.place} must be {fault.must_be}, not {shown(fault.value)}{advice}"
        )

    def read(self, value: Any, name: str) -> Any:
        """Convert a JSON value, and refuse one that doesn't fit."""
        if self.convert is not None:
            value = self.convert(value, name)
        fault = self.test(value)
        if fault is not None:
            raise self.error(fault, name)
        return value


@functools.cache
def _fields(cls: Any) -> dict[str, _Field]:
    """The fields of a dataclass."""
    hints = typing.get_type_hints(cls, include_extras=True)
    rule = _OF_SETTINGS if issubclass(cls, Settings) else None
    fields = {}
    for entry in dataclasses.fields(cls):
        hint = hints[entry.name]
        fields[entry.name] = _Field(hint, _conversion(hint), value_test(hint, rule))
    return fields


def _choices(hint: Any) -> list[Any]:
    """All values that the literals in a type name."""
    if typing.get_origin(hint) is typing.Literal:
        return list(typing.get_args(hint))
    return [choice for option in typing.get_args(hint) for choice in _choices(option)]


def suggest(name: str, known: typing.Iterable[str]) -> str:
    """A sentence part that names the nearest known name, or lists them all; of very many the sections."""
    known = list(known)
    close = difflib.get_close_matches(str(name)[:MAX_SHOWN], known, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    if len(known) > _MOST_LISTED:
        parts = [each.partition(".") for each in known]
        known = list({f"{first}.*" if rest else first for first, _, rest in parts})
    return f"known: {', '.join(sorted(known))}"


def to_dict(config: Any) -> dict[str, Any]:
    """The JSON form of a (nested) settings dataclass: tuples become lists."""
    return json.loads(json.dumps(dataclasses.asdict(config)))


def from_dict(cls: type[_T], values: Mapping[str, Any], where: str = "") -> _T:
    """Build a settings dataclass from its JSON form.

    Args:
        cls: The dataclass.
        values: Field names to values; fields left out keep their defaults.
        where: Where the values stand (a file or a section), for the error.

    Raises:
        ConfigError: If a name is unknown (the error suggests the nearest known one) or one without a default is
            missing, or a value is refused.
    """
    fields = _fields(typing.cast(Any, cls))
    prefix = f"{where}: " if where else ""
    if not isinstance(values, Mapping):
        raise ConfigError(
            f"{prefix}{cls.__name__} takes an object of settings by name, not {shown(values)}"
        )
    converted = {}
    for name, value in values.items():
        if name not in fields:
            raise ConfigError(
                f"{prefix}unknown setting {shown(name)} of {cls.__name__}; {suggest(str(name), fields)}"
            )
        converted[name] = fields[name].read(value, f"{where}.{name}" if where else name)
    if len(converted) < len(fields):
        for entry in dataclasses.fields(typing.cast(Any, cls)):
            if _is_needed(entry) and entry.name not in converted:
                raise ConfigError(f"{prefix}{entry.name!r} of {cls.__name__} is missing")
    return cls(**converted)


def _is_needed(entry: dataclasses.Field[Any]) -> bool:
    """True if a field has no default."""
    missing = dataclasses.MISSING
    return entry.default is missing and entry.default_factory is missing


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
    field = _fields(typing.cast(Any, type(config))).get(first)
    current = getattr(config, first) if field else None
    if field is None or (rest and not dataclasses.is_dataclass(current)):
        raise ConfigError(f"unknown setting {shown(name)}; {suggest(name, setting_names(root))}")
    value = _replace(current, rest, value, name, root) if rest else field.read(value, name)
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


def _conversion(hint: Any) -> _Conversion | None:
    """Make the function that gives a JSON value the type that a field declares; None where there is nothing to do."""
    origin = typing.get_origin(hint)
    options = typing.get_args(hint)
    if origin is Annotated:
        return _conversion(options[0])
    if origin in (types.UnionType, typing.Union):
        records = [option for option in options if dataclasses.is_dataclass(option)]
        return _conversion(records[0]) if records else None
    if dataclasses.is_dataclass(hint):
        cls = typing.cast(type, hint)
        return lambda value, where: (
            from_dict(cls, value, where) if isinstance(value, Mapping) else value
        )
    if origin in (dict, Mapping):
        inner = _conversion(options[1])
        return inner and functools.partial(_to_mapping, inner)
    if origin is tuple or hasattr(hint, "_fields"):
        inside = [_conversion(option) for option in options if option is not Ellipsis]
        make = (lambda items: hint(*items)) if hasattr(hint, "_fields") else tuple
        return functools.partial(_to_tuple, make, inside if any(inside) else ())
    return None


def _to_mapping(convert: _Conversion, value: Any, where: str) -> Any:
    if not isinstance(value, Mapping):
        return value
    return {name: convert(item, f"{where}.{name}") for name, item in value.items()}


def _to_tuple(make: Any, conversions: Sequence[_Conversion | None], value: Any, where: str) -> Any:
    """A list as the tuple that a field declares, whose test refuses it where it has a wrong length."""
    if not isinstance(value, list):
        return value
    items = value
    if conversions:
        items = []
        every = itertools.cycle(conversions)
        for index, (item, convert) in enumerate(zip(value, every, strict=False)):
            items.append(convert(item, f"{where}[{index}]") if convert else item)
    try:
        return make(items)
    except TypeError:  # too few or too many
        return tuple(items)


def changed_settings(before: Any, now: Any) -> str:
    """The first settings that differ between two JSON forms, in words; empty where none does."""
    changes = list(_differences(before, now))
    others = len(changes) - _MOST_CHANGES
    named = "; ".join(changes[:_MOST_CHANGES])
    return f"{named}; and {others} more" if others > 0 else named


def _differences(before: Any, now: Any, where: str = "") -> Iterator[str]:
    """Name each setting that differs."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from _differences(
                before.get(key), now.get(key), f"{where}.{key}" if where else key
            )
    elif before != now:
        yield f"{where} was {shown(before)}, now {shown(now)}"


def config_hash(config: Any) -> str:
    """A short stable name for settings: the first 12 hex digits of the SHA-256 of their JSON form, or of a mapping."""
    values = config if isinstance(config, dict) else to_dict(config)
    text = json.dumps(values, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
