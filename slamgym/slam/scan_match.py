"""Matching a scan against a map of end points: numba kernels.

GMapping's objective (:mod:`slamgym.slam.hill_climbing`) has a biased top: a beam that ends where nothing is
mapped yet scores nothing, so a pose that lags behind, whose beams end on known walls, scores more, and maps of
corridors shrink. Here ICP steps start at the predicted pose instead, and only beams that have found a wall pull:
fully across the wall, weakly along it. A short climb on a part of the beams follows only where that match is
poor.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.end_points import surface_normals
from slamgym.slam.hill_climbing import (
    CellPose,
    MatchSettings,
    Prior,
    Search,
    climb,
    exp_of_minus,
    surface_near,
)
from slamgym.slam.near_means import NearMeans, empty_means
from slamgym.slam.near_surfaces import (
    BLOCK, FARTHEST, IN_U, IN_V, NORMAL_U, NORMAL_V, NOTHING, PULL_T, PULL_U, PULL_V, SQUARE, TO_U, TO_V, TT, UT, UU, UV, VT, VV, WEIGHT, X, Y,
    average_means, copy_cells, room_for_surfaces,
)
from slamgym.slam.tiles import TileMaps, TilePool

TANGENT = 0.1
"""Weight of a distance along the surface against one across it. Along a wall the nearest mean says little,
but not nothing: without it, a scan that sees two parallel walls slides."""
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


class CellScan(NamedTuple):
    """A scan's end points in the robot frame, in the order of the beams."""

    points: FloatArray  # (n, 2) [cells]
    normals: FloatArray  # (n, 2) unit normals of the surface there, zero for none


class NormalEquations(NamedTuple):
    """The symmetric matrix [[uu, uv, ut], [uv, vv, vt], [ut, vt, tt]]."""

    uu: float
    uv: float
    vv: float
    ut: float
    vt: float
    tt: float


class Match(NamedTuple):
    """A pose and how well it fits."""

    pose: CellPose
    score: float  # GMapping's, over the points taken
    log_likelihood: float  # GMapping's, over the points taken
    binding: NormalEquations  # what the points bind


@kernel
def _solve(h: NormalEquations, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Solve h q = (x, y, z); zero where the matrix is singular."""
    a, b, c, d, e, f = h.uu, h.uv, h.vv, h.ut, h.vt, h.tt
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
def _pulls(rows: FloatArray, count: int, gain: float) -> None:
    """Weight, information and pull of a block's first points."""
    if gain * FARTHEST < 0.5:
        for j in range(np.uint64(count)):
            g = gain * rows[np.uint64(SQUARE) + j]
            rows[np.uint64(WEIGHT) + j] = 1.0 - g * (1.0 - g * (0.5 - g * (1.0 / 6.0 - g * (1.0 / 24.0))))
    else:
        for j in range(np.uint64(count)):
            rows[np.uint64(WEIGHT) + j] = exp_of_minus(gain * rows[np.uint64(SQUARE) + j])
    for j in range(np.uint64(count)):
        x, y, w = rows[np.uint64(X) + j], rows[np.uint64(Y) + j], rows[np.uint64(WEIGHT) + j]
        n_u, n_v = rows[np.uint64(NORMAL_U) + j], rows[np.uint64(NORMAL_V) + j]
        du, dv = rows[np.uint64(TO_U) + j], rows[np.uint64(TO_V) + j]
        # Information of this pair: full across the surface, TANGENT along it; both without a normal.
        along = TANGENT if n_u != 0.0 or n_v != 0.0 else 1.0
        i_uu = w * (n_u * n_u * (1.0 - along) + along)
        i_uv = w * (n_u * n_v * (1.0 - along))
        i_vv = w * (n_v * n_v * (1.0 - along) + along)
        # A turn moves the point by (-y, x).
        i_ut, i_vt = i_uv * x - i_uu * y, i_vv * x - i_uv * y
        rows[np.uint64(UU) + j] = i_uu
        rows[np.uint64(UV) + j] = i_uv
        rows[np.uint64(VV) + j] = i_vv
        rows[np.uint64(UT) + j] = i_ut
        rows[np.uint64(VT) + j] = i_vt
        rows[np.uint64(TT) + j] = i_vt * x - i_ut * y
        f_u, f_v = i_uu * du + i_uv * dv, i_uv * du + i_vv * dv
        rows[np.uint64(PULL_U) + j] = f_u
        rows[np.uint64(PULL_V) + j] = f_v
        rows[np.uint64(PULL_T) + j] = x * f_v - y * f_u


@kernel
def align(
    pool: TilePool,
    table: np.ndarray,
    scan: CellScan,
    stride: int,
    start: CellPose,
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
        scan: The scan.
        stride: Take every so many points.
        start: Pose to begin with.
        prior: The pull of the predicted pose.
        steps: Most steps.
        s: Settings.
    """
    points, normals = scan.points, scan.normals
    cells = pool.cells.view(np.uint64).reshape(pool.cells.shape[0], pool.cells.shape[1])
    room = room_for_surfaces()
    words, rows = room
    u, v, theta = start
    match = Match(start, 0.0, 0.0, NormalEquations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    force = 2.0 * s.gain
    for step in range(steps + 1):
        cos, sin = math.cos(theta), math.sin(theta)
        total, likelihood = 0.0, 0.0
        uu = uv = vv = ut = vt = tt = 0.0  # normal equations
        r_u = r_v = r_t = 0.0
        for begin in range(0, len(points), stride * BLOCK):
            count = min(BLOCK, (len(points) - begin + stride - 1) // stride)
            for j in range(count):
                i = np.uint64(begin + j * stride)
                at = np.uint64(j)
                p_x, p_y = points[i, 0], points[i, 1]
                x = cos * p_x - sin * p_y
                y = sin * p_x + cos * p_y
                rows[np.uint64(X) + at], rows[np.uint64(Y) + at] = x, y
                n_x, n_y = normals[i, 0], normals[i, 1]
                rows[np.uint64(NORMAL_U) + at] = cos * n_x - sin * n_y
                rows[np.uint64(NORMAL_V) + at] = sin * n_x + cos * n_y
            copy_cells(cells, table, u, v, room, count)
            average_means(words, rows, count)
            _pulls(rows, count, s.gain)
            for j in range(np.uint64(count)):
                d2 = rows[np.uint64(SQUARE) + j]
                if d2 == NOTHING:
                    likelihood += s.miss
                    continue
                likelihood -= s.likelihood_gain * d2
                total += rows[np.uint64(WEIGHT) + j]
                uu += rows[np.uint64(UU) + j]
                uv += rows[np.uint64(UV) + j]
                vv += rows[np.uint64(VV) + j]
                ut += rows[np.uint64(UT) + j]
                vt += rows[np.uint64(VT) + j]
                tt += rows[np.uint64(TT) + j]
                r_u += rows[np.uint64(PULL_U) + j]
                r_v += rows[np.uint64(PULL_V) + j]
                r_t += rows[np.uint64(PULL_T) + j]
        match = Match(CellPose(u, v, theta), total, likelihood, NormalEquations(uu, uv, vv, ut, vt, tt))
        if total == 0.0 or step == steps:
            break
        k, k_t = prior.stiffness, prior.turn_stiffness
        move_u, move_v, turn = _solve(
            NormalEquations(
                force * uu + k + 1e-6,  # where nothing binds, nothing moves
                force * uv,
                force * vv + k + 1e-6,
                force * ut,
                force * vt,
                force * tt + k_t + 1e-6,
            ),
            force * r_u - k * (u - prior.pose.u),
            force * r_v - k * (v - prior.pose.v),
            force * r_t - k_t * (theta - prior.pose.theta),
        )
        u, v, theta = u + move_u, v + move_v, theta + turn
        if abs(move_u) + abs(move_v) < CONVERGED_CELLS and abs(turn) < CONVERGED_RAD:
            break
    return match


@kernel
def match_scan(
    pool: TilePool, table: np.ndarray, memory: NearMeans, scan: CellScan, prior: Prior, s: MatchSettings
) -> Match:
    """Match a scan: ICP on a part of the beams, if it fits poorly a climb and ICP again, then ICP on all.

    Args:
        pool: The tiles.
        table: (rows, cols) int32, the map.
        memory: What a climb looks up.
        scan: The scan.
        prior: The predicted pose and its pull.
        s: Settings.
    """
    stride = COARSE_STRIDE * s.stride
    # A part of the beams scores a part of the points.
    stiffness, turn_stiffness = prior.stiffness / COARSE_STRIDE, prior.turn_stiffness / COARSE_STRIDE
    soft = Prior(prior.pose, stiffness, turn_stiffness, prior.sure)
    near = align(pool, table, scan, stride, prior.pose, soft, COARSE_STEPS, s)
    num_points = (len(scan.points) + stride - 1) // stride
    accepted, better = SURE_SHARES if prior.sure else UNSURE_SHARES
    if near.score < accepted * num_points:
        top = climb(pool, table, memory, scan.points, stride, soft, COARSE_HALVINGS, s)
        far = align(pool, table, scan, stride, top, soft, COARSE_STEPS, s)
        if far.score > near.score + better * num_points:
            near = far
    return align(pool, table, scan, s.stride, near.pose, prior, FINE_STEPS, s)


@kernel
def match_particles(
    maps: TileMaps,
    poses: FloatArray,
    points: FloatArray,
    variance: float,
    turn_variance: float,
    s: MatchSettings,
    log_likelihoods: FloatArray,
) -> int:
    """Move each particle to the best match of the scan with the particle's own map.

    Args:
        maps: The particles' maps.
        poses: (particles, 3) predicted [m, m, rad], changed in place where the match scores above the
            minimum.
        points: (n, 2) end points in the robot frame, in the order of the beams [m].
        variance: Of the predicted position [m^2].
        turn_variance: Of the predicted heading [rad^2].
        s: Settings.
        log_likelihoods: (particles,) receives the log-likelihood at the final pose.

    Returns:
        How many particles were matched; the others keep their pose.
    """
    parts, tables, origin, resolution = maps
    pool, s = TilePool(*parts), MatchSettings(*s)
    scale = 1.0 / resolution
    scaled = points * scale
    normals = np.empty_like(points)
    surface_normals(points, normals)
    scan = CellScan(scaled, normals)
    stiffness = s.odometry_weight * resolution * resolution / variance
    turn_stiffness = s.odometry_weight / turn_variance
    # How far off an end point is predicted, for one standard deviation of the position and one of the heading.
    square = 0.0
    for i in range(len(scaled)):
        square += (scaled[i, 0] ** 2 + scaled[i, 1] ** 2) / len(scaled)
    sure = math.sqrt(variance) * scale + math.sqrt(turn_variance * square) < CAPTURE_CELLS
    memory = empty_means()
    matched = 0
    for p in range(len(poses)):
        u, v = (poses[p, 0] - origin[0]) * scale, (poses[p, 1] - origin[1]) * scale
        prior = Prior(CellPose(u, v, poses[p, 2]), stiffness, turn_stiffness, sure)
        if s.search == Search.COARSE_TO_FINE:
            match = match_scan(pool, tables[p], memory, scan, prior, s)
        else:
            top = climb(pool, tables[p], memory, scaled, s.stride, prior, s.halvings, s)
            match = align(pool, tables[p], scan, s.stride, top, prior, 0, s)
        if match.score > s.minimum_score:
            poses[p, 0] = origin[0] + match.pose.u * resolution
            poses[p, 1] = origin[1] + match.pose.v * resolution
            poses[p, 2] = match.pose.theta
            matched += 1
        else:
            match = align(pool, tables[p], scan, s.stride, prior.pose, prior, 0, s)
        log_likelihoods[p] = match.log_likelihood
    return matched


@kernel
def align_freely(
    maps: TileMaps,
    particle: int,
    pose: FloatArray,
    points: FloatArray,
    s: MatchSettings,
    out: FloatArray,
) -> None:
    """Align a scan from where it was matched, without the pull of the odometry: what the scan alone says.

    Args:
        maps: The particles' maps.
        particle: Whose map.
        pose: (3,) the match [m, m, rad].
        points: (n, 2) end points in the robot frame, in the order of the beams [m].
        s: Settings.
        out: (10,) receives the pose, the score and what the points bind, the entries
            of a symmetric matrix in the order of :class:`NormalEquations` [1], [m] and [m^2].
    """
    parts, tables, origin, resolution = maps
    pool, s = TilePool(*parts), MatchSettings(*s)
    scale = 1.0 / resolution
    normals = np.empty_like(points)
    surface_normals(points, normals)
    start = CellPose((pose[0] - origin[0]) * scale, (pose[1] - origin[1]) * scale, pose[2])
    free = Prior(start, 0.0, 0.0, True)
    match = align(
        pool, tables[particle], CellScan(points * scale, normals), s.stride, start, free, FINE_STEPS, s
    )
    out[0], out[1] = origin[0] + match.pose.u * resolution, origin[1] + match.pose.v * resolution
    out[2], out[3] = match.pose.theta, match.score
    h = match.binding
    out[4], out[5], out[6] = h.uu, h.uv, h.vv
    out[7], out[8], out[9] = h.ut * resolution, h.vt * resolution, h.tt * resolution**2
