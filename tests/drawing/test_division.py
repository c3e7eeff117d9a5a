"""Boundaries are chosen so that rooms are parted as a whole, and their ends lie on what was drawn."""

import math

import pytest
import shapely
from drawing.painted import FLAT, painted
from shapely import MultiPolygon, Point

from slamgym.drawing import make_drawing
from slamgym.drawing.openings import Gap, divide, onto_faces

HALLS = MultiPolygon([shapely.union_all([
    shapely.box(0, 0, 4, 6), shapely.box(4, 1, 4.1, 2), shapely.box(4, 4, 4.1, 5), shapely.box(4.1, 0, 8, 6)
])])  # fmt: skip
"""Two rooms with two doors between them."""


def doors(first, second):
    return [Gap((4.05, 1), (4.05, 2), first), Gap((4.05, 4), (4.05, 5), second)]


@pytest.mark.parametrize(
    ("first", "second", "rooms"), [(2.0, -1.0, 2), (1.0, -2.0, 1), (-0.5, -0.5, 1), (1.0, 1.0, 2)]
)
def test_two_boundaries_between_the_same_rooms_count_together(first, second, rooms):
    division = divide(HALLS, doors(first, second))
    assert len(division.rooms) == rooms
    assert len(division.doors) == (2 if rooms == 2 else 0)
    assert sum(room.area for room in division.rooms) == pytest.approx(HALLS.area, abs=1e-3)


def ring(odds):
    """Four rooms around a block, and the doors between neighbours."""
    floor = shapely.box(0, 0, 9, 9).difference(shapely.box(3, 3, 6, 6))
    lines = [((0, 3), (3, 3)), ((6, 3), (9, 3)), ((3, 6), (3, 9)), ((6, 6), (9, 6))]
    return divide(
        MultiPolygon([floor]), [Gap(*line, value) for line, value in zip(lines, odds, strict=True)]
    )


def test_a_loop_is_open_or_closed_as_a_whole():
    """One boundary across a ring parts nothing; a second one parts it if both together are likely."""
    assert len(ring((2.0, -5.0, -5.0, -5.0)).rooms) == 1
    parted = ring((2.0, 1.0, -5.0, -5.0))
    assert (len(parted.rooms), len(parted.doors)) == (2, 2)
    assert len(ring((1.0, 1.0, 1.0, 1.0)).rooms) == 4


def test_infinite_log_odds_always_part():
    assert len(divide(HALLS, doors(math.inf, -50.0)).rooms) == 2


def test_a_niche_is_never_a_room():
    niche = shapely.box(4, 2, 4.9, 3.0)
    floor = MultiPolygon([shapely.union_all([shapely.box(0, 0, 4, 6), niche])])
    (room,) = divide(floor, [Gap((4, 2), (4, 3))]).rooms
    assert room.area == pytest.approx(24.9, abs=1e-3)


def test_each_door_says_which_rooms_it_joins():
    division = divide(HALLS, doors(1.0, 1.0))
    assert sorted(division.joins) in ([(0, 1), (0, 1)], [(1, 0), (1, 0)])
    assert divide(HALLS, []).doors == ()


def test_ends_of_doors_lie_on_the_faces_that_were_drawn():
    floor = MultiPolygon([FLAT])
    (moved,) = onto_faces([Gap((4.05, 1.26), (4.03, 2.22))], floor)
    assert (moved.start[1], moved.end[1]) == pytest.approx((1.3, 2.2))
    assert all(floor.boundary.distance(Point(end)) < 1e-9 for end in (moved.start, moved.end))
    (jambs,) = onto_faces([Gap((4.0, 1.27), (4.0, 2.24))], floor)  # a face is nearer than the jamb
    assert (*jambs.start, *jambs.end) == pytest.approx((4.0, 1.3, 4.0, 2.2))
    far = Gap((2.0, 1.5), (2.6, 1.5))
    assert onto_faces([far], MultiPolygon([shapely.box(0, 0, 9, 9)])) == [far]


def test_cleaning_alone_finds_the_door_of_a_plain_flat():
    drawing = make_drawing(painted(FLAT)[0], model="none")
    (door,) = drawing.doors
    assert (len(drawing.rooms), door.kind) == (2, "door")
    assert door.width == pytest.approx(0.9, abs=0.1)
