"""Least squares over poses and the wheels' errors, compared with a dense solution and with what is true."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import plain
from slamgym.metrics import relative_poses
from slamgym.slam.graph.factor import elimination_order, rank_anchors
from slamgym.slam.graph.pose_graph import graph_distances
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.graph.solver import Edges, edge_errors, optimise, total_cost
from slamgym.slam.graph.wheels import WheelCalibration

PRIOR = WheelCalibration().prior
NODES = 40


def ring(radius=5.0):
    """Round in a circle, swaying."""
    angle = np.linspace(0, 2 * np.pi, NODES, endpoint=False)
    heading = wrap_angle(angle + np.pi / 2 + 0.5 * np.sin(5 * angle))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heading])


def edges_between(truth, first, second, errors=(0.0, 0.0, 0.0, 0.0), width=np.inf):
    """Exact edges, the steps of the path by odometry with these systematic errors."""
    first, second = np.asarray(first), np.asarray(second)
    measured, design = relative_poses(truth[first], truth[second]), np.zeros((len(first), 3, 4))
    for edge in np.flatnonzero(second == first + 1):
        true = measured[edge].copy()
        for _ in range(20):  # what is measured says how the errors bear on it
            step = WheelCalibration().step(measured[[edge]])
            measured[edge] = true - step.design @ errors
        design[edge] = step.design
    information = np.tile(np.diag([400.0, 400.0, 4000.0]), (len(first), 1, 1))
    return Edges(first, second, measured, information, design, np.full(len(first), width))


def every(count):
    """An order of elimination: first all nodes but every so many."""
    return elimination_order(np.arange(NODES) % count == 0, np.zeros(0, dtype=int))


def errors_of(poses, wheels, edges):
    return edge_errors(poses, wheels, plain(edges))


@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_a_step_and_its_covariances_are_those_of_dense_matrices(seed):
    rng = np.random.default_rng(seed)
    first = np.concatenate([np.arange(NODES - 1), rng.integers(0, NODES - 8, 12)])
    second = np.concatenate([np.arange(1, NODES), first[NODES - 1 :] + rng.integers(2, 8, 12)])
    edges = edges_between(ring(), first, second)
    spread = rng.normal(size=(len(first), 3, 3))
    edges = edges._replace(
        information=edges.information + 100.0 * spread @ spread.transpose(0, 2, 1)
    )
    poses = ring() + rng.normal(0.0, 0.001, (NODES, 3))

    def errors(x):
        return errors_of(x[:-4].reshape(-1, 3), x[-4:], edges).ravel()

    x = np.concatenate([poses.ravel(), np.zeros(4)])
    steps = 1e-6 * np.eye(len(x))[3:]  # the first node stays
    jacobian = np.array([(errors(x + step) - errors(x - step)) / 2e-6 for step in steps]).T
    weighted = np.einsum("eki,ekl->eil", jacobian.reshape(-1, 3, len(steps)), edges.information)
    normal = np.einsum("eil,elj->ij", weighted, jacobian.reshape(-1, 3, len(steps)))
    normal[-4:, -4:] += np.diag(PRIOR)
    expected = np.linalg.solve(normal, np.einsum("eil,el->i", weighted, errors(x).reshape(-1, 3)))
    found = optimise(poses, np.zeros(4), edges, every(5), PRIOR, iterations=1)
    assert found.poses[1:].ravel() == pytest.approx((poses[1:].ravel() - expected[:-4]), abs=2e-5)
    assert found.wheels == pytest.approx(-expected[-4:], abs=1e-5)
    covariances = np.linalg.inv(normal)
    for node in (3, NODES - 1):
        columns = covariances[:-4, 3 * node - 3 : 3 * node]
        found_columns = np.vstack([found.covariance(other, node) for other in range(1, NODES)])
        assert found_columns == pytest.approx(columns, rel=0.01, abs=1e-5)
    assert found.wheels_covariance == pytest.approx(covariances[-4:, -4:], rel=0.01, abs=1e-7)


@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_the_order_of_elimination_changes_nothing_but_the_fill(seed):
    rng = np.random.default_rng(seed)
    anchors = np.arange(NODES) % 4 == 0
    old = rng.choice(np.flatnonzero(anchors), 30)
    first, second = (
        np.append(np.arange(NODES - 1), old),
        np.append(np.arange(1, NODES), (old + 2 + np.arange(30)) % NODES),
    )
    edges = edges_between(ring(), first, second)
    start = ring() + rng.normal(0.0, 0.01, (NODES, 3))
    ranks = rank_anchors(first, second, anchors)
    assert sorted(ranks) == list(range(anchors.sum()))
    orders = elimination_order(anchors, ranks), np.arange(NODES), rng.permutation(NODES)
    assert all(sorted(places) == list(range(NODES)) for places in orders)
    ranked, *others = (
        optimise(start, np.zeros(4), edges, places, PRIOR, 20, 1e-9) for places in orders
    )
    for other in others:
        assert other.poses == pytest.approx(ranked.poses, abs=1e-7)
        for pair in ((7, 7), (7, 23), (23, 7)):
            assert other.covariance(*pair) == pytest.approx(
                ranked.covariance(*pair), rel=1e-5, abs=1e-9
            )
        assert len(other.factor.rows) >= len(ranked.factor.rows)


@settings(max_examples=10)
@given(
    st.integers(0, 1000),
    st.tuples(
        st.floats(-0.03, 0.03),
        st.floats(-0.01, 0.01),
        st.floats(-0.05, 0.05),
        st.floats(-0.02, 0.02),
    ),
)
def test_what_the_wheels_do_wrong_is_found_from_a_drifted_start(seed, errors):
    truth, rng = ring(), np.random.default_rng(seed)
    steps, seen = np.arange(NODES - 1), np.arange(2, NODES)
    edges = edges_between(truth, [*steps, *seen * 0], [*steps + 1, *seen], errors)
    start = [truth[0]]
    for motion in edges.measured[: NODES - 1]:
        start.append(moved_by(start[-1], motion + rng.normal(0.0, [0.02, 0.02, 0.02])))
    found = optimise(np.array(start), np.zeros(4), edges, every(5), 1e-6 * PRIOR, 50, 1e-10)
    assert np.abs(errors_of(found.poses, found.wheels, edges)).max() < 1e-5
    assert (found.poses - truth)[:, :2] == pytest.approx(0.0, abs=1e-4)
    assert wrap_angle((found.poses - truth)[:, 2]) == pytest.approx(0.0, abs=1e-4)
    assert found.wheels == pytest.approx(errors, abs=1e-3)


def test_a_closed_loop_spreads_its_error_over_the_whole_way():
    straight = np.column_stack([np.arange(NODES), np.zeros(NODES), np.zeros(NODES)]).astype(float)
    steps = np.arange(NODES - 1)
    edges = edges_between(straight, [*steps, 0], [*steps + 1, NODES - 1])
    edges.measured[-1, 0] += 0.5
    edges.information[-1] *= 1e6
    found = optimise(
        straight, np.zeros(4), edges._replace(design=0.0 * edges.design), every(10), PRIOR, 20
    )
    assert np.diff(found.poses[:, 0]) == pytest.approx(1.0 + 0.5 / (NODES - 1), abs=1e-5)
    # Where the wheels may have measured too little, that is what happened.
    found = optimise(straight, np.zeros(4), edges, every(10), PRIOR, 20)
    assert found.wheels[0] == pytest.approx(0.5 / (NODES - 1), rel=0.1)


@pytest.mark.parametrize(("width", "is_bent"), [(8.0, False), (np.inf, True)])
def test_a_false_closure_loses_its_pull(width, is_bent):
    truth, steps = ring(), np.arange(NODES - 1)
    edges = edges_between(truth, [*steps, 0, 5], [*steps + 1, NODES - 1, 25])
    edges.measured[-1] = 0.0  # opposite sides are one place
    edges.width[-1] = width
    found = optimise(truth, np.zeros(4), edges, every(5), PRIOR, 30)
    before = total_cost(truth, np.zeros(4), plain(edges), PRIOR)
    assert total_cost(found.poses, found.wheels, plain(edges), PRIOR) <= before
    moved = np.abs(found.poses - truth)[:, :2].max()
    assert moved > 0.5 if is_bent else moved < 0.02


@pytest.mark.parametrize(
    ("error", "expected"), [(0.0, 0.0), (0.1, 4.0), (0.15, 8.0), (0.2, 8.0), (2.0, 8.0)]
)
def test_an_edge_costs_its_chi_squared_but_never_more_than_its_width(error, expected):
    """Switched off by its scale s, an edge costs s^2 chi^2, and the penalty (1 - s)^2 width makes up the rest."""
    truth = ring()
    edges = edges_between(truth, [0], [12], width=8.0)
    edges.measured[0, 0] += error  # an information of 400: chi^2 is (20 error)^2
    cost = total_cost(truth, np.zeros(4), plain(edges), PRIOR)
    assert cost == pytest.approx(expected, abs=1e-9)


def test_distances_go_the_short_way():
    lengths = np.ones(199)
    straight = graph_distances(lengths, np.zeros(0, int), np.zeros(0, int), 199)
    assert straight == pytest.approx(np.arange(199, -1, -1), rel=2e-3)
    # Back at node 20: the places round it are as near as if the way between had not been.
    closed = graph_distances(lengths, np.array([20]), np.array([190]), 199)
    assert closed[[190, 20, 0]] == pytest.approx([9.0, 9.1, 29.1], abs=0.1)
    # What was seen a moment ago is no short cut.
    assert graph_distances(lengths, np.array([180]), np.array([199]), 199) == pytest.approx(
        straight
    )
