"""pymunk's answer for discs among walls that stand, to the bit, for many robots at once: a numba kernel.

:class:`slamgym.sim.contact.ContactSolver` asks pymunk for one robot; a batch of robots can't cross from compiled code
into pymunk and back for each of them. This is what Chipmunk, the solver below pymunk, computes for a single dynamic
circle among static segments without friction and bounce: its ``cpSpaceStep`` with ``cpBBTree``, ``CircleToSegment`` and
``cpArbiter`` (Munk2D in pymunk 7.3), each operation in the same order. A test drives both side by side.
"""

import math
from typing import NamedTuple

import numpy as np
import pymunk

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.sim.contact import ITERATIONS, SKIN, SLOP, SOLVER_STEP, Velocity
from slamgym.sim.robot import RobotConfig

_PERSISTENCE = 3  # steps after which a contact is forgotten
_WIDENED = float(np.float32(0.1))  # share of its side by which a moving box is widened
_BUILT, _STEPS, _PAIRS = range(3)


class DiscLaw(NamedTuple):
    """What all robots have in common."""

    radius: float  # with the skin [m]
    mass: float  # [kg]
    moment: float  # [kg m^2]
    pushing: float  # share of an overlap that a step takes away

    @classmethod
    def of(cls, robot: RobotConfig) -> "DiscLaw":
        """The law of a round robot."""
        moment = pymunk.moment_for_circle(robot.mass, 0.0, robot.radius)
        pushing = 1.0 - math.pow(pymunk.Space().collision_bias, SOLVER_STEP)
        return cls(robot.radius + SKIN, float(robot.mass), moment, pushing)


class DiscContacts(NamedTuple):
    """What the solver remembers from step to step, one row a robot; S is the most walls that one has."""

    order: IntArray  # (N, S) walls as the tree of their boxes lists them
    pairs: IntArray  # (N, S) walls near the robot
    impulses: FloatArray  # (N, S) of the last contact with each wall [N s]
    stamps: IntArray  # (N, S) step of that contact; 0 where none was
    near: FloatArray  # (N, 4) box in which ``pairs`` holds: left, bottom, right, top [m]
    push: FloatArray  # (N, 3) velocity that ends an overlap of the skin [m/s, m/s, rad/s]
    marks: IntArray  # (N, 3) whether the tree was built, steps so far, number of pairs

    @classmethod
    def none(cls, count: int, walls: int) -> "DiscContacts":
        """Of so many robots that have touched nothing, among so many walls at most."""
        order, pairs, stamps = (np.zeros((count, walls), dtype=np.int64) for _ in range(3))
        near, push = np.zeros((count, 4)), np.zeros((count, 3))
        marks = np.zeros((count, 3), dtype=np.int64)
        return cls(order, pairs, np.zeros((count, walls)), stamps, near, push, marks)


@kernel
def solve_disc(
    contacts: DiscContacts, i: int, walls: FloatArray, law: DiscLaw, state: FloatArray, wish: Velocity
) -> tuple[Velocity, Velocity]:
    """Remove from a velocity what contact forbids, as :meth:`slamgym.sim.contact.ContactSolver.solve` does.

    Args:
        contacts: Changed in place.
        i: The robot.
        walls: Of its building, shape (S, 4) [m].
        law: Of the robot.
        state: Its drive state, see :mod:`slamgym.sim.motion`.
        wish: Velocity that the drive asks for.

    Returns:
        The velocity that contact leaves of the wish, and the slow push that ends an overlap of the skin.
    """
    marks, push, radius = contacts.marks[i], contacts.push[i], law.radius
    pairs, impulses, stamps = contacts.pairs[i], contacts.impulses[i], contacts.stamps[i]
    if not marks[_BUILT]:
        _enter(contacts, i, walls, radius)
    marks[_STEPS] += 1
    # The body moves by the push that the last step asked for, then contacts are found where it stands.
    x, y = state[0] + push[0] * SOLVER_STEP, state[1] + push[1] * SOLVER_STEP
    turned = state[2] + push[2] * SOLVER_STEP
    is_listed_anew = _list_pairs(contacts, i, walls, (x - radius, y - radius, x + radius, y + radius))
    count = marks[_PAIRS]
    found, walls_met, met = np.empty((count, 8)), np.empty(count, dtype=np.int64), 0
    for k in range(count):
        s = pairs[k] if is_listed_anew else pairs[count - 1 - k]
        if _meet(x, y, walls[s], law, found[met]):
            walls_met[met] = s
            met += 1

    per_mass, per_moment = 1.0 / law.mass, 1.0 / law.moment
    vx = wish[0] * law.mass / SOLVER_STEP * per_mass * SOLVER_STEP
    vy = wish[1] * law.mass / SOLVER_STEP * per_mass * SOLVER_STEP
    w = wish[2] * law.moment / SOLVER_STEP * per_moment * SOLVER_STEP
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
    for _ in range(ITERATIONS):
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
    moved = (x - state[0]) / SOLVER_STEP, (y - state[1]) / SOLVER_STEP, (turned - state[2]) / SOLVER_STEP
    return (vx, vy, w), moved


@kernel
def _meet(x: float, y: float, wall: FloatArray, law: DiscLaw, contact: FloatArray) -> bool:
    """Whether a disc touches a wall; writes normal, arm, effective mass, bias and no push yet."""
    ex, ey = wall[2] - wall[0], wall[3] - wall[1]
    radius = law.radius
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
    contact[4] = 1.0 / (1.0 / law.mass + 1.0 / law.moment * across * across)
    contact[5] = -law.pushing * min(0.0, distance + SLOP) / SOLVER_STEP
    contact[6] = 0.0
    return True


@kernel
def _box(wall: FloatArray) -> tuple[float, float, float, float]:
    return min(wall[0], wall[2]), min(wall[1], wall[3]), max(wall[0], wall[2]), max(wall[1], wall[3])


@kernel
def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


@kernel
def _widened(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    wide, high = (box[2] - box[0]) * _WIDENED, (box[3] - box[1]) * _WIDENED
    return box[0] - wide, box[1] - high, box[2] + wide, box[3] + high


@kernel
def _list_pairs(
    contacts: DiscContacts, i: int, walls: FloatArray, box: tuple[float, float, float, float]
) -> bool:
    """Whether the robot left the box in which its pairs hold, so that they had to be listed anew.

    A new list is gone through as the tree lists the walls, an old one backwards.
    """
    near, pairs, marks = contacts.near[i], contacts.pairs[i], contacts.marks[i]
    if near[0] <= box[0] and near[2] >= box[2] and near[1] <= box[1] and near[3] >= box[3]:
        return False
    near[0], near[1], near[2], near[3] = _widened(box)
    marks[_PAIRS] = 0
    for s in contacts.order[i, : len(walls)]:
        if _overlap(_box(walls[s]), (near[0], near[1], near[2], near[3])):
            pairs[marks[_PAIRS]] = s
            marks[_PAIRS] += 1
    return True


@kernel
def _enter(contacts: DiscContacts, i: int, walls: FloatArray, radius: float) -> None:
    """The solver as it is made: the robot is at the origin before it is put to its place."""
    marks, near = contacts.marks[i], contacts.near[i]
    marks[_BUILT], marks[_STEPS], marks[_PAIRS] = 1, 0, 0
    contacts.push[i], contacts.stamps[i] = 0.0, 0
    near[0], near[1], near[2], near[3] = _widened((-radius, -radius, radius, radius))
    for s in range(len(walls)):
        if _overlap(_box(walls[s]), (near[0], near[1], near[2], near[3])):
            contacts.pairs[i, marks[_PAIRS]] = s
            marks[_PAIRS] += 1
    _list_by_tree(walls, contacts.order[i])


@kernel
def _list_by_tree(walls: FloatArray, order: IntArray) -> None:
    """List walls as the leaves of the tree of boxes into which they were put one after the other."""
    count = len(walls)
    boxes = np.empty((2 * count, 4))
    children = np.full((2 * count, 2), -1, dtype=np.int64)
    parents = np.full(2 * count, -1, dtype=np.int64)
    root, nodes = 0, count  # the first are leaves
    for s in range(count):
        boxes[s, 0], boxes[s, 1], boxes[s, 2], boxes[s, 3] = _box(walls[s])
        if s == 0:
            continue
        node = root
        while children[node, 0] >= 0:
            a, b = children[node, 0], children[node, 1]
            cost_a = _area(boxes[b], boxes[b]) + _area(boxes[a], boxes[s])
            cost_b = _area(boxes[a], boxes[a]) + _area(boxes[b], boxes[s])
            if cost_a == cost_b:
                cost_a, cost_b = _proximity(boxes[a], boxes[s]), _proximity(boxes[b], boxes[s])
            node = b if cost_b < cost_a else a
        above, joint = parents[node], nodes
        nodes += 1
        children[joint, 0], children[joint, 1] = s, node
        parents[s], parents[node], parents[joint] = joint, joint, above
        assign(boxes[node], boxes[joint])
        if above < 0:
            root = joint
        else:
            children[above, 0 if children[above, 0] == node else 1] = joint
        while joint >= 0:
            for k in range(2):
                boxes[joint, k] = min(boxes[joint, k], boxes[s, k])
                boxes[joint, 2 + k] = max(boxes[joint, 2 + k], boxes[s, 2 + k])
            joint = parents[joint]
    stack, top, listed = np.empty(count + 1, dtype=np.int64), 1, 0
    stack[0] = root
    while top > 0 and count > 0:
        top -= 1
        node = stack[top]
        if children[node, 0] < 0:
            order[listed] = node
            listed += 1
        else:
            stack[top], stack[top + 1] = children[node, 1], children[node, 0]
            top += 2


@kernel
def _area(a: FloatArray, b: FloatArray) -> float:
    """Of the box about both."""
    return (max(a[2], b[2]) - min(a[0], b[0])) * (max(a[3], b[3]) - min(a[1], b[1]))


@kernel
def _proximity(a: FloatArray, b: FloatArray) -> float:
    return abs(a[0] + a[2] - b[0] - b[2]) + abs(a[1] + a[3] - b[1] - b[3])
