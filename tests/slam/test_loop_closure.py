"""Loops: who is a candidate, which closures agree, and what closing them does to the error."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.metrics import relative_poses
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.graph.loop_closure import (
    GROUP_SEPARATION,
    LOOP_RADIUS,
    Closure,
    agree,
    find_candidates,
    graph_distances,
)
from slamgym.slam.graph.solver import Edges, chi_squared, optimise

CONFIG = PoseGraphConfig(local_nodes=10)
SIGMA = np.array([0.02, 0.02, 0.01])


def two_rounds(number=60, radius=4.0):
    """Poses on a circle that is driven twice."""
    angle = np.linspace(0.0, 4.0 * np.pi, number, endpoint=False)
    heading = (angle + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heading])


def chain(steps, start):
    """Poses from relative motions, one after the other."""
    poses = [start]
    for dx, dy, turn in steps:
        x, y, theta = poses[-1]
        cos, sin = np.cos(theta), np.sin(theta)
        poses.append(np.array([x + cos * dx - sin * dy, y + sin * dx + cos * dy, theta + turn]))
    return np.array(poses)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_distances_in_the_graph_are_those_of_all_ways_tried(seed):
    rng = np.random.default_rng(seed)
    nodes, edges = 7, 12
    first, second = rng.integers(0, nodes, (2, edges))
    key = first * nodes + second
    unique = (first != second) & (np.unique(key, return_index=True)[1][:, None] == np.arange(edges)).any(
        axis=0
    )
    first, second = first[unique], second[unique]
    lengths = rng.uniform(0.1, 2.0, len(first))
    shortest = np.where(np.eye(nodes) > 0, 0.0, np.inf)
    for a, b, length in zip(first, second, lengths, strict=True):
        shortest[a, b] = shortest[b, a] = min(shortest[a, b], length)
    for via in range(nodes):  # Floyd and Warshall
        shortest = np.minimum(shortest, shortest[:, via : via + 1] + shortest[via : via + 1])
    for node in range(nodes):
        assert graph_distances(first, second, lengths, nodes, node) == pytest.approx(shortest[node])


@given(st.integers(30, 59), st.integers(1, 4))
def test_candidates_are_near_old_and_apart(node, most):
    poses = two_rounds()
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    distances = np.abs(driven - driven[node])
    found = find_candidates(poses, node, distances, CONFIG, most)
    assert len(found) <= most
    assert found
    assert found[0].node == node - 30  # the same place, one round earlier
    for k, candidate in enumerate(found):
        away = np.hypot(*(poses[candidate.node] - poses[node])[:2])
        assert away < LOOP_RADIUS + candidate.window
        assert distances[candidate.node] > CONFIG.loop_length
        assert abs(candidate.node - node) > CONFIG.local_nodes
        assert all(abs(candidate.node - other.node) >= GROUP_SEPARATION for other in found[:k])


def closure(poses, old, new, error=(0.0, 0.0, 0.0)):
    measured = relative_poses(poses[[old]], poses[[new]])[0] + np.array(error)
    return Closure(old, new, measured, np.eye(3))


@given(
    st.integers(0, 26), st.integers(0, 26), st.integers(0, 3), st.floats(-np.pi, np.pi), st.floats(4.0, 20.0)
)
def test_true_closures_agree_wherever_drift_has_put_them_and_a_false_one_does_not(
    i, j, further, direction, size
):
    poses = two_rounds()
    a, b = closure(poses, i, i + 30 + further), closure(poses, j, j + 30 + further)
    assert agree(a, b, poses)
    # Drift moves the second round as a whole: closures don't depend on where it is believed to be.
    moved = poses.copy()
    moved[30:, :2] += (0.7, -0.4)
    assert agree(a, b, moved)
    false = closure(poses, j, j + 30, (size * np.cos(direction), size * np.sin(direction), 0.0))
    assert not agree(a, false, poses)
    assert not agree(a, closure(poses, j, j + 30, (0.0, 0.0, 2.5)), poses)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_closing_a_noisy_loop_brings_its_end_home(seed):
    truth, rng = two_rounds(), np.random.default_rng(seed)
    n = len(truth)
    driven = relative_poses(truth[:-1], truth[1:]) + SIGMA * rng.standard_normal((n - 1, 3))
    start = chain(driven, truth[0])
    old, new = np.arange(0, 30, 3), np.arange(0, 30, 3) + 30
    seen = relative_poses(truth[old], truth[new]) + 0.5 * SIGMA * rng.standard_normal((len(old), 3))
    first, second = np.concatenate([np.arange(n - 1), old]), np.concatenate([np.arange(1, n), new])
    information = np.tile(np.diag(1.0 / SIGMA**2), (len(first), 1, 1))
    edges = Edges(first, second, np.vstack([driven, seen]), information, np.arange(len(first)) >= n - 1)
    found = optimise(start, edges, 1e6, 30)
    # Of the dead reckoning only the loops are wrong; the solution shares their error out.
    assert chi_squared(found, edges).sum() < chi_squared(start, edges).sum()
    assert chi_squared(found, edges).sum() < 3.0 * len(first) * 1.5
    apart = np.hypot(*(found[new] - found[old])[:, :2].T)
    assert apart.max() < 0.15
    assert tuple(found[0]) == tuple(start[0])
