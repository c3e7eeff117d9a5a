"""Contact between the robot and the world: solved by pymunk, and by a kernel that gives the same for a batch of robots.

A batch of robots can't cross from compiled code into pymunk and back for each of them. The kernel computes what
Chipmunk, the solver below pymunk, does for a single dynamic circle among static segments without friction and bounce:
its ``cpSpaceStep`` with ``cpBBTree``, ``CircleToSegment`` and ``cpArbiter`` (Munk2D in pymunk 7.3), each operation in
the same order. A test drives both next to each other.
"""

import math
from typing import NamedTuple

import numpy as np
import pymunk

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray, Pose2D
from slamgym.sim.robot import ROBOT_MASS, RobotConfig

SKIN = 0.01
"""Contact begins this far outside the body [m]. The solver needs some overlap to work with; the skin takes
it, so that the body itself never enters an obstacle."""

SUBSTEP_DISTANCE = 0.008
"""Furthest that a point of the body may move between two looks at the contacts [m]: less than the skin, so
that no obstacle is passed unseen."""

_SLOP = 0.001
"""Overlap of skin and obstacle that is left standing, so that resting contacts persist [m]."""

_ITERATIONS = 30
"""Sequential-impulse iterations; two walls of a corner converge to 1e-6 m/s in about ten."""

_SOLVER_STEP = 0.01
"""Nominal duration of a solver step [s]. It is the same for every substep, however long: the solver starts
from the impulses of its last step, scaled by the ratio of the durations, but here an impulse takes away a
velocity, not a force."""

Velocity = tuple[float, float, float]
"""Velocity of a rigid body in the world's axes: x [m/s], y [m/s], turning [rad/s]."""

Extent = tuple[float, float, float, float]
"""Left, bottom, right and top [m]."""

_set_position = vars(pymunk.Body)["position"].__set__
_set_angle = vars(pymunk.Body)["angle"].__set__
_set_velocity = vars(pymunk.Body)["velocity"].__set__
_set_angular_velocity = vars(pymunk.Body)["angular_velocity"].__set__
_set_force = vars(pymunk.Body)["force"].__set__
_set_torque = vars(pymunk.Body)["torque"].__set__


class ContactSolver:
    """A pymunk space with the walls as static segments, people as discs and the robot as a rigid body.

    Each call answers: of a wished velocity at this pose, what do the contacts leave? The wish
    enters as the force that would bring the body from rest to it, because the solver applies contact
    impulses after forces.
    """

    def __init__(self, segments: FloatArray, discs: FloatArray, robot: RobotConfig) -> None:
        self._space = pymunk.Space()
        self._space.iterations = _ITERATIONS
        self._space.collision_slop = _SLOP
        # The robot with its skin; the base frame's origin is the body's.
        self._moment = pymunk.moment_for_circle(ROBOT_MASS, 0.0, robot.radius)
        self._body = pymunk.Body(ROBOT_MASS, self._moment)
        shape = pymunk.Circle(self._body, robot.radius + SKIN)
        self._people = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in discs]
        people = [
            pymunk.Circle(body, float(radius))
            for body, radius in zip(self._people, discs[:, 2], strict=True)
        ]
        walls = _walls(self._space, segments)
        self._space.add(self._body, shape, *self._people, *walls, *people)

    def place_people(self, discs: FloatArray) -> None:
        """Move the people, shape (P, 3)."""
        for body, disc in zip(self._people, discs, strict=True):
            body.position = float(disc[0]), float(disc[1])

    def solve(self, pose: Pose2D, wish: Velocity) -> tuple[Velocity, Velocity]:
        """Remove from a velocity what contact forbids.

        Args:
            pose: Where the robot stands.
            wish: Velocity that the drive asks for.

        Returns:
            The part of the wished velocity that contact allows, and the slow push that ends an overlap of the skin.
            The body moves by the sum of both.
        """
        body = self._body
        # By the properties themselves: pymunk's __setattr__ takes longer than what they do.
        _set_position(body, (pose.x, pose.y))
        _set_angle(body, pose.theta)
        _set_velocity(body, (0.0, 0.0))
        _set_angular_velocity(body, 0.0)
        force_x = wish[0] * ROBOT_MASS / _SOLVER_STEP
        force_y = wish[1] * ROBOT_MASS / _SOLVER_STEP
        _set_force(body, (force_x, force_y))
        _set_torque(body, wish[2] * self._moment / _SOLVER_STEP)
        self._space.step(_SOLVER_STEP)
        velocity = body.velocity
        position = body.position
        # The step moved the body before it solved, from rest: that is the push which the last overlap asked
        # for.
        push_x = (position.x - pose.x) / _SOLVER_STEP
        push_y = (position.y - pose.y) / _SOLVER_STEP
        push_turn = (body.angle - pose.theta) / _SOLVER_STEP
        left = (velocity.x, velocity.y, body.angular_velocity)
        return left, (push_x, push_y, push_turn)


def _walls(space: pymunk.Space, segments: FloatArray) -> list[pymunk.Segment]:
    return [
        pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0)
        for x0, y0, x1, y1 in segments.tolist()
    ]


def wall_order(segments: FloatArray) -> IntArray:
    """Indices of walls, shape (S,), in the order in which Chipmunk's tree of their boxes lists them."""
    space = pymunk.Space()
    walls = _walls(space, segments)
    space.add(*walls)
    everywhere = pymunk.BB(-math.inf, -math.inf, math.inf, math.inf)
    index_of: dict[pymunk.Shape, int] = {wall: index for index, wall in enumerate(walls)}
    listed = space.bb_query(everywhere, pymunk.ShapeFilter())
    return np.array([index_of[wall] for wall in listed], np.int64)


_PERSISTENCE = 3
"""So many steps after the last one a contact is forgotten."""
_WIDENED = float(np.float32(0.1))
"""Share of its side by which a moving box is widened."""

_BUILT = 0
"""Entry of :attr:`DiscContacts.marks`: whether the solver has begun."""
_STEPS = 1
"""Entry of :attr:`DiscContacts.marks`: steps so far."""
_PAIRS = 2
"""Entry of :attr:`DiscContacts.marks`: number of pairs."""

_NORMAL_X = 0
"""Entry of a contact: its normal, from the robot to the wall."""
_NORMAL_Y = 1
"""Entry of a contact: its normal."""
_ARM_X = 2
"""Entry of a contact: from the middle of the robot to where it touches [m]."""
_ARM_Y = 3
"""Entry of a contact: from the middle of the robot to where it touches [m]."""
_MASS = 4
"""Entry of a contact: mass that resists an impulse along the normal [kg]."""
_BIAS = 5
"""Entry of a contact: velocity that is to end the overlap [m/s]."""
_PUSHED = 6
"""Entry of a contact: impulse that ends the overlap, so far [N s]."""
_ENTRIES = 7
"""Number of entries of a contact."""


class DiscBody(NamedTuple):
    """The body that all robots of a batch have."""

    radius: float  # with the skin [m]
    moment: float  # [kg m^2]
    bias: float  # share of an overlap that a step takes away

    @classmethod
    def of(cls, robot: RobotConfig) -> "DiscBody":
        """The body of a robot."""
        bias = 1.0 - math.pow(pymunk.Space().collision_bias, _SOLVER_STEP)
        return cls(
            robot.radius + SKIN, pymunk.moment_for_circle(ROBOT_MASS, 0.0, robot.radius), bias
        )


class DiscContacts(NamedTuple):
    """State of the solver between steps, one row a robot; S is the most walls that one has."""

    order: IntArray  # (N, S) see :func:`wall_order`
    pairs: IntArray  # (N, S) walls near the robot
    impulses: FloatArray  # (N, S) of the last contact with each wall [N s]
    stamps: IntArray  # (N, S) step of that contact; 0 where none was
    near: FloatArray  # (N, 4) box in which ``pairs`` holds: left, bottom, right, top [m]
    push: FloatArray  # (N, 3) velocity that ends an overlap of the skin [m/s, m/s, rad/s]
    marks: IntArray  # (N, 3) whether the solver has begun, steps so far, number of pairs

    @classmethod
    def none(cls, count: int, walls: int) -> "DiscContacts":
        """State of so many robots that have touched nothing, among so many walls at most."""
        by_wall = (count, walls)
        return cls(
            order=np.zeros(by_wall, np.int64),
            pairs=np.zeros(by_wall, np.int64),
            impulses=np.zeros(by_wall),
            stamps=np.zeros(by_wall, np.int64),
            near=np.zeros((count, 4)),
            push=np.zeros((count, 3)),
            marks=np.zeros((count, 3), np.int64),
        )


@kernel
def solve_disc(
    contacts: DiscContacts,
    i: int,
    walls: FloatArray,
    disc: DiscBody,
    state: FloatArray,
    wish: Velocity,
) -> tuple[Velocity, Velocity]:
    """Remove from a velocity what contact forbids, as :meth:`ContactSolver.solve` does.

    Args:
        contacts: Changed in place.
        i: The robot.
        walls: Of its building, shape (S, 4) [m].
        disc: The robot.
        state: Its drive state, see :mod:`slamgym.sim.motion`.
        wish: Velocity that the drive asks for.

    Returns:
        The part of the wished velocity that contact allows, and the slow push that ends an overlap of the skin.
    """
    marks = contacts.marks[i]
    push = contacts.push[i]
    radius = disc.radius
    pairs = contacts.pairs[i]
    impulses = contacts.impulses[i]
    stamps = contacts.stamps[i]
    if not marks[_BUILT]:
        # As the solver is made: the robot is at the origin before it is put to its place.
        marks[_BUILT] = 1
        marks[_STEPS] = 0
        contacts.push[i] = 0.0
        contacts.stamps[i] = 0
        _list_pairs(contacts, i, walls, (-radius, -radius, radius, radius), np.arange(len(walls)))
    marks[_STEPS] += 1
    # The body moves by the push that the last step asked for, then contacts are found where it stands.
    x = state[0] + push[0] * _SOLVER_STEP
    y = state[1] + push[1] * _SOLVER_STEP
    turned = state[2] + push[2] * _SOLVER_STEP
    box = (x - radius, y - radius, x + radius, y + radius)
    near = contacts.near[i]
    # A new list is gone through as the tree lists the walls, an old one backwards.
    is_new = not _holds((near[0], near[1], near[2], near[3]), box)
    if is_new:
        _list_pairs(contacts, i, walls, box, contacts.order[i, : len(walls)])
    count = marks[_PAIRS]
    found = np.empty((count, _ENTRIES))
    walls_met = np.empty(count, dtype=np.int64)
    met = 0
    for k in range(count):
        s = pairs[k] if is_new else pairs[count - 1 - k]
        if _meet(x, y, walls[s], disc, found[met]):
            walls_met[met] = s
            met += 1

    per_mass = 1.0 / ROBOT_MASS
    per_moment = 1.0 / disc.moment
    vx = wish[0] * ROBOT_MASS / _SOLVER_STEP * per_mass * _SOLVER_STEP
    vy = wish[1] * ROBOT_MASS / _SOLVER_STEP * per_mass * _SOLVER_STEP
    w = wish[2] * disc.moment / _SOLVER_STEP * per_moment * _SOLVER_STEP
    for k in range(met):
        s = walls_met[k]
        nx = found[k, _NORMAL_X]
        ny = found[k, _NORMAL_Y]
        rx = found[k, _ARM_X]
        ry = found[k, _ARM_Y]
        age = marks[_STEPS] - stamps[s]
        if stamps[s] == 0 or age > _PERSISTENCE:
            impulses[s] = 0.0
        elif age == 1:
            jx = -(nx * impulses[s])
            jy = -(ny * impulses[s])
            vx = vx + jx * per_mass
            vy = vy + jy * per_mass
            w += per_moment * (rx * jy - ry * jx)
        stamps[s] = marks[_STEPS]
    bx = 0.0
    by = 0.0
    turn = 0.0
    for _ in range(_ITERATIONS):
        is_settled = True
        for k in range(met):
            s = walls_met[k]
            nx = found[k, _NORMAL_X]
            ny = found[k, _NORMAL_Y]
            rx = found[k, _ARM_X]
            ry = found[k, _ARM_Y]
            away = (0.0 - (bx + -ry * turn)) * nx + (0.0 - (by + rx * turn)) * ny
            onto = (0.0 - (vx + -ry * w)) * nx + (0.0 - (vy + rx * w)) * ny
            pushed = found[k, _PUSHED]
            held = impulses[s]
            found[k, _PUSHED] = max(pushed + (found[k, _BIAS] - away) * found[k, _MASS], 0.0)
            impulses[s] = max(held - onto * found[k, _MASS], 0.0)
            more = found[k, _PUSHED] - pushed
            jx = -(nx * more)
            jy = -(ny * more)
            bx = bx + jx * per_mass
            by = by + jy * per_mass
            turn += per_moment * (rx * jy - ry * jx)
            more = impulses[s] - held
            jx = -(nx * more)
            jy = -(ny * more)
            vx = vx + jx * per_mass
            vy = vy + jy * per_mass
            w += per_moment * (rx * jy - ry * jx)
            is_settled = is_settled and found[k, _PUSHED] == pushed and more == 0.0
        if is_settled:
            break  # further rounds would change nothing
    push[0] = bx
    push[1] = by
    push[2] = turn
    moved = (
        (x - state[0]) / _SOLVER_STEP,
        (y - state[1]) / _SOLVER_STEP,
        (turned - state[2]) / _SOLVER_STEP,
    )
    return (vx, vy, w), moved


@kernel
def _meet(x: float, y: float, wall: FloatArray, disc: DiscBody, contact: FloatArray) -> bool:
    """True if a disc touches a wall; writes normal, arm, effective mass, bias and no push yet."""
    ex = wall[2] - wall[0]
    ey = wall[3] - wall[1]
    radius = disc.radius
    if not _overlap(_box(wall), (x - radius, y - radius, x + radius, y + radius)):
        return False
    along = (ex * (x - wall[0]) + ey * (y - wall[1])) / (ex * ex + ey * ey)
    along = along if along < 1.0 else 1.0
    along = 0.0 if along < 0.0 else along
    cx = wall[0] + ex * along
    cy = wall[1] + ey * along
    dx = cx - x
    dy = cy - y
    squared = dx * dx + dy * dy
    if squared >= radius * radius or squared == 0.0:
        return False
    scale = 1.0 / math.sqrt(squared)
    nx = dx * scale
    ny = dy * scale
    rx = (x + nx * radius) - x
    ry = (y + ny * radius) - y
    across = rx * ny - ry * nx
    distance = ((cx - rx) - x) * nx + ((cy - ry) - y) * ny
    contact[_NORMAL_X] = nx
    contact[_NORMAL_Y] = ny
    contact[_ARM_X] = rx
    contact[_ARM_Y] = ry
    contact[_MASS] = 1.0 / (1.0 / ROBOT_MASS + 1.0 / disc.moment * across * across)
    contact[_BIAS] = -disc.bias * min(0.0, distance + _SLOP) / _SOLVER_STEP
    contact[_PUSHED] = 0.0
    return True


@kernel
def _box(wall: FloatArray) -> Extent:
    x0, y0, x1, y1 = wall
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


@kernel
def _overlap(first: Extent, second: Extent) -> bool:
    left, bottom, right, top = first
    other_left, other_bottom, other_right, other_top = second
    meet_across = left <= other_right and other_left <= right
    return meet_across and bottom <= other_top and other_bottom <= top


@kernel
def _holds(outer: Extent, inner: Extent) -> bool:
    """True if a box lies within another one."""
    left, bottom, right, top = inner
    outer_left, outer_bottom, outer_right, outer_top = outer
    holds_across = outer_left <= left and outer_right >= right
    return holds_across and outer_bottom <= bottom and outer_top >= top


@kernel
def _list_pairs(
    contacts: DiscContacts, i: int, walls: FloatArray, box: Extent, order: IntArray
) -> None:
    """Note the walls near the box about the robot, widened so that the list holds for a while."""
    near = contacts.near[i]
    marks = contacts.marks[i]
    wide = (box[2] - box[0]) * _WIDENED
    high = (box[3] - box[1]) * _WIDENED
    near[0] = box[0] - wide
    near[1] = box[1] - high
    near[2] = box[2] + wide
    near[3] = box[3] + high
    marks[_PAIRS] = 0
    for s in order:
        if _overlap(_box(walls[s]), (near[0], near[1], near[2], near[3])):
            contacts.pairs[i, marks[_PAIRS]] = s
            marks[_PAIRS] += 1
