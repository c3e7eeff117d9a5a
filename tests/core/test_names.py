"""Names out of files are one part of a path, and texts become such names."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.config import from_dict
from slamgym.core.errors import ConfigError
from slamgym.core.names import MAX_NAME_BYTES, FileName, as_file_name, is_file_name


@dataclass(frozen=True)
class Entry:
    name: FileName


@pytest.mark.parametrize(
    "name", ["000001_hall", "a", "a..b", "plan~2", "Küche (1. OG)", "-x", "x" * MAX_NAME_BYTES]
)
def test_plain_names_pass(name):
    assert from_dict(Entry, {"name": name}).name == name


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        ".hidden",
        "/abs",
        "a/b",
        "a\\b",
        "C:x",
        "a\0b",
        "a\nb",
        " a",
        "a ",
        "\ud800",
        "ü" * MAX_NAME_BYTES,
    ],
)
def test_all_else_is_refused(name):
    with pytest.raises(ConfigError, match="name must be a plain file name"):
        from_dict(Entry, {"name": name})


@given(st.text())
def test_a_text_becomes_a_name(text):
    name = as_file_name(f"000001_{text}")
    assert is_file_name(name)
    assert len(name) <= MAX_NAME_BYTES


def test_long_texts_stay_apart():
    first, second = as_file_name("x" * 300), as_file_name("x" * 299 + "y")
    assert len(first) == len(second) == MAX_NAME_BYTES
    assert first != second
    assert as_file_name("000001_a b/c") == "000001_a-b-c"
