"""JSON and YAML from outside, parsed within the limits of size and depth, and records by the million from JSON."""

import dataclasses
import functools
import json
import sys
import types
import typing
from collections import Counter
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import yaml

from slamgym.core.config import Within, from_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.limits import DEPTH, DOCUMENT_BYTES, YAML_BYTES, Limit, shown
from slamgym.core.names import OneLine

_T = TypeVar("_T")
_Fits = Callable[[Any], bool]

YAML_SUFFIXES = (".yaml", ".yml")
MAX_DIGITS = 300
"""A longer whole number is no float any more."""


def load_json(text: str | bytes) -> Any:
    """``json.loads`` for texts of unknown origin.

    Raises:
        ValueError: If it isn't JSON, holds a number of hundreds of digits or half a surrogate pair, which nothing can
            print, or is nested beyond reason.
    """
    try:
        decoded = text if isinstance(text, str) else text.decode(json.detect_encoding(text), "surrogatepass")
        value = _DECODER.decode(decoded)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if (b"\\u" if isinstance(text, bytes) else "\\u") in text:  # type: ignore[operator]
        json.dumps(value, ensure_ascii=False).encode()
    return value


def parse_json(
    text: str | bytes,
    where: object,
    error: type[InputFileError] = InputFileError,
    limit: Limit = DOCUMENT_BYTES,
    fix: str = "",
) -> Any:
    """The value of a JSON text.

    Args:
        text: The text.
        where: The file or the line, for errors.
        error: What to raise.
        limit: Of its bytes.
        fix: What to do about a text that isn't JSON, for errors.

    Raises:
        InputFileError: If it is not JSON, too long, or nested too deeply.
    """
    limit.check(where, len(text), error)
    try:
        value = load_json(text)
    except ValueError as reason:
        raise error(where, f"is not valid JSON ({_one_line(reason)})" + (fix and f"; {fix}")) from None
    # Fewer brackets than the limit can't be nested deeper.
    brackets = (b"[", b"{") if isinstance(text, bytes) else ("[", "{")
    if sum(map(text.count, brackets)) > DEPTH.value:  # type: ignore[arg-type]
        _check_depth(value, where, error)
    return value


def read_json(path: Path | str, fix: str = "", limit: Limit = DOCUMENT_BYTES) -> Any:
    """Read a whole JSON file.

    Args:
        path: The file.
        fix: What to do about a file that isn't JSON, for errors.
        limit: Of its bytes.

    Raises:
        InputFileError: If it can't be read, isn't JSON, or is larger than allowed.
    """
    return parse_json(read_bytes(path, limit), path, limit=limit, fix=fix)


def parse_yaml(text: str, where: object) -> Any:
    """The value of a YAML text of plain values, without aliases: ten lines of them can stand for gigabytes.

    Args:
        text: The text.
        where: The file, for errors.

    Raises:
        InputFileError: If it is not YAML, too long, nested too deeply, or has aliases.
    """
    YAML_BYTES.check(where, len(text))
    try:
        value = yaml.load(text, Loader=_PlainLoader)
    except yaml.YAMLError as reason:
        mark = getattr(reason, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        problem = getattr(reason, "problem", None) or "it can't be parsed"
        raise InputFileError(f"{where}{line}", f"is not valid yaml ({_one_line(problem)})") from None
    # What PyYAML makes of impossible dates, empty numbers and the like.
    except (ValueError, TypeError, AttributeError, LookupError, RecursionError) as reason:
        raise InputFileError(where, f"is not valid yaml ({_one_line(reason)})") from None
    _check_depth(value, where, InputFileError)
    return value


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader without aliases and double keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The next node; refuses an alias."""
        if self.check_event(yaml.events.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(
                None, None, "aliases are not allowed; write the value out", mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """A mapping; refuses a key that stands there twice, of which one would be lost."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for key, count in Counter(keys).most_common(1):
            if count > 1:
                problem = f"the key {shown(key)} stands there twice"
                raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return super().construct_mapping(node, deep)


def _whole_number(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


_DECODER = json.JSONDecoder(parse_int=_whole_number)
"""``json.loads`` would make one for every text."""


def _yaml_number(loader: _PlainLoader, node: yaml.ScalarNode) -> int:
    number: int = loader.construct_yaml_int(node)
    if number.bit_length() > 3 * MAX_DIGITS:
        raise ValueError("a whole number of hundreds of digits")
    return number


_PlainLoader.add_constructor("tag:yaml.org,2002:int", _yaml_number)


def _check_depth(value: Any, where: object, error: type[InputFileError]) -> None:
    """Refuse what recursive functions may stumble over, level by level."""
    level, depth = [value], 0
    while level := [inner for outer in level for inner in _inside(outer) if isinstance(inner, list | dict)]:
        depth += 1
        DEPTH.check(where, depth, error)


def _inside(value: Any) -> Any:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()


def _one_line(reason: object) -> str:
    return " ".join(str(reason).split())[:160]


def read_record(cls: type[_T], values: Any) -> _T:
    """Build a dataclass of plain values from its JSON form, twenty times faster than ``from_dict``.

    What the class declares is turned into tests, once. A value that fails its test, or a declaration that is not known
    here, goes to :func:`slamgym.core.config.from_dict`, which says what is wrong.

    Raises:
        ConfigError: As ``from_dict`` raises it.
    """
    tests = _tests_of(cast(Hashable, cls))
    if tests is None or type(values) is not dict or len(values) != len(tests):
        return from_dict(cls, values)
    converted = {}
    try:
        for name, convert, fits in tests:
            value = values[name] if convert is None else convert(values[name])
            if not fits(value):
                return from_dict(cls, values)
            converted[name] = value
    except (KeyError, TypeError, ConfigError):
        return from_dict(cls, values)
    if hasattr(cls, "__post_init__"):
        return cls(**converted)
    # What a frozen dataclass does by 28 calls of object.__setattr__, at once.
    record = object.__new__(cls)
    record.__dict__.update(converted)
    return record


@functools.cache
def _tests_of(cls: Any) -> list[tuple[str, Callable[[Any], Any] | None, _Fits]] | None:
    """Name, conversion from JSON and test of each field; None if the class declares what isn't known here."""
    hints = typing.get_type_hints(cls, include_extras=True)
    names = [entry.name for entry in dataclasses.fields(cls)]
    tests = [_test_of(hints[name]) for name in names]
    known = [
        (name, _conversion_of(hints[name]), test) for name, test in zip(names, tests, strict=True) if test
    ]
    return known if len(known) == len(names) else None


def _conversion_of(hint: Any) -> Callable[[Any], Any] | None:
    """From a list to the tuple that a field declares, perhaps of records."""
    if typing.get_origin(hint) is not tuple:
        return None
    item: Any = typing.get_args(hint)[0]
    make = functools.partial(read_record, cast(type, item)) if dataclasses.is_dataclass(item) else None
    return lambda value: tuple(map(make, value) if make else value) if type(value) is list else value


def _test_of(hint: Any) -> _Fits | None:
    """A test of a declared type and its bounds; None if the declaration isn't known here."""
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _bounded(*options) if len(options) == 2 else None
    if origin is typing.Literal:
        return lambda value: type(value) is str and value in options
    if hint in (int, float):
        return _bounded(hint, Within())
    if hint is Any:
        return lambda value: True  # noqa: ARG005 - of a protocol
    if hint in (str, bool, types.NoneType) or dataclasses.is_dataclass(hint):
        return lambda value: type(value) is hint
    inner = [_test_of(option) for option in options if option is not Ellipsis]
    tests = [test for test in inner if test is not None]
    if not tests or len(tests) < len(inner):
        return None
    first, last = tests[0], tests[-1]
    if origin in (types.UnionType, typing.Union):
        return lambda value: any(test(value) for test in tests)
    if origin is tuple and Ellipsis in options:
        return lambda value: type(value) is tuple and all(map(first, value))
    if origin is tuple:
        return lambda value: (
            type(value) is tuple
            and len(value) == len(tests)
            and all(test(item) for test, item in zip(tests, value, strict=True))
        )
    if origin in (dict, Mapping):
        return lambda value: type(value) is dict and all(map(last, value.values()))
    return None


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
