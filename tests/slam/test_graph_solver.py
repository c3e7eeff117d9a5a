import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.metrics import relative_poses
from slamgym.slam.graph.solver import Edges, chi_squared, edge_errors, optimise


def ring(number=40, radius=5.0):
    angle = np.linspace(0, 2 * np.pi, number, endpoint=False)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), angle + np.pi / 2])


def edges_between(truth, first, second):
    first, second = np.asarray(first), np.asarray(second)
    measured = relative_poses(truth[first], truth[second])
    information = np.tile(np.diag([400.0, 400.0, 4000.0]), (len(first), 1, 1))
    return Edges(first, second, measured, information, np.zeros(len(first), bool))


def dead_reckoned(truth, rng):
    """Poses that drift along the ring."""
    poses = truth.copy()
    for k in range(1, len(truth)):
        step = relative_poses(truth[[k - 1]], truth[[k]])[0] + rng.normal(0.0, [0.02, 0.02, 0.03])
        c, s = np.cos(poses[k - 1, 2]), np.sin(poses[k - 1, 2])
        poses[k] = poses[k - 1] + [c * step[0] - s * step[1], s * step[0] + c * step[1], step[2]]
    return poses


@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_exact_measurements_are_met_exactly_from_a_drifted_start(seed):
    truth = ring()
    n = len(truth)
    edges = edges_between(truth, [*range(n - 1), n - 1], [*range(1, n), 0])
    found = optimise(dead_reckoned(truth, np.random.default_rng(seed)), edges, iterations=30, tolerance=1e-10)
    assert np.abs(edge_errors(found, edges)).max() < 1e-6
    assert found[0] == pytest.approx(truth[0])
    assert found == pytest.approx(truth, abs=1e-4) or np.abs(np.sin((found - truth)[:, 2] / 2)).max() < 1e-4


def test_the_gradient_is_that_of_the_cost():
    rng = np.random.default_rng(0)
    truth = ring(6)
    edges = edges_between(truth, [0, 1, 2, 3, 4, 0], [1, 2, 3, 4, 5, 5])
    poses = truth + rng.normal(0, 0.1, truth.shape)
    from slamgym.slam.graph.solver import _normal_equations

    _, gradient = _normal_equations(poses, edges, 1e9)
    for k in range(3, 18):
        step = np.zeros(18)
        step[k] = 1e-6
        ahead, behind = poses + step.reshape(-1, 3), poses - step.reshape(-1, 3)
        slope = (chi_squared(ahead, edges).sum() - chi_squared(behind, edges).sum()) / 2e-6
        assert 2.0 * gradient[k - 3] == pytest.approx(slope, rel=1e-4, abs=1e-4)


def test_a_false_closure_loses_its_pull():
    truth = ring()
    n = len(truth)
    good = edges_between(truth, [*range(n - 1), n - 1], [*range(1, n), 0])
    first, second = np.append(good.first, 5), np.append(good.second, 25)
    measured = np.vstack([good.measured, [[0.0, 0.0, 0.0]]])  # claims that opposite sides are one place
    information = np.concatenate([good.information, good.information[:1]])
    robust = np.arange(n + 1) >= n - 1
    found = optimise(truth, Edges(first, second, measured, information, robust), robust_width=8.0)
    assert np.abs(found - truth)[:, :2].max() < 0.02
    rigid = optimise(truth, Edges(first, second, measured, information, np.zeros(n + 1, bool)))
    assert np.abs(rigid - truth)[:, :2].max() > 0.5
