"""Signs of boundaries turn with the map, and say what lies on both sides of a line."""

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, painted

from slamgym.core.types import FREE, GridFrame, OccupancyGrid
from slamgym.drawing import load_floor_model
from slamgym.drawing.boundaries import BoundaryModels
from slamgym.drawing.candidates import Candidates
from slamgym.drawing.flood import BESIDE_LINE, HALF_LINE, REACHES, limited_flood
from slamgym.drawing.signs import Surroundings, boundary_signs
from slamgym.metrics.maps import distance_to

CELL = 0.05
DOOR = [[4.05, 1.3], [4.05, 2.2]]
"""The line across the door of the flat."""
ACROSS_ROOM = [[5.7, 0.0], [5.7, 3.0]]
LINES = np.array([DOOR, ACROSS_ROOM, [[4.0, 3.0], [2.5, 3.0]], [[0.0, 2.6], [4.0, 2.6]]])
"""Across its door, across its rooms, and along a wall."""


def surroundings(grid, angle_deg=0.0):
    return Surroundings.of(grid, grid.cells == FREE, angle_deg)


def table(lines, around):
    signs = boundary_signs(np.asarray(lines), around)
    return np.column_stack(list(signs.values()))


@pytest.fixture(scope="module")
def flat():
    return painted(FLAT)[0]


def test_signs_are_those_of_the_map_turned_by_a_quarter(flat):
    frame = flat.frame
    turned = OccupancyGrid(
        np.ascontiguousarray(np.rot90(flat.cells)),
        # x, y becomes -y, x
        GridFrame(CELL, -frame.bounds[3], frame.origin_x, frame.width_px, frame.height_px),
    )
    lines = np.stack([-LINES[..., 1], LINES[..., 0]], axis=-1)
    found = table(lines, surroundings(turned))
    assert found == pytest.approx(table(LINES, surroundings(flat)), abs=1e-6)


def test_signs_are_those_of_the_map_in_a_mirror(flat):
    frame = flat.frame
    mirrored = OccupancyGrid(
        np.ascontiguousarray(flat.cells[:, ::-1]), frame._replace(origin_x=-frame.bounds[2])
    )
    found = table(LINES * (-1.0, 1.0), surroundings(mirrored))
    assert found == pytest.approx(table(LINES, surroundings(flat)), abs=1e-6)


def test_signs_stay_when_the_ends_of_lines_are_exchanged(flat):
    around = surroundings(flat)
    assert table(LINES[:, ::-1], around) == pytest.approx(table(LINES, around), abs=1e-6)


def flooded(floor, line):
    """The flood from one line across a floor."""
    grid, _, _ = painted(floor)
    free = grid.cells == FREE
    flood = limited_flood(np.array([line]), free, distance_to(~free) * CELL, grid.frame)
    assert flood.area.shape == (1, 2, len(REACHES))
    return flood


def test_a_cut_across_a_dead_end_isolates_its_area():
    corridor = shapely.box(0, 0, 12, 1.2)
    flood = flooded(corridor, [[10.5, 0.0], [10.5, 1.2]])
    assert (flood.shared == 0.0).all()
    dead_end, rest = flood.area[0][np.argsort(flood.area[0, :, -1])]
    # Half a cell along the cut, and a row of cells that the grid may add or take at each wall.
    assert dead_end == pytest.approx(1.5 * 1.2, rel=0.1)
    assert rest == pytest.approx(1.2 * np.array(REACHES), rel=0.1)


def test_what_another_way_joins_is_shared():
    halls = shapely.box(0, 0, 4, 3).difference(shapely.box(1.9, 1.0, 2.1, 2.0))
    beside_pillar = flooded(halls, [[2.0, 2.0], [2.0, 3.0]])
    assert beside_pillar.shared[0, -1] > 0.8 * beside_pillar.area[0, :, -1].min()
    door = flooded(FLAT, DOOR)
    assert (door.shared == 0.0).all()


def test_the_flood_goes_no_farther_than_its_reach():
    hall = shapely.box(0, 0, 20, 20)
    flood = flooded(hall.union(shapely.box(20, 9.5, 22, 10.5)), [[20.0, 9.5], [20.0, 10.5]])
    for number, reach in enumerate(np.array(REACHES) + (HALF_LINE + BESIDE_LINE) * CELL):
        # A half disc, and a strip as wide as the line; octagons are larger than circles by some percent.
        expected = 0.5 * np.pi * reach**2 + 1.0 * reach
        assert flood.area[0, :, number].max() == pytest.approx(expected, rel=0.1)


def test_widest_is_the_largest_clearance_that_was_reached():
    flood = flooded(FLAT, DOOR)
    assert flood.widest[0, :, -1].max() == pytest.approx(2.0, abs=0.5)
    assert (np.diff(flood.widest[0], axis=1) >= 0.0).all()


def test_the_watershed_parts_at_a_door_and_not_in_a_room(flat):
    signs = boundary_signs(np.array([DOOR, ACROSS_ROOM]), surroundings(flat))
    names = [name for name in signs if name.startswith("watershed")]
    assert names
    for name in names:
        assert signs[name].tolist() == [1.0, 0.0]


def test_walls_go_on_behind_a_door_and_not_behind_a_line_across_a_room(flat):
    signs = boundary_signs(np.array([DOOR, ACROSS_ROOM]), surroundings(flat))
    door, across = signs["wall from 0.3 to 0.8 m, less"]
    assert door > 0.8
    assert across < 0.5


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_a_line_along_the_main_walls_is_not_oblique(flat, turn):
    signs = boundary_signs(np.array([DOOR, [[1.0, 1.0], [2.0, 2.0]]]), surroundings(flat, turn))
    assert signs["oblique"] == pytest.approx([0.0, 1.0])


def test_finer_cells_have_nearly_the_same_signs():
    coarse, fine = (
        table([DOOR], surroundings(painted(FLAT, resolution)[0])) for resolution in (0.05, 0.025)
    )
    # Areas and clearances differ by the cells at walls; shares by a place or two of a dozen.
    assert np.abs(coarse - fine).max() < 0.35


@pytest.mark.parametrize("with_doors", [False, True])
def test_every_weight_is_that_of_a_sign(with_doors):
    grid, _, model = painted(FLAT)
    candidates = Candidates.of(grid, model if with_doors else load_floor_model("none"), 0.0)
    models = BoundaryModels.pretrained()
    chosen = models.with_doors if with_doors else models.without_doors
    assert set(chosen.weights) == set(candidates.signs)
    odds = candidates.log_odds(models)
    assert odds.shape == (len(candidates.lines),)
    assert candidates.lines[np.argmax(odds)].mean(axis=0) == pytest.approx([4.05, 1.75], abs=0.1)


def test_a_floor_without_corners_has_no_candidates():
    grid, _, model = painted(shapely.box(0, 0, 4, 3))
    candidates = Candidates.of(grid, model, 0.0)
    assert len(candidates.log_odds(BoundaryModels.pretrained())) == 0
    assert len(candidates.division(np.zeros(0)).rooms) == 1
