"""Offices of hundreds of rooms are real: what a drawing costs grows with them, not with their square."""

import dataclasses
import json
import re

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, painted
from growth import MOST, growth
from shapely import MultiPolygon

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, GridFrame, OccupancyGrid
from slamgym.drawing import make_drawing
from slamgym.drawing.drawing import DrawnRoom
from slamgym.drawing.edits import Correction, Corrections, map_digest
from slamgym.drawing.formats.look import place_labels
from slamgym.drawing.openings import Gap, divide, onto_faces
from slamgym.metrics.wall_direction import find_wall_direction

GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)
PITCH = 4.0


def row_of_rooms(count):
    """Rooms side by side with doors between them, and the doors' lines."""
    rooms = [shapely.box(PITCH * k, 0.0, PITCH * k + 3.9, 4.0) for k in range(count)]
    doors = [shapely.box(PITCH * k - 0.1, 1.0, PITCH * k, 2.0) for k in range(1, count)]
    lines = [((PITCH * k - 0.05, 1.02), (PITCH * k - 0.05, 1.98)) for k in range(1, count)]
    return MultiPolygon([shapely.union_all([*rooms, *doors])]), lines


def test_ends_of_doors_are_found_on_large_floors():
    floors = {count: row_of_rooms(count) for count in (100, 400)}

    def fit(count):
        floor, lines = floors[count]
        return onto_faces([Gap(*line) for line in lines], floor)

    assert fit(100)[5].start == pytest.approx((24.0, 1.0))  # the jamb
    assert growth(fit, 100) < MOST


@pytest.mark.parametrize("odds", [-1.0, 1.0])
def test_large_floors_are_divided(odds):
    floors = {count: row_of_rooms(count) for count in (100, 400)}

    def cut(count):
        floor, lines = floors[count]
        return divide(floor, [Gap(*line, odds) for line in lines])

    assert len(cut(100).rooms) == (100 if odds > 0.0 else 1)
    assert growth(cut, 100) < MOST


def test_labels_of_large_floors_find_their_places():
    def labels(count):
        floor, _ = row_of_rooms(count)
        rooms = [
            DrawnRoom(f"R{k}", shapely.box(PITCH * k, 0, PITCH * k + 3.9, 4), 1.0, "SEEN", f"R{k}")
            for k in range(count)
        ]
        drawing = dataclasses.replace(
            PLAIN, floor=floor, rooms=tuple(rooms), doors=(), dimensions=()
        )
        return place_labels(drawing, 0.2)

    assert len(labels(50)[0]) == 50
    assert growth(labels, 100) < MOST


def checkerboard(side):
    places = np.arange(side)
    odd = (places[:, None] + places) % 2 == 1
    return np.where(odd, FREE, OCCUPIED).astype(np.uint8)


def test_outlines_that_touch_at_their_corners_are_followed():
    assert growth(lambda cells: find_wall_direction(checkerboard(round(cells**0.5))), 150**2) < MOST


def test_a_map_of_specks_is_refused(monkeypatch):
    monkeypatch.setenv("SLAMGYM_MAX_RUNS", "1000")
    cells = checkerboard(60)
    with pytest.raises(InputFileError, match="runs of floor or wall in its rows, above the limit"):
        make_drawing(OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, *cells.shape)), model="none")


def many_splits(count):
    places = np.linspace(0.2, 2.8, count)
    entries = [Correction("split", ((4.3, y), (7.1, y))) for y in places.tolist()]
    return Corrections(tuple(entries), {"sha256": map_digest(PLAIN.grid)}, "flat.corrections.json")


def test_thousands_of_splits_are_left_out_soon():
    def draw(count):
        drawing = make_drawing(GRID, "flat", MODEL, corrections=many_splits(count))
        left_out = [doubt for doubt in drawing.doubts if "doesn't part two rooms" in doubt]
        assert len(left_out) > 0.9 * count

    assert growth(draw, 100) < MOST


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"line": [[0, 0], [2, 0]], "thickness": 1e300}, r"thickness must be in \(0, 2\]"),
        ({"line": [[-1e5, 1], [1e5, 1]], "thickness": 0.1}, "it doesn't lie on the map"),
        ({"line": [[-1e3, 1], [1e3, 1]], "thickness": 1.5}, "it doesn't lie on the map"),
    ],
)
def test_corrections_far_beyond_the_map_are_left_out(tmp_path, entry, message):
    from slamgym.drawing.edits import read_corrections

    path = tmp_path / "flat.corrections.json"
    document = {
        "map": {"sha256": map_digest(PLAIN.grid)},
        "corrections": [{"kind": "remove_wall", **entry}],
    }
    path.write_text(json.dumps(document))
    drawing = make_drawing(GRID, "flat", MODEL, corrections=read_corrections(path))
    assert any(re.search(message, doubt) for doubt in drawing.doubts)
