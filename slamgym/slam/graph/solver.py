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
from slamgym.slam.graph.factor import BlockLayout, Factor, add_product, make_layout
from slamgym.slam.graph.relative import nearest_turn

FIXED = 1e12
"""Information of the first node, which stays where it is."""
LEAST_DAMPING = 1e-7
"""Damping of the first step: next to none."""
FIRST_DAMPING = 1e-5
"""Damping after a first step that made it worse."""
MOST_DAMPING = 1e3
"""With more damping than this no step makes it better."""
DAMPING_FACTOR = 10.0
"""The damping grows by this factor after a step that made it worse, and shrinks by it after one that made it better."""


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
    layout = _layout_of(edges, places, len(poses))
    count = len(edges.first)
    size = len(places)
    axes = np.arange(3)
    damping = LEAST_DAMPING
    cost = total_cost(poses, wheels, plain(edges), prior)
    for _ in range(iterations):
        blocks = np.zeros((3 * count + size, 3, 3))
        gradient = np.zeros((size, 3))
        linearise(poses, wheels, plain(edges), prior, blocks, gradient)
        on_diagonal = blocks[3 * count :]
        diagonal = on_diagonal[:, axes, axes]
        undamped = layout.factorise(blocks)
        while True:
            on_diagonal[:, axes, axes] = diagonal * (1.0 + damping)
            factor = undamped
            if damping > LEAST_DAMPING:
                factor = layout.factorise(blocks)
            step = factor.solve(gradient[..., None])[..., 0]
            moved = poses - step[:-1]
            headings = wrap_angle(moved[:, 2])
            moved[0] = poses[0]
            moved[:, 2] = headings
            changed = wheels - step[-1]
            new = total_cost(moved, changed, plain(edges), prior)
            if new <= cost or damping > MOST_DAMPING:
                break
            damping = max(damping * DAMPING_FACTOR, FIRST_DAMPING)
        if new > cost:
            break  # no step makes it better
        damping = max(damping * 0.1, LEAST_DAMPING)
        poses = moved
        wheels = changed
        cost = new
        if float(np.abs(step[:-1]).max()) < tolerance:
            break
    return Solution(poses, wheels, undamped)


def _layout_of(edges: Edges, places: IntArray, wheels: int) -> BlockLayout:
    """Lay out the blocks of :func:`linearise`: between the ends of each edge, and between each end and the wheels."""
    last = np.full(len(edges.first), wheels)
    rows = np.concatenate([edges.first, edges.first, edges.second])
    cols = np.concatenate([edges.second, last, last])
    return make_layout(places, rows, cols)


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
        a = edges.first[edge]
        b = edges.second[edge]
        error = errors[edge]
        cos = np.cos(poses[a, 2])
        sin = np.sin(poses[a, 2])
        dx = poses[b, 0] - poses[a, 0]
        dy = poses[b, 1] - poses[a, 1]
        error[0] = cos * dx + sin * dy
        error[1] = cos * dy - sin * dx
        error[2] = poses[b, 2] - poses[a, 2]
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
    if chi2 > width:
        return chi2, 2.0 * width / (width + chi2)
    return chi2, 1.0


@kernel
def total_cost(poses: FloatArray, wheels: FloatArray, edges: Edges, prior: FloatArray) -> float:
    """The objective of dynamic covariance scaling, s^2 chi2 + phi (1 - s)^2, summed, and the prior."""
    total = 0.0
    errors = np.empty((len(edges[0]), 3))
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
    count = len(errors)
    last = len(gradient) - 1
    jacobians = np.zeros((3, 3, 3))
    weighted = np.empty((3, 3, 3))
    to_a = jacobians[0]
    to_b = jacobians[1]
    to_wheels = jacobians[2]
    to_a[2, 2] = -1.0
    to_b[2, 2] = 1.0
    for edge in range(count):
        a = edges.first[edge]
        b = edges.second[edge]
        error = errors[edge]
        information = edges.information[edge]
        _, scale = _scale(error, information, edges.width[edge])
        cos = np.cos(poses[a, 2])
        sin = np.sin(poses[a, 2])
        dx = poses[b, 0] - poses[a, 0]
        dy = poses[b, 1] - poses[a, 1]
        to_b[0, 0] = cos
        to_b[0, 1] = sin
        to_b[1, 0] = -sin
        to_b[1, 1] = cos
        to_a[0, 0] = -cos
        to_a[0, 1] = -sin
        to_a[0, 2] = cos * dy - sin * dx
        to_a[1, 0] = sin
        to_a[1, 1] = -cos
        to_a[1, 2] = -cos * dx - sin * dy
        to_wheels[:] = -edges.design[edge]
        ends = (a, b, last)
        for k in range(3):
            weighted[k] = 0.0
            add_product(information, jacobians[k], weighted[k])
            weighted[k] *= scale * scale
            for row in range(3):
                for i in range(3):
                    gradient[ends[k], row] += weighted[k, i, row] * error[i]
            add_product(jacobians[k], weighted[k], blocks[3 * count + ends[k]])
        add_product(to_a, weighted[1], blocks[edge])
        add_product(to_a, weighted[2], blocks[count + edge])
        add_product(to_b, weighted[2], blocks[2 * count + edge])
    for axis in range(3):
        blocks[3 * count, axis, axis] += FIXED
        blocks[3 * count + last, axis, axis] += prior[axis]
        gradient[last, axis] += prior[axis] * wheels[axis]
