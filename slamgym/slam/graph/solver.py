"""Least squares over a graph of planar poses and the systematic errors of the wheels: Levenberg-Marquardt.

The error of an edge is the relative pose it measured, compared with the one the graph implies (Grisetti et al. 2010,
*A Tutorial on Graph-Based SLAM*, eq. 30-33). What the odometry measured is corrected by its systematic errors, which
are ``K`` more unknowns (Censi et al. 2013, *Simultaneous calibration of odometry and sensor parameters*); they border
the sparse matrix of the poses. Edges that may be false are scaled by dynamic covariance scaling (Agarwal et al. 2013),
so that they lose their pull instead of bending the map.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel, plain
from slamgym.core.portable import inverted, product
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.graph.factor import Factor, add_product, make_layout
from slamgym.slam.graph.relative import Match, nearest_turn, relative_jacobian

FIXED = 1e12
"""Information of the first node, which stays where it is."""
LEAST_DAMPING = 1e-7
"""Damping of the first step: next to none."""
FIRST_DAMPING = 1e-5
"""Damping after a first step that made it worse."""
MOST_DAMPING = 1e3
"""With more damping than this no step makes it better."""
GRADUATION = (1000.0, 100.0, 10.0)
"""After a closure the width shrinks by these factors: a large true correction isn't taken for a false one."""
DAMPING_FACTOR = 10.0
"""The damping grows by this factor after a step that made it worse, and shrinks by it after one that made it better."""


class Edges(NamedTuple):
    """Measured relative poses; ``E`` edges."""

    first: IntArray  # (E,) node whose frame the measurement is in
    second: IntArray  # (E,) node that was measured
    measured: FloatArray  # (E, 3) pose of the second node seen from the first [m, m, rad]
    information: FloatArray  # (E, 3, 3) inverse covariance, in the frame of the first node
    design: FloatArray  # (E, 3, K) change of the measurement by the odometry's errors; zero where the laser measured
    width: FloatArray  # (E,) chi-squared beyond which the edge loses its pull; infinite where it is sure

    @staticmethod
    def of(matches: Sequence[Match], width: float) -> "Edges":
        """What the laser measured, where the wheels' errors are known."""
        count = len(matches)
        return Edges(
            first=np.array([match.old for match in matches], dtype=np.int64),
            second=np.array([match.new for match in matches], dtype=np.int64),
            measured=np.array([match.measured for match in matches]).reshape(-1, 3),
            information=np.array([match.information for match in matches]).reshape(-1, 3, 3),
            design=np.zeros((count, 3, 3)),
            width=np.full(count, width),
        )

    def joined(self, other: "Edges") -> "Edges":
        """These and others."""
        return Edges(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


class Solution(NamedTuple):
    """A minimum, and the factor of the normal equations there."""

    poses: FloatArray  # (N, 3)
    wheels: FloatArray  # (K,)
    factor: Factor  # of the nodes, as if the wheels' errors were known
    levers: FloatArray  # (N, 3, K) how each node would move with those errors, with the sign turned
    wheels_covariance: FloatArray  # (K, K)

    def covariance(self, node: int, other: int) -> FloatArray:
        """Covariance (3, 3) of a node with another one."""
        known = self.factor.covariance(node, other)
        by_wheels = product(self.levers[node], self.wheels_covariance)
        return known + product(by_wheels, self.levers[other].T)


def approach(
    poses: FloatArray, wheels: FloatArray, edges: Edges, places: IntArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Poses and errors of the wheels from which :func:`optimise` goes on, where edges may disagree much with them."""
    for factor in GRADUATION:
        wide = edges._replace(width=edges.width * factor)
        rough = optimise(poses, wheels, wide, places, prior, 4, 1e-3)
        poses = rough.poses
        wheels = rough.wheels
    return poses, wheels


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
        wheels: (K,) initial values.
        edges: At least one path of edges must lead from node 0 to every node.
        places: From :func:`slamgym.slam.graph.factor.elimination_order`.
        prior: (K,) information of the wheels' errors being zero.
        iterations: Most Levenberg-Marquardt steps.
        tolerance: Stop when no pose moves further than this [m, rad].
    """
    layout = make_layout(places, edges.first, edges.second)
    count = len(edges.first)
    systematic = len(wheels)
    axes = np.arange(3)
    damping = LEAST_DAMPING
    cost = total_cost(poses, wheels, plain(edges), prior)
    for _ in range(iterations):
        blocks, right, corner = linearise(poses, wheels, plain(edges), prior)
        on_diagonal = blocks[count:]
        diagonal = on_diagonal[:, axes, axes]
        undamped = layout.factorise(blocks)
        solved = undamped.solve(right)
        known = inverted(_reduced(corner, right, solved)[:, 1:])
        levers = solved[..., 1:]
        while True:
            if damping > LEAST_DAMPING:
                on_diagonal[:, axes, axes] = diagonal * (1.0 + damping)
                solved = layout.factorise(blocks).solve(right)
            reduced = _reduced(corner, right, solved)
            wheel_step = product(inverted(reduced[:, 1:]), reduced[:, :1])
            step = solved[..., 0] - product(
                solved[..., 1:].reshape(-1, systematic), wheel_step
            ).reshape(-1, 3)
            moved = poses - step
            headings = wrap_angle(moved[:, 2])
            moved[0] = poses[0]
            moved[:, 2] = headings
            changed = wheels - wheel_step[:, 0]
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
        if np.abs(step).max() < tolerance:
            break
    return Solution(poses, wheels, undamped, levers, known)


def _reduced(corner: FloatArray, right: FloatArray, solved: FloatArray) -> FloatArray:
    """Gradient and normal matrix (K, 1 + K) of the wheels' errors once the poses are eliminated."""
    columns = right.shape[2]
    border = right[..., 1:].reshape(-1, columns - 1)
    return corner - product(border.T, solved.reshape(-1, columns))


@kernel
def edge_errors(poses: FloatArray, wheels: FloatArray, edges: Edges) -> FloatArray:
    """Compute implied minus measured relative poses (E, 3), in the frame of each first node.

    Args:
        poses: (N, 3)
        wheels: (K,) systematic errors.
        edges: The graph's.
    """
    edges = Edges(*edges)
    errors = np.empty(edges.measured.shape)
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
            for col in range(len(wheels)):
                error[row] -= edges.design[edge, row, col] * wheels[col]
        error[2] = nearest_turn(error[2])
    return errors


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
    errors = edge_errors(poses, wheels, edges)
    edges = Edges(*edges)
    for edge in range(len(errors)):
        chi2, scale = _scale(errors[edge], edges.information[edge], edges.width[edge])
        total += scale * scale * chi2
        if scale < 1.0:
            total += edges.width[edge] * (1.0 - scale) ** 2
    for axis in range(len(wheels)):
        total += prior[axis] * wheels[axis] * wheels[axis]
    return total


@kernel
def linearise(
    poses: FloatArray, wheels: FloatArray, edges: Edges, prior: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the normal equations of ``E`` edges, ``N`` nodes and ``K`` errors of the wheels.

    Args:
        poses: (N, 3)
        wheels: (K,)
        edges: The graph's.
        prior: (K,) information of the wheels' errors being zero.

    Returns:
        The blocks of each edge's ends, and those on the diagonal, (E + N, 3, 3); the gradient, and the blocks of the
        nodes with the wheels, (N, 3, 1 + K); the gradient of the wheels' errors, and their block, (K, 1 + K).
    """
    errors = edge_errors(poses, wheels, edges)
    edges = Edges(*edges)
    count = len(errors)
    size = len(poses)
    systematic = len(wheels)
    blocks = np.zeros((count + size, 3, 3))
    right = np.zeros((size, 3, 1 + systematic))
    corner = np.zeros((systematic, 1 + systematic))
    jacobian = np.zeros((3, 6))
    to_a = jacobian[:, :3]
    to_b = jacobian[:, 3:]
    by = np.empty((3, 6))
    by_a = by[:, :3]
    by_b = by[:, 3:]
    # The error, and its change by the wheels.
    change = np.empty((3, 1 + systematic))
    for edge in range(count):
        a = edges.first[edge]
        b = edges.second[edge]
        information = edges.information[edge]
        _, scale = _scale(errors[edge], information, edges.width[edge])
        relative_jacobian(poses[a], poses[b], jacobian)
        by[:] = 0.0
        add_product(information, to_a, by_a)
        add_product(information, to_b, by_b)
        by *= scale * scale
        add_product(to_a, by_a, blocks[count + a])
        add_product(to_b, by_b, blocks[count + b])
        add_product(to_a, by_b, blocks[edge])
        columns = 1
        change[:, 0] = errors[edge]
        if edges.design[edge].any():
            columns += systematic
            change[:, 1:] = -edges.design[edge]
        for col in range(columns):
            for i in range(3):
                pulled = 0.0
                for row in range(3):
                    right[a, row, col] += by_a[i, row] * change[i, col]
                    right[b, row, col] += by_b[i, row] * change[i, col]
                    pulled += information[i, row] * change[row, col]
                pulled *= scale * scale
                for k in range(1, columns):
                    corner[k - 1, col] += change[i, k] * pulled
    for axis in range(3):
        blocks[count, axis, axis] += FIXED
    for axis in range(systematic):
        corner[axis, 0] += prior[axis] * wheels[axis]
        corner[axis, 1 + axis] += prior[axis]
    return blocks, right, corner
