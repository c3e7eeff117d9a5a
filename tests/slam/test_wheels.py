import numpy as np
import pytest

from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D
from slamgym.slam.graph.wheels import FLOORS, LEAST_NOISE, MATCHED, WheelCalibration

STEP = np.tile((0.02, 0.0, 0.01), (10, 1))


CURVE = np.array([(0.3, 0.0, 0.4), (0.2, 0.01, -0.1), (0.5, 0.0, 0.6), (-0.1, 0.0, 0.2)])
STEPS = 6000


def learned(
    size: float, lies: int = 0, unseen: int = 0, believed: float = 16.0, times: int = 1
) -> np.ndarray:
    """Noise that is learned, so many times, from steps whose random errors are so many times those first assumed."""
    rng, wheels = np.random.default_rng(0), WheelCalibration()
    wheels.noise[:] = believed
    slips = np.tile(wheels.step(STEP).slips, (STEPS, 1))
    errors = size * np.sqrt(slips[:, [0, 0, 1]]) * rng.standard_normal((STEPS, 3))
    # The laser errs at both ends of a step.
    matched = np.sqrt(0.5 * np.array(MATCHED)[[0, 0, 1]]) * rng.standard_normal((STEPS + 1, 3))
    errors += np.diff(matched, axis=0)
    errors[:lies] += (0.0, 0.0, 3.0)
    for _ in range(times):
        seen = np.tile(np.arange(STEPS)[:, None] >= unseen, 3)
        wheels.learn(np.zeros(4), np.zeros((4, 4)), errors, slips, seen)
    return wheels.noise


@pytest.mark.parametrize("size", [0.5, 1.0, 3.0])
def test_the_size_of_random_errors_is_found(size):
    assert learned(size) == pytest.approx([size**2] * 2, rel=0.3)


def test_true_odometry_is_believed_and_slipping_is_not():
    assert (learned(0.0) == LEAST_NOISE).all()
    assert (learned(10.0) > 50.0).all()
    # A turn of three radians that didn't happen counts as many large errors, not as ten thousand.
    assert learned(1.0, lies=1)[1] < 3.0
    # Where the laser saw nothing, nothing is known of the odometry's errors.
    assert learned(1.0, lies=20, unseen=20) == pytest.approx([1.0, 1.0], rel=0.3)


@pytest.mark.parametrize("believed", [LEAST_NOISE, 400.0])
def test_the_size_is_found_whatever_was_believed_before(believed):
    assert learned(3.0, believed=believed, times=10) == pytest.approx([9.0, 9.0], rel=0.3)


def corrected(errors):
    """A motion whose increments are freed of systematic errors one by one."""
    scale, drift, turn, direction = errors
    moved = Pose2D(0.0, 0.0, 0.0)
    for x, y, theta in CURVE:
        change = drift * x + turn * theta
        # Half of an increment's own change of heading leads its motion aside.
        angle = direction + 0.5 * change
        cos, sin = (1.0 + scale) * np.cos(angle), (1.0 + scale) * np.sin(angle)
        moved = compose(moved, Pose2D(cos * x - sin * y, sin * x + cos * y, theta + change))
    return np.array(moved)


def test_the_design_is_the_change_of_the_motion_by_each_systematic_error():
    step = WheelCalibration().step(CURVE)
    assert corrected(np.zeros(4)) == pytest.approx(step.moved)
    size = 1e-6
    changes = [(corrected(error) - corrected(-error)) / (2.0 * size) for error in size * np.eye(4)]
    assert np.transpose(changes) == pytest.approx(step.design, abs=1e-8)


def test_the_motion_is_corrected_and_its_uncertainty_grows_with_it():
    wheels = WheelCalibration()
    wheels.systematic = np.array([0.02, 0.05, -0.1, 0.0])
    step = wheels.step(STEP)
    assert step.moved == pytest.approx([0.2, 0.009, 0.1], abs=1e-3)
    # What the drift adds to the turn, its scale takes away, in each increment: the way stays as it is.
    assert wheels.expected(step) == pytest.approx([1.02 * step.moved[0], 1.02 * step.moved[1], 0.1])
    spreads = [
        np.diag(np.linalg.inv(wheels.information(wheels.step(STEP[:count]))))
        for count in (0, 1, 10)
    ]
    assert spreads[0] == pytest.approx(np.square([FLOORS[0], FLOORS[0], FLOORS[1]]))
    assert (np.diff(spreads, axis=0) > 0.0).all()
