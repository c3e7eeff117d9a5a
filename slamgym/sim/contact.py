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

# Overlap of skin and obstacle that is left standing, so that resting contacts persist [m].
_SLOP = 0.001

# Sequential-impulse iterations; two walls of a corner converge to 1e-6 m/s in about ten.
_ITERATIONS = 30

# Nominal duration of a solver step [s]. It is the same for every substep, however long: the solver starts
# from the impulses of its last step, scaled by the ratio of the durations, but here an impulse takes away a
# velocity, not a force.
_SOLVER_STEP = 0.01

Velocity = tuple[float, float, float]
"""Velocity of a rigid body in the world's axes: x [m/s], y [m/s], turning [rad/s]."""

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
        moment = pymunk.moment_for_circle(ROBOT_MASS, 0.0, robot.radius)
        self._inertia = ROBOT_MASS, moment
        self._body = pymunk.Body(ROBOT_MASS, moment)
        shape = pymunk.Circle(self._body, robot.radius + SKIN)
        self._people = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in discs]
        people = [
            pymunk.Circle(body, float(disc[2]))
            for body, disc in zip(self._people, discs, strict=True)
        ]
        self._space.add(self._body, shape, *self._people, *_walls(self._space, segments), *people)

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
        body, (mass, moment) = self._body, self._inertia
        # By the properties themselves: pymunk's __setattr__ takes longer than what they do.
        _set_position(body, (pose.x, pose.y))
        _set_angle(body, pose.theta)
        _set_velocity(body, (0.0, 0.0))
        _set_angular_velocity(body, 0.0)
        _set_force(body, (wish[0] * mass / _SOLVER_STEP, wish[1] * mass / _SOLVER_STEP))
        _set_torque(body, wish[2] * moment / _SOLVER_STEP)
        self._space.step(_SOLVER_STEP)
        velocity, position = body.velocity, body.position
        # The step moved the body before it solved, from rest: that is the push which the last overlap asked
        # for.
        push_x, push_y, push_turn = (
            position.x - pose.x,
            position.y - pose.y,
            body.angle - pose.theta,
        )
        push = push_x / _SOLVER_STEP, push_y / _SOLVER_STEP, push_turn / _SOLVER_STEP
        return (velocity.x, velocity.y, body.angular_velocity), push


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
    index_of = {wall: index for index, wall in enumerate(walls)}
    return np.array(
        [index_of[wall] for wall in space.bb_query(everywhere, pymunk.ShapeFilter())], np.int64
    )  # type: ignore[index]


_PERSISTENCE = 3  # steps after which a contact is forgotten
_WIDENED = float(np.float32(0.1))  # share of its side by which a moving box is widened
_BUILT, _STEPS, _PAIRS = range(3)


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
        order, pairs, stamps = (np.zeros((count, walls), dtype=np.int64) for _ in range(3))
        near, push = np.zeros((count, 4)), np.zeros((count, 3))
        marks = np.zeros((count, 3), dtype=np.int64)
        return cls(order, pairs, np.zeros((count, walls)), stamps, near, push, marks)


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
    marks, push, radius = contacts.marks[i], contacts.push[i], disc.radius
    pairs, impulses, stamps = contacts.pairs[i], contacts.impulses[i], contacts.stamps[i]
    if not marks[_BUILT]:
        # As the solver is made: the robot is at the origin before it is put to its place.
        marks[_BUILT], marks[_STEPS] = 1, 0
        contacts.push[i], contacts.stamps[i] = 0.0, 0
        _list_pairs(contacts, i, walls, (-radius, -radius, radius, radius), np.arange(len(walls)))
    marks[_STEPS] += 1
    # The body moves by the push that the last step asked for, then contacts are found where it stands.
    x, y = state[0] + push[0] * _SOLVER_STEP, state[1] + push[1] * _SOLVER_STEP
    turned = state[2] + push[2] * _SOLVER_STEP
    box, near = (x - radius, y - radius, x + radius, y + radius), contacts.near[i]
    # A new list is gone through as the tree lists the walls, an old one backwards.
    is_new = not (
        near[0] <= box[0] and near[2] >= box[2] and near[1] <= box[1] and near[3] >= box[3]
    )
    if is_new:
        _list_pairs(contacts, i, walls, box, contacts.order[i, : len(walls)])
    count = marks[_PAIRS]
    found, walls_met, met = np.empty((count, 8)), np.empty(count, dtype=np.int64), 0
    for k in range(count):
        s = pairs[k] if is_new else pairs[count - 1 - k]
        if _meet(x, y, walls[s], disc, found[met]):
            walls_met[met] = s
            met += 1

    per_mass, per_moment = 1.0 / ROBOT_MASS, 1.0 / disc.moment
    vx = wish[0] * ROBOT_MASS / _SOLVER_STEP * per_mass * _SOLVER_STEP
    vy = wish[1] * ROBOT_MASS / _SOLVER_STEP * per_mass * _SOLVER_STEP
    w = wish[2] * disc.moment / _SOLVER_STEP * per_moment * _SOLVER_STEP
    for k in range(met):
        s = walls_met[k]
        nx, ny, rx, ry = found[k, 0], found[k, 1], found[k, 2], found[k, 3]
        age = marks[_STEPS] - stamps[s]
        if stamps[s] == 0 or age > _PERSISTENCE:
            impulses[s] = 0.0
        elif age == 1:
            jx, jy = -(nx * impulses[s]), -(ny * impulses[s])
            vx, vy = vx + jx * per_mass, vy + jy * per_mass
            w += per_moment * (rx * jy - ry * jx)
        stamps[s] = marks[_STEPS]
    bx, by, turn = 0.0, 0.0, 0.0
    for _ in range(_ITERATIONS):
        is_settled = True
        for k in range(met):
            s = walls_met[k]
            nx, ny, rx, ry = found[k, 0], found[k, 1], found[k, 2], found[k, 3]
            away = (0.0 - (bx + -ry * turn)) * nx + (0.0 - (by + rx * turn)) * ny
            onto = (0.0 - (vx + -ry * w)) * nx + (0.0 - (vy + rx * w)) * ny
            pushed, held = found[k, 6], impulses[s]
            found[k, 6] = max(pushed + (found[k, 5] - away) * found[k, 4], 0.0)
            impulses[s] = max(held - onto * found[k, 4], 0.0)
            more = found[k, 6] - pushed
            jx, jy = -(nx * more), -(ny * more)
            bx, by = bx + jx * per_mass, by + jy * per_mass
            turn += per_moment * (rx * jy - ry * jx)
            more = impulses[s] - held
            jx, jy = -(nx * more), -(ny * more)
            vx, vy = vx + jx * per_mass, vy + jy * per_mass
            w += per_moment * (rx * jy - ry * jx)
            is_settled = is_settled and found[k, 6] == pushed and more == 0.0
        if is_settled:
            break  # further rounds would change nothing
    push[0], push[1], push[2] = bx, by, turn
    moved = (
        (x - state[0]) / _SOLVER_STEP,
        (y - state[1]) / _SOLVER_STEP,
        (turned - state[2]) / _SOLVER_STEP,
    )
    return (vx, vy, w), moved


@kernel
def _meet(x: float, y: float, wall: FloatArray, disc: DiscBody, contact: FloatArray) -> bool:
    """True if a disc touches a wall; writes normal, arm, effective mass, bias and no push yet."""
    ex, ey = wall[2] - wall[0], wall[3] - wall[1]
    radius = disc.radius
    if not _overlap(_box(wall), (x - radius, y - radius, x + radius, y + radius)):
        return False
    along = (ex * (x - wall[0]) + ey * (y - wall[1])) / (ex * ex + ey * ey)
    along = along if along < 1.0 else 1.0
    along = 0.0 if along < 0.0 else along
    cx, cy = wall[0] + ex * along, wall[1] + ey * along
    dx, dy = cx - x, cy - y
    squared = dx * dx + dy * dy
    if squared >= radius * radius or squared == 0.0:
        return False
    scale = 1.0 / math.sqrt(squared)
    nx, ny = dx * scale, dy * scale
    rx, ry = (x + nx * radius) - x, (y + ny * radius) - y
    across = rx * ny - ry * nx
    distance = ((cx - rx) - x) * nx + ((cy - ry) - y) * ny
    contact[0], contact[1], contact[2], contact[3] = nx, ny, rx, ry
    contact[4] = 1.0 / (1.0 / ROBOT_MASS + 1.0 / disc.moment * across * across)
    contact[5] = -disc.bias * min(0.0, distance + _SLOP) / _SOLVER_STEP
    contact[6] = 0.0
    return True


@kernel
def _box(wall: FloatArray) -> tuple[float, float, float, float]:
    return (
        min(wall[0], wall[2]),
        min(wall[1], wall[3]),
        max(wall[0], wall[2]),
        max(wall[1], wall[3]),
    )


@kernel
def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


@kernel
def _list_pairs(
    contacts: DiscContacts,
    i: int,
    walls: FloatArray,
    box: tuple[float, float, float, float],
    order: IntArray,
) -> None:
    """Note the walls near the box about the robot, widened so that the list holds for a while."""
    near, marks = contacts.near[i], contacts.marks[i]
    wide, high = (box[2] - box[0]) * _WIDENED, (box[3] - box[1]) * _WIDENED
    near[0], near[1], near[2], near[3] = box[0] - wide, box[1] - high, box[2] + wide, box[3] + high
    marks[_PAIRS] = 0
    for s in order:
        if _overlap(_box(walls[s]), (near[0], near[1], near[2], near[3])):
            contacts.pairs[i, marks[_PAIRS]] = s
            marks[_PAIRS] += 1
