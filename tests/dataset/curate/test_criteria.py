import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.faults import Criteria, stuck_fault


def test_a_good_map_has_no_fault():
    assert Criteria().faults(0.95, 0.30, 0.60, has_clutter=False) == []


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ((0.81, 0.1, 0.1), ["coverage 0.81 < 0.95"]),
        ((0.9499, 0.1, 0.1), ["coverage 0.9499 < 0.95"]),
        ((1.0, 0.31, 0.1), ["map error 0.31 m > 0.30 m"]),
        ((1.0, 0.1, 0.75), ["position error 0.75 m > 0.60 m"]),
        ((0.5, 0.4, 0.8), ["coverage 0.50", "map error", "position error"]),
    ],
)
def test_every_fault_is_named_with_its_figure(figures, words):
    faults = Criteria().faults(*figures, has_clutter=False)
    assert len(faults) == len(words)
    for fault, word in zip(faults, words, strict=True):
        assert fault.sentence.startswith(word)


def test_with_furniture_the_distance_to_the_cad_walls_says_nothing():
    assert Criteria().faults(1.0, 2.0, 0.1, has_clutter=True) == []


@pytest.mark.parametrize(
    "settings", [{"min_coverage": 1.2}, {"max_map_error": 0.0}, {"max_ate": -1.0}, {"max_ate": math.nan}]
)
def test_senseless_criteria_are_refused(settings):
    with pytest.raises(ConfigError):
        Criteria(**settings)


def row(**values):
    return np.array([values.get(name, 0.0) for name in FEATURES])


def test_a_home_is_not_stuck_and_neither_is_a_small_closed_room():
    home = row(free_area=90.0, occupied_per_free=0.06, widest_frontier=1.0)
    room = row(free_area=12.0, occupied_per_free=0.09)
    assert stuck_fault(home, 0.05) is None
    assert stuck_fault(room, 0.05) is None


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"free_area": 12.0, "occupied_per_free": 0.06, "widest_frontier": 0.8}, "from one place"),
        ({"free_area": 60.0, "occupied_per_free": 0.001}, "few occupied cells"),
        ({"free_area": 60.0, "occupied_per_free": 0.4}, "many occupied cells"),
        ({}, "no free space"),
    ],
)
def test_maps_of_stuck_robots_are_detected(values, words):
    fault = stuck_fault(row(**values), 0.05)
    assert fault.is_stuck
    assert fault.sentence.startswith("stuck: ")
    assert words in fault.sentence


def test_the_ratio_is_assessed_alike_at_another_resolution():
    """Walls of one cell: half the cells' size halves the ratio of a map, not its fate."""
    ratios = []
    for cells_across in (100, 200):
        cells = np.full((cells_across + 4, cells_across + 4), 205, np.uint8)
        cells[2:-2, 2:-2] = 0
        cells[3:-3, 3:-3] = 254
        resolution = 5.0 / cells_across
        values = completeness_features(cells, resolution)
        ratios.append(values[FEATURES.index("occupied_per_free")] * 0.05 / resolution)
        assert stuck_fault(values, resolution) is None
    assert ratios[1] == pytest.approx(ratios[0], rel=0.05)
