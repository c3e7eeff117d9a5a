"""Corners and angles of drawn rooms."""

import importlib.util
import sys

from shapely import affinity, box
from shapely.geometry import Polygon
from source_tree import ROOT

SPEC = importlib.util.spec_from_file_location(
    "corners", ROOT / "benchmarks" / "drawing" / "corners.py"
)
corners = importlib.util.module_from_spec(SPEC)
sys.modules["corners"] = corners
SPEC.loader.exec_module(corners)
CORNER_WITHIN, CornerCounts = corners.CORNER_WITHIN, corners.CornerCounts
count_corners = corners.count_corners

ROOM = box(0.0, 0.0, 10.0, 6.0)
L_SHAPE = Polygon([(0, 0), (10, 0), (10, 6), (4, 6), (4, 3), (0, 3)])
STRAIGHT = 0.03


def test_a_drawing_like_the_truth_has_all_corners_and_angles():
    assert count_corners([L_SHAPE], [L_SHAPE], STRAIGHT) == CornerCounts(6, 6, 6, 6)
    mirrored = affinity.scale(L_SHAPE, xfact=-1.0)
    assert count_corners([mirrored], [mirrored], STRAIGHT) == CornerCounts(6, 6, 6, 6)


def test_corners_are_right_up_to_ten_pixels_of_a_building_that_fills_256():
    within = CORNER_WITHIN * 10.0
    moved = affinity.translate(ROOM, 0.99 * within)
    assert count_corners([moved], [ROOM], STRAIGHT).right == 4
    moved = affinity.translate(ROOM, 1.01 * within)
    assert count_corners([moved], [ROOM], STRAIGHT).right == 0


def test_an_angle_is_wrong_from_five_degrees_on():
    leaning = Polygon([(0, 0), (10, 0), (10, 6), (0.35, 6)])  # 3.3 degrees
    assert count_corners([leaning], [ROOM], STRAIGHT).right_angle == 4
    leaning = Polygon([(0, 0), (3, 0), (3, 1), (0.1, 1)])  # 5.7 degrees at two corners
    assert count_corners([leaning], [box(0, 0, 3, 1)], STRAIGHT) == CornerCounts(4, 4, 4, 2)


def test_corners_of_a_room_that_stands_for_none_are_wrong_and_those_of_one_that_is_missing_lack():
    drawn = [ROOM, box(11.0, 0.0, 12.0, 1.0)]
    true = [ROOM, box(0.0, 7.0, 2.0, 9.0), box(3.0, 7.0, 5.0, 9.0)]
    counts = count_corners(drawn, true, STRAIGHT)
    assert counts == CornerCounts(8, 12, 4, 4)
    figures = counts.figures()
    assert [figures[f"corner {name}"] for name in ("precision", "recall", "F1")] == [
        0.5,
        0.333,
        0.4,
    ]
    assert count_corners([], [ROOM], STRAIGHT) == CornerCounts(0, 4, 0, 0)


def test_a_corner_is_matched_once_and_points_on_a_straight_side_are_none():
    double = Polygon([(5, 0), (10, 0), (10, 5.9), (9.9, 6), (0, 6), (0, 0)])
    counts = count_corners([double], [ROOM], STRAIGHT)
    assert counts.drawn == 5
    assert counts.right == 4
    assert CornerCounts(1, 2, 3, 4) + CornerCounts(1, 1, 1, 1) == CornerCounts(2, 3, 4, 5)
