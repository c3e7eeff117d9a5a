"""Least squares over a graph of planar poses and the systematic errors of the wheels: Levenberg-Marquardt.

The error of an edge is the relative pose it measured, compared with the one the graph implies (Grisetti et al. 2010,
*A Tutorial on Graph-Based SLAM*, eq. 30-33). What the odometry measured is corrected by the wheels' systematic errors,
which are three more unknowns (Censi et al. 2013, *Simultaneous calibration of odometry and sensor parameters*). Edges
that may be false are scaled by dynamic covariance scaling (Agarwal et al. 2013), so that they lose their pull instead
of bending the map.
"""

from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel, plain
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.graph.factor import Factor, add_product, make_layout
from slamgym.slam.graph.relative import nearest_turn

FIXED = 1e12
"""Information of the first node, which stays where it is."""
LEAST_DAMPING, MOST_DAMPING = 1e-7, 1e3


class Edges(NamedTuple):
    """Measured relative poses; ``E`` edges."""

    first: IntArray  # (E,) node whose frame the measurement is in
    second: IntArray  # (E,) node that was measured
    measured: FloatArray  # (E, 3) pose of the second node seen from the first [m, m, rad]
    information: FloatArray  # (E, 3, 3) inverse covariance, in the frame of the first node
    design: FloatArray  # (E, 3, 3) change of the measurement by the wheels' errors; zero where the laser measured
    width: FloatArray  # (E,) chi-squared beyond which the edge loses its pull; infinite where it is sure


class Solution(NamedTuple):
    """A minimum, and the factor of the normal equations there."""

    poses: FloatArray  # (N, 3)
    wheels: FloatArray  # (3,)
    factor: Factor  # of N + 1 blocks: the nodes, and the wheels


def optimise(
    poses: FloatArray,
    wheels: FloatArray,
    edges: Edges,
    places: IntArray,
    prior: FloatArray,
    iterations: int,
    tolerance: float = 1e-4,
) -> Solution:
    """Find the poses and errors of the wheels that agree best with the edges; the first node stays where it is.

    Args:
        poses: Initial values, shape (N, 3).
        wheels: (3,) initial values.
        edges: At least one path of edges must lead from node 0 to every node.
        places: From :func:`slamgym.slam.graph.factor.elimination_order`.
        prior: (3,) information of the wheels' errors being zero.
        iterations: Most Levenberg-Marquardt steps.
        tolerance: Stop when no pose moves further than this [m, rad].
    """
    ends, last = (edges.first, edges.second), np.full(len(edges.first), len(poses))
    layout = make_layout(
        places, np.concatenate([ends[0], *ends]), np.concatenate([ends[1], last, last])
    )
    count, size, axes = len(edges.first), len(places), np.arange(3)
    damping, cost = LEAST_DAMPING, total_cost(poses, wheels, plain(edges), prior)
    for _ in range(iterations):
        blocks, gradient = np.zeros((3 * count + size, 3, 3)), np.zeros((size, 3))
        linearise(poses, wheels, plain(edges), prior, blocks, gradient)
        diagonal = blocks[3 * count :, axes, axes]
        undamped = layout.factorise(blocks)
        while True:
            blocks[3 * count :, axes, axes] = diagonal * (1.0 + damping)
            factor = layout.factorise(blocks) if damping > LEAST_DAMPING else undamped
            step = factor.solve(gradient[..., None])[..., 0]
            moved, changed = poses - step[:-1], wheels - step[-1]
            moved[0], moved[:, 2] = poses[0], wrap_angle(moved[:, 2])
            new = total_cost(moved, changed, plain(edges), prior)
            if new <= cost or damping > MOST_DAMPING:
                break
            damping = max(damping * 10.0, 1e-5)
        if new > cost:
            break  # no step makes it better
        damping = max(damping * 0.1, LEAST_DAMPING)
        poses, wheels, cost = moved, changed, new
        if float(np.abs(step[:-1]).max()) < tolerance:
            break
    return Solution(poses, wheels, undamped)


@kernel
def edge_errors(poses: FloatArray, wheels: FloatArray, edges: Edges, errors: FloatArray) -> None:
    """Compute implied minus measured relative poses of the first edges, in the frame of each first node.

    Args:
        poses: (N, 3)
        wheels: (3,) systematic errors.
        edges: The graph's.
        errors: (count, 3) receives them; as many as it has rows.
    """
    edges = Edges(*edges)
    for edge in range(len(errors)):
        a, b, error = edges.first[edge], edges.second[edge], errors[edge]
        cos, sin = np.cos(poses[a, 2]), np.sin(poses[a, 2])
        dx, dy = poses[b, 0] - poses[a, 0], poses[b, 1] - poses[a, 1]
        error[0], error[1], error[2] = (
            cos * dx + sin * dy,
            cos * dy - sin * dx,
            poses[b, 2] - poses[a, 2],
        )
        for row in range(3):
            error[row] -= edges.measured[edge, row]
            for col in range(3):
                error[row] -= edges.design[edge, row, col] * wheels[col]
        error[2] = nearest_turn(error[2])


@kernel
def _scale(error: FloatArray, information: FloatArray, width: float) -> tuple[float, float]:
    """Chi-squared of an edge, and the factor of dynamic covariance scaling, 1 within its width."""
    chi2 = 0.0
    for row in range(3):
        for col in range(3):
            chi2 += error[row] * information[row, col] * error[col]
    return chi2, 2.0 * width / (width + chi2) if chi2 > width else 1.0


@kernel
def total_cost(poses: FloatArray, wheels: FloatArray, edges: Edges, prior: FloatArray) -> float:
    """The objective of dynamic covariance scaling, s^2 chi2 + phi (1 - s)^2, summed, and the prior."""
    total, errors = 0.0, np.empty((len(edges[0]), 3))
    edge_errors(poses, wheels, edges, errors)
    edges = Edges(*edges)
    for edge in range(len(errors)):
        chi2, scale = _scale(errors[edge], edges.information[edge], edges.width[edge])
        total += scale * scale * chi2
        if scale < 1.0:
            total += edges.width[edge] * (1.0 - scale) ** 2
    for axis in range(3):
        total += prior[axis] * wheels[axis] * wheels[axis]
    return total


@kernel
def linearise(
    poses: FloatArray,
    wheels: FloatArray,
    edges: Edges,
    prior: FloatArray,
    blocks: FloatArray,
    gradient: FloatArray,
) -> None:
    """Compute the normal equations of ``E`` edges and ``M`` unknown blocks.

    Args:
        poses: (N, 3)
        wheels: (3,)
        edges: The graph's.
        prior: (3,) information of the wheels' errors being zero.
        blocks: (3 E + M, 3, 3) receives those of each edge's ends, of the first ends with the wheels, of the second
            ends with the wheels, and the diagonal.
        gradient: (M, 3) receives the gradient.
    """
    errors = np.empty((len(edges[0]), 3))
    edge_errors(poses, wheels, edges, errors)
    edges = Edges(*edges)
    count, last = len(errors), len(gradient) - 1
    jacobians, weighted = np.zeros((3, 3, 3)), np.empty((3, 3, 3))
    jacobians[0, 2, 2], jacobians[1, 2, 2] = -1.0, 1.0
    for edge in range(count):
        a, b, error, information = (
            edges.first[edge],
            edges.second[edge],
            errors[edge],
            edges.information[edge],
        )
        _, scale = _scale(error, information, edges.width[edge])
        cos, sin = np.cos(poses[a, 2]), np.sin(poses[a, 2])
        dx, dy = poses[b, 0] - poses[a, 0], poses[b, 1] - poses[a, 1]
        to_a, to_b = jacobians[0], jacobians[1]
        to_b[0, 0], to_b[0, 1], to_b[1, 0], to_b[1, 1] = cos, sin, -sin, cos
        to_a[0, 0], to_a[0, 1], to_a[1, 0], to_a[1, 1] = -cos, -sin, sin, -cos
        to_a[0, 2], to_a[1, 2] = cos * dy - sin * dx, -cos * dx - sin * dy
        jacobians[2] = -edges.design[edge]
        ends = a, b, last
        for k in range(3):
            weighted[k] = 0.0
            add_product(information, jacobians[k], weighted[k])
            weighted[k] *= scale * scale
            for row in range(3):
                for i in range(3):
                    gradient[ends[k], row] += weighted[k, i, row] * error[i]
            add_product(jacobians[k], weighted[k], blocks[3 * count + ends[k]])
        add_product(jacobians[0], weighted[1], blocks[edge])
        add_product(jacobians[0], weighted[2], blocks[count + edge])
        add_product(jacobians[1], weighted[2], blocks[2 * count + edge])
    for axis in range(3):
        blocks[3 * count, axis, axis] += FIXED
        blocks[3 * count + last, axis, axis] += prior[axis]
        gradient[last, axis] += prior[axis] * wheels[axis]
