"""Contact between the robot and the world, solved by pymunk.

Only a robot whose skin presses on something comes here (:func:`slamgym.sim.motion.drive_freely`): few do at a time.
"""

import math

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


class ContactSolver:
    """A pymunk space with the walls as static segments, people and other robots as discs and the robot as a rigid body.

    Each call answers: of a wished velocity at this pose, what do the contacts leave? The wish
    enters as the force that would bring the body from rest to it, because the solver applies contact
    impulses after forces.
    """

    def __init__(self, segments: FloatArray, discs: FloatArray, robot: RobotConfig) -> None:
        self._space = pymunk.Space()
        self._space.iterations = _ITERATIONS
        self._space.collision_slop = _SLOP
        # The robot with its skin; the base frame's origin is the body's. A disc that slides turns as it wishes.
        self._body = pymunk.Body(ROBOT_MASS, math.inf)
        shape = pymunk.Circle(self._body, robot.radius + SKIN)
        self._others = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in discs]
        others = [
            pymunk.Circle(body, float(radius))
            for body, radius in zip(self._others, discs[:, 2], strict=True)
        ]
        walls = [
            pymunk.Segment(self._space.static_body, (x0, y0), (x1, y1), 0.0)
            for x0, y0, x1, y1 in segments.tolist()
        ]
        self._space.add(self._body, shape, *self._others, *walls, *others)
        self._is_apart = True

    def release(self) -> None:
        """Note that the robot has driven on freely: the push of its last contact is over."""
        self._is_apart = True

    def place_discs(self, discs: FloatArray) -> None:
        """Move people and other robots, shape (P, 3)."""
        for body, disc in zip(self._others, discs, strict=True):
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
        if self._is_apart:
            self._is_apart = False
            self._step(pose, (0.0, 0.0, 0.0))  # finds the overlap that there is now
        self._step(pose, wish)
        body = self._body
        velocity = body.velocity
        position = body.position
        # The step moved the body before it solved, from rest: that is the push which the last overlap asked
        # for.
        push_x = (position.x - pose.x) / _SOLVER_STEP
        push_y = (position.y - pose.y) / _SOLVER_STEP
        return (velocity.x, velocity.y, wish[2]), (push_x, push_y, 0.0)

    def _step(self, pose: Pose2D, wish: Velocity) -> None:
        """Step the solver with the body at a pose, at rest, and the force that would bring it to a velocity."""
        body = self._body
        body.position = pose.x, pose.y
        body.velocity = 0.0, 0.0
        body.force = wish[0] * ROBOT_MASS / _SOLVER_STEP, wish[1] * ROBOT_MASS / _SOLVER_STEP
        self._space.step(_SOLVER_STEP)
