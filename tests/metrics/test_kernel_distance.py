"""The kernel distance and the Wasserstein distances on samples whose answer is known."""

import numpy as np
import pytest

from slamgym.metrics.two_sample import kernel_distance, statistic_distances


def samples(shift: float, seed: int, n: int = 40) -> list[dict[str, float]]:
    values = np.random.default_rng(seed).standard_normal((n, 3))
    values[:, 0] += shift
    return [{f"s{i}": float(v) for i, v in enumerate(row)} | {"constant": 1.0} for row in values]


def test_different_distributions_are_distinguished_and_equal_ones_are_not() -> None:
    same = kernel_distance(samples(0.0, 16), samples(0.0, 17), permutations=200)
    different = kernel_distance(samples(0.0, 0), samples(2.0, 1), permutations=200)
    assert same.p > 0.05
    assert abs(same.mmd2) < 1.0 / 40  # of the order of one over the size of the samples
    assert different.p == pytest.approx(1 / 201)
    assert different.mmd2 > 0.1


def test_p_values_of_equal_distributions_are_uniform() -> None:
    p = [kernel_distance(samples(0, 2 * k, 12), samples(0, 2 * k + 1, 12), 60).p for k in range(40)]
    # The share below 0.25 of 40 uniform values: 10 +- 2.7; three deviations.
    assert 2 <= np.sum(np.array(p) < 0.25) <= 18


def test_wasserstein_distance_is_the_shift_in_deviations_of_the_reference() -> None:
    distances = statistic_distances(samples(0.0, 0, 400), samples(1.5, 0, 400))
    assert distances["s0"] == pytest.approx(1.5, abs=0.1)
    assert distances["s1"] == 0.0
    assert distances["constant"] == 0.0
    changed = [row | {"constant": 3.0} for row in samples(0.0, 0)]
    assert 0.0 < statistic_distances(samples(0.0, 0), changed)["constant"] < 10.0


def test_one_map_is_no_sample() -> None:
    with pytest.raises(ValueError, match="at least 2"):
        kernel_distance(samples(0, 0, 1), samples(0, 1, 5))
