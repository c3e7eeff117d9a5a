"""Equations (7)-(12): what a beam measures, and the displacement that follows."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import kstest

from slamgym.parametric.lidar_error import (
    LAMBDA_SHORT,
    LidarErrors,
    displacement_x,
    displacement_y,
    max_ranges,
    measured_sight,
    rand_ranges,
    short_density,
    short_range,
    short_ranges,
)

WALL = st.floats(0.2, 3.5)
ANGLE = st.floats(-math.pi, math.pi)


def at(*values: float) -> np.ndarray:
    return np.array(values)


def test_every_systematic_term_acts_and_b4_differs_from_b5() -> None:
    distance = at(2.0)
    bearing = at(0.7)
    values = {
        name: float(LidarErrors(**{name: 0.01}).bearing_error(distance, bearing)[0])
        for name in ("b1", "b2", "b3", "b4", "b5", "b6")
    }
    expected = {
        "b1": 0.007,
        "b2": 0.01 * math.sin(0.7),
        "b3": 0.01 * math.cos(0.7),
        "b4": 0.01 * math.sin(1.4),
        "b5": 0.01 * math.cos(1.4),
        "b6": 0.005,
    }
    assert values == pytest.approx(expected)
    assert LidarErrors(a0=0.01, a1=0.02).range_error(distance)[0] == pytest.approx(0.05)


def test_the_print_has_b4_twice() -> None:
    printed = LidarErrors(b4=0.01, b5=0.5).as_printed()
    found = printed.bearing_error(at(2.0), at(0.7))[0]
    assert found == pytest.approx(0.01 * (math.sin(1.4) + math.cos(1.4)))


@given(WALL)
def test_7_short_readings_have_a_density_that_falls_and_sums_to_one(wall) -> None:
    total, _ = quad(lambda z: short_density(at(z), at(wall))[0], 0.0, wall)
    assert total == pytest.approx(1.0)
    near, far = short_density(at(0.0, wall), at(wall, wall))
    # By a factor e for each 1 / lambda = 2 m.
    assert far / near == pytest.approx(math.exp(-0.5 * wall))


@pytest.mark.parametrize("wall", [0.5, 2.0, 3.5])
def test_7_samples_follow_the_truncated_exponential(wall) -> None:
    samples = short_ranges(np.full(4000, wall), np.random.default_rng(0))
    assert samples.min() >= 0.0
    assert samples.max() <= wall
    whole = 1.0 - math.exp(-LAMBDA_SHORT * wall)
    # One chance in a thousand that a true sampler fails; the seed is fixed.
    assert kstest(samples, lambda z: (1.0 - np.exp(-LAMBDA_SHORT * z)) / whole).pvalue > 0.001
    mean = 1.0 / LAMBDA_SHORT - wall * math.exp(-LAMBDA_SHORT * wall) / whole
    assert samples.mean() == pytest.approx(mean, abs=4.0 * samples.std() / math.sqrt(4000))


def test_8_beams_without_return_are_a_point_mass_at_the_longest_range() -> None:
    np.testing.assert_array_equal(max_ranges(3, 3.5), [3.5, 3.5, 3.5])


def test_9_random_beams_have_any_range_whatever_the_wall() -> None:
    samples = rand_ranges(4000, 3.5, np.random.default_rng(0))
    assert kstest(samples / 3.5, "uniform").pvalue > 0.001


@given(WALL, st.floats(0.0, 1.0))
def test_10_inverts_the_density(wall, share) -> None:
    ranges = at(share * wall)
    density = short_density(ranges, at(wall))
    assert short_range(density, at(wall))[0] == pytest.approx(ranges[0], abs=1e-9)


@given(WALL, ANGLE, WALL, st.floats(-0.1, 0.1))
def test_11_and_12_are_the_true_minus_the_measured_place(wall, bearing, measured, error) -> None:
    true = wall * np.exp(1j * bearing)
    seen = measured * np.exp(1j * (bearing - error))
    x = displacement_x(at(wall), at(bearing), at(measured), at(error))[0]
    y = displacement_y(at(wall), at(bearing), at(measured), at(error))[0]
    assert x == pytest.approx((true - seen).real, abs=1e-12)
    assert y == pytest.approx((true - seen).imag, abs=1e-12)


def test_11_a_wall_ahead_that_is_measured_short_lies_further_ahead() -> None:
    assert displacement_x(at(2.0), at(0.0), at(1.9), at(0.0))[0] == pytest.approx(0.1)
    # Measured to the right of its place by half a turn's hundredth: also a little nearer in x.
    assert displacement_x(at(2.0), at(1.0), at(2.0), at(0.01))[0] < -0.015


def test_12_a_wall_ahead_that_is_measured_to_the_right_lies_to_the_left() -> None:
    assert displacement_y(at(2.0), at(0.0), at(2.0), at(0.01))[0] == pytest.approx(0.02, rel=1e-3)
    assert displacement_y(at(2.0), at(math.pi / 2), at(1.9), at(0.0))[0] == pytest.approx(0.1)


@given(WALL, ANGLE, st.floats(-0.05, 0.05), st.floats(-0.1, 0.1))
def test_the_measurement_undoes_the_displacement(wall, bearing, range_error, error) -> None:
    measured = at(wall - range_error)
    x = displacement_x(at(wall), at(bearing), measured, at(error))
    y = displacement_y(at(wall), at(bearing), measured, at(error))
    offsets = wall * np.array([[math.cos(bearing), math.sin(bearing)]])
    seen_range, direction = measured_sight(offsets, np.column_stack([x, y]))
    assert seen_range[0] == pytest.approx(measured[0])
    assert math.cos(direction[0] - bearing + error) == pytest.approx(1.0)
