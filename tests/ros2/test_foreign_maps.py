"""Maps of other mappers on our lattice."""

import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, Pose2D
from slamgym.ros2.foreign_maps import LATTICE_CELL, ForeignMap, classify_values

HERE = Pose2D(-1.0, 2.0, 0.0)


def take(values, resolution=LATTICE_CELL, origin=HERE):
    height, width = values.shape
    return ForeignMap("/map").take(values.reshape(-1), width, height, resolution, origin)


def value_at(grid, x, y):
    row, col = grid.frame.to_cell(x, y)
    return int(grid.cells[row, col])


def walls(resolution, origin=HERE, door=0.8):
    """A wall of one cell along x = 1 m with a door about y = 3.5 m, in free space of 4.5 x 4.5 m from the origin on."""
    count = round(4.5 / resolution)
    y = origin.y + (np.arange(count) + 0.5) * resolution
    values = np.zeros((count, count), np.int8)
    col = int((1.0 - origin.x) / resolution)
    values[np.abs(y - 3.5) > 0.5 * door, col] = 100
    return values


def test_a_map_on_our_lattice_stays_as_it_is():
    values = np.array([[0, 100, -1], [-1, 0, 100]], np.int8)
    grid = take(values)
    assert value_at(grid, -0.975, 2.025) == FREE
    assert value_at(grid, -0.925, 2.025) == OCCUPIED
    assert value_at(grid, -0.925, 2.075) == FREE
    assert value_at(grid, -0.875, 2.075) == OCCUPIED
    assert np.count_nonzero(grid.cells != UNKNOWN) == 4
    assert not grid.cells.flags.writeable


@settings(max_examples=60, deadline=None)
@given(
    resolution=st.sampled_from([0.02, 0.025, 0.03, 0.04, 0.05, 0.0500000007, 0.06, 0.075, 0.1]),
    x=st.floats(-2.0, -1.0),
    y=st.floats(1.0, 2.0),
)
def test_any_lattice_keeps_walls_closed_and_doors_open(resolution, x, y):
    origin = Pose2D(x, y, 0.0)
    grid = take(walls(resolution, origin), resolution, origin)
    for value in np.array(grid.frame[1:3]) / LATTICE_CELL:
        assert value == pytest.approx(round(value), abs=1e-6)
    # Along the wall at least one cell of every row is occupied but in the door, which stays open by two cells less.
    low, high = grid.frame.to_cell(1.0, 3.0)[0], grid.frame.to_cell(1.0, 2.1)[0]
    is_wall = (grid.cells == OCCUPIED).any(axis=1)
    assert is_wall[low:high].all()
    open_rows = np.count_nonzero(~is_wall[grid.frame.to_cell(1.0, 4.2)[0] : low])
    assert open_rows * LATTICE_CELL >= 0.8 - 2.0 * max(LATTICE_CELL, resolution) - 1e-9
    assert open_rows * LATTICE_CELL <= 0.8 + 2.0 * max(LATTICE_CELL, resolution) + 1e-9


def test_doors_of_fine_maps_close_by_less_than_a_cell_on_average():
    closed = []
    for shift in np.linspace(0.0, 0.05, 23):
        origin = Pose2D(-1.0, 2.0 + shift, 0.0)
        grid = take(walls(0.02, origin), 0.02, origin)
        rows = slice(grid.frame.to_cell(1.0, 4.2)[0], grid.frame.to_cell(1.0, 2.8)[0])
        closed.append(
            0.8 - LATTICE_CELL * np.count_nonzero(~(grid.cells[rows] == OCCUPIED).any(axis=1))
        )
    assert np.mean(closed) < LATTICE_CELL  # half a cell at each side


def test_occupied_wins_over_free_and_free_over_unknown():
    values = np.full((5, 5), -1, np.int8)
    values[0, 0] = 0
    assert value_at(take(values, 0.01), -0.975, 2.025) == FREE
    values[4, 4] = 100
    assert value_at(take(values, 0.01), -0.975, 2.025) == OCCUPIED


def test_what_ends_at_the_border_of_the_map_meets_the_unknown():
    grid = take(np.zeros((10, 10), np.int8))
    left, bottom, right, top = grid.frame.bounds
    assert (left, bottom) <= (-1.5, 1.5)
    assert (right, top) >= (0.0, 3.0)
    assert np.count_nonzero(grid.cells == FREE) == 100


def test_probabilities_about_a_half_are_unknown():
    values = np.array([[-1, 0, 30, 44, 45, 50, 55, 56, 90, 100, 101, -128]], np.int16).astype(
        np.int8
    )
    assert classify_values(values).tolist() == [[0, 1, 1, 1, 0, 0, 0, 2, 2, 2, 0, 0]]


def test_only_lethal_cells_of_a_costmap_are_walls():
    values = np.array([[-1, 99, 99, 100, 99, 99, 70, 40, 0, -1]] * 2, np.int8)
    # Behind the wall the seam lies on what nobody has seen.
    assert classify_values(values).tolist() == [[0, 0, 0, 2, 1, 1, 1, 1, 1, 0]] * 2
    # Without the seam that the body makes, the same values are probabilities.
    values[:, 4] = 20
    assert classify_values(values).tolist() == [[0, 2, 2, 2, 1, 2, 2, 1, 1, 0]] * 2


def test_a_map_may_grow_and_move_and_its_places_stay():
    maps = ForeignMap("/map")
    small = maps.take(np.zeros(100, np.int8), 10, 10, LATTICE_CELL, HERE)
    large = maps.take(np.full(400, 100, np.int8), 20, 20, LATTICE_CELL, Pose2D(-1.25, 1.9, 0.0))
    for grid, value in ((small, FREE), (large, OCCUPIED)):
        assert value_at(grid, -0.975, 2.025) == value


def test_updates_patch_the_last_map():
    maps = ForeignMap("/map")
    assert maps.patch([100], 0, 0, 1, 1) is None
    first = maps.take(array.array("b", [0] * 12), 4, 3, LATTICE_CELL, HERE)
    second = maps.patch(array.array("b", [100, -1]), 2, 1, 2, 1)
    assert value_at(first, -0.875, 2.075) == FREE
    assert value_at(second, -0.875, 2.075) == OCCUPIED
    assert value_at(second, -0.825, 2.075) == UNKNOWN
    with pytest.raises(
        InputFileError, match=r"/map: is 4 x 3 cells, but its update is of 2 x 1 from \(3, 1\) on"
    ):
        maps.patch([0, 0], 3, 1, 2, 1)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"width": 0}, "has no cells"),
        ({"width": 3}, "has 4 values where 3 x 2 cells need 6"),
        ({"resolution": float("nan")}, "has cells of nan m"),
        ({"resolution": 0.0}, "has cells of 0.0 m"),
        ({"origin": Pose2D(float("inf"), 0.0, 0.0)}, "an origin within"),
        ({"origin": Pose2D(0.0, 0.0, 0.2)}, "is turned by 0.2 rad"),
        ({"resolution": 1e4}, "cells of 10000 m, and a robot needs 1 m at most"),
        ({"resolution": 700.0, "width": 1, "height": 1}, "cells of 700 m"),
        ({"width": 1 << 20, "height": 1 << 20}, "more than 25 million cells of 0.05 m"),
        ({"resolution": 0.9, "width": 300, "height": 300}, "is 270 m x 270 m of 0.9 m a cell"),
    ],
)
def test_broken_maps_are_refused_with_one_sentence(changes, sentence):
    whole = {"data": [0] * 4, "width": 2, "height": 2, "resolution": LATTICE_CELL, "origin": HERE}
    with pytest.raises(InputFileError, match=sentence):
        ForeignMap("/map").take(**(whole | changes))
