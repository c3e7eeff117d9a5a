"""Settings as dataclasses: bounds that hold from construction on, and a JSON form that refuses unknown names."""

import dataclasses
import difflib
import functools
import hashlib
import json
import math
import numbers
import types
import typing
from collections.abc import Hashable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

from slamgym.core.errors import ConfigError
from slamgym.core.limits import MAX_SHOWN, shown
from slamgym.core.names import OneLine

_T = TypeVar("_T")
_MOST_LISTED = 40
"""More names than that are no help in a sentence."""


class Within(NamedTuple):
    """Which numbers a setting may be, as in ``Annotated[float, Within(gt=0.0, le=0.5)]``.

    Of a tuple they bound each number. Without bounds a number must be finite.
    """

    ge: float = -math.inf
    gt: float = -math.inf
    le: float = math.inf
    lt: float = math.inf
    power_of_two: bool = False
    infinite: bool = False
    """True if infinity is allowed, too."""

    def allow(self, number: float) -> bool:
        """True if the setting may be this number."""
        inside = self.ge <= number <= self.le and self.gt < number < self.lt
        if self.power_of_two:
            return inside and int(number).bit_count() == 1
        return inside or (self.infinite and number == math.inf)

    def __str__(self) -> str:
        low, high = max(self.ge, self.gt), min(self.le, self.lt)
        if math.isinf(low) and math.isinf(high):
            return "finite"
        if math.isinf(high):
            return f"{'above' if low == self.gt else 'at least'} {low:g}"
        if math.isinf(low):
            return f"{'below' if high == self.lt else 'at most'} {high:g}"
        kind = "a power of two " if self.power_of_two else ""
        return f"{kind}in {'(' if low == self.gt else '['}{low:g}, {high:g}{')' if high == self.lt else ']'}"


Positive = Annotated[float, Within(gt=0.0)]
NonNegative = Annotated[float, Within(ge=0.0)]
Share = Annotated[float, Within(ge=0.0, le=1.0)]
PositiveShare = Annotated[float, Within(gt=0.0, le=1.0)]
ShareBelowOne = Annotated[float, Within(ge=0.0, lt=1.0)]
Count = Annotated[int, Within(ge=1)]
CountOrZero = Annotated[int, Within(ge=0)]
Measured = Annotated[float, Within(ge=0.0, le=1e9)]
"""A figure of a record, which can't be below 0: more than 1e9 s are 30 years, and sums stay finite."""
Counted = Annotated[int, Within(ge=0, le=10**9)]
"""A number of things in a record."""


@typing.dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
class Settings:
    """Base of the classes of settings: each subclass is a frozen dataclass that refuses wrong values.

    A value must be of its field's type, one of its choices (``Literal``) and within its :class:`Within`.

    Args of a subclass:
        section: What names its settings in errors, as in ``slam.particles``.
        dropped: Former settings, each with the only value that it still has: files that hold that value are read.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]
    _section: ClassVar[str]
    _dropped: ClassVar[Mapping[str, Any]]

    def __init_subclass__(cls, section: str = "", dropped: Mapping[str, Any] | None = None) -> None:
        super().__init_subclass__()
        cls._section = section
        cls._dropped = dropped or {}
        dataclasses.dataclass(frozen=True)(cls)

    def __post_init__(self) -> None:
        for name, hint in _hints(type(self)).items():
            _require(hint, getattr(self, name), self._called(name))
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


def _hints(cls: type) -> dict[str, Any]:
    """Types of the fields of a dataclass or named tuple, with their bounds; looked up once."""
    return _look_up_hints(typing.cast(Hashable, cls))


@functools.cache
def _look_up_hints(cls: Any) -> dict[str, Any]:
    names = getattr(cls, "_fields", None) or [entry.name for entry in dataclasses.fields(cls)]
    hints = typing.get_type_hints(cls, include_extras=True)
    return {name: hints[name] for name in names}


class _Fault(NamedTuple):
    name: str
    must_be: str
    value: Any


def _require(hint: Any, value: Any, name: str) -> None:
    """Refuse a value that doesn't fit what its field declares."""
    for fault in _faults(hint, value, name, Within()):
        choices = [str(choice) for choice in _choices(hint)]
        close = difflib.get_close_matches(shown(fault.value).strip("'"), choices, n=1)
        advice = f"; did you mean {close[0]!r}?" if close else ""
        raise ConfigError(f"{fault.name} must be {fault.must_be}, not {shown(fault.value)}{advice}")


def _choices(hint: Any) -> list[Any]:
    """All values that the literals in a type name."""
    if typing.get_origin(hint) is typing.Literal:
        return list(typing.get_args(hint))
    return [choice for option in typing.get_args(hint) for choice in _choices(option)]


def _faults(hint: Any, value: Any, name: str, bounds: Within) -> Iterator[_Fault]:
    """Find what is wrong with a value; nothing if it fits the type."""
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        rules = [rule for rule in hint.__metadata__ if isinstance(rule, Within)]
        yield from _faults(hint.__origin__, value, name, rules[0] if rules else bounds)
        for rule in hint.__metadata__:
            if isinstance(rule, OneLine) and isinstance(value, str) and not rule.allow(value):
                yield _Fault(name, str(rule), value)
    elif origin in (types.UnionType, typing.Union):
        faults = [next(_faults(option, value, name, bounds), None) for option in options]
        if None not in faults:
            yield _Fault(name, " or ".join(fault.must_be for fault in faults if fault), value)
    elif origin is typing.Literal:
        if not any(value == choice and type(value) is type(choice) for choice in options):
            yield _Fault(name, " or ".join(map(repr, options)), value)
    elif hint in (int, float):
        kind: Any = numbers.Integral if hint is int else numbers.Real  # numpy's scalars are numbers, too
        if isinstance(value, bool) or not isinstance(value, kind):
            yield _Fault(name, f"of type {hint.__name__}", value)
        elif not bounds.allow(value):
            yield _Fault(name, str(bounds), value)
    elif hint is not Any and not isinstance(value, origin or hint):
        expected = "None" if hint is types.NoneType else f"of type {getattr(hint, '__name__', hint)}"
        yield _Fault(name, expected, value)
    else:
        yield from _faults_inside(hint, value, name, bounds)


def _faults_inside(hint: Any, value: Any, name: str, bounds: Within) -> Iterator[_Fault]:
    """Find what is wrong with the items of a tuple, a named tuple or a mapping."""
    options = typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        inner = [options[0]] * len(value) if options[1:] == (Ellipsis,) else options
        if len(inner) != len(value):
            yield _Fault(name, f"{len(inner)} values", value)
        for index, (option, item) in enumerate(zip(inner, value, strict=False)):
            yield from _faults(option, item, f"{name}[{index}]", bounds)
    elif isinstance(value, tuple) and hasattr(hint, "_fields"):
        for inner_name, option in _hints(hint).items():
            yield from _faults(option, getattr(value, inner_name), f"{name}.{inner_name}", bounds)
    elif typing.get_origin(hint) is list:
        for index, item in enumerate(value):
            yield from _faults(options[0], item, f"{name}[{index}]", bounds)
    elif isinstance(value, Mapping) and options:
        for key, item in value.items():
            yield from _faults(options[1], item, f"{name}[{key!r}]", bounds)


def suggest(name: str, known: typing.Iterable[str]) -> str:
    """A sentence part that names the nearest known name, or lists them all; of very many the sections."""
    known = list(known)
    close = difflib.get_close_matches(str(name)[:MAX_SHOWN], known, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    if len(known) > _MOST_LISTED:
        known = list(
            {f"{first}.*" if rest else first for first, _, rest in (n.partition(".") for n in known)}
        )
    return f"known: {', '.join(sorted(known))}"


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
        ConfigError: If a name is unknown (the error suggests the nearest known one) or one without a default is
            missing, or a value is refused, or a former setting has another value than the one that it still has.
    """
    hints, dropped = _hints(cls), getattr(cls, "_dropped", {})
    prefix = f"{where}: " if where else ""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{prefix}{cls.__name__} takes an object of settings by name, not {shown(values)}")
    converted = {}
    for name in values:
        if name in dropped:
            if values[name] != dropped[name]:
                always = f"is always {shown(dropped[name])} in this version, not {shown(values[name])}"
                raise ConfigError(f"{prefix}{name} of {cls.__name__} {always}")
            continue
        if name not in hints:
            raise ConfigError(
                f"{prefix}unknown setting {shown(name)} of {cls.__name__}; {suggest(str(name), hints)}"
            )
        path = f"{where}.{name}" if where else name
        converted[name] = _convert(hints[name], values[name], path)
        _require(hints[name], converted[name], path)
    for entry in dataclasses.fields(typing.cast(Any, cls)):
        is_needed = entry.default is dataclasses.MISSING and entry.default_factory is dataclasses.MISSING
        if is_needed and entry.name not in converted:
            raise ConfigError(f"{prefix}{entry.name!r} of {cls.__name__} is missing")
    return cls(**converted)


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
    hints = _hints(type(config))
    current = getattr(config, first) if first in hints else None
    if first not in hints or (rest and not dataclasses.is_dataclass(current)):
        raise ConfigError(f"unknown setting {shown(name)}; {suggest(name, setting_names(root))}")
    if rest:
        value = _replace(current, rest, value, name, root)
    else:
        value = _convert(hints[first], value, name)
        _require(hints[first], value, name)
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


def _convert(hint: Any, value: Any, where: str) -> Any:
    """Give a JSON value the type that the field declares."""
    if typing.get_origin(hint) is Annotated:
        return _convert(hint.__origin__, value, where)
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        dataclass_options = [option for option in typing.get_args(hint) if dataclasses.is_dataclass(option)]
        if isinstance(value, Mapping) and dataclass_options:
            return _convert(dataclass_options[0], value, where)
        return value
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return from_dict(typing.cast(type, hint), value, where)
    if isinstance(value, list) and isinstance(hint, type) and issubclass(hint, tuple):
        try:
            return hint(*value)
        except TypeError:  # too few or too many
            return tuple(value)
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(value, list) and origin is tuple:
        variadic = len(options) == 2 and options[1] is Ellipsis
        if not variadic and len(options) != len(value):
            return tuple(value)
        inner = [options[0]] * len(value) if variadic else options
        pairs = enumerate(zip(inner, value, strict=True))
        return tuple(_convert(option, item, f"{where}[{index}]") for index, (option, item) in pairs)
    if isinstance(value, Mapping) and origin in (dict, Mapping):
        return {name: _convert(options[1], item, f"{where}.{name}") for name, item in value.items()}
    return value


def config_hash(config: Any) -> str:
    """A short stable name for a settings value: the first 12 hex digits of the SHA-256 of its JSON form."""
    text = json.dumps(to_dict(config), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
