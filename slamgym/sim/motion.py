"""Numeric kernels of motion and collision: how near the robot is to everything, and how it drives.

Segments are walls and other straight outlines, shape (S, 4) as x0, y0, x1, y1 [m]; discs are people, shape
(P, 3) as x, y, radius [m]. The drive state is one array so that a step crosses from Python into compiled code
once; the constants below name its entries.
"""

import math

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray
from slamgym.sim.contact import SKIN, SUBSTEP_DISTANCE, Velocity

X = 0
"""Entry of the drive state: place of the body [m]."""
Y = 1
"""Entry of the drive state: place of the body [m]."""
THETA = 2
"""Entry of the drive state: heading of the body [rad]."""
LINEAR = 3
"""Entry of the drive state: speed of the drive [m/s]."""
ANGULAR = 4
"""Entry of the drive state: turning rate of the drive [rad/s]."""
LEFT = 5
"""Entry of the drive state: roll of the left wheel [m]."""
RIGHT = 6
"""Entry of the drive state: roll of the right wheel [m]."""
DISTANCE = 7
"""Entry of the drive state: distance of the body [m]."""

_RAMP_STEP = 0.02
"""Longest time over which the drive velocity counts as constant [s]. Only the acceleration ramp is
approximated; its position error over a stop-to-full-speed ramp of the Waffle Pi is below 0.05 mm, and
heading and distance are exact."""

_NO_PRESS = 1e-9
"""The skin doesn't press on what it comes nearer to by less than this [m]: rounding."""

NO_TIME = 1e-9
"""Remaining time too short to move in [s]."""

_SUBSTEP_TIME = 0.03
"""Longest contact substep [s]: resolves the acceleration ramp as the free motion does."""

_CONTACT_TOLERANCE = 1e-4
"""A velocity changed by less than this was not changed by contact [m/s, rad/s]: the iterative solver's residual."""


@kernel
def clearance(x: float, y: float, segments: FloatArray, discs: FloatArray) -> float:
    """Distance from a point to the nearest segment or disc [m]; negative inside a disc."""
    squared = np.inf
    for s in range(segments.shape[0]):
        ax = segments[s, 0]
        ay = segments[s, 1]
        ex = segments[s, 2] - ax
        ey = segments[s, 3] - ay
        px = x - ax
        py = y - ay
        length = ex * ex + ey * ey
        along = px * ex + py * ey
        if along > 0.0 and length > 0.0:
            along = min(1.0, along / length)
            px -= along * ex
            py -= along * ey
        squared = min(squared, px * px + py * py)
    nearest = math.sqrt(squared)
    for p in range(discs.shape[0]):
        nearest = min(nearest, math.hypot(x - discs[p, 0], y - discs[p, 1]) - discs[p, 2])
    return nearest


@kernel
def inside(x: float, y: float, segments: FloatArray) -> bool:
    """True if a point lies within the closed outlines that the segments form, by the even-odd rule."""
    odd = False
    for s in range(segments.shape[0]):
        ax = segments[s, 0]
        ay = segments[s, 1]
        bx = segments[s, 2]
        by = segments[s, 3]
        passes_by = (ay > y) != (by > y)
        if passes_by and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
    return odd


@kernel
def ramp(velocity: float, target: float, acceleration: float, span: float) -> tuple[float, float]:
    """Mean and final velocity of a trapezoidal ramp towards ``target`` over ``span`` seconds."""
    change = target - velocity
    ramp_time = abs(change) / acceleration
    if ramp_time >= span:
        final = velocity + math.copysign(acceleration * span, change)
        return 0.5 * (velocity + final), final
    mean = target - 0.5 * change * ramp_time / span
    return mean, target


@kernel
def wished(
    state: FloatArray, target_linear: float, target_angular: float, limits: FloatArray, span: float
) -> tuple[float, float, float, float, float, float, float]:
    """Motion of the drive towards a target velocity over a short span, if nothing is in the way.

    Args:
        state: Drive state.
        target_linear: As for :func:`drive_freely`.
        target_angular: The same.
        limits: The same.
        span: Time to drive [s].

    Returns:
        Displacement in the frame of the obstacles (two) [m]; distance [m]; turn [rad]; mean turning rate [rad/s]; speed
        [m/s] and turning rate [rad/s] at the end.
    """
    mean_linear, linear = ramp(state[LINEAR], target_linear, limits[0], span)
    mean_angular, angular = ramp(state[ANGULAR], target_angular, limits[1], span)
    distance = mean_linear * span
    turn = mean_angular * span
    dx, dy = chord(state[THETA], distance, turn)
    return dx, dy, distance, turn, mean_angular, linear, angular


@kernel
def drive_freely(
    state: FloatArray,
    target_linear: float,
    target_angular: float,
    limits: FloatArray,
    span: float,
    radius: float,
    segments: FloatArray,
    discs: FloatArray,
) -> float:
    """Drive towards a target velocity for as long as nothing is pressed on.

    The free distance in any direction is the clearance less the radius; the drive continues for as long as it
    can't use that distance up, then looks again (conservative advancement). In open space one look covers the
    whole step. The radius holds a skin about the body: close to something the drive goes on by what the skin takes.
    Where the skin touches something already, only what would press on it ends the drive.

    Args:
        state: Drive state, updated in place.
        target_linear: Commanded speed within the limits [m/s].
        target_angular: Commanded turning rate within the limits [rad/s].
        limits: Linear acceleration [m/s^2], angular acceleration [rad/s^2], wheel separation [m].
        span: Time to drive [s].
        radius: Of the body with its skin [m].
        segments: Obstacles, shape (S, 4).
        discs: Obstacles, shape (P, 3).

    Returns:
        The time left when the skin pressed on something [s]; 0 if the whole span was driven.
    """
    before = np.empty_like(state)
    slack = clearance(state[X], state[Y], segments, discs) - radius
    while span > NO_TIME:
        speed = max(abs(state[LINEAR]), abs(target_linear))
        free = max(slack, SUBSTEP_DISTANCE)
        part = span if speed * span <= free else free / speed
        assign(state, before)
        _advance(state, target_linear, target_angular, limits, part)
        reached = clearance(state[X], state[Y], segments, discs) - radius
        if slack < 0.0 and reached < slack - _NO_PRESS:
            assign(before, state)
            return span
        slack = reached
        span -= part
    return 0.0


@kernel
def _advance(
    state: FloatArray, target_linear: float, target_angular: float, limits: FloatArray, span: float
) -> None:
    """Integrate the differential drive; each piece of constant velocity is an exact arc."""
    pieces = max(1, math.ceil(span / _RAMP_STEP))
    step = span / pieces
    for _ in range(pieces):
        linear, state[LINEAR] = ramp(state[LINEAR], target_linear, limits[0], step)
        angular, state[ANGULAR] = ramp(state[ANGULAR], target_angular, limits[1], step)
        distance = linear * step
        turn = angular * step
        dx, dy = chord(state[THETA], distance, turn)
        state[X] += dx
        state[Y] += dy
        state[THETA] += turn
        roll = 0.5 * limits[2] * turn
        state[LEFT] += distance - roll
        state[RIGHT] += distance + roll
        state[DISTANCE] += abs(distance)


@kernel
def contact_span(state: FloatArray, target_linear: float) -> float:
    """A time in which the body, which turns within itself, can't move further than the contact skin allows [s]."""
    speed = max(abs(state[LINEAR]), abs(target_linear))
    return min(_SUBSTEP_TIME, SUBSTEP_DISTANCE / speed) if speed > 0.0 else _SUBSTEP_TIME


@kernel
def settle(
    state: FloatArray,
    drive: tuple[float, float, float, float, float, float, float],
    solved: tuple[Velocity, Velocity],
    limits: FloatArray,
    span: float,
    radius: float,
    segments: FloatArray,
    discs: FloatArray,
) -> tuple[bool, float, float]:
    """Carry out a contact substep.

    Args:
        state: Drive state, updated in place.
        drive: The drive's motion had nothing been in the way: :func:`wished`.
        solved: The part of that velocity that contact allows, and the push that ends an overlap of the skin.
        limits: As for :func:`drive_freely`.
        span: Duration [s].
        radius: Of the body without its skin [m].
        segments: Obstacles, shape (S, 4).
        discs: Obstacles, shape (P, 3).

    Returns:
        True if contact changed the motion; the body's speed [m/s] and turning rate [rad/s].
    """
    x = state[X]
    y = state[Y]
    theta = state[THETA]
    wished_dx, wished_dy, rolled, rolled_turn, wished_turning, linear, angular = drive
    left, push = solved
    left_x, left_y, left_turning = left
    push_x, push_y, push_turning = push
    change_x = abs(left_x - wished_dx / span)
    change_y = abs(left_y - wished_dy / span)
    change_turning = abs(left_turning - wished_turning)
    contact = max(change_x, change_y, change_turning) > _CONTACT_TOLERANCE
    # Cut to what the skin allows, even if the solver returns more.
    dx = (left_x + push_x) * span
    dy = (left_y + push_y) * span
    turn = (left_turning + push_turning) * span
    distance = math.hypot(dx, dy)
    if distance > SKIN:
        share = SKIN / distance
        dx = dx * share
        dy = dy * share
        turn = turn * share
    state[X] = x + dx
    state[Y] = y + dy
    state[THETA] = theta + turn
    if clearance(state[X], state[Y], segments, discs) < radius:
        contact = True
        state[X] = x
        state[Y] = y
    dx = state[X] - x
    dy = state[Y] - y
    turn = state[THETA] - theta
    middle = theta + 0.5 * turn
    distance = dx * math.cos(middle) + dy * math.sin(middle)
    # The drive rolls on as it would without contact.
    roll = 0.5 * limits[2] * rolled_turn
    state[LINEAR] = linear
    state[ANGULAR] = angular
    state[LEFT] += rolled - roll
    state[RIGHT] += rolled + roll
    state[DISTANCE] += math.hypot(dx, dy)
    return contact, distance / span, turn / span


@kernel
def chord(theta: float, distance: float, turn: float) -> tuple[float, float]:
    """Displacement along an arc of length ``distance`` that starts at heading ``theta`` and turns by ``turn``."""
    half = 0.5 * turn
    shortening = math.sin(half) / half if abs(half) > 1e-8 else 1.0
    length = distance * shortening
    return length * math.cos(theta + half), length * math.sin(theta + half)
