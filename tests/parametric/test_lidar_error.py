"""The beam mixture and the displacement that a measurement error makes."""

import dataclasses
import math

import numpy as np
import pytest

from slamgym.core.types import GridFrame
from slamgym.parametric.config import LidarErrorConfig, ScannerConfig
from slamgym.parametric.lidar_error import (
    HIT,
    MAX,
    NO_BEAM,
    RAND,
    SHORT,
    LidarErrors,
    draw_components,
    measure,
    wall_beams,
)
from slamgym.parametric.visibility import observe

NO_NOISE = LidarErrorConfig(
    sigma_range=0.0,
    sigma_bearing=0.0,
    weight_hit=1.0,
    weight_short=0.0,
    weight_max=0.0,
    weight_rand=0.0,
    median_px=0,
)


def one_wall():
    """A wall 2 m ahead of a robot at the origin that looks along +x, on a 5 cm grid."""
    frame = GridFrame(0.05, -1.0, -1.5, 60, 80)
    occupied = np.zeros(frame.shape, dtype=bool)
    occupied[:, frame.to_cell(2.0 + 0.025, 0.0)[1]] = True
    scanner = ScannerConfig(mount_x=0.0)
    visibility = observe(occupied, frame, np.zeros((1, 3)), scanner)
    return frame, occupied, scanner, visibility


def test_components_come_with_their_weights() -> None:
    config = LidarErrorConfig(weight_hit=0.4, weight_short=0.3, weight_max=0.2, weight_rand=0.1)
    counts = np.bincount(draw_components((100_000,), config, np.random.default_rng(1)), minlength=4)
    # Five standard errors of a share near one half.
    np.testing.assert_allclose(counts / counts.sum(), [0.4, 0.3, 0.2, 0.1], atol=0.008)


def test_every_systematic_term_acts_and_b4_differs_from_b5() -> None:
    distance, bearing = np.array([2.0]), np.array([0.7])
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


def test_a_constant_range_error_displaces_a_wall_along_the_beam() -> None:
    frame, _, scanner, visibility = one_wall()
    beams = wall_beams(visibility, LidarErrors(a0=0.1), NO_NOISE, scanner, np.random.default_rng(0))
    rows, cols = np.nonzero(beams.component == HIT)
    x, y = frame.to_point(rows, cols)
    away = np.hypot(x, y)
    # Measured 0.1 m short: true minus measured points from the robot to the wall.
    np.testing.assert_allclose(beams.field[0, rows, cols], 0.1 * x / away, atol=1e-6)
    np.testing.assert_allclose(beams.field[1, rows, cols], 0.1 * y / away, atol=1e-6)


def test_a_bearing_error_displaces_a_wall_across_the_beam() -> None:
    frame, _, scanner, visibility = one_wall()
    beams = wall_beams(visibility, LidarErrors(b3=0.01), NO_NOISE, scanner, np.random.default_rng(0))
    row, col = (int(v) for v in frame.to_cell(2.01, 0.01))
    # Ahead, da = b3: measured to the right of its place, so true minus measured points to the left (+y).
    assert beams.field[1, row, col] == pytest.approx(2.0 * 0.01, rel=0.05)
    assert abs(beams.field[0, row, col]) < 0.001


def test_no_error_no_displacement_and_only_walls_have_beams() -> None:
    _, occupied, scanner, visibility = one_wall()
    beams = wall_beams(visibility, LidarErrors(), NO_NOISE, scanner, np.random.default_rng(0))
    assert np.abs(beams.field).max() < 1e-6
    assert not (beams.component[~occupied] != NO_BEAM).any()


def test_the_median_filter_removes_a_lone_outlier() -> None:
    _, _, scanner, visibility = one_wall()
    noisy = dataclasses.replace(NO_NOISE, sigma_range=0.05)
    raw = wall_beams(visibility, LidarErrors(), noisy, scanner, np.random.default_rng(3))
    smooth = wall_beams(
        visibility, LidarErrors(), dataclasses.replace(noisy, median_px=5), scanner, np.random.default_rng(3)
    )
    hit = raw.component == HIT
    assert smooth.field[0][hit].std() < 0.7 * raw.field[0][hit].std()


def test_stray_beams_lose_the_wall_and_rand_sets_points_before_it() -> None:
    _, _, scanner, visibility = one_wall()
    config = dataclasses.replace(
        NO_NOISE, weight_hit=0.25, weight_short=0.25, weight_max=0.25, weight_rand=0.25
    )
    beams = wall_beams(visibility, LidarErrors(), config, scanner, np.random.default_rng(0))
    for component in (HIT, SHORT, MAX, RAND):
        assert (beams.component == component).any()
    assert len(beams.stray_points) == (beams.component == RAND).sum()
    assert (beams.stray_points[:, 0] <= 2.05).all()
    assert not beams.field[:, beams.component == SHORT].any()


def test_measurement_noise_has_the_configured_size() -> None:
    config = LidarErrorConfig(sigma_range=0.02, sigma_bearing=0.01)
    z, a = measure(np.full(20_000, 2.0), np.zeros(20_000), LidarErrors(), config, np.random.default_rng(0))
    assert z.std() == pytest.approx(0.02, rel=0.05)
    assert a.std() == pytest.approx(0.01, rel=0.05)
