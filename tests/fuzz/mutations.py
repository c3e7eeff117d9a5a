"""Strategies that damage good files: bytes flipped, cut and inserted, and values of documents swapped for others."""

import copy
import json
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

from slamgym.core.errors import SlamgymError

ODD_VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from(
        [
            0,
            -1,
            1e308,
            -1e308,
            1e-308,
            10**400,
            float("nan"),
            float("inf"),
            2**63,
            "",
            "\0",
            "a/../b",
            "é" * 300,
        ]
    ),
    st.sampled_from([[], {}, [[]], [[[[0]]]], {"": 0}, [None], ["a", 1], {"a": {"a": {"a": []}}}]),
    st.integers(-(10**6), 10**6),
    st.floats(-1e4, 1e4),
    st.text(max_size=5),
)
"""What stands where something else belongs."""

MAX_SENTENCE = 1000
"""Characters of a refusal, the path included."""

_BYTES = st.tuples(
    st.sampled_from(["flip", "cut", "drop", "insert", "repeat"]),
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
        before, hit, after = content[:place], content[place : place + length], content[place + length :]
        content = {
            "flip": before + bytes(byte ^ (1 << (length % 8)) for byte in hit[:2]) + hit[2:] + after,
            "cut": before,
            "drop": before + after,
            "insert": before + extra + hit + after,
            "repeat": before + hit * 3 + after,
        }[how]
    return content


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


def must_read_or_refuse(read: Callable[..., Any], *arguments: Any) -> None:
    """Call a reader: it must give a value, or a SlamgymError with one sentence of a sensible length."""
    sentence = ""
    try:
        read(*arguments)
    except SlamgymError as error:
        sentence = str(error)
    assert len(sentence) < MAX_SENTENCE
    assert "\n" not in sentence


def _with_fault(draw: st.DrawFn, document: Any) -> Any:
    """A document with one value replaced; the place is found by walking down from the root."""
    if not isinstance(document, dict | list) or not document:
        return copy.deepcopy(draw(ODD_VALUES))
    holder: Any = document
    while True:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        key = draw(st.sampled_from(keys))
        inner = holder[key]
        if not isinstance(inner, dict | list) or not inner or draw(st.integers(0, 3)) == 0:
            break
        holder = inner
    how = draw(st.sampled_from(["replace", "replace", "drop", "nest", "double"]))
    if how == "drop":
        del holder[key]
    elif how == "nest":
        for _ in range(draw(st.sampled_from([1, 40]))):
            inner = [inner] if draw(st.booleans()) else {"a": inner}
        holder[key] = inner
    elif how == "double" and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(inner))
    else:
        holder[key] = copy.deepcopy(draw(ODD_VALUES))  # which later faults may change
    return document
