import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from slamgym.core.intervals import (
    Interval,
    balanced_accuracy,
    crossed_mean,
    crossed_ratio,
    interquartile_mean,
    mean_band,
    mean_interval,
    median_interval,
    probability_of_improvement,
    ratio_of_means,
    ratio_where_both,
)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), factor=st.floats(0.5, 2.0))
def test_an_explorer_that_is_always_faster_by_a_factor_has_no_uncertainty(seed, factor):
    reference = np.random.default_rng(seed).uniform(50.0, 500.0, size=20)
    for interval in (
        ratio_of_means(factor * reference, reference),
        mean_interval(np.full(20, factor)),
    ):
        assert (interval.low, interval.value, interval.high) == pytest.approx(
            (factor, factor, factor)
        )


def test_the_value_lies_inside_its_interval_which_shrinks_with_the_number_of_plans():
    rng = np.random.default_rng(3)
    widths = []
    for n in (20, 80, 320):
        interval = mean_interval(rng.normal(5.0, 1.0, size=n))
        assert interval.low < interval.value < interval.high
        widths.append(interval.high - interval.low)
    # The width falls as 1 / sqrt(n): by 2 for four times the plans; 30 % off by chance.
    assert widths[0] / widths[1] == pytest.approx(2.0, rel=0.3)
    assert widths[1] / widths[2] == pytest.approx(2.0, rel=0.3)


def test_nineteen_of_twenty_intervals_hold_the_truth():
    rng = np.random.default_rng(0)
    found = [mean_interval(rng.normal(1.0, 0.5, size=40)) for _ in range(200)]
    held = [one.low <= 1.0 <= one.high for one in found]
    # Binomial(200, 0.95) has a standard deviation of 1.5 %; percentile intervals are a little narrow at n = 40.
    assert 0.89 <= np.mean(held) <= 0.99


def test_pairing_cancels_the_differences_between_plans():
    rng = np.random.default_rng(1)
    plans = rng.uniform(100.0, 1000.0, size=40)
    faster = plans * rng.normal(0.85, 0.02, size=40)
    paired = ratio_of_means(faster, plans)
    assert paired.high < 1.0
    assert paired.high - paired.low < 0.03
    unpaired = ratio_of_means(rng.permutation(faster), plans)
    assert unpaired.low <= 1.0 <= unpaired.high


def test_large_plans_count_more_in_the_ratio_of_means_than_in_the_mean_of_ratios():
    reference = np.array([10.0, 1000.0])
    values = np.array([5.0, 1000.0])  # faster on the small plan alone
    assert ratio_of_means(values, reference).value == pytest.approx(1005.0 / 1010.0)
    assert mean_interval(values / reference).value == pytest.approx(0.75)
    assert mean_interval(values - reference).value == pytest.approx(-2.5)


def test_the_seed_decides_the_interval_and_nothing_is_refused():
    values = np.random.default_rng(2).normal(size=30)
    assert mean_interval(values, 5) == mean_interval(values, 5)
    with pytest.raises(ValueError, match="no plans"):
        mean_interval(np.zeros(0))


def test_seeds_that_differ_widen_the_interval_however_many_plans_there_are():
    rng = np.random.default_rng(5)
    plans = rng.uniform(0.9, 1.1, size=(1, 400))
    runs = np.array(
        [[0.8], [1.0], [1.2]]
    )  # of one preset; the luck of a training, the same on every plan
    ratio = crossed_ratio(runs * plans, plans)
    assert ratio.value == pytest.approx(1.0)
    assert ratio.low < 0.9
    assert ratio.high > 1.1
    alike = crossed_ratio(np.ones((3, 1)) * plans, plans)
    assert alike.high - alike.low < 1e-9


def test_one_run_gives_the_interval_over_plans():
    values = np.random.default_rng(6).normal(5.0, 1.0, size=200)
    crossed, plain = crossed_mean(values[None]), mean_interval(values)
    assert crossed.value == pytest.approx(plain.value)
    # The same figure from other draws: two percentiles of 10,000 draws lie this near.
    assert (crossed.low, crossed.high) == pytest.approx((plain.low, plain.high), abs=0.02)
    with pytest.raises(ValueError, match="no plans"):
        crossed_ratio(np.ones((2, 3)), np.ones((2, 4)))


def test_the_band_of_curves_is_that_of_each_place():
    rows = np.random.default_rng(7).normal(size=(50, 3))
    low, high = mean_band(rows)
    for place in range(3):
        interval = mean_interval(rows[:, place])
        assert (low[place], high[place]) == pytest.approx((interval.low, interval.high), abs=0.05)


def test_the_median_has_an_interval_that_follows_the_groups():
    values = np.arange(101.0)
    found = median_interval(values)
    assert found.value == 50.0
    assert 35.0 < found.low < 45.0 < 55.0 < found.high < 65.0
    assert median_interval(np.ones(4)) == Interval(1.0, 1.0, 1.0)
    doubled = median_interval(np.repeat(values, 2), groups=np.repeat(np.arange(101), 2))
    assert (doubled.low, doubled.high) == pytest.approx((found.low, found.high), abs=2.0)


def test_balanced_accuracy_weighs_both_classes_alike():
    right = np.array([1.0] * 90 + [0.0] * 10)
    of_second = np.arange(100) >= 90
    found = balanced_accuracy(right, of_second, np.arange(100))
    assert found.value == 0.5
    assert balanced_accuracy(np.ones(100), of_second, np.arange(100)).low == 1.0


def test_the_interquartile_mean_is_the_mean_without_the_outer_quarters():
    values = np.random.default_rng(5).lognormal(size=(3, 40))
    interval = interquartile_mean(values)
    assert interval.value == pytest.approx(stats.trim_mean(values.ravel(), 0.25))
    assert interval.low < interval.value < interval.high
    # A quarter of one of five values is cut: half of the second and of the fourth belong to the middle.
    assert interquartile_mean(np.array([[0.0, 1.0, 2.0, 3.0, 100.0]])).value == pytest.approx(2.0)


def test_a_few_failures_hardly_move_the_interquartile_mean():
    values = np.random.default_rng(6).normal(10.0, 1.0, size=(1, 100))
    spoilt = values.copy()
    spoilt[0, :5] = 1000.0
    assert interquartile_mean(spoilt).value == pytest.approx(
        interquartile_mean(values).value, abs=0.2
    )


def test_more_runs_of_each_plan_are_no_more_plans():
    plans = np.random.default_rng(7).normal(10.0, 3.0, size=20)
    widths = [
        interval.high - interval.low
        for interval in (
            interquartile_mean(plans[None]),
            interquartile_mean(np.tile(plans, (5, 1))),
        )
    ]
    assert widths[1] == pytest.approx(widths[0], rel=0.15)


def test_the_probability_of_improvement_counts_pairs_on_the_same_plan():
    values, reference = np.array([[1.0, 5.0], [3.0, 5.0]]), np.array([[2.0, 5.0]])
    # On the first plan one of two runs is better, on the second all are tied.
    assert probability_of_improvement(values, reference).value == pytest.approx(0.5)
    assert probability_of_improvement(reference - 1.0, reference).low == 1.0
    rng = np.random.default_rng(8)
    ours, theirs = rng.normal(size=(3, 30)), rng.normal(size=(2, 30))
    there, back = (
        probability_of_improvement(*pair).value for pair in ((ours, theirs), (theirs, ours))
    )
    assert there + back == pytest.approx(1.0)


def test_a_ratio_where_both_succeed_leaves_out_failures():
    nan = np.nan
    values, reference = np.array([[1.0, 4.0, nan], [3.0, nan, 9.0]]), np.array([[2.0, 8.0, nan]])
    ratio = ratio_where_both(values, reference)
    # First plan: 1 and 3 against 2 each; second: 4 against 8; on the third the reference failed.
    assert ratio.value == pytest.approx(8.0 / 12.0)
    assert 0.5 <= ratio.low <= ratio.value <= ratio.high <= 1.5
    same = ratio_where_both(reference, 2.0 * reference)
    assert (same.value, same.low, same.high) == (0.5, 0.5, 0.5)
    with pytest.raises(ValueError, match="neither failed"):
        ratio_where_both(np.array([[1.0, nan]]), np.array([[nan, 1.0]]))


def test_a_ratio_where_both_succeed_is_the_crossed_ratio_where_nobody_fails():
    rng = np.random.default_rng(9)
    values, reference = rng.uniform(1.0, 3.0, size=(3, 40)), rng.uniform(1.0, 3.0, size=(1, 40))
    ours, theirs = ratio_where_both(values, reference), crossed_ratio(values, reference)
    assert ours.value == pytest.approx(theirs.value)
    # Other draws of the same distribution: bounds differ by the noise of 2,000 resamples.
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), rel=0.02)


@pytest.mark.parametrize("shape", [(0, 3), (2, 0), (4,)])
def test_tables_without_runs_or_plans_are_refused(shape):
    with pytest.raises(ValueError, match="no runs and plans"):
        interquartile_mean(np.zeros(shape))
    with pytest.raises(ValueError, match="no plans to compare on"):
        probability_of_improvement(np.zeros((2, 3)), np.zeros((2, 4)))
    with pytest.raises(ValueError, match="no plans to compare on"):
        ratio_where_both(np.zeros((2, 3)), np.zeros((2, 4)))
