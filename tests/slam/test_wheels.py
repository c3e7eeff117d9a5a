import numpy as np
import pytest

from slamgym.slam.graph.wheels import FLOORS, MATCHED, WheelCalibration

STEP = np.tile((0.02, 0.0, 0.01), (10, 1))


STEPS = 6000


def learned(size: float, lies: int = 0, unseen: int = 0) -> np.ndarray:
    """Noise that is learned from steps whose random errors are so many times those first assumed."""
    rng, wheels = np.random.default_rng(0), WheelCalibration()
    slips = np.tile(wheels.step(STEP).slips, (STEPS, 1))
    errors = size * np.sqrt(slips[:, [0, 0, 1]]) * rng.standard_normal((STEPS, 3))
    # The laser errs at both ends of a step.
    matched = np.sqrt(0.5 * np.array(MATCHED)[[0, 0, 1]]) * rng.standard_normal((STEPS + 1, 3))
    errors += np.diff(matched, axis=0)
    errors[:lies] += (0.0, 0.0, 3.0)
    wheels.learn(np.zeros(3), np.zeros((3, 3)), errors, slips, np.arange(STEPS) >= unseen)
    return wheels.noise


@pytest.mark.parametrize("size", [0.5, 1.0, 3.0])
def test_the_size_of_random_errors_is_found(size):
    assert learned(size) == pytest.approx([size**2] * 2, rel=0.3)


def test_true_odometry_is_believed_and_slipping_is_not():
    assert (learned(0.0) < 0.1).all()
    assert (learned(10.0) > 50.0).all()
    # A turn of three radians that didn't happen counts as many large errors, not as ten thousand.
    assert learned(1.0, lies=1)[1] < 3.0
    # Where the laser saw nothing, nothing is known of the odometry's errors.
    assert learned(1.0, lies=20, unseen=20) == pytest.approx([1.0, 1.0], rel=0.3)


def test_the_motion_is_corrected_and_its_uncertainty_grows_with_it():
    wheels = WheelCalibration()
    wheels.systematic = np.array([0.02, 0.05, -0.1])
    step = wheels.step(STEP)
    assert step.moved == pytest.approx([0.2, 0.009, 0.1], abs=1e-3)
    assert wheels.expected(step) == pytest.approx([1.02 * step.moved[0], 1.02 * step.moved[1], 0.1])
    spreads = [
        np.diag(np.linalg.inv(wheels.information(wheels.step(STEP[:count]))))
        for count in (0, 1, 10)
    ]
    assert spreads[0] == pytest.approx(np.square([FLOORS[0], FLOORS[0], FLOORS[1]]))
    assert (np.diff(spreads, axis=0) > 0.0).all()
