import math

import pytest

from slamgym.core.errors import ConfigError
from slamgym.dataset.faults import Criteria


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
    "settings",
    [{"min_coverage": 1.2}, {"max_map_error": 0.0}, {"max_ate": -1.0}, {"max_ate": math.nan}],
)
def test_senseless_criteria_are_refused(settings):
    with pytest.raises(ConfigError):
        Criteria(**settings)
