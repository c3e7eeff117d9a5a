import contextlib
import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad import generate_plan, parse_houseexpo, read_houseexpo, write_houseexpo
from slamgym.cad.houseexpo import format_houseexpo
from slamgym.core.errors import InputFileError, PlanError

SQUARE = [[0, 0], [4, 0], [4, 3], [0, 3]]


def parse(**keys):
    return parse_houseexpo(json.dumps({"id": "home", "verts": SQUARE, **keys}), "home.json")


def test_y_points_down_in_the_file_and_up_in_the_plan():
    # An L whose foot is at the bottom of the picture, that is at large y in the file.
    plan = parse(
        verts=[[0, 0], [1, 0], [1, 2], [4, 2], [4, 3], [0, 3]],
        room_category={"Kitchen": [[2, 2, 4, 3]]},
        doors=[[[1, 2], [1, 3]]],
    )
    assert plan.bounds == (0, 0, 4, 3)
    assert plan.free_space.contains(shapely.Point(3.5, 0.5))
    assert not plan.free_space.contains(shapely.Point(3.5, 2.5))
    assert plan.rooms[0].polygon.bounds == (2, 0, 4, 1)
    assert {plan.doors[0].start, plan.doors[0].end} == {(1, 0), (1, 1)}


@given(st.integers(0, 10**6))
@settings(max_examples=40)
def test_writing_and_reading_gives_the_same_plan(tmp_path_factory, seed):
    plan = generate_plan(seed)
    path = tmp_path_factory.mktemp("plans") / f"{plan.id}.json"
    write_houseexpo(path, plan)
    read = read_houseexpo(path)
    assert read.id == plan.id
    # Coordinates are whole centimetres and written to the micrometre.
    assert read.free_space.equals(plan.free_space)
    assert [room.category for room in read.rooms] == [room.category for room in plan.rooms]
    assert all(a.polygon.equals(b.polygon) for a, b in zip(read.rooms, plan.rooms, strict=True))
    assert read.doors == plan.doors
    assert format_houseexpo(read) == path.read_text()


def test_a_written_plan_has_all_keys_of_the_data_set_and_no_needless_ones():
    data = json.loads(format_houseexpo(parse(room_category={"Kitchen": [[0, 0, 2, 2]]})))
    assert set(data) == {"verts", "id", "room_category", "room_num", "bbox"}
    assert data["bbox"] == {"min": [0, 0], "max": [4, 3]}
    assert data["room_category"] == {"Kitchen": [[0, 0, 2, 2]]}
    assert data["room_num"] == 1


def test_holes_are_read_as_pillars():
    plan = parse(holes=[[[1, 1], [2, 1], [2, 2]]])
    assert plan.area == pytest.approx(12 - 0.5)
    assert len(plan.free_space.interiors) == 1


@pytest.mark.parametrize(
    ("verts", "area"),
    [
        (
            [[0, 0], [2, 0], [2, 2], [4, 2], [4, 4], [2, 4], [2, 2], [0, 2]],
            None,
        ),  # two squares touch at a corner
        ([[0, 0], [4, 0], [4, 3], [6, 3], [4, 3], [0, 3]], 12.0),  # a spike
        (
            [[0, 0], [4, 0], [4, 3], [2, 3], [2, 1], [2, 3], [0, 3]],
            12.0,
        ),  # a wall without thickness
        ([[0, 0], [4, 0], [4, 0], [4, 3], [0, 3], [0, 0]], 12.0),  # repeated vertices
        (
            [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1]],
            11.0,
        ),  # slit to a hole
    ],
)
def test_an_outline_that_touches_itself_is_mended_and_one_in_two_parts_refused(verts, area):
    if area is None:
        with pytest.raises(PlanError, match="2 disjoint parts"):
            parse(verts=verts)
    else:
        plan = parse(verts=verts)
        assert plan.free_space.is_valid
        assert plan.area == pytest.approx(area)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not valid JSON"),
        ('{"verts": [[0, 0], [1', "not valid JSON"),
        (b"\xff\xfe\x00", "not valid JSON"),
        ("[1, 2]", "no 'verts'"),
        ('{"id": "a"}', "no 'verts'"),
        ('{"verts": [[0, 0], [1, 0]]}', "2 vertices; an outline needs at least 3"),
        ('{"verts": []}', "0 vertices"),
        ('{"verts": 3}', "not a list of"),
        ('{"verts": {"a": 1}}', "not a list of"),
        ('{"verts": [[0, 0], [1, 0], [1]]}', "not a list of"),
        ('{"verts": [["0", "0"], ["1", "0"], ["1", "1"]]}', "not a list of"),
        ('{"verts": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}', "not a list of"),
        ('{"verts": [[0, 0], [NaN, 0], [1, 1]]}', "NaN or infinite"),
        ('{"verts": [[0, 0], [Infinity, 0], [1, 1]]}', "NaN or infinite"),
        ('{"verts": [[0, 0], [1e300, 0], [1, 1]]}', "beyond 10000 m"),
        ('{"verts": [[0, 0], [1, 1], [2, 2]]}', "encloses no area"),
        ('{"verts": [[1, 1], [1, 1], [1, 1]]}', "encloses no area"),
        ('{"verts": [[0, 0], [2, 2], [2, 0], [0, 2]]}', "crosses itself"),
        (
            '{"verts": [[0, 0], [4, 0], [4, 3], [0, 3]], "holes": [[[9, 9], [10, 9], [10, 10]]]}',
            "crosses itself",
        ),
        (
            '{"verts": [[0, 0], [4, 0], [4, 3], [0, 3]], "room_category": [1]}',
            "'room_category' is not",
        ),
        (
            '{"verts": [[0, 0], [4, 0], [4, 3]], "room_category": {"Hall": [[0, 0, 1]]}}',
            "list of .min x",
        ),
        ('{"verts": [[0, 0], [4, 0], [4, 3]], "room_category": {"Hall": [[0, 0, NaN, 1]]}}', "NaN"),
        ('{"verts": [[0, 0], [4, 0], [4, 3]], "doors": [[[0, 0]]]}', "'doors' has 1"),
        (
            '{"verts": [[0, 0], [4, 0], [4, 3]], "room_polygons": {"Hall": [7]}}',
            "not a list of rings",
        ),
        ('{"verts": [[0, 0], [4, 0], [4, 3]], "doors": 7}', "'doors' is not a list"),
    ],
)
def test_malformed_files_get_one_sentence_that_names_file_and_reason(text, reason):
    with pytest.raises(PlanError, match=reason) as caught:
        parse_houseexpo(text, "bad.json")
    assert str(caught.value).startswith("bad.json: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PlanError, match=r"gone\.json: can't be read"):
        read_houseexpo(tmp_path / "gone.json")
    with pytest.raises(PlanError, match="can't be read"):
        read_houseexpo(tmp_path)


def test_a_plan_that_can_not_be_written_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="can't be written"):
        write_houseexpo(tmp_path / "file" / "plan.json", generate_plan(0))


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
    lambda inner: (
        st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=12,
)
numbers = st.floats(-9, 9) | st.integers(-9, 9) | st.just(math.nan)
keys = {
    "verts": st.lists(st.lists(numbers, min_size=2, max_size=2), max_size=9) | json_values,
    "room_category": st.dictionaries(
        st.text(max_size=4), st.lists(st.lists(numbers, max_size=4), max_size=2)
    )
    | json_values,
    "holes": st.just([]) | json_values,
    "doors": json_values,
    "room_polygons": json_values,
}


@given(
    st.fixed_dictionaries(
        {"verts": keys["verts"]}, optional={key: keys[key] for key in list(keys)[1:]}
    )
)
@settings(max_examples=150)
def test_any_json_is_a_valid_plan_or_one_error(data):
    plan = None
    with contextlib.suppress(PlanError):
        plan = parse_houseexpo(json.dumps(data), "any.json")
    if plan is not None:
        assert plan.free_space.is_valid
        assert plan.area > 0
        assert np.isfinite(plan.segments()).all()
