"""The map decides what is joined and what is parted, the model what the floor is."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing.floor import floor_of_rooms, seen_space
from slamgym.metrics.layers import MapLayers

CELL = 0.05


def everywhere(shape, free=1.0):
    """A model that says the same of each cell."""
    full = np.full(shape, free, np.float32)
    nothing = np.zeros(shape, np.float32)
    return MapLayers(full, 1.0 - full, nothing, nothing)


def hall():
    """4 x 3 m of free cells, one of echoes around them."""
    cells = np.full((80, 100), UNKNOWN, np.uint8)
    cells[9:71, 9:91] = OCCUPIED
    cells[10:70, 10:90] = FREE
    return cells


def seen(cells):
    return seen_space(OccupancyGrid(cells, GridFrame(CELL, 0.0, 0.0, *cells.shape)))


def test_a_row_of_echoes_with_gaps_of_one_cell_stays_a_wall():
    cells = hall()
    cells[10:70:2, 50] = OCCUPIED
    space = seen(cells)
    assert not space[11:69, 50].any()
    assert space[20:60, 20:45].all()


def test_what_stands_alone_is_no_space():
    cells = hall()
    cells[40:60, 60:80] = OCCUPIED
    assert not seen(cells)[40:60, 60:80].any()


def test_a_ray_that_left_through_a_window_goes():
    cells = hall()
    cells[40:42, 90:] = FREE
    space = seen(cells)
    assert not space[:, 92:].any()
    assert space[20:60, 20:80].all()


def parted_hall():
    """Rooms left and right of a wall of 20 cm, and the free space."""
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:48], rooms[10:70, 52:90] = 1, 2
    return rooms, rooms > 0


def test_rooms_that_the_map_parts_stay_parted_whatever_the_model_says():
    rooms, space = parted_hall()
    floor = floor_of_rooms(everywhere(rooms.shape), space, rooms, np.zeros_like(space), CELL) >= 0.5
    assert floor[12:68, 12:46].all()
    assert floor[12:68, 54:88].all()
    assert (~floor[10:70, 46:54]).any(axis=1).all()


def test_rooms_meet_in_a_door_only():
    rooms, space = parted_hall()
    rooms[30:48, 48:50], rooms[30:48, 50:52] = 1, 2
    doors = np.zeros_like(space)
    doors[30:48, 46:54] = True
    space = rooms > 0
    for door, opened in ((doors, True), (np.zeros_like(doors), False)):
        floor = floor_of_rooms(everywhere(rooms.shape), space, rooms, door, CELL) >= 0.5
        assert floor[32:46, 44:56].all() == opened
        assert (~floor[10:26, 44:56]).any(axis=1).all()


@pytest.mark.parametrize(("free", "drawn"), [(0.7, False), (0.95, True)])
def test_what_nobody_saw_in_a_room_takes_a_sure_model(free, drawn):
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    rooms[40:70, 40:60] = 0  # a wardrobe
    layers = everywhere(rooms.shape, 0.0)
    layers.floor[10:70, 10:90] = 1.0
    layers.floor[40:70, 40:60] = free
    floor = floor_of_rooms(layers, rooms > 0, rooms, np.zeros(rooms.shape, np.bool_), CELL) >= 0.5
    assert floor[46:66, 46:54].all() == drawn
    assert floor[46:66, 46:54].any() == drawn


def test_floor_that_nobody_saw_between_two_rooms_is_not_drawn():
    rooms, space = parted_hall()
    rooms[:, 36:64] = 0
    floor = floor_of_rooms(everywhere(rooms.shape), rooms > 0, rooms, np.zeros_like(space), CELL) >= 0.5
    assert not floor[12:68, 42:58].any()
