"""Matching a scan against a map of end points: numba kernels.

The objective is GMapping's: the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the
beam's end point to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves
of shrinking step. Its top is biased: a beam that ends where nothing is mapped yet scores nothing, so a pose
that lags behind, whose beams end on known walls, scores more, and maps of corridors shrink. Here ICP steps
start at the predicted pose instead, and only beams that have found a wall pull: fully across the wall, weakly
along it. A short climb on a part of the beams follows only where that match is poor.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses (u, v, theta) are in cells and radians.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.end_points import surface_normals
from slamgym.slam.tiles import (
    COUNT,
    EMPTY,
    MEAN_U,
    MEAN_UNITS,
    MEAN_V,
    NEIGHBOURS,
    TILE_BITS,
    TILE_MASK,
    TilePool,
)

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""
TANGENT = 0.1
"""Weight of a distance along the surface against one across it. Along a wall the nearest mean says little,
but not nothing: without it, a scan that sees two parallel walls slides."""
SQUARE_WIDTH = 0.15
"""Closeness by which means are averaged is 1 / (this + d^2)^2 [cells^2]; 2 cm at 5 cm cells."""
CONVERGED_CELLS = 5e-3
CONVERGED_RAD = 2e-4
"""ICP stops when a step is smaller than 0.25 mm at 5 cm cells and 0.011 degrees."""
COARSE_STRIDE = 4
COARSE_HALVINGS = 2
COARSE_STEPS = 6
FINE_STEPS = 6
"""The first steps take every fourth point."""
CAPTURE_CELLS = 2.5
"""ICP finds a wall that lies about this far from where it is predicted."""
SURE_SHARES = 0.5, 0.1
UNSURE_SHARES = 0.95, 0.02
"""The climb is left out when the first match scores the first share of the points, and what it leads to must be
better by the second: where the prediction is good to within the capture range, and where it isn't. The climb
drags a pose to where more beams end on known walls, so it must not decide where it isn't needed."""


class MatchSettings(NamedTuple):
    """What the kernels need to know of :class:`slamgym.slam.config.SlamConfig`, in cells."""

    gain: float  # 1 / sigma [1/cells^2]
    likelihood_gain: float  # 1 / likelihood sigma [1/cells^2]
    miss: float  # log-likelihood of a beam with nothing near
    stride: int  # match every so many points
    linear_step: float  # [cells]
    angular_step: float  # [rad]
    halvings: int  # of GMapping's climb; negative for match_scan instead
    minimum_score: float
    odometry_weight: float


class Prior(NamedTuple):
    """The predicted pose and its pull, in units of the score."""

    u: float  # [cells]
    v: float  # [cells]
    theta: float  # [rad]
    stiffness: float  # [1/cells^2]
    turn_stiffness: float  # [1/rad^2]
    sure: bool  # whether the prediction is good to within the capture range


class Match(NamedTuple):
    """A pose and how well it fits."""

    u: float  # [cells]
    v: float  # [cells]
    theta: float  # [rad]
    score: float  # GMapping's, over the points taken
    log_likelihood: float  # GMapping's, over the points taken


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
    """exp(-x), from its series where that is good to 3e-4: within a 3 x 3 window the argument is small."""
    if x < 0.5:
        return 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))))
    return math.exp(-x)


@kernel
def surface_near(pool: TilePool, table: np.ndarray, u: float, v: float) -> tuple[float, float, float]:
    """The surface in the 3 x 3 cells round a point.

    Returns:
        Squared distance to the nearest cell mean, negative where the neighbourhood is empty [cells^2], and the
        offset to the middle of the surface [cells]: the average of the means by their counts and closeness. A
        wall seen from slightly wrong poses is smeared over two cells; the nearest of its means would hold a
        point anywhere within it.
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
    nearest, sum_u, sum_v, weight = 1e9, 0.0, 0.0, 0.0
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
        offset_u = cell_u - u + du + pool.cells[near, cell, MEAN_U] * (1.0 / MEAN_UNITS)
        offset_v = cell_v - v + dv + pool.cells[near, cell, MEAN_V] * (1.0 / MEAN_UNITS)
        d2 = offset_u * offset_u + offset_v * offset_v
        w = pool.cells[near, cell, COUNT] / ((SQUARE_WIDTH + d2) * (SQUARE_WIDTH + d2))
        sum_u += w * offset_u
        sum_v += w * offset_v
        weight += w
        nearest = min(nearest, d2)
    return nearest, sum_u / weight, sum_v / weight


@kernel
def score(
    pool: TilePool,
    table: np.ndarray,
    points: FloatArray,
    stride: int,
    u0: float,
    v0: float,
    theta: float,
    gain: float,
    to_beat: float,
) -> float:
    """GMapping's matching score of a pose over every ``stride``-th point; ``gain`` in 1/cells^2.

    The count starts at what a perfect fit would score and ends as soon as ``to_beat`` is out of reach; most
    poses that a climb tries lose, and show it early.
    """
    cos, sin = math.cos(theta), math.sin(theta)
    total = float((len(points) + stride - 1) // stride)
    for i in range(0, len(points), stride):
        u = u0 + cos * points[i, 0] - sin * points[i, 1]
        v = v0 + sin * points[i, 0] + cos * points[i, 1]
        d2, _, _ = surface_near(pool, table, u, v)
        total -= 1.0 - _exp_of_minus(gain * d2) if d2 >= 0.0 else 1.0
        if total <= to_beat:
            break
    return total


@kernel
def prior_cost(prior: Prior, u: float, v: float, theta: float) -> float:
    """What it costs to leave the predicted pose, in units of the score."""
    du, dv, turn = u - prior.u, v - prior.v, theta - prior.theta
    return 0.5 * (prior.stiffness * (du * du + dv * dv) + prior.turn_stiffness * turn * turn)


@kernel
def climb(
    pool: TilePool,
    table: np.ndarray,
    points: FloatArray,
    stride: int,
    prior: Prior,
    halvings: int,
    s: MatchSettings,
) -> tuple[float, float, float]:
    """GMapping's hill climbing: the best of six axis moves while there is one, then half the step.

    Returns:
        (u, v, theta) of the top.
    """
    u, v, theta = prior.u, prior.v, prior.theta
    linear_step, angular_step = s.linear_step, s.angular_step
    current = score(pool, table, points, stride, u, v, theta, s.gain, -1.0)
    halved = 0
    for _ in range(MAX_CLIMB_STEPS):
        best, best_u, best_v, best_theta = current, u, v, theta
        for move in range(6):
            sign = 1.0 if move % 2 == 0 else -1.0
            try_u = u + (sign * linear_step if move < 2 else 0.0)
            try_v = v + (sign * linear_step if 2 <= move < 4 else 0.0)
            try_theta = theta + (sign * angular_step if move >= 4 else 0.0)
            cost = prior_cost(prior, try_u, try_v, try_theta)
            value = score(pool, table, points, stride, try_u, try_v, try_theta, s.gain, best + cost) - cost
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
    return u, v, theta


@kernel
def _solve(
    a: float, b: float, c: float, d: float, e: float, f: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Solve [[a, b, d], [b, c, e], [d, e, f]] q = (x, y, z); zero where the matrix is singular."""
    m_aa, m_ab, m_ad = c * f - e * e, d * e - b * f, b * e - c * d
    determinant = a * m_aa + b * m_ab + d * m_ad
    if determinant < 1e-12:
        return 0.0, 0.0, 0.0
    m_bb, m_bd, m_dd = a * f - d * d, b * d - a * e, a * c - b * b
    return (
        (m_aa * x + m_ab * y + m_ad * z) / determinant,
        (m_ab * x + m_bb * y + m_bd * z) / determinant,
        (m_ad * x + m_bd * y + m_dd * z) / determinant,
    )


@kernel
def align(
    pool: TilePool,
    table: np.ndarray,
    points: FloatArray,
    normals: FloatArray,
    stride: int,
    u: float,
    v: float,
    theta: float,
    prior: Prior,
    steps: int,
    s: MatchSettings,
) -> Match:
    """Refine a pose by at most ``steps`` ICP steps; zero steps only evaluate it.

    Each step solves for the motion that brings the points to the surface near them, weighted by the objective's
    own weights exp(-d^2 / sigma), against the pull of the prior: one Gauss-Newton step. The last pose is
    returned, not the one that scored best on the way: the score counts beams that end on known walls, and to
    choose by it is to lag behind.

    Args:
        pool: The tiles.
        table: (rows, cols) int32, the map.
        points: (n, 2) end points in the robot frame [cells].
        normals: (n, 2) unit normals of the surface there in the robot frame, zero for none.
        stride: Take every so many points.
        u: Pose to begin with.
        v: Pose to begin with.
        theta: Pose to begin with.
        prior: The pull of the predicted pose.
        steps: Most steps.
        s: Settings.
    """
    match = Match(u, v, theta, 0.0, 0.0)
    force = 2.0 * s.gain
    for step in range(steps + 1):
        cos, sin = math.cos(theta), math.sin(theta)
        total, likelihood = 0.0, 0.0
        uu = uv = vv = ut = vt = tt = 0.0  # normal equations
        r_u = r_v = r_t = 0.0
        for i in range(0, len(points), stride):
            x = cos * points[i, 0] - sin * points[i, 1]
            y = sin * points[i, 0] + cos * points[i, 1]
            d2, du, dv = surface_near(pool, table, u + x, v + y)
            if d2 < 0.0:
                likelihood += s.miss
                continue
            likelihood -= s.likelihood_gain * d2
            w = _exp_of_minus(s.gain * d2)
            total += w
            # Information of this pair: full across the surface, TANGENT along it; both without a normal.
            n_u = cos * normals[i, 0] - sin * normals[i, 1]
            n_v = sin * normals[i, 0] + cos * normals[i, 1]
            along = TANGENT if n_u != 0.0 or n_v != 0.0 else 1.0
            i_uu = w * (n_u * n_u * (1.0 - along) + along)
            i_uv = w * (n_u * n_v * (1.0 - along))
            i_vv = w * (n_v * n_v * (1.0 - along) + along)
            # A turn moves the point by (-y, x).
            i_ut, i_vt = i_uv * x - i_uu * y, i_vv * x - i_uv * y
            uu += i_uu
            uv += i_uv
            vv += i_vv
            ut += i_ut
            vt += i_vt
            tt += i_vt * x - i_ut * y
            f_u, f_v = i_uu * du + i_uv * dv, i_uv * du + i_vv * dv
            r_u += f_u
            r_v += f_v
            r_t += x * f_v - y * f_u
        match = Match(u, v, theta, total, likelihood)
        if total == 0.0 or step == steps:
            break
        k, k_t = prior.stiffness, prior.turn_stiffness
        move_u, move_v, turn = _solve(
            force * uu + k + 1e-6,  # where nothing binds, nothing moves
            force * uv,
            force * vv + k + 1e-6,
            force * ut,
            force * vt,
            force * tt + k_t + 1e-6,
            force * r_u - k * (u - prior.u),
            force * r_v - k * (v - prior.v),
            force * r_t - k_t * (theta - prior.theta),
        )
        u, v, theta = u + move_u, v + move_v, theta + turn
        if abs(move_u) + abs(move_v) < CONVERGED_CELLS and abs(turn) < CONVERGED_RAD:
            break
    return match


@kernel
def match_scan(
    pool: TilePool,
    table: np.ndarray,
    points: FloatArray,
    normals: FloatArray,
    prior: Prior,
    s: MatchSettings,
) -> Match:
    """Match a scan: ICP on a part of the beams, if it fits poorly a climb and ICP again, then ICP on all.

    Args:
        pool: The tiles.
        table: (rows, cols) int32, the map.
        points: (n, 2) end points in the robot frame [cells].
        normals: (n, 2) unit normals of the surface there in the robot frame, zero for none.
        prior: The predicted pose and its pull.
        s: Settings.
    """
    stride = COARSE_STRIDE * s.stride
    # A part of the beams scores a part of the points.
    stiffness, turn_stiffness = prior.stiffness / COARSE_STRIDE, prior.turn_stiffness / COARSE_STRIDE
    soft = Prior(prior.u, prior.v, prior.theta, stiffness, turn_stiffness, prior.sure)
    near = align(pool, table, points, normals, stride, prior.u, prior.v, prior.theta, soft, COARSE_STEPS, s)
    num_points = (len(points) + stride - 1) // stride
    accepted, better = SURE_SHARES if prior.sure else UNSURE_SHARES
    if near.score < accepted * num_points:
        u, v, theta = climb(pool, table, points, stride, soft, COARSE_HALVINGS, s)
        far = align(pool, table, points, normals, stride, u, v, theta, soft, COARSE_STEPS, s)
        if far.score > near.score + better * num_points:
            near = far
    return align(pool, table, points, normals, s.stride, near.u, near.v, near.theta, prior, FINE_STEPS, s)


@kernel
def match_particles(
    pool: TilePool,
    tables: np.ndarray,
    poses: FloatArray,
    points: FloatArray,
    origin: FloatArray,
    resolution: float,
    variance: float,
    turn_variance: float,
    s: MatchSettings,
    log_likelihoods: FloatArray,
) -> int:
    """Move each particle to the best match of the scan with the particle's own map.

    Args:
        pool: The tiles.
        tables: (particles, rows, cols) int32.
        poses: (particles, 3) predicted [m, m, rad], changed in place where the match scores above the
            minimum.
        points: (n, 2) end points in the robot frame, in the order of the beams [m].
        origin: (2,) lower left corner of the tables [m].
        resolution: Cell size [m].
        variance: Of the predicted position [m^2].
        turn_variance: Of the predicted heading [rad^2].
        s: Settings.
        log_likelihoods: (particles,) receives the log-likelihood at the final pose.

    Returns:
        How many particles were matched; the others keep their pose.
    """
    scale = 1.0 / resolution
    scaled = points * scale
    normals = np.empty_like(points)
    surface_normals(points, normals)
    stiffness = s.odometry_weight * resolution * resolution / variance
    turn_stiffness = s.odometry_weight / turn_variance
    # How far off an end point is predicted, for one standard deviation of the position and one of the heading.
    square = 0.0
    for i in range(len(scaled)):
        square += (scaled[i, 0] ** 2 + scaled[i, 1] ** 2) / len(scaled)
    sure = math.sqrt(variance) * scale + math.sqrt(turn_variance * square) < CAPTURE_CELLS
    matched = 0
    for p in range(len(poses)):
        u, v = (poses[p, 0] - origin[0]) * scale, (poses[p, 1] - origin[1]) * scale
        prior = Prior(u, v, poses[p, 2], stiffness, turn_stiffness, sure)
        if s.halvings < 0:
            match = match_scan(pool, tables[p], scaled, normals, prior, s)
        else:
            u, v, theta = climb(pool, tables[p], scaled, s.stride, prior, s.halvings, s)
            match = align(pool, tables[p], scaled, normals, s.stride, u, v, theta, prior, 0, s)
        if match.score > s.minimum_score:
            poses[p, 0] = origin[0] + match.u * resolution
            poses[p, 1] = origin[1] + match.v * resolution
            poses[p, 2] = match.theta
            matched += 1
        else:
            match = align(
                pool, tables[p], scaled, normals, s.stride, prior.u, prior.v, prior.theta, prior, 0, s
            )
        log_likelihoods[p] = match.log_likelihood
    return matched
