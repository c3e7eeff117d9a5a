"""How maps look: statistics of drawings whose numbers are known, and the tests between sets of any learner."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.metrics.map_look import LOOK_NAMES, at_look_cell, cut_to_floor, free_fragments, look_statistics
from slamgym.metrics.two_sample import distinguish, half_against_half, tree_learner


def room(side: int = 100, wall: int = 1):
    """A square room in unknown space."""
    cells = np.full((side + 40, side + 40), UNKNOWN, np.uint8)
    cells[20 - wall : 20 + side + wall, 20 - wall : 20 + side + wall] = OCCUPIED
    cells[20 : 20 + side, 20 : 20 + side] = FREE
    return cells


def test_a_plain_room_has_closed_straight_walls_and_nothing_else():
    found = look_statistics(cut_to_floor(room()))
    assert set(LOOK_NAMES) <= set(found)
    assert found["free_area_m2"] == pytest.approx(25.0)
    assert found["long_side_m"] == pytest.approx(5.2)
    for name in ("open_border", "free_fragments_per_100m2", "rays_per_100m2", "dots_in_unknown_per_100m2"):
        assert found[name] == 0.0
    assert found["specks_in_free_share"] == 0.0
    assert found["wall_coherence"] > 0.9
    assert found["axis_alignment"] > 0.9


def test_a_stray_beam_counts_as_fragment_ray_and_dot():
    cells = room()
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
    cells = room()
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
    assert at_look_cell(room(), 0.05) is not None
    assert np.array_equal(at_look_cell(room(), 0.05), room())


def test_without_floor_nothing_is_left():
    assert cut_to_floor(np.full((9, 9), UNKNOWN, np.uint8)).size == 0


def sample(shift: float, count: int, seed: int):
    rng = np.random.default_rng(seed)
    return [{"a": rng.normal(shift), "b": rng.normal()} for _ in range(count)]


def test_distinguishing_is_balanced_and_held_out_by_building():
    pytest.importorskip("sklearn")
    rows = [*sample(0.0, 24, 0), *sample(6.0, 8, 1)]
    of_second = np.arange(32) >= 24
    buildings = [str(i // 2) for i in range(32)]
    seen = []

    def learner(train, labels, seed):
        assert not {b for b, t in zip(buildings, train, strict=True) if t} & {
            b for b, t in zip(buildings, train, strict=True) if not t
        }
        seen.append(len(set(labels[train])))
        return tree_learner(rows, 20)(train, labels, seed)

    found = distinguish(of_second, buildings, learner, folds=5)
    assert seen == [2, 2, 2, 2]  # as many folds as the smaller set has buildings
    assert found.accuracy.value > 0.95
    assert (found.scores[24:] > 0.5).all()
    always_first = distinguish(of_second, buildings, lambda train, *_: np.zeros((~train).sum()), folds=4)
    assert always_first.accuracy.value == 0.5
    assert half_against_half(buildings, tree_learner(sample(0.0, 32, 2), 20), 4, 6).low < 0.5


def test_distinguishing_needs_two_buildings_of_each_kind():
    with pytest.raises(ConfigError, match="two buildings"):
        distinguish(np.array([False, False, True]), ["a", "b", "c"], tree_learner([]), 5)
