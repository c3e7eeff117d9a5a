"""GMapping's matching objective over a map of end points, and its hill climbing: numba kernels.

The objective is the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the beam's end point
to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves of shrinking step.

A climb scores some 80 poses a few centimetres apart, so that a beam's end point falls into the same few cells
again and again. The means of the 3 x 3 cells are kept as a short list (:class:`NearMeans`); the next look at the cell
spares the walk through tiles, rows and neighbours.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.tiles import EMPTY, MEAN_U, MEAN_UNITS, MEAN_V, NEIGHBOURS, TILE_BITS, TILE_MASK, TilePool

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""
FIRST_TURN = 0.05
"""First step of the search in heading [rad] (GMapping's ``astep``)."""
SLOT_BITS = 7
SLOTS_ACROSS = 1 << SLOT_BITS
SLOT_MASK = SLOTS_ACROSS - 1
"""Cells this many apart share a slot: 6.4 m at 5 cm, twice what a TurtleBot3 sees, so that few compete."""
MAX_MEANS = 1 << 13
"""When so many means are kept all are forgotten."""
END_SHIFT = 32
END_MASK = (1 << END_SHIFT) - 1
COORDINATE_BITS = 20


class MatchSettings(NamedTuple):
    """Settings from :class:`slamgym.slam.config.SlamConfig` that the kernels need, in cells."""

    gain: float  # 1 / sigma [1/cells^2]
    likelihood_gain: float  # 1 / likelihood sigma [1/cells^2]
    miss: float  # log-likelihood of a beam with nothing near
    stride: int  # match every so many points
    linear_step: float  # [cells]
    only_climbs: bool  # GMapping's own search alone
    halvings: int  # of the step in GMapping's own search
    minimum_score: float
    odometry_weight: float


class CellPose(NamedTuple):
    """A pose in a particle's map."""

    u: float  # [cells]
    v: float  # [cells]
    theta: float  # [rad]


class Prior(NamedTuple):
    """The predicted pose and its pull, in units of the score."""

    pose: CellPose
    stiffness: float  # [1/cells^2]
    turn_stiffness: float  # [1/rad^2]
    sure: bool  # whether the prediction is good to within the capture range


class NearMeans(NamedTuple):
    """Cached values of the map that one climb after the other looks at."""

    slots: IntArray
    """(SLOTS_ACROSS * SLOTS_ACROSS, 2): number of a cell (map, v and u, COORDINATE_BITS each), and where its
    means begin and end (``begin | end << END_SHIFT``)."""
    means: FloatArray  # (MAX_MEANS, 2) from the corner of their cell [cells]
    state: IntArray  # (2,) number of the map, means kept


@kernel
def empty_means() -> NearMeans:
    """A memory that holds nothing."""
    return NearMeans(
        np.zeros((SLOTS_ACROSS * SLOTS_ACROSS, 2), dtype=np.int64),
        np.empty((MAX_MEANS, 2)),
        np.zeros(2, dtype=np.int64),
    )


@kernel
def forget(near: NearMeans) -> None:
    """Begin with another map."""
    near.state[0] += 1
    near.state[1] = 0


@kernel
def gather(
    cells: np.ndarray, table: np.ndarray, cell_u: int, cell_v: int, means: FloatArray, first: int
) -> int:
    """Write the means of the 3 x 3 cells round a cell to ``means[first:]``.

    Args:
        cells: The pool's cells.
        table: (rows, cols) int32, the map.
        cell_u: The cell; 1 or more.
        cell_v: The same upwards.
        means: Receives the means, from the corner of the cell [cells].
        first: Where to begin.

    Returns:
        Where they end.
    """
    row, col = cell_v >> TILE_BITS, cell_u >> TILE_BITS
    if row >= table.shape[0] or col >= table.shape[1] or table[row, col] == EMPTY:
        return first
    tile = np.uint64(table[row, col])
    in_u, in_v = cell_u & TILE_MASK, cell_v & TILE_MASK
    left = np.uint64(cells[tile, np.uint64((in_v << TILE_BITS) | in_u), np.uint64(NEIGHBOURS)])
    inside = 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK
    end = np.uint64(first)
    for dv in range(-1, 2):
        for du in range(-1, 2):
            if left & np.uint64(1):
                if not inside:
                    tile = np.uint64(table[(cell_v + dv) >> TILE_BITS, (cell_u + du) >> TILE_BITS])
                cell = np.uint64((((in_v + dv) & TILE_MASK) << TILE_BITS) | ((in_u + du) & TILE_MASK))
                means[end, np.uint64(0)] = du + cells[tile, cell, np.uint64(MEAN_U)] * (1.0 / MEAN_UNITS)
                means[end, np.uint64(1)] = dv + cells[tile, cell, np.uint64(MEAN_V)] * (1.0 / MEAN_UNITS)
                end += np.uint64(1)
            left >>= np.uint64(1)
    return int(np.int64(end))


@kernel
def exp_of_minus(x: float) -> float:
    """exp(-x), from its series where that is good to 3e-4: within a 3 x 3 window the argument is small."""
    if x < 0.5:
        return 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))))
    return math.exp(-x)


@kernel
def turn_points(points: FloatArray, theta: float, out: FloatArray) -> None:
    """Turn points (2, n) by theta."""
    cos, sin = math.cos(theta), math.sin(theta)
    for i in range(points.shape[1]):
        out[0, i] = cos * points[0, i] - sin * points[1, i]
        out[1, i] = sin * points[0, i] + cos * points[1, i]


@kernel
def score(
    cells: np.ndarray,
    table: np.ndarray,
    near: NearMeans,
    turned: FloatArray,
    u0: float,
    v0: float,
    gain: float,
    to_beat: float,
) -> float:
    """GMapping's matching score of a position; ``gain`` in 1/cells^2.

    The count starts at what a perfect fit would score and ends as soon as ``to_beat`` is out of reach; most
    poses that a climb tries lose, and show it early. All of the loop stands here: to hand a call this many
    arrays costs more than the look at a beam.

    Args:
        cells: The pool's cells.
        table: (rows, cols) int32, the map.
        near: The means near the cells looked at so far.
        turned: (2, n) end points, turned to the heading of the pose [cells].
        u0: Position [cells].
        v0: The same upwards.
        gain: 1 / sigma [1/cells^2].
        to_beat: Score to give up below.
    """
    total = float(turned.shape[1])
    map_key = near.state[0] << (2 * COORDINATE_BITS)
    for i in range(turned.shape[1]):
        u, v = u0 + turned[0, i], v0 + turned[1, i]
        nearest = math.inf
        if u >= 1.0 and v >= 1.0:
            cell_u, cell_v = int(u), int(v)
            slot = np.uint64(((cell_v & SLOT_MASK) << SLOT_BITS) | (cell_u & SLOT_MASK))
            span = near.slots[slot, np.uint64(1)]
            if near.slots[slot, np.uint64(0)] != map_key | (cell_v << COORDINATE_BITS) | cell_u:
                if near.state[1] + 9 > MAX_MEANS:
                    forget(near)
                    map_key = near.state[0] << (2 * COORDINATE_BITS)
                first = near.state[1]
                end = gather(cells, table, cell_u, cell_v, near.means, first)
                near.state[1] = end
                span = first | (end << END_SHIFT)
                near.slots[slot, 0] = map_key | (cell_v << COORDINATE_BITS) | cell_u
                near.slots[slot, 1] = span
            in_u, in_v = u - cell_u, v - cell_v
            for k in range(np.uint64(span & END_MASK), np.uint64(span >> END_SHIFT)):
                du, dv = near.means[k, np.uint64(0)] - in_u, near.means[k, np.uint64(1)] - in_v
                d2 = du * du + dv * dv
                nearest = d2 if d2 < nearest else nearest
        total -= 1.0 - exp_of_minus(gain * nearest) if nearest < math.inf else 1.0
        if total <= to_beat:
            break
    return total


@kernel
def prior_cost(prior: Prior, pose: CellPose) -> float:
    """Cost of a deviation from the predicted pose, in units of the score."""
    du, dv, turn = pose.u - prior.pose.u, pose.v - prior.pose.v, pose.theta - prior.pose.theta
    return 0.5 * (prior.stiffness * (du * du + dv * dv) + prior.turn_stiffness * turn * turn)


@kernel
def climb(
    pool: TilePool,
    table: np.ndarray,
    near: NearMeans,
    points: FloatArray,
    stride: int,
    prior: Prior,
    halvings: int,
    s: MatchSettings,
) -> CellPose:
    """GMapping's hill climbing: the best of six axis moves while there is one, then half the step.

    Returns:
        The top.
    """
    forget(near)
    pose = prior.pose
    linear_step, angular_step = s.linear_step, FIRST_TURN
    taken = np.ascontiguousarray(points[::stride].T)
    ahead, aside = np.empty_like(taken), np.empty_like(taken)
    turn_points(taken, pose.theta, ahead)
    current = score(pool.cells, table, near, ahead, pose.u, pose.v, s.gain, -1.0)
    halved, back = 0, -1
    for _ in range(MAX_CLIMB_STEPS):
        best, best_pose, best_move = current, pose, -1
        for move in range(6):
            if move == back:
                continue  # where the climb came from, and lower
            sign = 1.0 if move % 2 == 0 else -1.0
            trial = CellPose(
                pose.u + (sign * linear_step if move < 2 else 0.0),
                pose.v + (sign * linear_step if 2 <= move < 4 else 0.0),
                pose.theta + (sign * angular_step if move >= 4 else 0.0),
            )
            if move >= 4:
                turn_points(taken, trial.theta, aside)
            cost = prior_cost(prior, trial)
            turned = ahead if move < 4 else aside
            value = score(pool.cells, table, near, turned, trial.u, trial.v, s.gain, best + cost) - cost
            if value > best:
                best, best_pose, best_move = value, trial, move
        if best_move >= 0:
            current, pose, back = best, best_pose, best_move ^ 1
            if best_move >= 4:
                turn_points(taken, pose.theta, ahead)
            continue
        halved += 1
        if halved > halvings:
            break
        back = -1
        linear_step *= 0.5
        angular_step *= 0.5
    return pose
