import cv2
import numpy as np
import pytest

from slamgym.core.types import GridFrame
from slamgym.metrics.maps import distance_to
from slamgym.viz.contact_sheet import (
    ERROR_SCALE,
    SheetEntry,
    draw_contact_sheet,
    draw_overlay,
    error_colour,
)


def entry(slam_shift_px=0):
    """A room of 5 x 4 m whose SLAM map has its right wall moved by some cells."""
    cad = np.zeros((120, 140), np.uint8)
    cad[20:100, 20:120] = 254
    slam = np.full_like(cad, 205)
    slam[20:100, 20 : 120 + slam_shift_px] = 254
    slam[20:100, 120 + slam_shift_px] = 0
    path = np.array([[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]])
    return SheetEntry("room", "details", cad, slam, GridFrame(0.05, 0.0, 0.0, 120, 140), path)


def test_distance_is_zero_on_the_cells_and_euclidean_elsewhere():
    cells = np.zeros((9, 9), bool)
    cells[4, 4] = True
    distance = distance_to(cells)
    assert distance[4, 4] == 0
    assert distance[0, 1] == pytest.approx(5.0, abs=1e-5)


def test_error_colours_go_from_green_to_red_and_stop_there():
    right, wrong, far = error_colour(np.array([0.0, ERROR_SCALE, 10.0]))
    assert right[1] > right[0]
    assert wrong[0] > wrong[1]
    assert (wrong == far).all()


def test_a_wall_in_its_place_is_green_and_a_moved_one_red():
    column = 2 * 120 + 1
    good = draw_overlay(entry(0))[120, column]
    bad = draw_overlay(entry(8))[120, column + 16]
    assert (good == error_colour(np.zeros(1))[0]).all()
    assert (bad == error_colour(np.full(1, 8 * 0.05))[0]).all()


def test_a_sheet_holds_every_entry():
    one, five = draw_contact_sheet("one", [entry()]), draw_contact_sheet("five", [entry()] * 5)
    assert one.dtype == np.uint8
    assert one.ndim == 3
    assert five.shape[1] > one.shape[1]  # two cards beside each other
    card = cv2.countNonZero(255 - one.min(axis=2))
    assert cv2.countNonZero(255 - five.min(axis=2)) > 4.5 * card
