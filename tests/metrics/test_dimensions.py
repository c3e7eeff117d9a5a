"""Dimensions, doors and walls of drawn plans whose walls were moved by known centimetres."""

import numpy as np
import pytest

from slamgym.metrics import compare_openings, label_rooms, measure_dimensions, unseen_share
from slamgym.metrics.dimensions import floor_area, floor_runs, wall_runs
from slamgym.metrics.openings import find_doors

CELL = 0.05
ROOM_A, ROOM_B = (1.02, 1.03, 4.31, 5.17), (4.43, 1.03, 8.08, 5.17)
"""Left, top, right and bottom [m] of two rooms with a wall of 12 cm between them."""
DOOR = (4.31, 2.51, 4.43, 3.36)
"""0.85 m wide."""


def share(*boxes, walls=(), cell=CELL, size=(6.2, 9.2)):
    """Share of floor of each cell: boxes of floor, then boxes of wall, each (left, top, right, bottom) [m]."""

    def covered(box):
        sides = []
        for low, high, length in ((box[1], box[3], size[0]), (box[0], box[2], size[1])):
            at = np.arange(round(length / cell)) * cell
            sides.append(
                np.clip(np.minimum(at + cell, high) - np.maximum(at, low), 0.0, None) / cell
            )
        return np.outer(*sides)

    floor = np.clip(sum(covered(box) for box in boxes), 0.0, 1.0)
    return np.clip(floor - sum((covered(wall) for wall in walls), np.zeros_like(floor)), 0.0, 1.0)


def grown(box, by):
    return box[0] - by, box[1] - by, box[2] + by, box[3] + by


TRUTH = share(ROOM_A, ROOM_B, DOOR)


class TestLengths:
    def test_a_plan_agrees_with_itself(self):
        found = measure_dimensions(TRUTH, TRUTH, CELL)
        assert len(found.room_width) >= 4
        assert len(found.wall_length) >= 7
        assert len(found.wall_thickness) >= 1
        for errors in (found.room_width, found.wall_length, found.wall_thickness):
            assert np.abs(errors).max() == 0.0
        assert found.area_ratio == 1.0

    @pytest.mark.parametrize("by", [-0.05, -0.02, 0.01, 0.03])
    def test_rooms_that_are_narrower_by_centimetres_come_out_so(self, by):
        drawn = share(grown(ROOM_A, by), grown(ROOM_B, by), DOOR)
        found = measure_dimensions(drawn, TRUTH, CELL)
        assert np.median(found.room_width) == pytest.approx(2 * by, abs=0.01)
        assert np.median(found.wall_thickness) == pytest.approx(-2 * by, abs=0.01)
        assert np.median(found.wall_length) == pytest.approx(2 * by, abs=0.01)
        area = sum((b[2] - b[0]) * (b[3] - b[1]) for b in (grown(ROOM_A, by), grown(ROOM_B, by)))
        assert found.floor_area == pytest.approx(area, abs=0.15)

    def test_a_wall_that_moves_makes_one_room_wider_and_the_other_narrower(self):
        moved = share((*ROOM_A[:2], 4.36, ROOM_A[3]), (4.48, *ROOM_B[1:]), (4.3, 2.51, 4.5, 3.36))
        errors = measure_dimensions(moved, TRUTH, CELL).room_width
        assert np.sort(errors)[[0, -1]] == pytest.approx([-0.05, 0.05], abs=0.01)

    def test_binary_drawings_are_measured_to_whole_cells(self):
        drawn = np.zeros((40, 60), bool)
        drawn[5:35, 5:55] = True
        narrow = np.zeros_like(drawn)
        narrow[6:34, 6:54] = True
        found = measure_dimensions(narrow, drawn, CELL)
        assert found.room_width == pytest.approx([-0.10] * len(found.room_width))
        assert found.floor_area == pytest.approx(28 * 48 * CELL**2)

    def test_a_missing_room_is_an_error_of_its_whole_width(self):
        found = measure_dimensions(share(ROOM_A), share(ROOM_A, ROOM_B), CELL)
        assert found.room_width.min() == pytest.approx(-4.14, abs=0.01)

    def test_faint_shares_far_from_the_floor_are_no_area(self):
        haze = np.maximum(TRUTH, 0.2)
        assert floor_area(haze.astype(np.float32)) - floor_area(TRUTH.astype(np.float32)) < 100.0

    def test_a_wall_within_one_cell_has_the_thickness_of_its_share(self):
        line = np.array([0, 1, 1, 0.4, 1, 1, 0], np.float32)
        assert wall_runs(line)[0].length == pytest.approx(0.6)
        assert [
            run.length for run in floor_runs(np.array([0, 0.25, 1, 1, 0.5, 0], np.float32))
        ] == [2.75]


class TestOpenings:
    def test_a_plan_agrees_with_itself(self):
        found = compare_openings(TRUTH, TRUTH, CELL)
        assert (found.doors, found.doors_kept, found.walls, found.walls_opened) == (1, 1, 1, 0)
        assert np.abs(found.door_width).max() == 0.0

    def test_a_closed_door_is_counted(self):
        found = compare_openings(share(ROOM_A, ROOM_B), TRUTH, CELL)
        assert (found.doors_closed, found.walls_opened, len(found.door_width)) == (1, 0, 0)

    def test_an_invented_door_opens_a_wall(self):
        found = compare_openings(share(ROOM_A, ROOM_B, DOOR, (4.3, 4.2, 4.45, 4.8)), TRUTH, CELL)
        assert (found.doors_kept, found.doors_invented, found.walls_opened) == (1, 1, 1)

    def test_a_wall_that_is_gone_is_opened(self):
        found = compare_openings(share((1.02, 1.03, 8.08, 5.17)), TRUTH, CELL)
        assert found.walls_opened == 1

    @pytest.mark.parametrize("by", [-0.10, -0.04, 0.06])
    def test_the_width_of_a_door_that_is_kept(self, by):
        drawn = share(ROOM_A, ROOM_B, (4.3, 2.51 - by / 2, 4.44, 3.36 + by / 2))
        found = compare_openings(drawn, TRUTH, CELL)
        assert found.door_width == pytest.approx([by], abs=0.01)

    def test_a_wall_that_drifted_by_a_decimetre_is_neither_opened_nor_closes_its_door(self):
        moved = share((*ROOM_A[:2], 4.41, ROOM_A[3]), (4.53, *ROOM_B[1:]), (4.4, 2.55, 4.54, 3.4))
        found = compare_openings(moved, TRUTH, CELL)
        assert (found.doors_kept, found.walls_opened) == (1, 0)

    def test_a_door_stands_in_the_middle_of_its_opening(self):
        floor = TRUTH >= 0.5
        (door,) = find_doors(label_rooms(floor, CELL), floor)
        assert (door.row + 0.5) * CELL == pytest.approx((DOOR[1] + DOOR[3]) / 2.0, abs=1.5 * CELL)
        assert DOOR[0] - 2.0 * CELL < (door.col + 0.5) * CELL < DOOR[2] + 2.0 * CELL


def test_floor_that_was_never_seen():
    floor, seen = np.ones((10, 10), bool), np.zeros((10, 10), bool)
    seen[:, :8] = True
    assert unseen_share(floor, seen) == pytest.approx(0.2)
    assert unseen_share(~floor, seen) == 0.0
