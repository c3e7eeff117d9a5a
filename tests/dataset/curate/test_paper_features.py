import cv2
import numpy as np
import pytest

from slamgym.dataset.curate.paper_features import (
    PAPER_FEATURES,
    count_holes,
    count_parts,
    euler_number,
    paper_features,
)


def holes_by_parts(mask):
    """Holes of 8-connected parts: 4-connected parts of the rest that don't reach the outside."""
    rest = np.pad((~mask).astype(np.uint8), 1, constant_values=1)
    return cv2.connectedComponents(rest, connectivity=4)[0] - 2


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_holes_by_squares_are_those_that_parts_show(share):
    rng = np.random.default_rng(round(10 * share))
    found = 0
    for _ in range(200):
        mask = rng.random(rng.integers(1, 16, 2)) < share
        assert count_holes(mask) == holes_by_parts(mask)
        found += count_holes(mask)
    assert found > 0


def test_euler_numbers_by_hand():
    ring = np.pad(np.zeros((2, 2), np.bool_), 1, constant_values=True)
    assert euler_number(ring) == 0  # a part with a hole
    assert euler_number(np.eye(3, dtype=np.bool_)) == 1  # joined at corners
    assert euler_number(np.zeros((3, 3), np.bool_)) == 0
    assert (count_parts(ring), count_holes(ring)) == (1, 1)


def room():
    """A room of 6 by 4 m with a pillar, at 5 cm."""
    cells = np.full((120, 160), 205, np.uint8)
    cells[19:101, 19:141] = 0
    cells[20:100, 20:140] = 254
    cells[50:60, 70:80] = 0
    return cells


def test_a_room_has_the_numbers_that_it_was_drawn_with():
    found = dict(zip(PAPER_FEATURES, paper_features(room(), 0.05), strict=True))
    assert len(found) == 15
    assert found["free_area"] == pytest.approx(24.0 - 0.25)
    assert found["islands"] == 1
    assert found["pockets"] == 0
    assert found["frontier"] == found["open_frontier"] == 0.0
    assert found["free_share"] + found["occupied_share"] + found["unknown_share"] == pytest.approx(
        1.0
    )


def test_a_room_without_a_wall_is_open_there():
    cells = room()
    cells[20:100, 140] = 205
    found = dict(zip(PAPER_FEATURES, paper_features(cells, 0.05), strict=True))
    assert found["frontier"] == pytest.approx(4.0)
    assert found["widest_frontier"] == pytest.approx(
        4.0, abs=0.5
    )  # but for a clearance at each end


def test_flips_turns_and_margins_change_nothing():
    cells = room()
    cells[30:60, 140] = 205
    expected = paper_features(cells, 0.05)
    for other in (
        cells[::-1],
        cells[:, ::-1],
        np.rot90(cells),
        np.pad(cells, 9, constant_values=205),
    ):
        assert paper_features(np.ascontiguousarray(other), 0.05) == pytest.approx(expected)


def test_an_unknown_map_has_none():
    assert not paper_features(np.full((9, 9), 205, np.uint8), 0.05).any()
