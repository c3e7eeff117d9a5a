"""JSON and YAML from outside, parsed within the limits of size and depth, and the text of JSON files."""

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml

from slamgym.core.config import from_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.limits import DEPTH, DOCUMENT_BYTES, YAML_BYTES, Limit, shown

_T = TypeVar("_T")

YAML_SUFFIXES = (".yaml", ".yml")
MAX_DIGITS = 300
"""A longer whole number is no float any more."""


def json_text(document: Any) -> str:
    """A JSON document as the package's files hold it."""
    return json.dumps(document, indent=1) + "\n"


def load_json(text: str | bytes) -> Any:
    """``json.loads`` for texts of unknown origin.

    Raises:
        ValueError: If it isn't JSON, holds a number of hundreds of digits or half a surrogate pair, which nothing can
            print, or is nested beyond reason.
    """
    try:
        decoded = (
            text
            if isinstance(text, str)
            else text.decode(json.detect_encoding(text), "surrogatepass")
        )
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
        advice = fix and f"; {fix}"
        raise error(where, f"is not valid JSON ({_one_line(reason)}){advice}") from None
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
        raise InputFileError(
            f"{where}{line}", f"is not valid yaml ({_one_line(problem)})"
        ) from None
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
    depth = 0
    level = _nested([value])
    while level:
        depth += 1
        DEPTH.check(where, depth, error)
        level = _nested(level)


def _nested(values: list[Any]) -> list[Any]:
    """The lists and objects that stand in some values."""
    found = []
    for value in values:
        inner = value.values() if isinstance(value, Mapping) else value
        if isinstance(value, list | Mapping):
            found += [each for each in inner if isinstance(each, list | dict)]
    return found


def _one_line(reason: object) -> str:
    return " ".join(str(reason).split())[:160]


def known_fields(
    cls: type[_T],
    values: Mapping[str, Any],
    where: object,
    error: type[InputFileError] = InputFileError,
) -> _T:
    """Build a dataclass from those values of a document that it declares: files from elsewhere hold more.

    Args:
        cls: The dataclass.
        values: Names to values.
        where: The file, for errors.
        error: What to raise.

    Raises:
        InputFileError: If a value doesn't fit what its field declares, or one without a default is missing.
    """
    known = {
        entry.name: values[entry.name]
        for entry in dataclasses.fields(cast(Any, cls))
        if entry.name in values
    }
    try:
        return from_dict(cls, known)
    except ConfigError as fault:
        raise error(where, str(fault)) from None
