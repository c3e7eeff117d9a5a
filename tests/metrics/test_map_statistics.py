"""Map statistics on pictures whose numbers are known."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.metrics.map_statistics import (
    LOOK_NAMES,
    at_look_cell,
    cut_to_floor,
    free_fragments,
    look_statistics,
    open_border,
    wall_thickness,
    wall_tilt,
)


def room(thickness: int = 1, size: int = 60):
    cells = np.full((size, size), UNKNOWN, dtype=np.uint8)
    cells[10:50, 10:50] = OCCUPIED
    cells[10 + thickness : 50 - thickness, 10 + thickness : 50 - thickness] = FREE
    return cells


def test_shares_and_blobs_of_a_plain_room() -> None:
    statistics = look_statistics(cut_to_floor(room()))
    assert statistics["share_free"] == pytest.approx(38**2 / 42**2)
    assert statistics["share_occupied"] == pytest.approx((40**2 - 38**2) / 42**2)
    assert statistics["blobs_per_100m2"] == pytest.approx(100.0 / (38**2 * 0.05**2))
    assert statistics["specks_per_100m2"] == 0.0
    assert statistics["open_border"] == 0.0
    assert statistics["tilt_deg"] == pytest.approx(0.0, abs=0.1)
    patterns = sum(value for name, value in statistics.items() if name.startswith("pattern_"))
    assert patterns == pytest.approx(1.0)


def test_thicker_walls_count_as_thicker_and_a_line_as_one() -> None:
    thickness = [wall_thickness(room(n) == OCCUPIED) for n in (1, 2, 3, 4, 5)]
    assert thickness[0] == pytest.approx(1.0)
    assert all(np.diff(thickness[1:]) > 0.0)


def test_a_missing_wall_is_an_open_border() -> None:
    cells = room()
    cells[10, 11:49] = UNKNOWN
    assert open_border(cells == FREE, cells == UNKNOWN) == pytest.approx(0.25, abs=0.02)


def test_a_turned_wall_shows_its_tilt() -> None:
    rows, cols = np.indices((200, 200))
    for degrees in (-10.0, 5.0, 20.0):
        slope = np.tan(np.radians(degrees))
        line = np.abs((100 - rows) - slope * (cols - 100)) < 1.0
        assert wall_tilt(line) == pytest.approx(degrees, abs=1.0)


def square_room(side: int = 100, wall: int = 1):
    """A square room in unknown space."""
    cells = np.full((side + 40, side + 40), UNKNOWN, np.uint8)
    cells[20 - wall : 20 + side + wall, 20 - wall : 20 + side + wall] = OCCUPIED
    cells[20 : 20 + side, 20 : 20 + side] = FREE
    return cells


def test_a_plain_room_has_closed_straight_walls_and_nothing_else():
    found = look_statistics(cut_to_floor(square_room()))
    assert set(LOOK_NAMES) <= set(found)
    assert found["free_area_m2"] == pytest.approx(25.0)
    assert found["long_side_m"] == pytest.approx(5.2)
    for name in (
        "open_border",
        "free_fragments_per_100m2",
        "rays_per_100m2",
        "dots_in_unknown_per_100m2",
    ):
        assert found[name] == 0.0
    assert found["specks_in_free_share"] == 0.0
    assert found["wall_coherence"] > 0.9
    assert found["axis_alignment"] > 0.9


def test_a_stray_beam_counts_as_fragment_ray_and_dot():
    cells = square_room()
    cells[10, 45:60] = FREE  # beyond the wall, not connected
    cells[10, 60] = OCCUPIED
    cells[50:52, 50] = OCCUPIED
    cut = cells[8:-8, 8:-8]
    found = look_statistics(cut)
    assert free_fragments(cut == FREE) == 1
    per_100m2 = 100.0 / found["free_area_m2"]
    assert found["free_fragments_per_100m2"] == pytest.approx(per_100m2)
    assert found["rays_per_100m2"] == pytest.approx(per_100m2)
    assert found["dots_in_unknown_per_100m2"] == pytest.approx(per_100m2)
    assert found["specks_in_free_share"] == pytest.approx(2 / (found["free_area_m2"] / 0.05**2))
    assert found["open_border"] > 0.05


def test_a_wall_without_a_row_is_as_open_as_it_is_long():
    cells = square_room()
    cells[19, 20:70] = UNKNOWN
    found = look_statistics(cut_to_floor(cells))
    assert found["open_border"] == pytest.approx(50 / 400)
    assert found["open_run_m"] == pytest.approx(2.5)


@pytest.mark.parametrize("offset", range(5))
def test_thin_walls_stay_closed_at_larger_cells(offset):
    fine = np.full((250, 260), UNKNOWN, np.uint8)
    fine[20 + offset : 220, 20 + offset : 225] = OCCUPIED
    fine[21 + offset : 219, 21 + offset : 224] = FREE
    coarse = at_look_cell(fine, 0.02)
    assert coarse.shape == (100, 104)
    assert look_statistics(cut_to_floor(coarse))["open_border"] == 0.0


def test_maps_at_the_common_cell_stay_as_they_are():
    assert at_look_cell(square_room(), 0.05) is not None
    assert np.array_equal(at_look_cell(square_room(), 0.05), square_room())


def test_without_floor_nothing_is_left():
    assert cut_to_floor(np.full((9, 9), UNKNOWN, np.uint8)).size == 0
