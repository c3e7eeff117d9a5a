"""The map decides what is joined and what is parted, the model what the floor is."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing.floor import floor_of_rooms, seen_space

CELL = 0.05


def drawn(free, rooms, echoes=None):
    """The cells that are floor by a model, where all rooms were seen."""
    echoes = np.zeros(rooms.shape, np.bool_) if echoes is None else echoes
    return floor_of_rooms(free.astype(np.float32), rooms > 0, echoes, rooms, CELL) >= 0.5


def hall():
    """4 x 3 m of free cells, one of echoes around them."""
    cells = np.full((80, 100), UNKNOWN, np.uint8)
    cells[9:71, 9:91] = OCCUPIED
    cells[10:70, 10:90] = FREE
    return cells


def walls_of_hall():
    """Where the echoes around the hall are."""
    return np.asarray(hall() == OCCUPIED)


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
    """Rooms left and right of a wall of 20 cm."""
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:48], rooms[10:70, 52:90] = 1, 2
    return rooms


def test_rooms_that_the_map_parts_stay_parted_whatever_the_model_says():
    rooms = parted_hall()
    floor = drawn(np.ones(rooms.shape), rooms, echoes=walls_of_hall())
    assert floor[12:68, 12:46].all()
    assert floor[12:68, 54:88].all()
    assert (~floor[12:68, 46:54]).any(axis=1).all()  # slits of 20 cm are wall


def test_rooms_meet_in_a_door_only():
    rooms = parted_hall()
    rooms[30:48, 48:50], rooms[30:48, 50:52] = 1, 2
    floor = drawn(np.ones(rooms.shape), rooms, echoes=walls_of_hall())
    assert floor[32:46, 44:56].all()
    assert (~floor[12:26, 44:56]).any(axis=1).all()


def test_a_thin_thing_in_one_room_is_no_wall_if_the_model_says_so():
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    rooms[30:50, 48:51] = 0
    assert drawn(np.ones(rooms.shape), rooms)[32:48, 49].all()


@pytest.mark.parametrize(("free", "is_drawn"), [(0.4, False), (0.7, True)])
def test_what_nobody_saw_at_the_edge_of_a_room_is_floor_if_the_model_says_so(free, is_drawn):
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    rooms[40:70, 40:60] = 0  # a wardrobe
    model = np.zeros(rooms.shape)
    model[10:70, 10:90] = 1.0
    model[40:70, 40:60] = free
    floor = drawn(model, rooms)
    assert floor[46:66, 46:54].all() == is_drawn
    assert floor[46:66, 46:54].any() == is_drawn


def test_what_nobody_saw_in_the_middle_of_a_room_is_floor_if_the_model_says_so():
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    rooms[30:50, 40:60] = 0
    assert drawn(0.6 * np.ones(rooms.shape), rooms)[30:50, 40:60].all()


@pytest.mark.parametrize("has_walls", [True, False])
def test_what_the_model_rejects_stays_if_walls_close_it_in(has_walls):
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    model = np.zeros(rooms.shape)
    model[10:70, 10:50] = 1.0
    echoes = np.zeros(rooms.shape, np.bool_)
    if has_walls:
        echoes[9:71, 9:91] = rooms[9:71, 9:91] == 0
    floor = drawn(model, rooms, echoes=echoes)
    assert floor[12:68, 12:48].all()
    assert floor[12:68, 55:88].all() == has_walls
    assert floor[12:68, 55:88].any() == has_walls


def test_floor_that_nobody_saw_between_two_rooms_is_not_drawn():
    rooms = parted_hall()
    rooms[:, 36:64] = 0
    assert not drawn(np.ones(rooms.shape), rooms)[12:68, 42:58].any()


@pytest.mark.parametrize(("walls", "is_drawn"), [(slice(10, 70), True), (slice(10, 20), False)])
def test_a_room_of_which_less_than_half_has_walls_was_seen_through_glass(walls, is_drawn):
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:60], rooms[30:50, 60:90] = 1, 2
    echoes = np.zeros(rooms.shape, np.bool_)
    echoes[walls, 60:90] = rooms[walls, 60:90] == 0
    floor = drawn(np.ones(rooms.shape), rooms, echoes=echoes)
    assert floor[12:68, 12:58].all()
    assert floor[32:48, 64:88].all() == is_drawn
    assert floor[32:48, 64:88].any() == is_drawn


def test_the_largest_room_is_drawn_without_any_walls():
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:90] = 1
    assert drawn(np.ones(rooms.shape), rooms, echoes=rooms < 0)[12:68, 12:88].all()


def test_a_wardrobe_at_a_thin_wall_to_another_room_is_floor():
    rooms = np.zeros((80, 100), np.int64)
    rooms[10:70, 10:48], rooms[10:70, 50:90] = 1, 2
    model = (rooms > 0).astype(np.float64)
    rooms[30:50, 34:48] = 0
    floor = drawn(model, rooms, echoes=walls_of_hall())
    assert floor[32:48, 36:46].all()
    assert not floor[12:68, 48:50].any()
