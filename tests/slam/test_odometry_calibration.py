"""What is learned of the odometry is what is wrong with it."""

import numpy as np
import pytest

from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D
from slamgym.slam.odometry_calibration import SLIP_DRIFT, OdometryCalibration


def drive(calibration: OdometryCalibration, scale: float, drift: float, turn: float, slip: float = 0.0):
    """Some 60 m with curves, in steps of 0.13 m; what the wheels say, and matches without error."""
    rng = np.random.default_rng(1)
    for step in range(480):
        said = Pose2D(0.13, 0.0, 0.1 if step % 40 < 20 else -0.06)
        slipped = slip * np.sqrt(said.x) * rng.standard_normal()
        moved = Pose2D(
            (1.0 + scale) * said.x, 0.0, (1.0 + turn) * said.theta + drift * said.x + float(slipped)
        )
        calibration.learn(np.array([said]), moved, 1e-6, 1e-6)


@pytest.mark.parametrize(
    ("scale", "drift", "turn"), [(0.02, 0.0, 0.0), (0.0, -0.012, 0.0), (-0.01, 0.006, 0.03), (0.0, 0.0, 0.0)]
)
def test_systematic_errors_are_found_and_taken_out(scale: float, drift: float, turn: float):
    calibration = OdometryCalibration()
    drive(calibration, scale, drift, turn)
    assert calibration.scale == pytest.approx(scale, abs=0.002)
    assert calibration.heading == pytest.approx([drift, turn], abs=0.002)
    corrected = calibration.correct(np.array([[1.0, 0.0, 0.5]]))
    assert corrected[0] == pytest.approx([1.0 + scale, 0.0, 0.5 * (1.0 + turn) + drift], abs=0.004)


def test_the_size_of_random_errors_is_learned():
    exact, slippery = OdometryCalibration(), OdometryCalibration()
    drive(exact, 0.0, 0.0, 0.0)
    drive(slippery, 0.0, 0.0, 0.0, slip=2.0 * SLIP_DRIFT)
    assert exact.noise[1] < 0.1
    # Part of the slip is drawn in turns, which the prior calls noisier: between the two.
    assert 0.5 < slippery.noise[1] < 4.0
    motion = np.array([[1.0, 0.0, 0.0]])
    assert exact.spread(motion).heading < 0.2 * slippery.spread(motion).heading


def test_before_anything_is_learned_the_odometry_stands():
    calibration = OdometryCalibration()
    increments = np.array([[0.1, 0.0, 0.02], [0.1, 0.0, -0.02]])
    assert (calibration.correct(increments) == increments).all()
    spread = calibration.spread(increments)
    assert 0.0 < spread.random_distance < spread.distance
    assert 0.0 < spread.random_heading < spread.heading


def test_a_single_lie_is_no_systematic_error():
    calibration = OdometryCalibration()
    drive(calibration, 0.0, 0.0, 0.0)
    before = calibration.noise[1]
    calibration.learn(np.array([Pose2D(0.6, 0.0, 0.0)]), Pose2D(0.6, 0.0, 0.5), 1e-6, 1e-6)
    assert calibration.heading == pytest.approx([0.0, 0.0], abs=0.002)
    # But the trust in what comes next is less.
    assert calibration.noise[1] > 1.1 * before


def test_restarting_forgets_the_stretch_and_keeps_what_was_learned():
    calibration = OdometryCalibration()
    drive(calibration, 0.02, 0.0, 0.0)
    calibration.learn(np.array([Pose2D(0.3, 0.0, 0.0)]), Pose2D(0.1, 0.0, 1.0), 1e-6, 1e-6)
    calibration.restart()
    assert calibration.scale == pytest.approx(0.02, abs=0.002)
    start = compose(Pose2D(0.0, 0.0, 0.0), Pose2D(0.3, 0.0, 0.0))
    calibration.learn(np.array([start]), Pose2D(0.306, 0.0, 0.0), 1e-6, 1e-6)
    assert calibration.scale == pytest.approx(0.02, abs=0.002)


def test_a_bias_of_the_matches_is_not_taken_for_an_error_of_true_odometry():
    noisy, rng = OdometryCalibration(), np.random.default_rng(2)
    for _ in range(120):
        said = Pose2D(0.5, 0.0, 0.0)
        moved = Pose2D(0.502 + 0.005 * rng.standard_normal(), 0.0, 0.003 * rng.standard_normal())
        noisy.learn(np.array([said]), moved, 0.01**2, 0.005**2)
    # Residuals no larger than the matches' own errors leave no noise to the wheels.
    assert noisy.noise[1] < 0.1
    assert noisy.significance < 0.5
