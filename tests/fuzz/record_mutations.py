"""Documents that are almost right: a valid JSON value with some of its parts replaced, dropped or doubled."""

import copy
import json

from hypothesis import strategies as st

NASTY = st.one_of(
    st.sampled_from(
        [
            None, True, False, 0, 1, -1, 2**31, 2**63, -(2**63), 10**30, 0.5, -0.0, 1e308, 1e-320, float("inf"),
            float("nan"), "", "x", "..", "../x", "/abs/x", "a/b", "a\0b", ".x", "x" * 300, "\u202e", "\ud800", "1",
            [], {}, [[]], [{}], [0], [0, 0], [0, 0, 0], ["x"], {"x": 0}, {"x": {}}, {"": None},
            [[[[[[[[1]]]]]]]], {"between": [0, 1]}, {"value": 1},
        ]
    ),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
)  # fmt: skip


def paths_in(value, path=()):
    """The path of every part of a JSON value, the whole first."""
    yield path
    if isinstance(value, (dict, list)):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from paths_in(item, (*path, key))


def _replaced(value, path, change):
    """A copy in which ``change`` was made to the container and the key that a path ends in."""
    if not path:
        box = [value]
        change(box, 0)
        return box[0] if box else None
    value = copy.deepcopy(value)
    place = value
    for key in path[:-1]:
        place = place[key]
    change(place, path[-1])
    return value


@st.composite
def damaged_values(draw, value):
    """A JSON value with one to three changes."""
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(list(paths_in(value))))
        kind = draw(st.sampled_from(["replace", "replace", "replace", "drop", "wrap", "add"]))
        nasty = draw(NASTY)

        def change(place, key, kind=kind, nasty=nasty):
            if kind == "drop":
                del place[key]
            elif kind == "wrap":
                place[key] = [place[key]]
            elif kind == "add" and isinstance(place[key], dict):
                place[key] = {**place[key], str(nasty)[:20]: nasty}
            elif kind == "add" and isinstance(place[key], list):
                place[key] = [*place[key], nasty]
            else:
                place[key] = nasty

        value = _replaced(value, path, change)
    return value


@st.composite
def damaged_bytes(draw, content):
    """Bytes that were cut, overwritten or grown in one place."""
    start = draw(st.integers(0, len(content)))
    kind = draw(st.sampled_from(["cut", "overwrite", "insert", "remove", "nest"]))
    if kind == "cut":
        return content[:start]
    if kind == "nest":
        return content[:start] + b"[" * 100_000 + content[start:]
    patch = draw(st.binary(min_size=1, max_size=12))
    if kind == "insert":
        return content[:start] + patch + content[start:]
    return content[:start] + (patch if kind == "overwrite" else b"") + content[start + len(patch) :]


@st.composite
def damaged_json(draw, value):
    """The bytes of a damaged document: mostly well-formed JSON of the wrong content, sometimes not even JSON."""
    text = json.dumps(draw(damaged_values(value))).encode()
    return draw(damaged_bytes(text)) if draw(st.integers(0, 7)) == 0 else text


@st.composite
def damaged_lines(draw, values):
    """The bytes of a file of lines, one of them damaged."""
    lines = [json.dumps(value).encode() for value in values]
    chosen = draw(st.integers(0, len(lines) - 1))
    lines[chosen] = draw(damaged_json(values[chosen]))
    return b"\n".join(lines) + (b"\n" if draw(st.integers(0, 7)) else b"")
