"""Least squares over a graph of planar poses: sparse Levenberg-Marquardt with robust edges.

The error of an edge is the relative pose it measured, compared with the one the graph implies (Grisetti et
al. 2010, *A Tutorial on Graph-Based SLAM*, eq. 30-33). Loop closures are scaled by dynamic covariance scaling
(Agarwal et al. 2013), so that a false one loses its pull instead of bending the map.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Edges:
    """Measured relative poses; ``E`` edges."""

    first: IntArray  # (E,) node whose frame the measurement is in
    second: IntArray  # (E,) node that was measured
    measured: FloatArray  # (E, 3) pose of the second node seen from the first [m, m, rad]
    information: FloatArray  # (E, 3, 3) inverse covariance, in the frame of the first node
    robust: BoolArray  # (E,) whether the edge may be false and is scaled when it disagrees


def edge_errors(poses: FloatArray, edges: Edges) -> FloatArray:
    """Implied minus measured relative poses, (E, 3), in the frame of each first node."""
    a, b = poses[edges.first], poses[edges.second]
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    implied = np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy, b[:, 2] - a[:, 2]])
    error: FloatArray = implied - edges.measured
    error[:, 2] = wrap_angle(error[:, 2])
    return error


def chi_squared(poses: FloatArray, edges: Edges) -> FloatArray:
    """Squared Mahalanobis length of each edge's error, (E,)."""
    error = edge_errors(poses, edges)
    return np.asarray(np.einsum("ei,eij,ej->e", error, edges.information, error), dtype=np.float64)


def optimise(
    poses: FloatArray, edges: Edges, robust_width: float = 5.0, iterations: int = 15, tolerance: float = 1e-4
) -> FloatArray:
    """Find the poses that agree best with the edges; the first node stays where it is.

    Args:
        poses: Initial values, shape (N, 3).
        edges: At least one path of edges must lead from node 0 to every node.
        robust_width: Phi of dynamic covariance scaling: a robust edge is scaled down once its chi-squared
            exceeds this.
        iterations: Most Levenberg-Marquardt steps.
        tolerance: Stop when no pose moves further than this [m, rad].

    Returns:
        The poses, shape (N, 3).
    """
    poses = poses.copy()
    if len(poses) < 2 or len(edges.first) == 0:
        return poses
    damping = 1e-6
    cost = _cost(poses, edges, robust_width)
    for _ in range(iterations):
        hessian, gradient = _normal_equations(poses, edges, robust_width)
        for _ in range(6):
            step = _solve(hessian, gradient, damping)
            moved = poses.copy()
            moved[1:] -= step.reshape(-1, 3)
            moved[1:, 2] = wrap_angle(moved[1:, 2])
            new_cost = _cost(moved, edges, robust_width)
            if new_cost <= cost:
                break
            damping = max(damping * 10.0, 1e-6)
        else:
            break  # no step makes it better
        largest = float(np.abs(step).max())
        poses, cost, damping = moved, new_cost, damping * 0.1
        if largest < tolerance:
            break
    return poses


def scaling(chi2: FloatArray, edges: Edges, robust_width: float) -> FloatArray:
    """The factor s^2 of dynamic covariance scaling for each edge, (E,); 1 where it isn't robust (eq. 15)."""
    scale = np.minimum(1.0, 2.0 * robust_width / (robust_width + chi2))
    return np.where(edges.robust, scale**2, 1.0)


def _cost(poses: FloatArray, edges: Edges, robust_width: float) -> float:
    """The objective of dynamic covariance scaling: s^2 chi2 + phi (1 - s)^2, summed."""
    chi2 = chi_squared(poses, edges)
    squared = scaling(chi2, edges, robust_width)
    return float((squared * chi2 + robust_width * (1.0 - np.sqrt(squared)) ** 2).sum())


def _normal_equations(poses: FloatArray, edges: Edges, robust_width: float) -> tuple[csc_matrix, FloatArray]:
    """J^T W J and J^T W e without node 0."""
    a, b = edges.first, edges.second
    error = edge_errors(poses, edges)
    chi2 = np.einsum("ei,eij,ej->e", error, edges.information, error)
    weight = edges.information * scaling(chi2, edges, robust_width)[:, None, None]
    jacobian_a, jacobian_b = _jacobians(poses, edges)
    weighted_a = np.einsum("eki,ekj->eij", jacobian_a, weight)  # J^T W, (E, 3, 3)
    weighted_b = np.einsum("eki,ekj->eij", jacobian_b, weight)
    size = 3 * (len(poses) - 1)
    gradient = np.zeros(size + 3)
    np.add.at(gradient.reshape(-1, 3), a, np.einsum("eij,ej->ei", weighted_a, error))
    np.add.at(gradient.reshape(-1, 3), b, np.einsum("eij,ej->ei", weighted_b, error))
    blocks = np.concatenate(
        [weighted_a @ jacobian_a, weighted_a @ jacobian_b, weighted_b @ jacobian_a, weighted_b @ jacobian_b]
    )
    block_rows, block_cols = np.concatenate([a, a, b, b]), np.concatenate([a, b, a, b])
    free = (block_rows > 0) & (block_cols > 0)
    inner = np.arange(3)
    rows, cols = np.broadcast_arrays(
        3 * (block_rows[free, None, None] - 1) + inner[:, None],
        3 * (block_cols[free, None, None] - 1) + inner,
    )
    hessian = csc_matrix((blocks[free].ravel(), (rows.ravel(), cols.ravel())), shape=(size, size))
    return hessian, gradient[3:]


def _jacobians(poses: FloatArray, edges: Edges) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the errors by the first and by the second pose, each (E, 3, 3)."""
    a, b = poses[edges.first], poses[edges.second]
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    first, second = np.zeros((len(a), 3, 3)), np.zeros((len(a), 3, 3))
    second[:, :2, :2] = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
    first[:, :2, :2] = -second[:, :2, :2]
    first[:, 0, 2], first[:, 1, 2] = -sin * dx + cos * dy, -cos * dx - sin * dy
    first[:, 2, 2], second[:, 2, 2] = -1.0, 1.0
    return first, second


def turned_covariance(covariance: FloatArray, angle: float) -> FloatArray:
    """A covariance (3, 3) of a pose, in a frame that is turned."""
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(rotation @ covariance @ rotation.T, dtype=np.float64)


def _solve(hessian: csc_matrix, gradient: FloatArray, damping: float) -> FloatArray:
    damped = hessian.copy()
    damped.setdiag(hessian.diagonal() * (1.0 + damping) + 1e-9)
    # The matrix is symmetric and positive: minimum degree on its pattern, no pivoting off the diagonal.
    factor = splu(damped, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(factor.solve(gradient), dtype=np.float64)
