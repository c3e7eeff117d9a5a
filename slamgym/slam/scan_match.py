"""Matching a scan against a map of end points: numba kernels.

The objective is GMapping's: the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the
beam's end point to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves of
shrinking step. Its top is biased: a beam that ends where nothing is mapped yet scores nothing, so a pose that
lags behind, whose beams end on known walls, scores more, and maps of corridors shrink. Here ICP steps start at
the predicted pose instead, and only pull on beams that have found a wall; across the wall fully, along it
weakly. A short climb on a part of the beams follows only where that match is poor.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians here.
"""

import math

import numpy as np

from slamgym.jit import kernel
from slamgym.slam.tiles import EMPTY, MEAN_U, MEAN_UNITS, MEAN_V, NEIGHBOURS, TILE_BITS, TILE_MASK, TilePool
from slamgym.types import Float32Array, FloatArray

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""
NORMAL_REACH = 3
NORMAL_GAP = 0.2
NORMAL_THICKNESS = 0.03
"""A surface normal comes from up to so many points on either side, each within this gap of the next [m], if they
lie on a line this thin [m]."""
TANGENT = 0.1
"""Weight of a distance along the surface against one across it. Along a wall the nearest mean says little, but
not nothing: without it, a scan that sees two parallel walls slides."""
CONVERGED_CELLS = 5e-3
CONVERGED_RAD = 2e-4
"""ICP stops when a step is smaller than 0.25 mm at 5 cm cells and 0.011 degrees."""
COARSE_STRIDE = 4
COARSE_HALVINGS = 2
COARSE_STEPS = 6
FINE_STEPS = 6
"""The first steps take every fourth point."""
ACCEPTED_SHARE = 0.95
BETTER_SHARE = 0.02
"""The climb is left out when the first match scores this share of the points; its own match must be better by
this share."""


def _neighbour_lists() -> tuple[np.ndarray, np.ndarray]:
    """For each 9-bit neighbourhood, how many bits it has and which ones."""
    numbers, lists = np.zeros(512, dtype=np.int8), np.zeros((512, 9), dtype=np.int8)
    for bits in range(512):
        members = [k for k in range(9) if bits >> k & 1]
        numbers[bits] = len(members)
        lists[bits, : len(members)] = members
    return numbers, lists


_NUM_NEIGHBOURS, _NEIGHBOURS = _neighbour_lists()
_DU = np.arange(9) % 3 - 1
_DV = np.arange(9) // 3 - 1


@kernel
def _exp_of_minus(x: float) -> float:
    """exp(-x), from its series where that is good to 1e-4: within a 3 x 3 window the argument is small."""
    if x < 0.5:
        return 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))))
    return math.exp(-x)


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
def surface_normals(points: FloatArray, out: FloatArray) -> None:
    """Unit normals of the surface at each end point, from the points beside it; zero where it isn't straight.

    Args:
        points: (n, 2) end points in the order of the beams [m].
        out: (n, 2) receives the normals.
    """
    n = len(points)
    for i in range(n):
        out[i, 0] = out[i, 1] = 0.0
        first, last = i, i
        for _ in range(NORMAL_REACH):
            if (
                first > 0
                and math.hypot(
                    points[first - 1, 0] - points[first, 0], points[first - 1, 1] - points[first, 1]
                )
                < NORMAL_GAP
            ):
                first -= 1
            if (
                last < n - 1
                and math.hypot(points[last + 1, 0] - points[last, 0], points[last + 1, 1] - points[last, 1])
                < NORMAL_GAP
            ):
                last += 1
        count = last - first + 1
        if count < 3:
            continue
        mean_x = mean_y = xx = xy = yy = 0.0
        for j in range(first, last + 1):
            mean_x += points[j, 0]
            mean_y += points[j, 1]
        mean_x /= count
        mean_y /= count
        for j in range(first, last + 1):
            dx, dy = points[j, 0] - mean_x, points[j, 1] - mean_y
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        half_trace, half_gap = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        thickness = (half_trace - half_gap) / count
        spread = (half_trace + half_gap) / count
        if thickness > NORMAL_THICKNESS**2 or spread < 4.0 * thickness:
            continue
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
        out[i, 0], out[i, 1] = math.cos(angle), math.sin(angle)


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
    bits = pool.cells[tile, (in_v << TILE_BITS) | in_u, NEIGHBOURS]
    if bits == 0:
        return -1.0, 0.0, 0.0
    best, best_u, best_v = 1e9, 0.0, 0.0
    base_u, base_v = cell_u - u, cell_v - v
    inside = 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK
    for b in range(_NUM_NEIGHBOURS[bits]):
        k = _NEIGHBOURS[bits, b]
        du, dv = _DU[k], _DV[k]
        if inside:
            near, cell = tile, ((in_v + dv) << TILE_BITS) | (in_u + du)
        else:
            near_u, near_v = cell_u + du, cell_v + dv
            near = table[near_v >> TILE_BITS, near_u >> TILE_BITS]
            cell = ((near_v & TILE_MASK) << TILE_BITS) | (near_u & TILE_MASK)
        offset_u = base_u + du + pool.cells[near, cell, MEAN_U] * (1.0 / MEAN_UNITS)
        offset_v = base_v + dv + pool.cells[near, cell, MEAN_V] * (1.0 / MEAN_UNITS)
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
            total += _exp_of_minus(gain * d2)
    return total


@kernel
def climb(
    pool: TilePool, table: np.ndarray, points: FloatArray, stride: int, u0: float, v0: float, theta0: float,
    linear_step: float, angular_step: float, halvings: int, gain: float, stiffness: float, turn_stiffness: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """GMapping's hill climbing: the best of six axis moves while there is one, then half the step.

    The prior's share is scaled down with ``stride``, as the score is.

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
            value = score(pool, table, points, stride, try_u, try_v, try_theta, gain) - prior_cost(
                try_u - u0, try_v - v0, try_theta - theta0, stiffness / stride, turn_stiffness / stride
            )
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
def prior_cost(du: float, dv: float, turn: float, stiffness: float, turn_stiffness: float) -> float:
    """What it costs to leave the predicted pose, in units of the score."""
    return 0.5 * (stiffness * (du * du + dv * dv) + turn_stiffness * turn * turn)


@kernel
def align(
    pool: TilePool, table: np.ndarray, points: FloatArray, normals: FloatArray, stride: int, u0: float, v0: float, theta0: float,
    prior_u: float, prior_v: float, prior_theta: float, steps: int, gain: float, stiffness: float,
    turn_stiffness: float, likelihood_gain: float, miss: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Refine a pose by at most ``steps`` ICP steps; zero steps only evaluate it.

    Each step solves for the motion that brings the points to their nearest means, weighted by the objective's
    own weights exp(-d^2 / sigma), against the pull of the prior: one Gauss-Newton step. The best pose met is
    returned, so a step that loses is never kept.

    Returns:
        (u, v, theta, score, log-likelihood) of that pose. The log-likelihood is GMapping's: -d^2 / likelihood
        sigma per matched beam and ``miss`` per beam with nothing near.
    """
    u, v, theta = u0, v0, theta0
    best_u, best_v, best_theta, best_score, best_likelihood, best_value = u, v, theta, 0.0, 0.0, -1e9
    force = 2.0 * gain
    for step in range(steps + 1):
        cos, sin = math.cos(theta), math.sin(theta)
        total, fit, likelihood = 0.0, 0.0, 0.0
        uu = uv = vv = ut = vt = tt = 0.0
        r_u = r_v = r_turn = 0.0
        for i in range(0, len(points), stride):
            x = cos * points[i, 0] - sin * points[i, 1]
            y = sin * points[i, 0] + cos * points[i, 1]
            d2, du, dv = nearest_mean(pool, table, u + x, v + y)
            if d2 < 0.0:
                likelihood += miss
                continue
            likelihood -= likelihood_gain * d2
            w = _exp_of_minus(gain * d2)
            total += w
            # Information of this pair: full across the surface, TANGENT along it; isotropic without a normal.
            n_u = cos * normals[i, 0] - sin * normals[i, 1]
            n_v = sin * normals[i, 0] + cos * normals[i, 1]
            if n_u == 0.0 and n_v == 0.0:
                i_uu, i_uv, i_vv = w, 0.0, w
            else:
                i_uu = w * (n_u * n_u * (1.0 - TANGENT) + TANGENT)
                i_uv = w * (n_u * n_v * (1.0 - TANGENT))
                i_vv = w * (n_v * n_v * (1.0 - TANGENT) + TANGENT)
            i_ut, i_vt = i_uv * x - i_uu * y, i_vv * x - i_uv * y
            uu += i_uu
            uv += i_uv
            vv += i_vv
            ut += i_ut
            vt += i_vt
            tt += i_vt * x - i_ut * y
            f_u, f_v = i_uu * du + i_uv * dv, i_uv * du + i_vv * dv
            fit += w - gain * (f_u * du + f_v * dv) + gain * w * d2
            r_u += f_u
            r_v += f_v
            r_turn += x * f_v - y * f_u
        value = fit - prior_cost(u - prior_u, v - prior_v, theta - prior_theta, stiffness, turn_stiffness)
        if value > best_value:
            best_u, best_v, best_theta, best_score, best_likelihood, best_value = (
                u,
                v,
                theta,
                total,
                likelihood,
                value,
            )
        if total == 0.0 or step == steps:
            break
        # Normal equations of sum w |J step - residual|^2, where a point moves by (du - y turn, dv + x turn).
        a, b, c = force * uu + stiffness + 1e-6, force * uv, force * vv + stiffness + 1e-6
        d, e, f = force * ut, force * vt, force * tt + turn_stiffness + 1e-6
        g_u = force * r_u - stiffness * (u - prior_u)
        g_v = force * r_v - stiffness * (v - prior_v)
        g_t = force * r_turn - turn_stiffness * (theta - prior_theta)
        m_uu, m_uv, m_ut = c * f - e * e, d * e - b * f, b * e - c * d
        m_vv, m_vt, m_tt = a * f - d * d, b * d - a * e, a * c - b * b
        determinant = a * m_uu + b * m_uv + d * m_ut
        if determinant < 1e-12:
            break
        move_u = (m_uu * g_u + m_uv * g_v + m_ut * g_t) / determinant
        move_v = (m_uv * g_u + m_vv * g_v + m_vt * g_t) / determinant
        turn = (m_ut * g_u + m_vt * g_v + m_tt * g_t) / determinant
        u, v, theta = u + move_u, v + move_v, theta + turn
        if abs(move_u) + abs(move_v) < CONVERGED_CELLS and abs(turn) < CONVERGED_RAD:
            break
    return best_u, best_v, best_theta, best_score, best_likelihood


@kernel
def match_scan(
    pool: TilePool, table: np.ndarray, points: FloatArray, normals: FloatArray, stride: int, u0: float, v0: float,
    theta0: float, linear_step: float, angular_step: float, gain: float, stiffness: float, turn_stiffness: float,
    likelihood_gain: float, miss: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Match a scan from a predicted pose: ICP; where that fits poorly, a climb and ICP from its top; ICP on all.

    Returns:
        As :func:`align`.
    """
    coarse = COARSE_STRIDE * stride
    soft, turn_soft = stiffness / COARSE_STRIDE, turn_stiffness / COARSE_STRIDE
    u, v, theta, value, _ = align(
        pool, table, points, normals, coarse, u0, v0, theta0, u0, v0, theta0, COARSE_STEPS, gain, soft, turn_soft,
        likelihood_gain, miss,
    )  # fmt: skip
    num_coarse = (len(points) + coarse - 1) // coarse
    if value < ACCEPTED_SHARE * num_coarse:
        u1, v1, theta1, _ = climb(
            pool, table, points, coarse, u0, v0, theta0, linear_step, angular_step, COARSE_HALVINGS, gain, stiffness,
            turn_stiffness,
        )  # fmt: skip
        u1, v1, theta1, value1, _ = align(
            pool, table, points, normals, coarse, u1, v1, theta1, u0, v0, theta0, COARSE_STEPS, gain, soft,
            turn_soft, likelihood_gain, miss,
        )  # fmt: skip
        if value1 > value + BETTER_SHARE * num_coarse:
            u, v, theta = u1, v1, theta1
    return align(
        pool, table, points, normals, stride, u, v, theta, u0, v0, theta0, FINE_STEPS, gain, stiffness,
        turn_stiffness, likelihood_gain, miss,
    )  # fmt: skip


@kernel
def match_particles(
    pool: TilePool, tables: np.ndarray, poses: FloatArray, points: FloatArray, origin: FloatArray, resolution: float,
    stride: int, halvings: int, linear_step: float, angular_step: float, sigma: float, likelihood_sigma: float,
    minimum_score: float, stiffness: float, turn_stiffness: float, log_likelihoods: FloatArray,
) -> int:  # fmt: skip
    """Move each particle to the best match of the scan with the particle's own map.

    Args:
        pool: The tiles.
        tables: (particles, rows, cols) int32.
        poses: (particles, 3) [m, m, rad], changed in place where the match scores above ``minimum_score``.
        points: (n, 2) end points in the robot frame, in the order of the beams [m].
        origin: (2,) lower left corner of the tables [m].
        resolution: Cell size [m].
        stride: Take every so many points (1: all).
        halvings: Times GMapping's climb halves its steps; negative for :func:`match_scan` instead of it.
        linear_step: First step of the climb [m].
        angular_step: First step of the climb [rad].
        sigma: Width of the score [m^2].
        likelihood_sigma: Width of the likelihood [m^2].
        minimum_score: Score that a match needs.
        stiffness: Pull of the predicted position, in units of the score [1/m^2].
        turn_stiffness: Pull of the predicted heading, in units of the score [1/rad^2].
        log_likelihoods: (particles,) receives the log-likelihood at the final pose.

    Returns:
        How many particles were matched; the others keep their pose.
    """
    scale = 1.0 / resolution
    scaled = points * scale
    normals = np.empty_like(points)
    surface_normals(points, normals)
    gain, likelihood_gain = resolution * resolution / sigma, resolution * resolution / likelihood_sigma
    miss = -0.5 / likelihood_sigma
    stiffness *= resolution * resolution
    matched = 0
    for p in range(len(poses)):
        table = tables[p]
        start_u, start_v = (poses[p, 0] - origin[0]) * scale, (poses[p, 1] - origin[1]) * scale
        start_theta = poses[p, 2]
        if halvings < 0:
            u, v, theta, value, likelihood = match_scan(
                pool, table, scaled, normals, stride, start_u, start_v, start_theta, linear_step * scale,
                angular_step, gain, stiffness, turn_stiffness, likelihood_gain, miss,
            )  # fmt: skip
        else:
            u, v, theta, _ = climb(
                pool, table, scaled, stride, start_u, start_v, start_theta, linear_step * scale, angular_step,
                halvings, gain, stiffness, turn_stiffness,
            )  # fmt: skip
            _, _, _, value, likelihood = align(
                pool, table, scaled, normals, stride, u, v, theta, u, v, theta, 0, gain, 0.0, 0.0, likelihood_gain,
                miss,
            )  # fmt: skip
        if value > minimum_score:
            poses[p, 0] = origin[0] + u * resolution
            poses[p, 1] = origin[1] + v * resolution
            poses[p, 2] = theta
            matched += 1
        else:
            _, _, _, _, likelihood = align(
                pool, table, scaled, normals, stride, start_u, start_v, start_theta, start_u, start_v, start_theta,
                0, gain, 0.0, 0.0, likelihood_gain, miss,
            )  # fmt: skip
        log_likelihoods[p] = likelihood
    return matched
