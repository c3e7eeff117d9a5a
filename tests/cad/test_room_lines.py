import itertools
import json
import lzma
from pathlib import Path

import pytest

from slamgym.cad import check_plan, open_plans
from slamgym.core.errors import InputFileError, PlanError

POLIMI = Path(__file__).parents[3] / "shared/data/floorplans/polimi_schools_offices/polimi.jsonl.xz"


def walls(points, portal):
    """Segments round a room in the data set's manner: walls, and the portal as a point."""
    ring = [*points, points[0]]
    pieces = [[*a, *b, "WALL", "NORMAL"] for a, b in itertools.pairwise(ring)]
    return [*pieces, [*portal, *portal, "PORTAL", "NORMAL"]]


def room(label, points, portal):
    return {"label": label, "polygon": [*points, points[0]], "segments": walls(points, portal)}


@pytest.fixture
def floor():
    """Two rooms of 5 x 4 m side by side at 0.1 m per pixel, joined by a portal in their common wall."""
    left = [[0, 0], [50, 0], [50, 20], [50, 40], [0, 40]]
    right = [[50, 0], [100, 0], [100, 40], [50, 40], [50, 20]]
    rooms = [room("BIG OFFICE", left, [50, 20]), room("CORRIDOR", right, [50, 20])]
    return {"name": "two/rooms", "m_per_px": 0.1, "rooms": rooms}


def write(path, *floors):
    text = "".join(json.dumps(floor) + "\n" for floor in floors).encode()
    path.write_bytes(lzma.compress(text) if path.suffix == ".xz" else text)
    return path


@pytest.mark.parametrize("name", ["floors.jsonl", "floors.jsonl.xz"])
def test_rooms_are_joined_at_their_portals(tmp_path, floor, name):
    source = open_plans(write(tmp_path / name, floor))
    assert list(source.ids) == ["two_rooms"]
    plan = source.load("two_rooms")
    check_plan(plan)
    assert [room.category for room in plan.rooms] == ["Big_Office", "Corridor"]
    # Two rooms less half a wall of 0.15 m all round, and doorways of at most 1 m from either room's portal.
    rooms = 2 * (5 - 0.15) * (4 - 0.15)
    assert rooms + 0.9 * 0.15 < plan.area < rooms + 2.1 * 0.15
    # y points up: the rooms lie below the axis that was the picture's top.
    assert plan.bounds == pytest.approx((0.075, -3.925, 9.925, -0.075))


def test_a_portal_to_the_outside_stays_shut(tmp_path, floor):
    floor["rooms"].append(room("ENTRANCE", [[0, 40], [50, 40], [50, 60], [0, 60]], [0, 50]))
    plan = open_plans(write(tmp_path / "a.jsonl", floor)).load("two_rooms")
    # Nothing leads from the entrance to the other rooms, so it is no part of the plan, which stays closed.
    assert [room.category for room in plan.rooms] == ["Big_Office", "Corridor"]
    assert plan.bounds == pytest.approx((0.075, -3.925, 9.925, -0.075))


def test_malformed_floors_are_one_error(tmp_path, floor):
    path = tmp_path / "bad.jsonl"
    for text in ("{", "[]", "\xff"):
        path.write_text(text, encoding="latin-1")
        with pytest.raises(InputFileError, match=r"bad\.jsonl:? ?.*is not"):
            open_plans(path)
    faults = [
        {**floor, "m_per_px": "wide"},
        {**floor, "m_per_px": 1e-125},
        {"name": "two/rooms"},
        {
            **floor,
            "rooms": [{"label": "A", "polygon": [[0, 0], [1, 0], [None, 1]], "segments": []}],
        },
        {
            **floor,
            "rooms": [
                {"label": "A", "polygon": [[0, 0], [9, 0], [9, float("nan")]], "segments": []}
            ],
        },
    ]
    for fault in faults:
        with pytest.raises(PlanError, match=r"bad\.jsonl:two_rooms: its rooms are malformed"):
            open_plans(write(path, fault)).load("two_rooms")
    with pytest.raises(
        PlanError, match=r"bad\.jsonl:two rooms: its rooms are malformed"
    ):  # one line
        open_plans(write(path, {**floor, "m_per_px": None, "name": "two\nrooms"})).load(
            "two\nrooms"
        )
    with pytest.raises(PlanError, match="disjoint"):
        open_plans(write(path, {**floor, "rooms": []})).load("two_rooms")


@pytest.mark.skipif(not POLIMI.exists(), reason="needs the schools and offices")
def test_schools_and_offices_have_loops():
    source = open_plans(POLIMI)
    loops = 0
    for plan_id in source.ids[:12]:
        try:
            plan = source.load(plan_id)
        except PlanError:
            continue
        loops += any(len(hole.coords) > 6 for hole in plan.free_space.interiors)
    assert loops >= 9
