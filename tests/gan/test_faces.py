"""Lines along faces are drawn as deep as asked, by fractions of a cell."""

import numpy as np
import pytest

from slamgym.gan.translation.finishing import shrunk_floor
from slamgym.metrics import measure_dimensions


def two_rooms(wall_px=4):
    free = np.zeros((60, 100), np.float32)
    free[10:50, 10:48] = 1.0
    free[10:50, 48 + wall_px : 90] = 1.0
    return free


@pytest.mark.parametrize("depth", [0.25, 0.5, 0.8, 1.0, 1.5])
def test_rooms_shrink_by_the_depth_on_every_side(depth):
    free = two_rooms()
    found = measure_dimensions(shrunk_floor(free, depth), free, 0.05)
    assert found.room_width == pytest.approx([-2 * depth * 0.05] * len(found.room_width), abs=0.005)
    assert found.wall_thickness == pytest.approx([2 * depth * 0.05], abs=0.005)


def test_a_line_of_no_depth_changes_nothing():
    free = two_rooms()
    assert shrunk_floor(free, 0.0) is free
