"""Which old nodes may be seen again from a new one, and which closures agree with each other."""

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from slamgym.core.geometry import compose, inverse, wrap_angle
from slamgym.core.types import FloatArray, IntArray, Pose2D
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.config import PoseGraphConfig

HEADING_COST = 0.5
"""A candidate that looks elsewhere counts as further away [m/rad]."""
LOOP_EDGE_LENGTH = 0.1
"""Length of a closed loop's edge in the graph [m]: the uncertainty that remains after a closure."""
GROUP_SEPARATION = 20
"""Two candidates of one node lie at least so many nodes apart."""
LOOP_RADIUS = 3.0
"""A loop is sought with nodes this near, plus the uncertainty that has accumulated [m]."""
DRIFT, DRIFT_TURN = 0.04, 0.012
"""Uncertainty of position [m/m] and heading [rad/m] that accumulates per metre along the graph."""
LARGEST_WINDOW = 6.0
"""Most position uncertainty that a loop is searched in [m]."""


class LoopCandidate(NamedTuple):
    """An old node to look for, and how far off it may be."""

    node: int
    window: float  # [m]
    turn: float  # [rad]


class Closure(NamedTuple):
    """A relative pose found between distant nodes."""

    old: int
    new: int
    measured: FloatArray  # (3,) pose of the new node seen from the old one
    information: FloatArray  # (3, 3)


def graph_distances(
    first: IntArray, second: IntArray, lengths: FloatArray, num_nodes: int, node: int
) -> FloatArray:
    """Length of the shortest path along the edges from ``node`` to every node, (N,) [m]."""
    # Two edges between the same nodes would be added up by the matrix: the sequence's edge wins.
    key = first * num_nodes + second
    _, unique = np.unique(key, return_index=True)
    graph = csr_matrix((lengths[unique], (first[unique], second[unique])), shape=(num_nodes, num_nodes))
    return np.asarray(dijkstra(graph, directed=False, indices=np.array([node]))[0], dtype=np.float64)


def find_candidates(
    poses: FloatArray, node: int, distances: FloatArray, config: PoseGraphConfig, most: int
) -> list[LoopCandidate]:
    """Nodes that may be seen again from ``node``, the most promising first.

    Args:
        poses: Current estimates, (N, 3).
        node: The node at which a loop is sought.
        distances: From :func:`graph_distances`.
        config: Settings.
        most: Most candidates to give.
    """
    window = np.minimum(0.2 + DRIFT * distances, LARGEST_WINDOW)
    away = np.hypot(poses[:, 0] - poses[node, 0], poses[:, 1] - poses[node, 1])
    turn = np.abs(wrap_angle(poses[:, 2] - poses[node, 2]))
    indices = np.arange(len(poses))
    possible = (distances > config.loop_length) & (away < LOOP_RADIUS + window)
    possible &= np.abs(indices - node) > config.local_nodes
    chosen: list[LoopCandidate] = []
    cost = np.where(possible, away + HEADING_COST * turn, math.inf)
    while len(chosen) < most:
        best = int(np.argmin(cost))
        if not math.isfinite(cost[best]):
            break
        turn_window = min(0.08 + DRIFT_TURN * float(distances[best]), 1.0)
        chosen.append(LoopCandidate(best, float(window[best]), turn_window))
        cost[np.abs(indices - best) < GROUP_SEPARATION] = math.inf
    return chosen


def agree(a: Closure, b: Closure, poses: FloatArray) -> bool:
    """Return True if two closures agree, given the motion between their ends (Mangelson et al. 2018).

    The path old_a -> new_a -> new_b -> old_b -> old_a must lead back to where it began, up to the drift of the
    two stretches driven.
    """
    old = relative_poses(poses[[a.old]], poses[[b.old]])[0]
    new = relative_poses(poses[[a.new]], poses[[b.new]])[0]
    through = compose(compose(Pose2D(*a.measured), Pose2D(*new)), inverse(Pose2D(*b.measured)))
    error = np.array(through) - old
    driven = float(np.hypot(old[0], old[1]) + np.hypot(new[0], new[1]))
    near = float(np.hypot(error[0], error[1])) < 0.25 + 3.0 * DRIFT * driven
    return near and abs(wrap_angle(float(error[2]))) < 0.1 + 3.0 * DRIFT_TURN * driven
