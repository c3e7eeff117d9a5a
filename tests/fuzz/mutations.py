"""Strategies that damage good files: bytes flipped, cut and inserted, and values of documents swapped for others."""

import copy
import json
import os
import re
from collections.abc import Callable
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st

from slamgym.core.errors import SlamgymError

ODD_VALUES = st.one_of(
    st.sampled_from(
        [
            None, True, False, 0, 1, -1, 0.5, -0.0, 1e308, -1e308, 1e-308, 1e-320, float("nan"), float("inf"), 2**31,
            2**63, -(2**63), 10**30, 10**400, "", "x", "1", "\0", "a\0b", "..", "../x", "/abs/x", "a/b", "a/../b", ".x",
            "x" * 300, "é" * 300, "\u202e", "\ud800",
        ]
    ),
    st.sampled_from(
        [
            [], {}, [[]], [{}], [0], [0, 0], [0, 0, 0], ["x"], [None], ["a", 1], [[[[0]]]], [[[[[[[[1]]]]]]]], {"": 0},
            {"": None}, {"x": 0}, {"x": {}}, {"a": {"a": {"a": []}}}, {"between": [0, 1]}, {"value": 1},
        ]
    ),
    st.integers(-(10**6), 10**6),
    st.integers(),
    st.floats(-1e4, 1e4),
    st.floats(),
    st.text(max_size=8),
)  # fmt: skip
"""What stands where something else belongs."""

MAX_SENTENCE = 1000
"""Characters of a refusal, the path included."""

_BYTES = st.tuples(
    st.sampled_from([*["flip", "cut", "drop", "insert", "repeat"] * 4, "nest"]),
    st.floats(0.0, 1.0, exclude_max=True),
    st.integers(1, 40),
    st.binary(max_size=12),
)


@st.composite
def mutated_bytes(draw: st.DrawFn, files: list[bytes]) -> bytes:
    """One of some good files with up to four faults in it."""
    content = draw(st.sampled_from(files))
    for how, share, length, extra in draw(st.lists(_BYTES, max_size=4)):
        place = int(share * len(content))
        before, hit, after = (
            content[:place],
            content[place : place + length],
            content[place + length :],
        )
        content = {
            "flip": before
            + bytes(byte ^ (1 << (length % 8)) for byte in hit[:2])
            + hit[2:]
            + after,
            "cut": before,
            "drop": before + after,
            "insert": before + extra + hit + after,
            "repeat": before + hit * 3 + after,
            "nest": before + b"[" * 100_000 + after,
        }[how]
    return content


_NUMBER = re.compile(rb"\d+(\.\d+)?")
_NUMBERS = st.sampled_from(
    [b"0", b"1", b"-1", b"7", b"0.5", b"1e9", b"1e308", b"1e-308", b"nan", b"-inf", b"9" * 20]
)


@st.composite
def mutated_text(draw: st.DrawFn, files: list[bytes]) -> bytes:
    """One of some good files of lines in which up to three numbers are others; now and then with other faults, too."""
    content = draw(st.sampled_from(files))
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.sampled_from(list(_NUMBER.finditer(content))))
        number = draw(
            _NUMBERS | st.floats(-100.0, 100.0).map(lambda value: str(round(value, 2)).encode())
        )
        content = content[: place.start()] + number + content[place.end() :]
    return content if draw(st.integers(0, 2)) else draw(mutated_bytes([content]))


@st.composite
def mutated_value(draw: st.DrawFn, values: list[Any]) -> Any:
    """One of some good documents in which up to three values are others, missing, twice there or nested."""
    document = copy.deepcopy(draw(st.sampled_from(values)))
    for _ in range(draw(st.integers(1, 3))):
        document = _with_fault(draw, document)
    return document


@st.composite
def mutated_json(draw: st.DrawFn, values: list[Any]) -> bytes:
    """The same as JSON text; now and then damaged as text, too."""
    text = json.dumps(draw(mutated_value(values))).encode()
    return draw(mutated_bytes([text])) if draw(st.integers(0, 4)) == 0 else text


@st.composite
def mutated_lines(draw: st.DrawFn, values: list[Any]) -> bytes:
    """A file of one document a line, of which one is not as it should be, or the last line is torn."""
    lines = [json.dumps(value).encode() for value in values]
    chosen = draw(st.integers(0, len(lines) - 1))
    lines[chosen] = draw(mutated_json([values[chosen]]))
    return b"\n".join(lines) + (b"\n" if draw(st.integers(0, 7)) else b"")


def _alike(value: Any) -> st.SearchStrategy[Any]:
    """Other values of a kind: a reader that checks kinds alone lets them through."""
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, int):
        return st.sampled_from(
            [0, 1, 2, value + 1, 2 * value, -value, 10**6, 2**31, 2**63]
        ) | st.integers(0, 100)
    if isinstance(value, float):
        return st.sampled_from([0.0, 1.0, -value, 1e-308, 1e-3, 1e9, 1e308]) | st.floats(0.0, 2.0)
    if isinstance(value, str):
        return st.sampled_from(["", value + "x", value.upper(), value[::-1]]) | st.text(max_size=8)
    return st.just(value[::-1] if isinstance(value, list) else value)


def cases(usual: int) -> settings:
    """How many examples a test tries: ``FUZZ_CASES`` of the environment, or its usual number."""
    return settings(max_examples=int(os.environ.get("FUZZ_CASES", usual)))


def must_read_or_refuse(read: Callable[..., Any], *arguments: Any) -> Any:
    """Call a reader: it must give a value, or a SlamgymError with one sentence of a sensible length.

    Returns:
        The value; None if there is none.
    """
    try:
        return read(*arguments)
    except SlamgymError as error:
        sentence = str(error)
    assert len(sentence) < MAX_SENTENCE, sentence
    assert "\n" not in sentence, sentence
    return None


def _with_fault(draw: st.DrawFn, document: Any) -> Any:
    """A document with one value replaced; the place is found by walking down from the root."""
    if not isinstance(document, dict | list) or not document:
        return copy.deepcopy(draw(ODD_VALUES))
    holder: Any = document
    while True:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        outer = [key for key in keys if isinstance(holder[key], dict | list)]
        key = draw(
            st.sampled_from([*keys, *outer * 3])
        )  # mostly further down, where the first check has passed
        inner = holder[key]
        if not isinstance(inner, dict | list) or not inner or draw(st.integers(0, 3)) == 0:
            break
        holder = inner
    how = draw(
        st.sampled_from([*["alike"] * 8, "replace", "replace", "drop", "nest", "double", "add"])
    )
    if how == "alike":
        holder[key] = draw(_alike(inner))
    elif how == "drop":
        del holder[key]
    elif how == "nest":
        for _ in range(draw(st.sampled_from([1, 40]))):
            inner = [inner] if draw(st.booleans()) else {"a": inner}
        holder[key] = inner
    elif how == "double" and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(inner))
    elif how == "add" and isinstance(holder, dict):
        holder[draw(st.text(max_size=8))] = copy.deepcopy(draw(ODD_VALUES))
    else:
        holder[key] = copy.deepcopy(draw(ODD_VALUES))  # which later faults may change
    return document
