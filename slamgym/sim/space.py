"""The physical world: the robot that drives through a building.

A step has two regimes that share one motion model (:mod:`slamgym.sim.motion`). Until its skin touches something the
robot follows the exact arc, which costs a microsecond. Then pymunk takes over in substeps of a few millimetres and
decides how much of the commanded motion contact allows. Where there is no contact, both give the same motion. Last,
every substep is checked against the obstacles, and one that would put the body into an obstacle is not carried out: no
speed, time step or corner lets the robot through a wall.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import between, unit_vectors, wrap_angle
from slamgym.core.types import FloatArray, Pose2D, Twist2D
from slamgym.sim import motion
from slamgym.sim.building import Building, Contacts
from slamgym.sim.clutter import Clutter
from slamgym.sim.contact import SKIN, Solved, Velocity
from slamgym.sim.robot import RobotConfig
from slamgym.sim.surfaces import Surfaces

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_ROBOT_FACES = 16
"""Faces of a robot as others see it: 4 mm within the circle."""


class Motion(NamedTuple):
    """The robot's motion during one step."""

    pose: Pose2D
    """True pose after the step, world frame."""

    increment: Pose2D
    """True motion of the body, in the frame of the pose before the step."""

    wheels: tuple[float, float]
    """Distances that the left and the right wheel rolled [m]; more or less than the body moved where contact made
    them slip."""

    contact: bool
    """True if contact stopped or deflected the body at any time during the step."""

    distance: float
    """Distance of the axle's middle, forward or backward [m]."""


class World:
    """A robot in a building, alone or among other robots.

    Args:
        plan: The floor plan, or the building that other robots are in, too.
        robot: The robot's measures and limits.
        clutter: Furniture and people in the floor plan; none where left out.
        surfaces: What all that is made of; plain where left out.
        state: Where the drive state is kept, shape (8,), as kernels over many robots want it; its own where left out.
        others: Number of other robots in the building, which the caller lets drive and tells of each other
            (:class:`slamgym.sim.encounter.Encounter`).

    Attributes:
        building: What the robot drives in.
        robot: As given.
        pose: True pose of the robot's base frame, world frame.
        velocity: True velocity of the body.
        state: As given, see :mod:`slamgym.sim.motion`.
        discs: People and other robots, who can be touched, shape (P, 3) as x, y, radius [m].
    """

    def __init__(
        self,
        plan: "FloorPlan | Building",
        robot: RobotConfig,
        *,
        clutter: Clutter | None = None,
        surfaces: Surfaces | None = None,
        state: FloatArray | None = None,
        others: int = 0,
    ) -> None:
        self.building = plan if isinstance(plan, Building) else Building(plan, clutter, surfaces)
        self.robot = robot
        self.discs = self.building.discs
        self._num_others = others
        if others:
            self.discs = np.vstack([self.discs, np.full((others, 3), np.inf)])
            self.discs[-others:, 2] = robot.radius
        self._limits = np.array(
            [robot.linear_acceleration, robot.angular_acceleration, robot.wheel_separation]
        )
        self._contact_radius = float(robot.radius) + SKIN
        self.state = np.zeros(8) if state is None else state
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.velocity = Twist2D(0.0, 0.0)
        self._contacts = Contacts(self.building, robot, 1)

    def _note_pose(self) -> Pose2D:
        """Read the pose off the drive state."""
        x, y, theta = self.state[:3].tolist()
        self.pose = Pose2D(x, y, wrap_angle(theta))
        return self.pose

    def segments(self) -> FloatArray:
        """All that the LIDAR sees now, shape (S, 4) as x0, y0, x1, y1 [m], world frame; read-only.

        Alone in a building the array's last rows follow what is moved and the people as they walk. Other robots are
        cylinders that a laser meets at the radius at which they collide.
        """
        segments = self.building.segments()
        if self._num_others:
            segments = np.vstack([segments, *map(_outline, self.discs[-self._num_others :])])
            segments.flags.writeable = False
        return segments

    def place_others(self, places: FloatArray) -> None:
        """Tell where the other robots are, shape (N, 2 or more) [m]."""
        self.discs[-self._num_others :, :2] = places[:, :2]

    def reset(self, pose: Pose2D) -> None:
        """Put the robot at rest at a pose.

        Raises:
            ConfigError: If the pose is outside the plan's free space or the body would overlap something.
        """
        self.state[:] = 0.0
        self.state[:3] = pose
        self._note_pose()
        self.velocity = Twist2D(0.0, 0.0)
        self.building.reset()
        # The solver remembers earlier contacts; without it the next episode can't depend on the last one.
        self._contacts.reset()
        self._check_start(pose)

    def _check_start(self, pose: Pose2D) -> None:
        """Refuse a start from which the robot can't drive.

        Raises:
            ConfigError: If the pose is outside the plan's free space or the body would overlap something.
        """
        x, y, _ = pose
        plan = self.building.plan
        if not np.isfinite(self.state).all():
            raise ConfigError(f"start pose ({x:.2f}, {y:.2f}) in plan {plan.id} must be finite")
        walls = self.building.obstacles[: len(plan.segments())]
        if not motion.inside(x, y, walls):
            raise ConfigError(
                f"start pose ({x:.2f}, {y:.2f}) in plan {plan.id} is outside the free space; "
                "choose another or let the start be sampled"
            )
        if motion.clearance(x, y, self.building.obstacles, self.discs) < self.robot.radius:
            raise ConfigError(
                f"start pose ({x:.2f}, {y:.2f}) in plan {plan.id} leaves no room for the robot's body; "
                "choose another or let the start be sampled"
            )

    def step(self, command: Twist2D, dt: float) -> Motion:
        """Drive for ``dt`` seconds towards a commanded velocity.

        Args:
            command: Wished velocity; what exceeds the robot's limits is cut off.
            dt: Duration [s]; any length.

        Returns:
            What happened.

        Raises:
            ValueError: If the command or the duration is not a number, or the duration is not positive.
        """
        target = self._within_limits(command, dt)
        before = self.pose
        self.state[motion.LEFT :] = 0.0
        self.let_time_pass(dt)
        contact = self.drive_touching(target, self._drive_freely(target, dt))
        pose = self._note_pose()
        left, right, distance = self.state[motion.LEFT :].tolist()
        return Motion(pose, between(before, pose), (left, right), contact, distance)

    def carry(self, pose: Pose2D, dt: float) -> Motion:
        """Let ``dt`` seconds pass, if any, after which the robot is known to be at a pose, along a recorded path, say.

        Returns:
            The motion, as of wheels that rolled without slip.
        """
        before = self.pose
        if dt > 0.0:
            self.let_time_pass(dt)
        self.state[:3] = pose
        pose = self._note_pose()
        moved = between(before, pose)
        aside = 0.5 * self.robot.wheel_separation * moved.theta
        return Motion(pose, moved, (moved.x - aside, moved.x + aside), False, abs(moved.x))

    def let_time_pass(self, dt: float) -> None:
        """People walk and things are moved while the robot, alone in its building, stands."""
        if self.building.is_lively:
            self.building.let_time_pass(dt, self.body[np.newaxis])

    @property
    def body(self) -> FloatArray:
        """The robot with its skin: x, y, radius [m]."""
        return np.array([*self.state[:2], self._contact_radius])

    def _within_limits(self, command: Twist2D, dt: float) -> Twist2D:
        linear = float(command[0])
        angular = float(command[1])
        if math.isnan(linear) or math.isnan(angular):
            raise ValueError(f"command {command} is not a number")
        if not 0.0 < dt < math.inf:
            raise ValueError(f"dt must be positive and finite, not {dt}")
        linear = min(max(linear, -self.robot.max_linear), self.robot.max_linear)
        angular = min(max(angular, -self.robot.max_angular), self.robot.max_angular)
        return Twist2D(linear, angular)

    def _drive_freely(self, target: Twist2D, span: float) -> float:
        """Drive until the skin touches something; the time left."""
        left: float = motion.drive_freely(
            self.state,
            target.linear,
            target.angular,
            self._limits,
            span,
            self._contact_radius,
            self.building.obstacles,
            self.discs,
        )
        if left < span:
            self.velocity = Twist2D(*self.state[motion.LINEAR : motion.LEFT].tolist())
            self._contacts.release()
        return left

    def drive_touching(self, target: Twist2D, left: float) -> bool:
        """Drive on from where the skin touches something for the time that is left; whether that changed the motion."""
        contact = False
        while left > motion.NO_TIME:
            span = min(left, motion.contact_span(self.state, target.linear))
            contact |= self._contact_substep(target, span)
            left = self._drive_freely(target, left - span)
        return contact

    def _contact_substep(self, target: Twist2D, span: float) -> bool:
        """Move for a short time with pymunk deciding on contacts; whether they changed the motion."""
        wish = self.wish(target, span)
        (solved,) = self._contacts.solve([self.stand], [wish.velocity])
        return self.settle(wish, solved, span)

    @property
    def stand(self) -> Pose2D:
        """Where the robot stands; its heading goes on growing in turns."""
        return Pose2D(*self.state[: motion.LINEAR].tolist())

    def wish(self, target: Twist2D, span: float) -> "WishedMotion":
        """What the drive would do for a short time towards a velocity."""
        drive = motion.wished(self.state, target.linear, target.angular, self._limits, span)
        dx, dy, _, _, turning, _, _ = drive
        return WishedMotion(drive, (dx / span, dy / span, turning))

    def settle(self, wish: "WishedMotion", solved: Solved, span: float) -> bool:
        """Do for a short time what contact leaves of a wish; whether that is something else."""
        contact, linear, angular = motion.settle(
            self.state,
            wish.drive,
            (solved.left, solved.push),
            self._limits,
            span,
            float(self.robot.radius),
            self.building.obstacles,
            self.discs,
        )
        self.velocity = Twist2D(linear, angular)
        return bool(contact)


class WishedMotion(NamedTuple):
    """What a drive would do if nothing were in the way."""

    drive: tuple[float, float, float, float, float, float, float]
    """See :func:`slamgym.sim.motion.wished`."""
    velocity: Velocity


def _outline(disc: FloatArray) -> FloatArray:
    """The faces of a robot that a laser meets, shape (_ROBOT_FACES, 4) [m]."""
    x, y, radius = disc
    numbers = np.arange(_ROBOT_FACES + 1, dtype=np.float64)
    corners = radius * unit_vectors(numbers * (2.0 * math.pi / _ROBOT_FACES)) + (x, y)
    return np.hstack([corners[:-1], corners[1:]])
