"""Contact between the robot and the world, solved by pymunk."""

import pymunk

from slamgym.core.types import FloatArray, Pose2D
from slamgym.sim.robot import RobotConfig

SKIN = 0.01
"""Contact begins this far outside the body [m]. The solver needs some overlap to work with; the skin takes
it, so that the body itself never enters an obstacle."""

SUBSTEP_DISTANCE = 0.008
"""Furthest that a point of the body may move between two looks at the contacts [m]: less than the skin, so
that no obstacle is passed unseen."""

# Overlap of skin and obstacle that is left standing, so that resting contacts persist [m].
SLOP = 0.001

# Sequential-impulse iterations; two walls of a corner converge to 1e-6 m/s in about ten.
ITERATIONS = 30

# Nominal duration of a solver step [s]. It is the same for every substep, however long: the solver starts
# from the impulses of its last step, scaled by the ratio of the durations, but here an impulse takes away a
# velocity, not a force.
SOLVER_STEP = 0.01

Velocity = tuple[float, float, float]
"""Of a rigid body in the world's axes: x [m/s], y [m/s], turning [rad/s]."""

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
        self._space.iterations = ITERATIONS
        self._space.collision_slop = SLOP
        self._body, shape = _robot_body(robot)
        self._inertia = self._body.mass, self._body.moment
        self._people = [pymunk.Body(body_type=pymunk.Body.KINEMATIC) for _ in discs]
        people = [pymunk.Circle(body, float(disc[2])) for body, disc in zip(self._people, discs, strict=True)]
        walls = [
            pymunk.Segment(self._space.static_body, (float(x0), float(y0)), (float(x1), float(y1)), 0.0)
            for x0, y0, x1, y1 in segments
        ]
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
            The velocity that contact leaves of the wish, and the slow push that ends an overlap of the skin.
            The body moves by the sum of both.
        """
        body, (mass, moment) = self._body, self._inertia
        # By the properties themselves: pymunk's __setattr__ takes longer than what they do.
        _set_position(body, (pose.x, pose.y))
        _set_angle(body, pose.theta)
        _set_velocity(body, (0.0, 0.0))
        _set_angular_velocity(body, 0.0)
        _set_force(body, (wish[0] * mass / SOLVER_STEP, wish[1] * mass / SOLVER_STEP))
        _set_torque(body, wish[2] * moment / SOLVER_STEP)
        self._space.step(SOLVER_STEP)
        velocity, position = body.velocity, body.position
        # The step moved the body before it solved, from rest: that is the push which the last overlap asked
        # for.
        push_x, push_y, push_turn = position.x - pose.x, position.y - pose.y, body.angle - pose.theta
        push = push_x / SOLVER_STEP, push_y / SOLVER_STEP, push_turn / SOLVER_STEP
        return (velocity.x, velocity.y, body.angular_velocity), push


def _robot_body(robot: RobotConfig) -> tuple[pymunk.Body, pymunk.Shape]:
    """The robot with its skin; the base frame's origin is the body's."""
    if robot.shape == "circle":
        moment = pymunk.moment_for_circle(robot.mass, 0.0, robot.radius)
        body = pymunk.Body(robot.mass, moment)
        return body, pymunk.Circle(body, robot.radius + SKIN)
    rear, right, front, left = robot.footprint
    corners = [(rear, right), (front, right), (front, left), (rear, left)]
    moment = pymunk.moment_for_poly(robot.mass, corners)
    body = pymunk.Body(robot.mass, moment)
    return body, pymunk.Poly(body, corners, radius=SKIN)
