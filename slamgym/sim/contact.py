"""Contacts of robots with the world and with each other, solved by pymunk.

Only a robot whose skin presses on something comes here (:func:`slamgym.sim.motion.drive_freely`): few do at a time.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import pymunk

from slamgym.core.types import FloatArray, Pose2D
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


class Solved(NamedTuple):
    """What contact makes of a wished velocity; the body moves by the sum of both."""

    left: Velocity
    """The part of the wish that contact allows."""
    push: Velocity
    """The slow push that ends an overlap of the skin."""


class ContactSolver:
    """A pymunk space with the walls as static segments, people as discs and each robot as a rigid body.

    Each call answers: of wished velocities at these poses, what do the contacts leave? A wish
    enters as the force that would bring its body from rest to it, because the solver applies contact
    impulses after forces. Robots that push each other move alike: all have the same weight and tyres.

    Args:
        segments: Walls and furniture, shape (S, 4) [m].
        discs: People, shape (P, 3) as x, y, radius [m].
        robot: Each robot.
        count: How many there are.
    """

    def __init__(
        self, segments: FloatArray, discs: FloatArray, robot: RobotConfig, count: int = 1
    ) -> None:
        self._space = pymunk.Space()
        self._space.iterations = _ITERATIONS
        self._space.collision_slop = _SLOP
        # Robots with their skin; the base frame's origin is the body's. A disc that slides turns as it wishes.
        self._bodies = [pymunk.Body(ROBOT_MASS, math.inf) for _ in range(count)]
        shapes = [pymunk.Circle(body, robot.radius + SKIN) for body in self._bodies]
        self._others = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in discs]
        others = [
            pymunk.Circle(body, float(radius))
            for body, radius in zip(self._others, discs[:, 2], strict=True)
        ]
        walls = [
            pymunk.Segment(self._space.static_body, (x0, y0), (x1, y1), 0.0)
            for x0, y0, x1, y1 in segments.tolist()
        ]
        self._space.add(*self._bodies, *shapes, *self._others, *walls, *others)
        self._is_apart = True
        self.place_discs(discs)

    def release(self) -> None:
        """Note that the robots have driven on freely: the push of their last contact is over."""
        self._is_apart = True

    def place_discs(self, discs: FloatArray) -> None:
        """Move people, shape (P, 3)."""
        for body, disc in zip(self._others, discs, strict=True):
            body.position = float(disc[0]), float(disc[1])

    def solve(self, poses: Sequence[Pose2D], wishes: Sequence[Velocity]) -> list[Solved]:
        """Remove from velocities what contact forbids.

        Args:
            poses: Where the robots stand.
            wishes: Velocities that their drives ask for.
        """
        if self._is_apart:
            self._is_apart = False
            self._step(poses, [(0.0, 0.0, 0.0)] * len(poses))  # finds the overlap that there is now
        self._step(poses, wishes)
        solved = []
        for body, pose, wish in zip(self._bodies, poses, wishes, strict=True):
            velocity = body.velocity
            position = body.position
            # The step moved the body before it solved, from rest: that is the push which the last overlap asked
            # for.
            push_x = (position.x - pose.x) / _SOLVER_STEP
            push_y = (position.y - pose.y) / _SOLVER_STEP
            solved.append(Solved((velocity.x, velocity.y, wish[2]), (push_x, push_y, 0.0)))
        return solved

    def _step(self, poses: Sequence[Pose2D], wishes: Sequence[Velocity]) -> None:
        """Step the solver with bodies at poses, at rest, and the forces that would bring them to velocities."""
        for body, pose, wish in zip(self._bodies, poses, wishes, strict=True):
            body.position = pose.x, pose.y
            body.velocity = 0.0, 0.0
            body.force = wish[0] * ROBOT_MASS / _SOLVER_STEP, wish[1] * ROBOT_MASS / _SOLVER_STEP
        self._space.step(_SOLVER_STEP)
