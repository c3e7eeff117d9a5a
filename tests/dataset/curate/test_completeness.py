import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slamgym.dataset.curate.completeness import (
    FEATURES,
    completeness_features,
    count_holes,
    inside_hull,
    shared_sides,
    without_spikes,
)

RESOLUTION = 0.05

noise = arrays(
    np.uint8, st.tuples(st.integers(1, 24), st.integers(1, 24)), elements=st.sampled_from([0, 205, 254])
)
masks = arrays(np.bool_, st.tuples(st.integers(1, 16), st.integers(1, 16)))


def room(height=60, width=80, margin=10):
    """A room without a door: walls of one cell, free inside, unknown around."""
    cells = np.full((height + 2 * margin, width + 2 * margin), 205, np.uint8)
    cells[margin : margin + height, margin : margin + width] = 0
    cells[margin + 1 : margin + height - 1, margin + 1 : margin + width - 1] = 254
    return cells


def features(cells, resolution=RESOLUTION):
    return dict(zip(FEATURES, completeness_features(cells, resolution), strict=True))


@given(noise, st.integers(0, 3), st.booleans(), st.integers(0, 5))
def test_flips_quarter_turns_and_margins_change_nothing(cells, turns, flip, margin):
    turned = np.rot90(cells[:, ::-1] if flip else cells, turns)
    moved = np.ascontiguousarray(np.pad(turned, margin, constant_values=205))
    assert np.array_equal(completeness_features(moved, RESOLUTION), completeness_features(cells, RESOLUTION))


@given(noise)
def test_shares_add_up_and_every_value_is_finite_and_not_negative(cells):
    values = completeness_features(cells, RESOLUTION)
    assert np.isfinite(values).all()
    assert (values >= 0.0).all()
    named = dict(zip(FEATURES, values, strict=True))
    if (cells != 205).any():
        assert named["free_share"] + named["occupied_share"] + named["unknown_share"] == pytest.approx(1.0)
    # Of one map the hull can't hold more cells than there are.
    assert named["free_area"] <= (cells == 254).sum() * RESOLUTION**2 + 1e-12
    assert named["widest_frontier"] <= named["open_frontier"] + 1e-12


def test_areas_and_lengths_do_not_depend_on_the_resolution():
    coarse = room()
    coarse[30:34, 10] = 205  # a gap in the wall
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    a, b = features(coarse, 0.1), features(fine, 0.05)
    for name in ("free_area", "free_share", "islands", "pockets", "frontier", "frontier_share"):
        assert b[name] == pytest.approx(a[name], rel=0.05), name


def test_a_closed_room_has_no_frontier():
    values = features(room())
    assert values["free_area"] == pytest.approx(58 * 78 * RESOLUTION**2)
    for name in ("frontier", "frontier_share", "open_frontier", "widest_frontier", "islands", "pockets"):
        assert values[name] == 0.0, name


def test_a_doorway_is_an_open_frontier_and_pin_holes_are_not():
    door = room()
    door[30:46, 10] = 205  # 0.8 m
    through = features(door)
    assert through["frontier"] == pytest.approx(16 * RESOLUTION)
    # Cells nearer to a door post than a robot's radius don't count.
    assert 0.2 <= through["widest_frontier"] == through["open_frontier"] <= 0.8
    pin_holes = room()
    pin_holes[15:65:3, 10] = 205
    values = features(pin_holes)
    assert values["frontier"] > through["frontier"]
    assert values["open_frontier"] == 0.0


def test_spikes_of_stray_beams_do_not_widen_the_hull():
    spiked = room(margin=40)
    spiked[70, 5:41] = 254
    plain = features(room(margin=40))
    values = features(spiked)
    assert values["free_area"] == pytest.approx(plain["free_area"], rel=0.01)
    assert values["unknown_area"] <= plain["unknown_area"] + 0.01
    assert values["open_frontier"] == 0.0
    # 1.8 m of spike would have 3.5 m of sides; what is left is its root in the wall.
    assert values["frontier"] <= 0.1
    assert values["islands"] == values["pockets"] == 0.0


@pytest.mark.parametrize("count", [0, 1, 3, 7])
def test_islands_are_counted(count):
    cells = room()
    for number in range(count):
        cells[30:34, 20 + 10 * number : 23 + 10 * number] = 0
    values = features(cells)
    assert values["islands"] == count
    assert values["wall_parts"] == pytest.approx(10.0 * (count + 1) / values["free_area"])


def test_pockets_are_enclosed_unknown_regions():
    cells = room()
    cells[30:40, 30:40] = 205
    cells[50:52, 50:52] = 205
    assert features(cells)["pockets"] == 2


def test_an_empty_map_has_only_zeros():
    assert not completeness_features(np.full((5, 9), 205, np.uint8), RESOLUTION).any()


@pytest.mark.parametrize("value", [0, 254])
def test_a_map_of_one_cell_is_measured(value):
    cells = np.full((7, 7), 205, np.uint8)
    cells[3, 3] = value
    assert np.isfinite(completeness_features(cells, RESOLUTION)).all()


@given(masks)
def test_holes_are_the_closed_parts_of_the_background(mask):
    """A hole of an 8-connected figure is a 4-connected part of the rest that doesn't reach the border."""
    background = np.pad(~mask, 1, constant_values=True)
    seen = np.zeros_like(background)
    parts = 0
    for row, col in np.argwhere(background):
        if seen[row, col]:
            continue
        parts += 1
        stack = [(row, col)]
        seen[row, col] = True
        while stack:
            r, c = stack.pop()
            for nr, nc in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                inside = 0 <= nr < background.shape[0] and 0 <= nc < background.shape[1]
                if inside and background[nr, nc] and not seen[nr, nc]:
                    seen[nr, nc] = True
                    stack.append((nr, nc))
    assert count_holes(mask) == parts - 1


@given(masks.filter(lambda mask: mask.any()), st.integers(0, 2))
def test_the_hull_is_the_set_of_lattice_points_in_it(mask, margin):
    from shapely import MultiPoint, Point

    hull = inside_hull(mask, margin)
    rows, cols = np.nonzero(mask)
    corners = [
        (min(max(c + dc, 0), mask.shape[1] - 1), min(max(r + dr, 0), mask.shape[0] - 1))
        for r, c in zip(rows.tolist(), cols.tolist(), strict=True)
        for dr in (-margin, margin)
        for dc in (-margin, margin)
    ]
    shape = MultiPoint(corners).convex_hull.buffer(1e-9)
    expected = np.array(
        [[shape.covers(Point(c, r)) for c in range(mask.shape[1])] for r in range(mask.shape[0])]
    )
    assert np.array_equal(hull, expected)


@given(masks)
def test_sides_between_a_mask_and_its_complement_are_those_where_it_changes(mask):
    changes = int((mask[:, 1:] != mask[:, :-1]).sum() + (mask[1:] != mask[:-1]).sum())
    assert shared_sides(mask, ~mask) == shared_sides(~mask, mask) == changes
    assert shared_sides(mask, np.zeros_like(mask)) == 0


def test_what_is_narrower_than_a_spike_goes_and_the_rest_stays():
    free = np.zeros((40, 40), np.bool_)
    free[10:30, 10:30] = True
    free[20, :] = True
    kept = without_spikes(free, RESOLUTION)
    assert kept[10:30, 10:30].all()
    assert kept.sum() == 400
