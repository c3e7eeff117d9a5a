"""Floor that the robot saw is drawn or named."""

import numpy as np
import pytest
import shapely
from drawing.painted import painted
from shapely import MultiPolygon

from slamgym.commands.cli import main
from slamgym.core.types import FREE, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing import make_drawing
from slamgym.drawing.evidence import left_out_floor, undrawn_cells
from slamgym.drawing.floor import faces_within_cells
from slamgym.interop import write_ros_map
from slamgym.metrics.layers import MapLayers

HALL_AND_ROOM = shapely.union_all([shapely.box(0, 0, 6, 4), shapely.box(6.2, 0, 10, 4)])


def left_out(drawn, grid):
    lost = undrawn_cells(drawn, grid.cells == FREE, grid.frame)
    return left_out_floor(lost, grid.frame)


def room_and_yard(side):
    """A room of 25 m2, and beside it a square that no walls close in."""
    grid, _, _ = painted(shapely.box(0, 0, 5, 5))
    cells = np.full((400, 600), UNKNOWN, np.uint8)
    cells[20 : 20 + len(grid.cells), 20 : 20 + grid.cells.shape[1]] = grid.cells
    yard = round(side / 0.05)
    cells[20 : 20 + yard, 200 : 200 + yard] = FREE
    return OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, *cells.shape))


def only_left(columns):
    """A model that takes what is free in the first columns for floor."""

    def layers(grid, angle_deg):
        free = faces_within_cells(grid.cells == FREE)
        free[:, columns:] = 0.0
        return MapLayers.of_floor(free)

    return layers


def test_seen_floor_that_is_not_drawn_is_left_out_with_its_area_and_place():
    grid, floor, _ = painted(HALL_AND_ROOM)
    drawn = MultiPolygon([shapely.box(0, 0, 6, 4)])
    (part,) = left_out(drawn, grid)
    # A band along what is drawn isn't counted, nor corners into which no disc fits.
    assert part.area == pytest.approx(3.8 * 4.0, rel=0.05)
    assert (part.centroid.x, part.centroid.y) == pytest.approx((8.1, 2.0), abs=0.1)
    assert left_out(MultiPolygon(shapely.get_parts(floor)), grid) == []


def test_a_ray_is_not_left_out():
    grid, _, _ = painted(HALL_AND_ROOM.union(shapely.box(10, 1, 16, 1.3)))
    drawn = MultiPolygon(shapely.get_parts(HALL_AND_ROOM))
    assert left_out(drawn, grid) == []


@pytest.mark.parametrize(("side", "is_half"), [(5.0, False), (12.0, True)])
def test_a_drawing_says_what_it_left_out(side, is_half):
    """A yard that no walls close in, beside a room."""
    drawing = make_drawing(room_and_yard(side), model=only_left(150))
    assert drawing.left_out_area == pytest.approx(side**2, rel=0.1)
    assert drawing.is_half == is_half
    assert any("of seen floor around" in doubt for doubt in drawing.doubts)
    assert any("less than half" in doubt for doubt in drawing.doubts) == is_half


def test_strips_are_not_left_out_without_a_word():
    grid = room_and_yard(5.0)
    rows, cols = np.indices(grid.cells.shape)
    grid.cells[(cols >= 200) & (rows // 8 % 2 == 0)] = UNKNOWN  # strips of 0.4 m stay
    drawing = make_drawing(grid, model=only_left(150))
    assert drawing.left_out == ()
    assert any("in strips and small patches" in doubt for doubt in drawing.doubts)


@pytest.mark.parametrize(("side", "code"), [(5.0, 0), (12.0, 1)])
def test_the_command_says_it_too(side, code, tmp_path, capsys, monkeypatch):
    path = write_ros_map(tmp_path / "yard", room_and_yard(side))
    monkeypatch.setattr("slamgym.drawing.load_floor_model", lambda _: only_left(150))
    words = ["cad", str(path), "-o", str(tmp_path / "out"), "--formats", "json", "--model", "none"]
    assert main(words) == code
    assert f"left out {round(side**2 / 10)}" in capsys.readouterr().out
