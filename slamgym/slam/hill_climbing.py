"""GMapping's matching objective over a map of end points, and its hill climbing: numba kernels.

The objective is the sum over beams of ``exp(-d^2 / sigma)``, where d is the distance from the beam's end point
to the nearest cell mean in the 3 x 3 cells round it. GMapping climbs it with six axis moves of shrinking step.

Convention: see :mod:`slamgym.slam.tiles` for points in cells. Poses are in cells and radians.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.near_means import (
    COORDINATE_BITS,
    END_MASK,
    END_SHIFT,
    MAX_MEANS,
    SLOT_BITS,
    SLOT_MASK,
    NearMeans,
    forget,
    gather,
)
from slamgym.slam.tiles import TilePool

MAX_CLIMB_STEPS = 50
"""Bound on the moves of one climb, so that a climb across a featureless map ends."""


class Search(IntEnum):
    """How a scan is matched: the settings' ``matcher`` as the kernels take it."""

    COARSE_TO_FINE = 0
    HILL_CLIMBING = 1


class MatchSettings(NamedTuple):
    """What the kernels need to know of :class:`slamgym.slam.config.SlamConfig`, in cells."""

    gain: float  # 1 / sigma [1/cells^2]
    likelihood_gain: float  # 1 / likelihood sigma [1/cells^2]
    miss: float  # log-likelihood of a beam with nothing near
    stride: int  # match every so many points
    linear_step: float  # [cells]
    angular_step: float  # [rad]
    search: int  # one of Search
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
    """What it costs to leave the predicted pose, in units of the score."""
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
    linear_step, angular_step = s.linear_step, s.angular_step
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
