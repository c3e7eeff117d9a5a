import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.agents.evaluation.coverage_curve import CoverageCurve, horizon


def linear(seconds=100, speed=0.2):
    """Coverage grows evenly to 1."""
    time = np.arange(0.0, seconds + 1.0)
    return CoverageCurve(time, speed * time, time / seconds)


def test_levels_are_reached_when_a_linear_curve_passes_them():
    curve = linear()
    assert curve.reached(0.5) == (50.0, 10.0)
    assert curve.reached(0.95)[1] == pytest.approx(19.0)
    assert curve.reached(1.0)[0] == 100.0
    assert curve.final == 1.0


def test_a_level_that_was_never_reached_is_none():
    curve = CoverageCurve(np.array([0.0, 10.0]), np.array([0.0, 2.0]), np.array([0.1, 0.6]))
    assert curve.reached(0.8) is None
    assert curve.reached(0.1) == (0.0, 0.0)


def test_the_area_under_a_linear_curve_is_a_half_and_goes_on_level_after_the_end():
    assert linear().mean_until(100.0) == pytest.approx(0.495)  # a staircase of 100 steps
    assert linear().mean_until(200.0) == pytest.approx(0.5 * 0.495 + 0.5)
    instant = CoverageCurve(np.array([0.0]), np.array([0.0]), np.array([1.0]))
    assert instant.mean_until(7.0) == 1.0


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 0.2), min_size=1, max_size=200), st.integers(0, 100))
def test_thinning_changes_no_reading_by_more_than_its_step(gains, second):
    coverage = np.minimum(1.0, np.cumsum(gains))
    time = np.arange(len(gains), dtype=float)
    curve = CoverageCurve(time, 0.1 * time, coverage)
    thin = CoverageCurve.from_dict(curve.thinned().to_dict())
    assert len(thin.time) <= len(curve.time)
    # 0.0005 is the step of thinning, 0.00005 the rounding of the JSON form.
    assert thin.at(np.array([second]))[0] == pytest.approx(
        curve.at(np.array([second]))[0], abs=0.0006
    )
    assert thin.final == pytest.approx(curve.final, abs=1e-4)


def test_a_faster_curve_has_the_larger_area():
    slow, fast = linear(200), linear(100)
    end = horizon(50.0)
    assert fast.mean_until(end) > slow.mean_until(end)
    assert (slow.at(50.0), fast.at(50.0)) == (0.25, 0.5)
    with pytest.raises(ValueError, match="at least one"):
        CoverageCurve.from_dict({})
