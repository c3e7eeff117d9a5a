"""Matching a scan against a map of end points: numba kernels.

The objective is GMapping's: the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the
beam's end point to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves of
shrinking step; here a short climb on a part of the beams finds the right hill, and ICP steps (weighted
closed-form alignment of the end points to their nearest means, which is a fixed-point iteration of the same
objective) find its top in fewer evaluations.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians here.
"""

import math

import numpy as np

from slamgym.jit import kernel
from slamgym.slam.tiles import EMPTY, TILE_BITS, TILE_MASK, TilePool
from slamgym.types import Float32Array, FloatArray

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""
CONVERGED_CELLS = 2e-3
CONVERGED_RAD = 1e-4
"""ICP stops when a step is smaller than 0.1 mm at 5 cm cells and 0.006 degrees."""


def _neighbour_lists() -> tuple[np.ndarray, np.ndarray]:
    """For each 9-bit neighbourhood, how many bits it has and which ones."""
    numbers, lists = np.zeros(512, dtype=np.int8), np.zeros((512, 9), dtype=np.int8)
    for bits in range(512):
        members = [k for k in range(9) if bits >> k & 1]
        numbers[bits] = len(members)
        lists[bits, : len(members)] = members
    return numbers, lists


_NUM_NEIGHBOURS, _NEIGHBOURS = _neighbour_lists()


@kernel
def usable_end_points(
    ranges: Float32Array, directions: FloatArray, mount: FloatArray, range_min: float, range_max: float, out: FloatArray
) -> int:  # fmt: skip
    """End points of the beams that can be matched, in the robot frame.

    Args:
        ranges: (num_beams,) [m]; infinite and nan beams are left out.
        directions: (num_beams, 2) unit vectors of the beams in the robot frame.
        mount: (2,) sensor position in the robot frame [m].
        range_min: Smallest range taken [m].
        range_max: Largest range taken [m].
        out: (num_beams, 2) receives the points [m].

    Returns:
        The number of points.
    """
    n = 0
    for i in range(len(ranges)):
        r = ranges[i]
        if r >= range_min and r <= range_max:
            out[n, 0] = mount[0] + r * directions[i, 0]
            out[n, 1] = mount[1] + r * directions[i, 1]
            n += 1
    return n


@kernel
def nearest_mean(pool: TilePool, table: np.ndarray, u: float, v: float) -> tuple[float, float, float]:
    """Squared distance to, and offset of, the nearest cell mean in the 3 x 3 cells round a point.

    Returns:
        (d^2, du, dv) [cells]; d^2 is negative where the neighbourhood is empty.
    """
    cell_u, cell_v = int(u), int(v)
    row, col = cell_v >> TILE_BITS, cell_u >> TILE_BITS
    if u < 1.0 or v < 1.0 or row >= table.shape[0] or col >= table.shape[1]:
        return -1.0, 0.0, 0.0
    tile = table[row, col]
    if tile == EMPTY:
        return -1.0, 0.0, 0.0
    in_v, in_u = cell_v & TILE_MASK, cell_u & TILE_MASK
    bits = pool.neighbours[tile, (in_v << TILE_BITS) | in_u]
    if bits == 0:
        return -1.0, 0.0, 0.0
    best, best_u, best_v = 1e9, 0.0, 0.0
    base_u, base_v = cell_u - 1 - u, cell_v - 1 - v
    inside = 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK
    for b in range(_NUM_NEIGHBOURS[bits]):
        k = _NEIGHBOURS[bits, b]
        dv = k // 3
        du = k - 3 * dv
        if inside:
            near, cell = tile, ((in_v + dv - 1) << TILE_BITS) | (in_u + du - 1)
        else:
            near_u, near_v = cell_u + du - 1, cell_v + dv - 1
            near = table[near_v >> TILE_BITS, near_u >> TILE_BITS]
            cell = ((near_v & TILE_MASK) << TILE_BITS) | (near_u & TILE_MASK)
        offset_u = base_u + du + pool.means[near, cell, 0]
        offset_v = base_v + dv + pool.means[near, cell, 1]
        d2 = offset_u * offset_u + offset_v * offset_v
        if d2 < best:
            best, best_u, best_v = d2, offset_u, offset_v
    return best, best_u, best_v


@kernel
def score(
    pool: TilePool, table: np.ndarray, points: FloatArray, stride: int, u0: float, v0: float, theta: float, gain: float
) -> float:  # fmt: skip
    """GMapping's matching score of a pose, over every ``stride``-th point; ``gain`` is 1 / sigma [1/cells^2]."""
    cos, sin = math.cos(theta), math.sin(theta)
    total = 0.0
    for i in range(0, len(points), stride):
        u = u0 + cos * points[i, 0] - sin * points[i, 1]
        v = v0 + sin * points[i, 0] + cos * points[i, 1]
        d2, _, _ = nearest_mean(pool, table, u, v)
        if d2 >= 0.0:
            total += math.exp(-gain * d2)
    return total


@kernel
def climb(
    pool: TilePool, table: np.ndarray, points: FloatArray, stride: int, u0: float, v0: float, theta0: float,
    linear_step: float, angular_step: float, halvings: int, gain: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """GMapping's hill climbing: the best of six axis moves while there is one, then half the step.

    Returns:
        (u, v, theta, score) of the top.
    """
    u, v, theta = u0, v0, theta0
    current = score(pool, table, points, stride, u, v, theta, gain)
    halved = 0
    for _ in range(MAX_CLIMB_STEPS):
        best, best_u, best_v, best_theta = current, u, v, theta
        for move in range(6):
            sign = 1.0 if move % 2 == 0 else -1.0
            try_u = u + (sign * linear_step if move < 2 else 0.0)
            try_v = v + (sign * linear_step if 2 <= move < 4 else 0.0)
            try_theta = theta + (sign * angular_step if move >= 4 else 0.0)
            value = score(pool, table, points, stride, try_u, try_v, try_theta, gain)
            if value > best:
                best, best_u, best_v, best_theta = value, try_u, try_v, try_theta
        if best > current:
            current, u, v, theta = best, best_u, best_v, best_theta
            continue
        halved += 1
        if halved > halvings:
            break
        linear_step *= 0.5
        angular_step *= 0.5
    return u, v, theta, current


@kernel
def align(
    pool: TilePool, table: np.ndarray, points: FloatArray, stride: int, u0: float, v0: float, theta0: float,
    steps: int, gain: float, likelihood_gain: float, miss: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Refine a pose by at most ``steps`` ICP steps; zero steps only evaluate it.

    Each step solves the weighted orthogonal Procrustes problem in closed form, with the objective's own weights
    exp(-d^2 / sigma). The best pose met is returned, so a step that loses is never kept.

    Returns:
        (u, v, theta, score, log-likelihood) of that pose. The log-likelihood is GMapping's: -d^2 / likelihood
        sigma per matched beam and ``miss`` per beam with nothing near.
    """
    u0_best, v0_best, theta_best, score_best, likelihood_best = u0, v0, theta0, -1.0, 0.0
    for step in range(steps + 1):
        cos, sin = math.cos(theta0), math.sin(theta0)
        total, likelihood = 0.0, 0.0
        sum_x = sum_y = sum_u = sum_v = dot = cross = 0.0
        for i in range(0, len(points), stride):
            x = cos * points[i, 0] - sin * points[i, 1]
            y = sin * points[i, 0] + cos * points[i, 1]
            d2, du, dv = nearest_mean(pool, table, u0 + x, v0 + y)
            if d2 < 0.0:
                likelihood += miss
                continue
            likelihood -= likelihood_gain * d2
            w = math.exp(-gain * d2)
            total += w
            sum_x += w * x
            sum_y += w * y
            sum_u += w * du
            sum_v += w * dv
            # The rotation wants target (x + du, y + dv) against source (x, y).
            dot += w * (x * (x + du) + y * (y + dv))
            cross += w * (x * dv - y * du)
        if total > score_best:
            u0_best, v0_best, theta_best, score_best, likelihood_best = u0, v0, theta0, total, likelihood
        if total == 0.0 or step == steps:
            break
        mean_x, mean_y, mean_u, mean_v = sum_x / total, sum_y / total, sum_u / total, sum_v / total
        turn = math.atan2(
            cross - total * (mean_x * mean_v - mean_y * mean_u),
            dot - total * (mean_x * (mean_x + mean_u) + mean_y * (mean_y + mean_v)),
        )
        turn_cos, turn_sin = math.cos(turn), math.sin(turn)
        move_u = mean_u + mean_x - (turn_cos * mean_x - turn_sin * mean_y)
        move_v = mean_v + mean_y - (turn_sin * mean_x + turn_cos * mean_y)
        u0, v0, theta0 = u0 + move_u, v0 + move_v, theta0 + turn
        if abs(move_u) + abs(move_v) < CONVERGED_CELLS and abs(turn) < CONVERGED_RAD:
            break
    return u0_best, v0_best, theta_best, score_best, likelihood_best


@kernel
def match_particles(
    pool: TilePool, tables: np.ndarray, poses: FloatArray, points: FloatArray, origin: FloatArray, resolution: float,
    stride: int, coarse_stride: int, halvings: int, icp_steps: int, linear_step: float, angular_step: float,
    sigma: float, likelihood_sigma: float, minimum_score: float, log_likelihoods: FloatArray,
) -> int:  # fmt: skip
    """Move each particle to the best match of the scan with the particle's own map.

    Args:
        pool: The tiles.
        tables: (particles, rows, cols) int32.
        poses: (particles, 3) [m, m, rad], changed in place where the match scores above ``minimum_score``.
        points: (n, 2) end points in the robot frame [m].
        origin: (2,) lower left corner of the tables [m].
        resolution: Cell size [m].
        stride: Take every so many points (1: all).
        coarse_stride: The climb takes every so many points.
        halvings: Times the climb halves its steps.
        icp_steps: Most ICP steps after the climb.
        linear_step: First step of the climb [m].
        angular_step: First step of the climb [rad].
        sigma: Width of the score [m^2].
        likelihood_sigma: Width of the likelihood [m^2].
        minimum_score: Score that a match needs.
        log_likelihoods: (particles,) receives the log-likelihood at the final pose.

    Returns:
        How many particles were matched; the others keep their pose.
    """
    scale = 1.0 / resolution
    scaled = points * scale
    gain, likelihood_gain = resolution * resolution / sigma, resolution * resolution / likelihood_sigma
    miss = -0.5 / likelihood_sigma
    matched = 0
    for p in range(len(poses)):
        table = tables[p]
        start_u, start_v = (poses[p, 0] - origin[0]) * scale, (poses[p, 1] - origin[1]) * scale
        u, v, theta, _ = climb(
            pool, table, scaled, coarse_stride, start_u, start_v, poses[p, 2], linear_step * scale, angular_step,
            halvings, gain,
        )  # fmt: skip
        u, v, theta, value, likelihood = align(
            pool, table, scaled, stride, u, v, theta, icp_steps, gain, likelihood_gain, miss
        )
        if value > minimum_score:
            poses[p, 0] = origin[0] + u * resolution
            poses[p, 1] = origin[1] + v * resolution
            poses[p, 2] = theta
            matched += 1
        else:
            _, _, _, _, likelihood = align(
                pool, table, scaled, stride, start_u, start_v, poses[p, 2], 0, gain, likelihood_gain, miss
            )
        log_likelihoods[p] = likelihood
    return matched
