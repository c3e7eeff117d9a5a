"""What the whole drive tells of the odometry's headings."""

import numpy as np
import pytest

from slamgym.slam.graph.wheels import HEADING_ERROR, SMALLEST_NOISE, WheelTurns
from slamgym.slam.odometry_calibration import SLIP_DRIFT, SLIP_TURN

DRIFT, TURN = 0.01, 0.03
NODES = 400


def drive(slips: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """True nodes (N, 3), and odometry (N, 3) between them whose heading errs."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-0.3, 0.3, NODES)
    poses = np.zeros((NODES, 3))
    poses[:, 2] = np.cumsum(turns)
    noise = slips * rng.standard_normal(NODES)
    noise *= np.sqrt(SLIP_DRIFT**2 * 0.5 + SLIP_TURN**2 * np.abs(turns))
    # The robot turns further than its wheels say by the drift and the share of the turn.
    measured = (turns - DRIFT * 0.5 - noise) / (1.0 + TURN)
    return poses, np.column_stack([np.full(NODES, 0.5), np.zeros(NODES), measured])


def matched(poses: np.ndarray, seed: int = 1) -> np.ndarray:
    """The nodes as a scan matcher finds them."""
    errors = HEADING_ERROR * np.random.default_rng(seed).standard_normal(NODES)
    return poses + np.column_stack([np.zeros(NODES), np.zeros(NODES), errors])


def learned(poses: np.ndarray, odometry: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wheels = WheelTurns()
    for motion in odometry:
        wheels.move(motion[None])
        wheels.append()
    return wheels.between(poses, np.diff(poses[:, 2]), np.full(NODES - 1, HEADING_ERROR**2))


def test_systematic_errors_are_taken_out_though_the_path_is_noisy():
    poses, odometry = drive(slips=0.1)
    turns, information = learned(matched(poses), odometry)
    errors = turns - np.diff(poses[:, 2])
    raw = odometry[1:, 2] - np.diff(poses[:, 2])
    # What is left is slip, of which the path's noise must show little: 6 mrad at either end of half a metre.
    assert np.sqrt(np.mean(errors**2)) < 0.3 * np.sqrt(np.mean(raw**2))
    assert np.mean(errors**2 * information) < 3.0


@pytest.mark.parametrize("slips", [0.12, 0.18])
def test_the_size_of_slips_is_found(slips: float):
    squares = []
    for seed in range(10):
        poses, odometry = drive(slips, seed)
        turns, information = learned(matched(poses, 100 + seed), odometry)
        squares.append(np.mean((turns - np.diff(poses[:, 2])) ** 2 * information))
    assert np.mean(squares) == pytest.approx(1.0, rel=0.3)


def test_wheels_that_slip_much_are_left_to_the_matches():
    poses, odometry = drive(slips=1.0)
    _, information = learned(matched(poses), odometry)
    assert (information == 0.0).all()


def test_true_odometry_is_believed_as_far_as_is_safe():
    poses, odometry = drive(slips=0.0)
    _, information = learned(poses, odometry)
    slip = SLIP_DRIFT**2 * 0.5 + SLIP_TURN**2 * np.abs(odometry[1:, 2])
    noise = 1.0 / (information * slip)
    assert (noise < 2.0 * SMALLEST_NOISE).all()


def test_a_lie_is_left_out_and_spoils_nothing():
    poses, odometry = drive(slips=0.15)
    honest, _ = learned(poses, odometry)
    odometry[200, 2] += np.radians(30.0)
    turns, information = learned(poses, odometry)
    assert information[199] == 0.0
    assert np.count_nonzero(information == 0.0) == 1
    others = np.arange(NODES - 1) != 199
    np.testing.assert_allclose(turns[others], honest[others], atol=2e-3)
