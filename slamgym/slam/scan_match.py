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
    NearMeans,
    Prior,
    climb,
    empty_means,
)
from slamgym.slam.near_surfaces import (
    BLOCK_POINTS,
    Block,
    add_up,
    average_means,
    copy_cells,
    empty_block,
    see_points,
    weigh,
)
from slamgym.slam.tiles import TileMaps, TilePool

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
    block: Block  # to look them up in


class Match(NamedTuple):
    """A pose and how well it fits."""

    pose: CellPose
    score: float  # GMapping's, over the points taken
    log_likelihood: float  # GMapping's, over the points taken
    binding: tuple[float, float, float, float, float, float]
    """Normal matrix of the points: uu, uv, vv, ut, vt, tt of [[uu, uv, ut], [uv, vv, vt], [ut, vt, tt]]."""


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
    cells = pool.cells.view(np.uint64).reshape(pool.cells.shape[:2])  # a cell as one number
    block = scan.block
    sums = block.sums
    u, v, theta = start
    match = Match(start, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    force = 2.0 * s.gain
    for step in range(steps + 1):
        sums[:] = 0.0
        for begin in range(0, len(points), stride * BLOCK_POINTS):
            count = min(BLOCK_POINTS, (len(points) - begin + stride - 1) // stride)
            see_points(points, normals, begin, stride, theta, block, count)
            copy_cells(cells, table, u, v, block, count)
            average_means(block, count)
            weigh(block, count, s.gain)
            add_up(block, count, s.miss, s.likelihood_gain)
        likelihood, total, r_u, r_v, r_t = sums[0], sums[1], sums[8], sums[9], sums[10]
        uu, uv, vv, ut, vt, tt = sums[2], sums[3], sums[4], sums[5], sums[6], sums[7]  # normal equations
        match = Match(CellPose(u, v, theta), total, likelihood, (uu, uv, vv, ut, vt, tt))
        if total == 0.0 or step == steps:
            break
        k, k_t = prior.stiffness, prior.turn_stiffness
        least = 1e-6  # where nothing binds, nothing moves
        move_u, move_v, turn = _solve(
            force * uu + k + least, force * uv, force * vv + k + least,
            force * ut, force * vt, force * tt + k_t + least,
            force * r_u - k * (u - prior.pose.u),
            force * r_v - k * (v - prior.pose.v),
            force * r_t - k_t * (theta - prior.pose.theta),
        )  # fmt: skip
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
def _cell_scan(points: FloatArray, scale: float) -> CellScan:
    """A scan (n, 2) [m] for cells of 1 / scale."""
    normals = np.empty_like(points)
    surface_normals(points, normals)
    return CellScan(points * scale, normals, empty_block())


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
    scan = _cell_scan(points, scale)
    scaled = scan.points
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
        if not s.only_climbs:
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
    maps: TileMaps, particle: int, pose: FloatArray, points: FloatArray, s: MatchSettings, out: FloatArray
) -> None:
    """Align a scan from where it was matched, without the pull of the odometry: what the scan alone says.

    Args:
        maps: The particles' maps.
        particle: Whose map.
        pose: (3,) the match [m, m, rad].
        points: (n, 2) end points in the robot frame, in the order of the beams [m].
        s: Settings.
        out: (10,) receives the pose, the score and what the points bind, the entries
            of a symmetric matrix in the order of :attr:`Match.binding` [1], [m] and [m^2].
    """
    parts, tables, origin, resolution = maps
    pool, s = TilePool(*parts), MatchSettings(*s)
    scale = 1.0 / resolution
    start = CellPose((pose[0] - origin[0]) * scale, (pose[1] - origin[1]) * scale, pose[2])
    free = Prior(start, 0.0, 0.0, True)
    match = align(pool, tables[particle], _cell_scan(points, scale), s.stride, start, free, FINE_STEPS, s)
    out[0], out[1] = origin[0] + match.pose.u * resolution, origin[1] + match.pose.v * resolution
    out[2], out[3] = match.pose.theta, match.score
    uu, uv, vv, ut, vt, tt = match.binding
    out[4], out[5], out[6] = uu, uv, vv
    out[7], out[8], out[9] = ut * resolution, vt * resolution, tt * resolution**2
