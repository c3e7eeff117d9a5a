"""The uncertainty of a path grows as it is driven and falls where a loop is closed."""

import numpy as np
import pytest

from slamgym.slam.graph.uncertainty import PathUncertainty, step_covariance

STEP = np.diag([1e-4, 1e-4, 1e-5])


def straight(count: int) -> np.ndarray:
    return np.column_stack([0.5 * np.arange(count), np.zeros(count), np.zeros(count)])


def driven(poses: np.ndarray) -> PathUncertainty:
    path = PathUncertainty()
    for count in range(1, len(poses) + 1):
        path.append(poses[:count], STEP)
    return path


def test_the_start_is_certain_and_what_follows_is_less_and_less():
    traces = [np.trace(driven(straight(count)).latest[:2, :2]) for count in range(1, 30)]
    assert traces[0] == 0.0
    assert (np.diff(traces) > 0.0).all()


def test_a_heading_error_moves_what_lies_ahead_sideways():
    covariance = step_covariance(np.array([2.0, 0.0]), np.diag([0.0, 0.0, 0.01]), np.zeros((3, 3)))
    assert covariance[1, 1] == pytest.approx(0.04)
    assert covariance[0, 0] == pytest.approx(0.0)


def test_a_closed_loop_makes_the_end_as_certain_as_the_place_it_came_back_to():
    poses = straight(40)
    poses[20:] = poses[19::-1]
    path = driven(poses)
    before = np.trace(path.latest[:2, :2])
    path.follow(poses, [(3, 39, STEP)])
    after = np.trace(path.latest[:2, :2])
    assert after < 0.2 * before
    # Whatever the order in which the two nodes are named.
    path.follow(poses, [(39, 3, STEP)])
    assert np.trace(path.latest[:2, :2]) == after


def test_covariances_are_symmetric_and_positive():
    path = driven(straight(25))
    assert path.latest == pytest.approx(path.latest.T)
    assert (np.linalg.eigvalsh(path.latest) > 0.0).all()
