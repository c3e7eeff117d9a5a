"""The beam mixture and the displacement that a measurement error makes."""

import math

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame
from slamgym.parametric.config import ScannerView
from slamgym.parametric.lidar_error import LidarErrors, observed_cad, wall_beams
from slamgym.parametric.visibility import observe

NO_ERRORS = LidarErrors()


def one_wall():
    """A wall 2 m ahead of a robot at the origin that looks along +x, on a 5 cm grid."""
    frame = GridFrame(0.05, -1.0, -1.5, 60, 80)
    occupied = np.zeros(frame.shape, dtype=bool)
    occupied[:, frame.to_cell(2.0 + 0.025, 0.0)[1]] = True
    return frame, occupied, observe(occupied, frame, np.zeros((1, 3)), ScannerView(mount_x=0.0))


def beams_of(visibility, errors=NO_ERRORS, severity=0.0, seed=0):
    return wall_beams(visibility, errors, 3.5, severity, np.random.default_rng(seed))


def test_every_systematic_term_acts_and_b4_differs_from_b5() -> None:
    distance = np.array([2.0])
    bearing = np.array([0.7])
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
    frame, _, visibility = one_wall()
    beams = beams_of(visibility, LidarErrors(a0=0.1))
    rows, cols = np.nonzero(beams.hit)
    x, y = frame.to_point(rows, cols)
    away = np.hypot(x, y)
    # Measured 0.1 m short: true minus measured points from the robot to the wall. The median of five cells in a row
    # is that of the middle one, but for the wall's ends.
    inner = np.abs(y) < np.abs(y).max() - 0.11
    np.testing.assert_allclose(
        beams.field[0, rows, cols][inner], (0.1 * x / away)[inner], atol=2e-3
    )
    np.testing.assert_allclose(
        beams.field[1, rows, cols][inner], (0.1 * y / away)[inner], atol=1e-6
    )


def test_a_bearing_error_displaces_a_wall_across_the_beam() -> None:
    frame, _, visibility = one_wall()
    beams = beams_of(visibility, LidarErrors(b3=0.01))
    row, col = (int(v) for v in frame.to_cell(2.01, 0.01))
    # Ahead, da = b3: measured to the right of its place, so true minus measured points to the left (+y).
    assert beams.field[1, row, col] == pytest.approx(2.0 * 0.01, rel=0.05)
    assert abs(beams.field[0, row, col]) < 0.001


def test_no_error_no_displacement_and_only_walls_have_beams() -> None:
    _, occupied, visibility = one_wall()
    beams = beams_of(visibility)
    assert np.abs(beams.field).max() < 1e-6
    assert not (beams.hit | beams.lost)[~occupied].any()
    assert not beams.lost.any()
    seen = observed_cad(occupied, visibility, beams)
    assert (seen[visibility.seen] == np.where(occupied, OCCUPIED, FREE)[visibility.seen]).all()
    assert (seen[~visibility.seen] == UNKNOWN).all()


def test_the_median_filter_removes_a_lone_outlier(monkeypatch) -> None:
    _, _, visibility = one_wall()
    smooth = beams_of(visibility, severity=1.0, seed=3)
    monkeypatch.setattr("slamgym.parametric.lidar_error._MEDIAN_PX", 1)
    raw = beams_of(visibility, severity=1.0, seed=3)
    assert smooth.field[0][raw.hit].std() < 0.7 * raw.field[0][raw.hit].std()
    # One centimetre of noise, as of a range straight ahead; five standard errors.
    assert raw.field[0][raw.hit].std() == pytest.approx(
        0.01, rel=5.0 / np.sqrt(2.0 * raw.hit.sum())
    )


@pytest.mark.parametrize("severity", [1.0, 6.0, 100.0])
def test_stray_beams_lose_the_wall_and_set_points_before_it(severity) -> None:
    visibility = one_wall()[2]
    found = [beams_of(visibility, severity=severity, seed=seed) for seed in range(20)]
    lost = np.array([beams.lost.sum() for beams in found]).sum()
    count = 20 * (found[0].hit | found[0].lost).sum()
    share = min(1.0, 0.05 * severity)  # short, max and rand: a twentieth
    assert lost / count == pytest.approx(share, abs=5.0 * np.sqrt(share * (1.0 - share) / count))
    stray = np.concatenate([beams.stray_points for beams in found])
    assert len(stray) / count == pytest.approx(0.2 * share, abs=5.0 * np.sqrt(0.2 * share / count))
    assert (stray[:, 0] <= 2.05).all()
    for beams in found:
        assert not beams.field[:, beams.lost].any()
        assert not (beams.hit & beams.lost).any()
