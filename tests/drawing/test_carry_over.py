"""Corrections and ids carry over, by place, to a map of a second drive, in whatever frame it lies."""

import json
import math

import pytest
import shapely
from drawing.painted import FLAT, painted
from shapely import affinity

from slamgym.core.errors import InputFileError
from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.drawing import make_drawing
from slamgym.drawing.carry_over import room_ids
from slamgym.drawing.edits import Correction, Corrections, FormerRoom, map_digest, read_corrections
from slamgym.drawing.formats.json import drawing_facts

GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)
SPLIT = {"kind": "split", "line": [[0.2, 3.2], [2.2, 3.2]]}
WALL = {"kind": "add_wall", "line": [[5.5, 0.0], [5.5, 3.0]], "thickness": 0.1}
NAME = {"kind": "name_room", "at": [1.0, 4.5], "name": "Küche"}
JOIN = {"kind": "join", "at": [4.04, 1.75]}


def saved(folder, *entries, rooms=None):
    """As the report saves them."""
    facts = drawing_facts(PLAIN)
    if rooms is None:
        rooms = [{"id": room["id"], "polygon": room["polygon"]} for room in facts["rooms"]]
    path = folder / "flat.corrections.json"
    document = {"map": facts["map"], "rooms": rooms, "corrections": list(entries)}
    path.write_text(json.dumps(document), encoding="utf-8")
    return read_corrections(path)


def second_drive(floor=FLAT, turn_deg=37.0):
    """A map of a floor in a frame of its own."""
    turned, _, model = painted(floor, turn_deg=turn_deg)
    frame = turned.frame
    shifted = GridFrame(frame.resolution, frame.origin_x - 3.0, frame.origin_y + 8.0, *frame.shape)

    def there(grid, angle_deg):
        return model(OccupancyGrid(grid.cells, there_frame(grid.frame)), angle_deg)

    def there_frame(part):
        return GridFrame(part.resolution, part.origin_x + 3.0, part.origin_y - 8.0, *part.shape)

    return OccupancyGrid(turned.cells, shifted), there


def place_of(x, y, turn_deg=37.0):
    """Where a place of the first map lies in the second."""
    turn = math.radians(turn_deg)
    return shapely.Point(
        math.cos(turn) * x - math.sin(turn) * y - 3.0, math.sin(turn) * x + math.cos(turn) * y + 8.0
    )


def test_corrections_carry_over_to_a_map_in_another_frame(tmp_path):
    grid, model = second_drive()
    drawing = make_drawing(grid, "flat", model, corrections=saved(tmp_path, SPLIT, WALL, NAME))
    assert not any("correction" in doubt for doubt in drawing.doubts)
    (kitchen,) = [room for room in drawing.rooms if room.name == "Küche"]
    assert kitchen.polygon.contains(place_of(1.0, 4.5))
    areas = sorted(round(room.area, 1) for room in drawing.rooms)
    assert areas == pytest.approx([4.5, 4.5, 5.0, 12.6], abs=0.35)
    # They are saved again in the frame of the map that they were carried to.
    kept = drawing.provenance["corrections"][0]["line"]
    assert shapely.Point(kept[0]).distance(place_of(0.2, 3.2)) < 0.1


def test_rooms_keep_their_ids_by_place(tmp_path):
    grid, model = second_drive(turn_deg=180.0)
    ids = {room.id: room.polygon.representative_point() for room in PLAIN.rooms}
    drawing = make_drawing(grid, "flat", model, corrections=saved(tmp_path, NAME))
    found = {room.id: room.polygon for room in drawing.rooms}
    assert found.keys() == ids.keys()
    assert all(found[own].contains(place_of(at.x, at.y, 180.0)) for own, at in ids.items())


def test_what_no_longer_fits_is_named_and_the_rest_is_carried_out(tmp_path):
    wall = shapely.box(3.9, 1.3, 4.2, 2.2)
    grid, model = second_drive(FLAT.difference(wall))
    drawing = make_drawing(grid, "flat", model, corrections=saved(tmp_path, SPLIT, JOIN))
    assert len(drawing.rooms) == 3
    (said,) = [doubt for doubt in drawing.doubts if "correction left out" in doubt]
    assert "join" in said
    assert "no door and no boundary" in said


def test_corrections_of_another_building_are_refused(tmp_path):
    grid, model = second_drive(shapely.box(0, 0, 20, 2))
    with pytest.raises(InputFileError, match=r"flat.corrections.json.* is of another building"):
        make_drawing(grid, "hall", model, corrections=saved(tmp_path, SPLIT))


def test_corrections_without_rooms_are_taken_as_they_lie(tmp_path):
    moved = OccupancyGrid(GRID.cells.copy(), GRID.frame)
    moved.cells[:, -1] = 0
    drawing = make_drawing(moved, "flat", MODEL, corrections=saved(tmp_path, JOIN, rooms=[]))
    assert len(drawing.rooms) == 1
    assert any("hold no rooms" in doubt for doubt in drawing.doubts)


def test_a_room_that_was_split_gives_its_id_to_the_larger_part():
    whole = shapely.box(0, 0, 4, 3)
    other = shapely.box(5, 0, 8, 3)
    former = tuple(
        FormerRoom(own, (tuple(room.exterior.coords),))
        for own, room in (("R01", whole), ("R02", other))
    )
    parts = [shapely.box(0, 0, 1, 3), other, shapely.box(1.1, 0, 4, 3)]
    corrections = Corrections((), {"sha256": map_digest(GRID)}, rooms=former)
    assert room_ids(parts, corrections) == ["R03", "R02", "R01"]
    assert room_ids(parts, Corrections((Correction(**NAME),))) == ["R01", "R02", "R03"]
    away = [affinity.translate(part, 50.0) for part in parts]
    assert room_ids(away, corrections) == ["R03", "R04", "R05"]
