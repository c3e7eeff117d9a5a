"""Intervals and tests against values from the literature and against their own definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.intervals import mean_interval, wilson_interval
from slamgym.metrics import improvement


def test_wilson_interval_of_the_papers_table() -> None:
    # 14 of 21 maps improved.
    interval = wilson_interval(14, 21)
    assert interval.value == pytest.approx(2 / 3)
    assert (interval.low, interval.high) == (
        pytest.approx(0.454, abs=0.002),
        pytest.approx(0.828, abs=0.002),
    )


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_share_and_stays_in_the_unit_interval(counts) -> None:
    interval = wilson_interval(*counts)
    assert 0.0 <= interval.low <= interval.value <= interval.high <= 1.0


def test_wilson_interval_covers_the_true_share_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    drawn = rng.binomial(60, 0.9, 2000)
    held = [
        interval.low <= 0.9 <= interval.high
        for interval in (wilson_interval(int(k), 60) for k in drawn)
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


def test_sign_test_of_the_papers_table() -> None:
    mse2 = np.full(21, 0.1)
    mse1 = np.where(np.arange(21) < 14, 0.05, 0.15)
    result = improvement(mse1, mse2)
    assert result.sign_p == pytest.approx(0.189, abs=0.001)
    assert result.ratio_of_means.value == pytest.approx((14 * 0.05 + 7 * 0.15) / 2.1)
    assert result.median_ratio == pytest.approx(0.5)


def test_a_clear_improvement_is_significant_and_equal_errors_are_not() -> None:
    rng = np.random.default_rng(1)
    mse2 = rng.uniform(0.05, 0.15, 40)
    better = improvement(0.4 * mse2, mse2)
    assert better.share_improved.value == 1.0
    assert better.share_improved.low > 0.9
    assert max(better.sign_p, better.wilcoxon_p) < 1e-6
    assert better.ratio_of_means.value == pytest.approx(0.4)
    # The ratio is the same on every map, so that no choice of plans changes it.
    assert better.ratio_of_means.low == pytest.approx(better.ratio_of_means.high)
    same = improvement(mse2, mse2)
    assert (same.share_improved.value, same.sign_p, same.wilcoxon_p) == (0.0, 1.0, 1.0)


def test_repeated_maps_of_a_plan_do_not_narrow_the_interval() -> None:
    values = np.random.default_rng(2).normal(1.0, 0.3, 30)
    once = mean_interval(values)
    repeated = mean_interval(
        np.repeat(values, 10), groups=[str(i) for i in np.repeat(np.arange(30), 10)]
    )
    careless = mean_interval(np.repeat(values, 10))
    assert repeated.high - repeated.low == pytest.approx(once.high - once.low, rel=0.1)
    assert careless.high - careless.low < 0.5 * (once.high - once.low)


@pytest.mark.parametrize(("mse1", "mse2"), [([], []), ([0.1], [0.1, 0.2])])
def test_errors_without_counterparts_are_refused(mse1, mse2) -> None:
    with pytest.raises(ValueError, match="one length"):
        improvement(np.array(mse1), np.array(mse2))
