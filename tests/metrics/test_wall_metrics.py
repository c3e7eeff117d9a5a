"""Wall metrics and rooms on drawings whose answers are known."""

import numpy as np
import pytest

from slamgym.metrics import (
    boundary_distance,
    boundary_score,
    free_boundary,
    intersection_over_union,
    label_rooms,
    room_score,
)  # fmt: skip

METRES_PER_PX = 0.05


def flat(doorway_px: int = 18, wall: bool = True):
    """Two rooms of 2.5 m x 3 m side by side, and a doorway (18 px: 0.9 m) in the wall between them."""
    free = np.zeros((80, 130), bool)
    free[10:70, 10:120] = True
    if wall:
        free[10:70, 63:66] = False
        free[30 : 30 + doorway_px, 63:66] = True
    return free


class TestWallScore:
    def test_a_map_agrees_with_itself(self):
        score = boundary_score(flat(), flat(), METRES_PER_PX)
        distance = boundary_distance(flat(), flat(), METRES_PER_PX)
        assert (score.f1, distance) == (1.0, 0.0)
        assert intersection_over_union(flat(), flat()) == 1.0

    @pytest.mark.parametrize(("shift_px", "found"), [(1, True), (2, True), (3, False)])
    def test_the_tolerance_is_in_metres(self, shift_px, found):
        box = flat(wall=False)
        shifted = np.roll(box, (shift_px, shift_px), axis=(0, 1))
        f1 = boundary_score(shifted, box, METRES_PER_PX, tolerance=0.1).f1
        # Where the outlines cross each other they agree at any shift.
        assert (f1 > 0.99) if found else (f1 < 0.1)

    def test_a_tolerance_below_a_pixel_is_one_pixel(self):
        box = flat(wall=False)
        assert (
            boundary_score(np.roll(box, 1, axis=0), box, METRES_PER_PX, tolerance=0.001).f1 == 1.0
        )

    def test_an_erased_inner_wall_costs_recall_but_hardly_any_area(self):
        score = boundary_score(flat(wall=False), flat(), METRES_PER_PX)
        inner = 2 * (60 - 18) / free_boundary(flat()).sum()
        assert score.precision == 1.0
        assert score.recall == pytest.approx(
            1.0 - inner, abs=0.03
        )  # ends of the wall touch the outline
        assert intersection_over_union(flat(wall=False), flat()) > 0.98

    def test_distances_of_a_shifted_wall(self):
        line = np.zeros((50, 50), bool)
        line[20, 5:45] = True
        distance = boundary_distance(np.roll(line, 4, axis=0), line, METRES_PER_PX)
        assert distance == pytest.approx(0.2)

    def test_hausdorff_sees_what_is_missing_and_what_is_extra_alike(self):
        with_wall, without = flat(doorway_px=0), flat(wall=False)
        one = boundary_distance(with_wall, without, METRES_PER_PX)
        other = boundary_distance(without, with_wall, METRES_PER_PX)
        assert one == other
        assert one > 0.5

    def test_empty_maps(self):
        none = np.zeros((20, 20), bool)
        assert boundary_score(none, none, METRES_PER_PX).f1 == 1.0
        assert boundary_distance(none, none, METRES_PER_PX) == 0.0
        assert boundary_distance(none, ~none, METRES_PER_PX) == float("inf")
        assert intersection_over_union(none, none) == 1.0
        assert intersection_over_union(none, ~none) == 0.0

    @pytest.mark.parametrize("compare", [boundary_distance, room_score])
    def test_shapes_must_agree(self, compare):
        with pytest.raises(ValueError, match="different shapes"):
            compare(np.zeros((2, 2), bool), np.zeros((2, 3), bool), METRES_PER_PX)


class TestRooms:
    def test_a_doorway_separates_two_rooms(self):
        labels = label_rooms(flat(), METRES_PER_PX)
        assert labels.max() == 2
        assert labels[40, 30] != labels[40, 100]
        assert np.count_nonzero(labels) == np.count_nonzero(flat())

    def test_a_wide_opening_and_an_erased_wall_make_one_room(self):
        assert label_rooms(flat(doorway_px=40), METRES_PER_PX).max() == 1
        assert label_rooms(flat(wall=False), METRES_PER_PX).max() == 1

    def test_rooms_do_not_depend_on_the_scale_of_the_image(self):
        large = np.repeat(np.repeat(flat(), 2, axis=0), 2, axis=1)
        assert label_rooms(large, METRES_PER_PX / 2).max() == 2

    def test_specks_and_slits_are_no_rooms(self):
        free = flat()
        free[2:5, 2:5] = True  # 0.15 m
        free[73:76, 10:120] = True  # a slit of 0.15 m, 5.5 m long
        assert label_rooms(free, METRES_PER_PX).max() == 2

    def test_furniture_in_a_room_does_not_split_it(self):
        free = flat()
        free[25:33, 25:33] = False
        assert label_rooms(free, METRES_PER_PX).max() == 2

    def test_score_counts_rooms_and_their_places(self):
        same = room_score(flat(), flat(), METRES_PER_PX)
        assert (same.count, same.f1) == (same.true_count, 1.0)
        erased = room_score(flat(wall=False), flat(), METRES_PER_PX)
        assert erased.count == erased.true_count - 1
        # The one large room covers half of itself with each of the two: no counterpart above one half.
        assert erased.f1 < 1.0

    def test_nothing_free_has_no_rooms(self):
        none = np.zeros((30, 30), bool)
        assert label_rooms(none, METRES_PER_PX).max() == 0
        assert room_score(none, none, METRES_PER_PX).f1 == 1.0
        assert room_score(none, flat()[:30, :30], METRES_PER_PX).f1 == 0.0
