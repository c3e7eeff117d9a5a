"""Records by the million: dataclasses of plain values from their JSON form, ten times faster than by ``from_dict``.

What a class declares is turned into tests, once. A value that fails its test, or a declaration that is not
known here, goes to :func:`slamgym.core.config.from_dict`, which says what is wrong.
"""

import dataclasses
import functools
import math
import sys
import types
import typing
from collections.abc import Callable, Hashable, Mapping
from operator import itemgetter
from typing import Annotated, Any, NamedTuple, TypeVar, cast

from slamgym.core.config import Within, from_dict
from slamgym.core.errors import ConfigError
from slamgym.core.names import OneLine

_T = TypeVar("_T")
_Fits = Callable[[Any], bool]


class _Field(NamedTuple):
    name: str
    convert: Callable[[Any], Any] | None
    """From its JSON form, where that differs."""
    fits: _Fits


class _Tests(NamedTuple):
    """What a class declares: most fields are told by the types of their values, all at once."""

    size: int
    """Number of fields."""
    plain: Callable[[Any], tuple[Any, ...]]
    """The values that their types alone decide about, numbers without bounds first."""
    kinds: tuple[type, ...]
    numbers: int
    """So many of them must be finite."""
    others: tuple[_Field, ...]
    is_plain: bool
    """Whether making one only sets its attributes."""


def read_record(cls: type[_T], values: Any) -> _T:
    """Build a record from its JSON form, as :func:`slamgym.core.config.from_dict` does.

    Raises:
        ConfigError: As ``from_dict`` raises it.
    """
    tests = _tests_of(cast(Hashable, cls))
    if tests is None or type(values) is not dict or len(values) != tests.size:
        return from_dict(cls, values)
    try:
        plain = tests.plain(values)
        # A whole number for a float, or a sum that overflows, takes the slow way.
        if tuple(map(type, plain)) != tests.kinds or not math.isfinite(sum(plain[: tests.numbers])):
            return from_dict(cls, values)
        converted = values.copy()
        for name, convert, fits in tests.others:
            value = values[name] if convert is None else convert(values[name])
            if not fits(value):
                return from_dict(cls, values)
            converted[name] = value
    except (KeyError, TypeError, ConfigError):
        return from_dict(cls, values)
    if not tests.is_plain:
        return cls(**converted)
    # What a frozen dataclass does by 28 calls of object.__setattr__, at once.
    record = object.__new__(cls)
    record.__dict__.update(converted)
    return record


@functools.cache
def _tests_of(cls: Any) -> _Tests | None:
    """The tests of a class; None if it declares what isn't known here."""
    hints = typing.get_type_hints(cls, include_extras=True)
    plain: list[tuple[str, type]] = []
    others = []
    for entry in dataclasses.fields(cls):
        hint = hints[entry.name]
        if hint in (float, str, bool):
            plain.append((entry.name, hint))
            continue
        fits = _test_of(hint)
        if fits is None:
            return None
        others.append(_Field(entry.name, _conversion_of(hint), fits))
    plain.sort(key=lambda pair: pair[1] is not float)
    names, kinds = tuple(name for name, _ in plain), tuple(kind for _, kind in plain)
    # itemgetter of one name gives no tuple
    getter = itemgetter(*names) if len(names) > 1 else lambda values: tuple(values[name] for name in names)
    is_plain = not (hasattr(cls, "__post_init__") or hasattr(cls, "__slots__"))
    return _Tests(len(plain) + len(others), getter, kinds, kinds.count(float), tuple(others), is_plain)


def _conversion_of(hint: Any) -> Callable[[Any], Any] | None:
    if typing.get_origin(hint) is not tuple:
        return None
    item: Any = typing.get_args(hint)[0]
    if dataclasses.is_dataclass(item):
        return lambda value: (
            tuple(read_record(cast(type, item), inner) for inner in value) if type(value) is list else value
        )
    return lambda value: tuple(value) if type(value) is list else value


def _test_of(hint: Any) -> _Fits | None:
    """Whether a value is of a declared type and within its bounds; None if the declaration isn't known here."""
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _bounded(options[0], options[1]) if len(options) == 2 else None
    if origin in (types.UnionType, typing.Union):
        tests = [_test_of(option) for option in options]
        known = [test for test in tests if test is not None]
        return (lambda value: any(test(value) for test in known)) if len(known) == len(tests) else None
    if origin is typing.Literal:
        return lambda value: type(value) is str and value in options
    if origin is tuple:
        return _items(options)
    if origin in (dict, Mapping):
        return _values(options[1])
    if hint in (int, float):
        return _bounded(hint, Within())
    if hint is Any:
        return lambda value: True  # noqa: ARG005 - of a protocol
    return (lambda value: type(value) is hint) if hint in (str, bool, types.NoneType) else None


def _bounded(hint: Any, rule: Any) -> _Fits | None:
    if hint is str and isinstance(rule, OneLine):
        return lambda value: type(value) is str and rule.allow(value)
    if not isinstance(rule, Within) or hint not in (int, float):
        return None
    kinds = (int,) if hint is int else (float, int)
    if rule == Within(ge=rule.ge, le=rule.le):
        low, high = max(rule.ge, -sys.float_info.max), min(rule.le, sys.float_info.max)
        return lambda value: type(value) in kinds and low <= value <= high
    return lambda value: type(value) in kinds and rule.allow(value)


def _items(options: tuple[Any, ...]) -> _Fits | None:
    variadic = options[1:] == (Ellipsis,)
    if dataclasses.is_dataclass(options[0]):
        return (lambda value: type(value) is tuple) if variadic else None  # its items were read as records
    if set(options) in ({int}, {float}):
        count, kinds = len(options), {int, *options}
        return lambda value: (
            type(value) is tuple
            and len(value) == count
            and kinds.issuperset(map(type, value))
            and math.isfinite(sum(value))
        )
    tests = [_test_of(option) for option in (options[:1] if variadic else options)]
    known = [test for test in tests if test is not None]
    if len(known) != len(tests):
        return None
    if variadic:
        return lambda value: type(value) is tuple and all(map(known[0], value))
    return lambda value: (
        type(value) is tuple
        and len(value) == len(known)
        and all(test(item) for test, item in zip(known, value, strict=True))
    )


def _values(hint: Any) -> _Fits | None:
    test = _test_of(hint)
    if hint is Any:
        return lambda value: type(value) is dict
    return (
        (lambda value: type(value) is dict and all(map(test, value.values()))) if test is not None else None
    )
