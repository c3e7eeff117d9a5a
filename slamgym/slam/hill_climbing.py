"""GMapping's scan matcher, hill climbing over a map of end points: numba kernels.

The objective is the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the beam's end point
to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves of shrinking step.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.tiles import (
    EMPTY,
    MEAN_U,
    MEAN_UNITS,
    MEAN_V,
    NEIGHBOURS,
    TILE_BITS,
    TILE_MASK,
    TileMaps,
    TilePool,
)

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""
FIRST_TURN = 0.05
"""First step of the search in heading [rad] (GMapping's ``astep``)."""


class MatchSettings(NamedTuple):
    """Settings from :class:`slamgym.slam.config.SlamConfig` that the kernels need, in cells."""

    gain: float  # 1 / sigma [1/cells^2]
    likelihood_gain: float  # 1 / likelihood sigma [1/cells^2]
    miss: float  # log-likelihood of a beam with nothing near
    stride: int  # match every so many points
    linear_step: float  # [cells]
    halvings: int  # of the steps
    minimum_score: float


class CellPose(NamedTuple):
    """A pose in a particle's map."""

    u: float  # [cells]
    v: float  # [cells]
    theta: float  # [rad]


@kernel
def nearest_square(cells: np.ndarray, table: np.ndarray, u: float, v: float) -> float:
    """Squared distance from a point to the nearest mean in the 3 x 3 cells round it [cells^2]; infinite without any.

    Args:
        cells: The pool's cells.
        table: (rows, cols) int32, the map.
        u: The point [cells].
        v: The same upwards.
    """
    nearest = math.inf
    if not (u >= 1.0 and v >= 1.0):
        return nearest
    cell_u = int(u)
    cell_v = int(v)
    row = cell_v >> TILE_BITS
    col = cell_u >> TILE_BITS
    if row >= table.shape[0] or col >= table.shape[1] or table[row, col] == EMPTY:
        return nearest
    tile = np.uint64(table[row, col])
    at_u = cell_u & TILE_MASK
    at_v = cell_v & TILE_MASK
    own = np.uint64((at_v << TILE_BITS) | at_u)
    neighbours = np.uint64(cells[tile, own, np.uint64(NEIGHBOURS)])
    inside = 0 < at_u < TILE_MASK and 0 < at_v < TILE_MASK
    in_u = u - cell_u
    in_v = v - cell_v
    for k in range(9):
        if neighbours & np.uint64(1 << k):
            near_u = k % 3 - 1
            near_v = k // 3 - 1
            if not inside:
                near_row = (cell_v + near_v) >> TILE_BITS
                near_col = (cell_u + near_u) >> TILE_BITS
                tile = np.uint64(table[near_row, near_col])
            to_u = (at_u + near_u) & TILE_MASK
            to_v = (at_v + near_v) & TILE_MASK
            cell = np.uint64((to_v << TILE_BITS) | to_u)
            mean_u = cells[tile, cell, np.uint64(MEAN_U)] * (1.0 / MEAN_UNITS)
            mean_v = cells[tile, cell, np.uint64(MEAN_V)] * (1.0 / MEAN_UNITS)
            du = near_u + mean_u - in_u
            dv = near_v + mean_v - in_v
            nearest = min(nearest, du * du + dv * dv)
    return nearest


@kernel
def exp_of_minus(x: float) -> float:
    """exp(-x), from its series where that is good to 3e-4: within a 3 x 3 window the argument is small."""
    if x < 0.5:
        return 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))))
    return math.exp(-x)


@kernel
def turn_points(points: FloatArray, theta: float, out: FloatArray) -> None:
    """Turn points (2, n) by theta."""
    cos = math.cos(theta)
    sin = math.sin(theta)
    for i in range(points.shape[1]):
        out[0, i] = cos * points[0, i] - sin * points[1, i]
        out[1, i] = sin * points[0, i] + cos * points[1, i]


@kernel
def score(
    cells: np.ndarray,
    table: np.ndarray,
    turned: FloatArray,
    u: float,
    v: float,
    gain: float,
    to_beat: float,
) -> float:
    """GMapping's matching score of a position; ``gain`` in 1/cells^2.

    The count starts at what a perfect fit would score and ends as soon as ``to_beat`` is out of reach; most
    poses that a climb tries lose, and show it early.

    Args:
        cells: The pool's cells.
        table: (rows, cols) int32, the map.
        turned: (2, n) end points, turned to the heading of the pose [cells].
        u: Position [cells].
        v: The same upwards.
        gain: 1 / sigma [1/cells^2].
        to_beat: Score to give up below.
    """
    total = float(turned.shape[1])
    for i in range(turned.shape[1]):
        square = nearest_square(cells, table, u + turned[0, i], v + turned[1, i])
        total -= 1.0 - exp_of_minus(gain * square) if square < math.inf else 1.0
        if total <= to_beat:
            break
    return total


@kernel
def climb(
    pool: TilePool, table: np.ndarray, points: FloatArray, start: CellPose, s: MatchSettings
) -> tuple[CellPose, float]:
    """GMapping's hill climbing: the best of six axis moves while there is one, then half the step.

    Args:
        pool: The tiles.
        table: (rows, cols) int32, the map.
        points: (2, n) end points in the robot frame [cells].
        start: Where to begin.
        s: Settings.

    Returns:
        The top and its score.
    """
    pose = start
    linear_step = s.linear_step
    angular_step = FIRST_TURN
    ahead = np.empty_like(points)  # turned to the heading of the pose
    aside = np.empty_like(points)  # to that of a trial
    turn_points(points, pose.theta, ahead)
    current = score(pool.cells, table, ahead, pose.u, pose.v, s.gain, -1.0)
    halved = 0
    back = -1
    for _ in range(MAX_CLIMB_STEPS):
        best = current
        best_pose = pose
        best_move = -1
        for move in range(6):
            if move == back:
                continue  # where the climb came from, and lower
            sign = 1.0 if move % 2 == 0 else -1.0
            du = sign * linear_step if move < 2 else 0.0
            dv = sign * linear_step if 2 <= move < 4 else 0.0
            turn = sign * angular_step if move >= 4 else 0.0
            trial = CellPose(pose.u + du, pose.v + dv, pose.theta + turn)
            if move >= 4:
                turn_points(points, trial.theta, aside)
            turned = ahead if move < 4 else aside
            value = score(pool.cells, table, turned, trial.u, trial.v, s.gain, best)
            if value > best:
                best = value
                best_pose = trial
                best_move = move
        if best_move >= 0:
            current = best
            pose = best_pose
            back = best_move ^ 1
            if best_move >= 4:
                turn_points(points, pose.theta, ahead)
            continue
        halved += 1
        if halved > s.halvings:
            break
        back = -1
        linear_step *= 0.5
        angular_step *= 0.5
    return pose, current


@kernel
def log_likelihood(
    pool: TilePool, table: np.ndarray, points: FloatArray, pose: CellPose, s: MatchSettings
) -> float:
    """GMapping's log-likelihood of a scan at a pose: the sum over beams of -d^2 / sigma.

    Args:
        pool: The tiles.
        table: (rows, cols) int32, the map.
        points: (2, n) end points in the robot frame [cells].
        pose: The pose.
        s: Settings.
    """
    turned = np.empty_like(points)
    total = 0.0
    turn_points(points, pose.theta, turned)
    for i in range(points.shape[1]):
        square = nearest_square(pool.cells, table, pose.u + turned[0, i], pose.v + turned[1, i])
        total += s.miss if square == math.inf else -s.likelihood_gain * square
    return total


@kernel
def match_particles(
    maps: TileMaps,
    poses: FloatArray,
    points: FloatArray,
    s: MatchSettings,
    log_likelihoods: FloatArray,
) -> int:
    """Move each particle to the best match of the scan with the particle's own map.

    Args:
        maps: The particles' maps.
        poses: (particles, 3) predicted [m, m, rad], changed in place where the match scores above the minimum.
        points: (n, 2) end points in the robot frame [m].
        s: Settings.
        log_likelihoods: (particles,) receives the log-likelihood at the final pose.

    Returns:
        Number of particles that were matched; the others keep their pose.
    """
    parts, tables, origin, resolution = maps
    pool = TilePool(*parts)
    s = MatchSettings(*s)
    scale = 1.0 / resolution
    taken = np.ascontiguousarray(points[:: s.stride].T) * scale
    matched = 0
    for p in range(len(poses)):
        u = (poses[p, 0] - origin[0]) * scale
        v = (poses[p, 1] - origin[1]) * scale
        pose = CellPose(u, v, poses[p, 2])
        top, value = climb(pool, tables[p], taken, pose, s)
        if value > s.minimum_score:
            pose = top
            poses[p, 0] = origin[0] + pose.u * resolution
            poses[p, 1] = origin[1] + pose.v * resolution
            poses[p, 2] = pose.theta
            matched += 1
        log_likelihoods[p] = log_likelihood(pool, tables[p], taken, pose, s)
    return matched
