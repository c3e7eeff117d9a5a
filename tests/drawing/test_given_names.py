"""Rooms are called as the map itself calls them."""

import pytest
import shapely
from drawing.painted import FLAT, painted, shares

from slamgym.drawing import make_drawing
from slamgym.drawing.given_names import with_given_names
from slamgym.interop.valetudo import MapSegment

GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)


def segment(name, *box):
    return MapSegment(name, shares(shapely.box(*box), GRID.frame) >= 0.5)


def names(*segments):
    return [room.name for room in with_given_names(PLAIN, segments, GRID.frame).rooms]


def test_a_room_takes_the_name_of_the_segment_that_covers_most_of_it():
    assert names(segment("Kitchen|", 4.1, 0, 7.3, 3), segment("Hall", 0, 0, 4, 5)) == [
        "Hall",
        "Kitchen",
    ]


@pytest.mark.parametrize("name", ["segment 3", "17", " ", "-"])
def test_numbers_of_segments_are_no_names(name):
    assert names(segment(name, 0, 0, 4, 5)) == ["R01", "R02"]


def test_a_segment_over_two_rooms_names_the_larger_and_one_over_a_corner_none():
    assert names(segment("Flat", 0, 0, 8, 5)) == ["Flat", "R02"]
    assert names(segment("Corner", 4.1, 0, 5, 3)) == ["R01", "R02"]
