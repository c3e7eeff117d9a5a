"""Faces are moved by fractions of a cell, and no wall is lost by it."""

import cv2
import numpy as np
import pytest

from slamgym.gan.translation.finishing import CLOSED, moved_faces
from slamgym.metrics import measure_dimensions
from slamgym.metrics.dimensions import floor_runs


def two_rooms(wall_px=4):
    free = np.zeros((60, 100), np.float32)
    free[10:50, 10:48] = 1.0
    free[10:50, 48 + wall_px : 90] = 1.0
    return free


@pytest.mark.parametrize("shift", [0.25, 0.5, 0.8, 1.0, 1.3])
def test_rooms_grow_by_the_shift_on_every_side(shift):
    free = two_rooms()
    found = measure_dimensions(moved_faces(free, shift), free, 0.05)
    assert found.room_width == pytest.approx([2 * shift * 0.05] * len(found.room_width), abs=0.005)
    assert found.wall_thickness == pytest.approx([-2 * shift * 0.05], abs=0.005)


@pytest.mark.parametrize("wall_px", [1, 2, 3])
def test_a_thin_wall_stays_joined_to_the_walls_that_it_meets(wall_px):
    assert len(np.unique(_parts(moved_faces(two_rooms(wall_px), 1.05) >= 0.5))) == 3


@pytest.mark.parametrize("wall_px", [1, 2])
def test_a_wall_of_which_nothing_would_be_left_keeps_its_middle(wall_px):
    moved = moved_faces(two_rooms(wall_px), 1.3)
    for row in moved[12:48]:
        assert len(floor_runs(row)) == 2
        assert row[48 : 48 + wall_px].min() == pytest.approx(CLOSED)


def test_an_oblique_thin_wall_stays_closed():
    free = np.zeros((60, 60), np.float32)
    free[5:55, 5:55] = 1.0
    for step in range(5, 55):
        free[step, max(5, step // 2 + 10) : step // 2 + 12] = 0.0
    labels = np.unique(_parts(moved_faces(free, 1.05) >= 0.5))
    assert len(labels) == 3  # outside, and a room on either side


def test_a_shift_of_nothing_changes_nothing():
    free = two_rooms()
    assert moved_faces(free, 0.0) is free


def _parts(mask):
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1]
