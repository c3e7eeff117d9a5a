import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slamgym.dataset.curate.completeness import FEATURES, completeness_features

RESOLUTION = 0.05

noise = arrays(
    np.uint8,
    st.tuples(st.integers(1, 24), st.integers(1, 24)),
    elements=st.sampled_from([0, 205, 254]),
)


def room(height=60, width=80, margin=10):
    """A room without a door: walls of one cell, free inside, unknown around."""
    cells = np.full((height + 2 * margin, width + 2 * margin), 205, np.uint8)
    cells[margin : margin + height, margin : margin + width] = 0
    cells[margin + 1 : margin + height - 1, margin + 1 : margin + width - 1] = 254
    return cells


def features(cells, resolution=RESOLUTION):
    return dict(zip(FEATURES, completeness_features(cells, resolution), strict=True))


@given(noise, st.integers(1, 3), st.integers(0, 3), st.booleans(), st.integers(0, 5))
def test_flips_quarter_turns_and_margins_change_nothing(cells, scale, turns, flip, margin):
    cells = cells.repeat(scale, 0).repeat(scale, 1)
    turned = np.rot90(cells[:, ::-1] if flip else cells, turns)
    moved = np.ascontiguousarray(np.pad(turned, margin, constant_values=205))
    assert np.array_equal(
        completeness_features(moved, RESOLUTION), completeness_features(cells, RESOLUTION)
    )


@given(noise)
def test_every_value_is_finite_and_not_negative(cells):
    values = completeness_features(cells, RESOLUTION)
    assert np.isfinite(values).all()
    assert (values >= 0.0).all()


def test_a_closed_room_leads_nowhere():
    values = features(room())
    assert values["floor"] == pytest.approx(52 * 72 * RESOLUTION**2)  # 4 cells from the walls
    assert all(values[name] == 0.0 for name in FEATURES[1:])


def test_a_doorway_lets_all_discs_out_and_pin_holes_none():
    door = room()
    door[30:46, 10] = 205  # 0.8 m
    through = features(door)
    assert 3.0 > through["ahead_20"] > through["ahead_30"] > through["ahead_40"] > 0.3
    assert through["way_out"] == 0.4
    gap = room()
    gap[30:39, 10] = 205  # 0.45 m
    values = features(gap)
    assert values["ahead_20"] > 0.5
    assert values["ahead_30"] == values["ahead_40"] == 0.0
    assert values["way_out"] == 0.25
    pin_holes = room()
    pin_holes[15:65:3, 10] = 205
    assert features(pin_holes) == features(room())


def test_a_pocket_lies_ahead_but_leads_not_out():
    cells = room()
    cells[30:50, 40:60] = 205
    values = features(cells)
    assert values["ahead_20"] == pytest.approx(1.0)
    assert values["way_out"] == 0.0


def test_a_room_that_is_only_seen_through_a_gap_is_no_floor():
    cells = np.hstack([room(), room(40, 40, 20)])
    assert features(cells)["floor"] == features(room())["floor"]


def test_fine_maps_are_measured_as_coarse_ones():
    cells = room()
    cells[30:46, 10] = 205
    fine = cells.repeat(2, axis=0).repeat(2, axis=1)
    assert features(fine, RESOLUTION / 2) == features(cells)


@pytest.mark.parametrize("value", [0, 205])
def test_a_map_without_free_cells_has_only_zeros(value):
    cells = np.full((7, 7), 205, np.uint8)
    cells[3, 3] = value
    assert not completeness_features(cells, RESOLUTION).any()
