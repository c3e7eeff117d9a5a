"""The quick reader gives what ``from_dict`` gives, and refuses what it refuses in its words."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core import documents
from slamgym.core.config import Within, from_dict
from slamgym.core.documents import read_record
from slamgym.core.errors import ConfigError
from slamgym.core.names import FileName


@dataclass(frozen=True)
class Inner:
    kind: Literal["a", "b"]
    value: float = 0.0


@dataclass(frozen=True)
class Row:
    name: FileName
    index: Annotated[int, Within(ge=0, lt=10)]
    share: float
    seen: bool
    maybe: float | None
    text: str
    place: tuple[float, float]
    any: dict[str, Any]
    digests: dict[str, str]
    inner: tuple[Inner, ...]


GOOD = {
    "name": "x", "index": 3, "share": 0.5, "seen": True, "maybe": None, "text": "t", "place": [1.0, 2],
    "any": {"a": [1, {}]}, "digests": {"A": "0"}, "inner": [{"kind": "a", "value": 1.5}],
}  # fmt: skip
ODD = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 20), st.floats(), st.sampled_from(["a", "../x", ".", "", "a\nb"]),
    st.lists(st.floats() | st.text(max_size=2), max_size=3),
    st.dictionaries(st.sampled_from(["kind", "value", "A"]), st.sampled_from(["a", "c", 1, None]), max_size=2),
    st.lists(st.dictionaries(st.sampled_from(["kind", "value"]), st.sampled_from(["a", "c", 1, None])), max_size=2),
)  # fmt: skip


def outcome(read, values):
    try:
        return repr(read(Row, values))
    except ConfigError as error:
        return str(error)


def test_a_good_record_takes_the_quick_way(monkeypatch):
    expected = from_dict(Row, GOOD)
    monkeypatch.setattr(documents, "from_dict", None)
    assert read_record(Row, GOOD) == expected


@given(field=st.sampled_from(sorted(GOOD)), value=ODD)
def test_whatever_a_field_holds_both_ways_agree(field, value):
    values = GOOD | {field: value}
    assert outcome(read_record, values) == outcome(from_dict, values)


@pytest.mark.parametrize(
    "values", [[], None, {}, GOOD | {"more": 1}, {k: v for k, v in GOOD.items() if k != "text"}]
)
def test_what_is_no_such_record_is_refused_alike(values):
    assert outcome(read_record, values) == outcome(from_dict, values)
