"""The physical world: a floor plan, what stands and walks in it, the robot that drives through it, and its start.

A step has two regimes that share one motion model (:mod:`slamgym.sim.motion`). Until its skin touches something the
robot follows the exact arc, which costs a microsecond. Then pymunk takes over in substeps of a few millimetres and
decides how much of the commanded motion contact allows. Where there is no contact, both give the same motion. Last,
every substep is checked against the obstacles, and one that would put the body into an obstacle is not carried out: no
speed, time step or corner lets the robot through a wall.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import largest_part
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.geometry import between, wrap_angle
from slamgym.core.types import FloatArray, Pose2D, Twist2D
from slamgym.sim import motion
from slamgym.sim.changes import Changes
from slamgym.sim.clutter import Clutter
from slamgym.sim.contact import SKIN, ContactSolver, Velocity
from slamgym.sim.passages import Passages
from slamgym.sim.people import PERSON_RADIUS, Crowd
from slamgym.sim.robot import RobotConfig
from slamgym.sim.surfaces import Surfaces, no_surfaces

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_MARGIN = 0.02
"""Room to spare around the robot at the start [m]."""

_DRAWS = 200
"""So many places are drawn at most until one is away from all people."""

_SIMPLIFICATION = 0.01
"""Detail of the plan's outline that doesn't matter for where a robot fits [m]."""


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
    """A robot in a floor plan.

    Args:
        plan: The building. Its walls are obstacles from both sides.
        robot: The robot's measures and limits.
        clutter: Furniture and people; none where left out.
        surfaces: What all that is made of; plain where left out.
        state: Where the drive state is kept, shape (8,), as kernels over many robots want it; its own where left out.

    Attributes:
        pose: True pose of the robot's base frame, world frame.
        velocity: True velocity of the body.
        surfaces: The materials of the first of :meth:`segments`; people are plain.
        discs: People, who can be touched, shape (P, 3) as x, y, radius [m].
    """

    def __init__(
        self,
        plan: "FloorPlan",
        robot: RobotConfig,
        *,
        clutter: Clutter | None = None,
        surfaces: Surfaces | None = None,
        state: FloatArray | None = None,
    ) -> None:
        self.plan = plan
        self.robot = robot
        walls = np.asarray(plan.segments(), dtype=np.float64)
        clutter = clutter or Clutter()
        self._crowd = Crowd(clutter.people, clutter.walkable) if clutter.walkable else None
        self.discs = self._crowd.discs if self._crowd else np.empty((0, 3))
        # One array: what stays, what may be moved, then the legs of those who walk.
        standing = np.vstack([walls, clutter.segments()])
        self.surfaces = no_surfaces() if surfaces is None else surfaces
        legs = self._crowd.legs() if self._crowd else np.empty((0, 4))
        segments = np.vstack([standing, legs])
        self._legs = segments[len(standing) :]
        self._changes = Changes(clutter, segments[len(walls) : len(standing)])
        self._visible = segments.view()
        self._visible.flags.writeable = False
        self._obstacles = self._visible[: len(standing)]
        self._limits = np.array(
            [robot.linear_acceleration, robot.angular_acceleration, robot.wheel_separation]
        )
        self._contact_radius = float(robot.radius) + SKIN
        self._state = np.zeros(8) if state is None else state
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.velocity = Twist2D(0.0, 0.0)
        self._solver: ContactSolver | None = None

    def _note_pose(self) -> Pose2D:
        """Read the pose off the drive state."""
        x, y, theta = self._state[:3].tolist()
        self.pose = Pose2D(x, y, wrap_angle(theta))
        return self.pose

    def segments(self) -> FloatArray:
        """All that the LIDAR sees now, shape (S, 4) as x0, y0, x1, y1 [m], world frame.

        The array is read-only for the caller, and its last rows follow what is moved and the people as they walk.
        """
        return self._visible

    def furniture(self) -> tuple[FloatArray, ...]:
        """Solids that stand on the floor now, chairs and doors' leaves too: corners of each, shape (K, 2) [m]."""
        return self._changes.furniture()

    def reset(self, pose: Pose2D) -> None:
        """Put the robot at rest at a pose.

        Raises:
            ConfigError: If the pose is outside the plan's free space or the body would overlap something.
        """
        self._state[:] = 0.0
        self._state[:3] = pose
        self._note_pose()
        self.velocity = Twist2D(0.0, 0.0)
        # The solver remembers earlier contacts; without it the next episode can't depend on the last one.
        self._solver = None
        if self._crowd:
            self._crowd.reset()
            self._legs[:] = self._crowd.legs()
        self._changes.reset()
        self._check_start(pose)

    def _check_start(self, pose: Pose2D) -> None:
        """Refuse a start from which the robot can't drive.

        Raises:
            ConfigError: If the pose is outside the plan's free space or the body would overlap something.
        """
        x, y, _ = pose
        plan_id = self.plan.id
        if not np.isfinite(self._state).all():
            raise ConfigError(f"start pose ({x:.2f}, {y:.2f}) in plan {plan_id} must be finite")
        walls = self._obstacles[: len(self.plan.segments())]
        if not motion.inside(x, y, walls):
            raise ConfigError(
                f"start pose ({x:.2f}, {y:.2f}) in plan {plan_id} is outside the free space; "
                "choose another or let the start be sampled"
            )
        if motion.clearance(x, y, self._obstacles, self.discs) < self.robot.radius:
            raise ConfigError(
                f"start pose ({x:.2f}, {y:.2f}) in plan {plan_id} leaves no room for the robot's body; "
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
        self._state[motion.LEFT :] = 0.0
        self.let_time_pass(dt)
        contact = self.drive_touching(target, self._drive_freely(target, dt))
        pose = self._note_pose()
        left, right, distance = self._state[motion.LEFT :].tolist()
        return Motion(pose, between(before, pose), (left, right), contact, distance)

    def carry(self, pose: Pose2D, dt: float) -> Motion:
        """Let ``dt`` seconds pass, if any, after which the robot is known to be at a pose, along a recorded path, say.

        Returns:
            The motion, as of wheels that rolled without slip.
        """
        before = self.pose
        if dt > 0.0:
            self.let_time_pass(dt)
        self._state[:3] = pose
        pose = self._note_pose()
        moved = between(before, pose)
        aside = 0.5 * self.robot.wheel_separation * moved.theta
        return Motion(pose, moved, (moved.x - aside, moved.x + aside), False, abs(moved.x))

    @property
    def num_obstacles(self) -> int:
        """So many of :meth:`segments`, the first ones, can be touched."""
        return len(self._obstacles)

    @property
    def is_lively(self) -> bool:
        """True if people walk or things are moved while time passes."""
        return bool(self._crowd or self._changes.movables)

    def let_time_pass(self, dt: float) -> None:
        """People walk and things are moved while the robot stands."""
        if self._crowd:
            self._let_people_walk(self._crowd, dt)
        if self._changes.movables and self._changes.advance(dt, self._somebody()):
            self._solver = None  # it holds the obstacles as they stood

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

    def _let_people_walk(self, crowd: Crowd, dt: float) -> None:
        """People move first, about a robot that stands; then the robot moves among people who stand."""
        x, y = self._state[:2].tolist()
        crowd.advance(dt, x, y, self._contact_radius)
        self._legs[:] = crowd.legs()
        if self._solver is not None:
            self._solver.place_discs(crowd.discs)

    def _somebody(self) -> FloatArray:
        """The robot and the people with their skin, shape (D, 3) as x, y, radius [m]."""
        robot = [*self._state[:2], self._contact_radius]
        return np.vstack([robot, self.discs + np.array([0.0, 0.0, SKIN])])

    def _drive_freely(self, target: Twist2D, span: float) -> float:
        """Drive until the skin touches something; the time left."""
        left: float = motion.drive_freely(
            self._state,
            target.linear,
            target.angular,
            self._limits,
            span,
            self._contact_radius,
            self._obstacles,
            self.discs,
        )
        if left < span:
            self.velocity = Twist2D(*self._state[motion.LINEAR : motion.LEFT].tolist())
            if self._solver is not None:
                self._solver.release()
        return left

    def drive_touching(self, target: Twist2D, left: float) -> bool:
        """Drive on from where the skin touches something for the time that is left; whether that changed the motion."""
        contact = False
        while left > motion.NO_TIME:
            span = min(left, motion.contact_span(self._state, target.linear))
            contact |= self._contact_substep(target, span)
            left = self._drive_freely(target, left - span)
        return contact

    def _contact_substep(self, target: Twist2D, span: float) -> bool:
        """Move for a short time with pymunk deciding on contacts; whether they changed the motion."""
        pose = Pose2D(*self._state[: motion.LINEAR].tolist())
        drive = motion.wished(self._state, target.linear, target.angular, self._limits, span)
        dx, dy, _, _, turning, _, _ = drive
        solved = self._solve_contact(pose, (dx / span, dy / span, turning))
        contact, linear, angular = motion.settle(
            self._state,
            drive,
            solved,
            self._limits,
            span,
            float(self.robot.radius),
            self._obstacles,
            self.discs,
        )
        self.velocity = Twist2D(linear, angular)
        return bool(contact)

    def _solve_contact(self, pose: Pose2D, wish: Velocity) -> tuple[Velocity, Velocity]:
        """The part of a wished velocity that contact allows, and the push that ends an overlap of the skin."""
        if self._solver is None:
            self._solver = ContactSolver(self._obstacles, self.discs, self.robot)
            self._solver.place_discs(self.discs)
        return self._solver.solve(pose, wish)


def sample_start(
    plan: "FloorPlan", robot: RobotConfig, rng: np.random.Generator, clutter: Clutter | None = None
) -> Pose2D:
    """Draw a pose at which the robot touches nothing and from which it can reach most of the building.

    The place is drawn evenly from the largest connected area in which the robot fits, the heading evenly from
    the full turn.

    Args:
        plan: The building.
        robot: The robot.
        rng: Source of the draw.
        clutter: Furniture and people to keep off.

    Returns:
        The pose of the robot's base, world frame.

    Raises:
        PlanError: If the robot fits nowhere.
    """
    if clutter is None or clutter.passages is None:
        return sample_pose(start_area(plan, robot), rng)
    return _sample_among(clutter.passages, clutter, plan, robot, rng)


def start_area(plan: "FloorPlan", robot: RobotConfig) -> shapely.Polygon:
    """Where :func:`sample_start` draws from in an empty building, for a caller who draws often.

    Raises:
        PlanError: If the robot fits nowhere.
    """
    area = largest_part(fitting_area(plan, _room_for(robot)))
    if area.is_empty:
        raise _fits_nowhere(plan, robot)
    return area


def sample_pose(area: shapely.Polygon, rng: np.random.Generator) -> Pose2D:
    """A pose whose place is drawn evenly from an area and whose heading from the full turn."""
    x, y = sample_point(area, rng)
    return Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))


def fitting_area(plan: "FloorPlan", radius: float) -> BaseGeometry:
    """Where the middle of a disc can be without touching a wall."""
    area: BaseGeometry = plan.free_space.simplify(_SIMPLIFICATION)
    return area.buffer(-radius - _SIMPLIFICATION, quad_segs=4)


def sample_point(area: shapely.Polygon, rng: np.random.Generator) -> tuple[float, float]:
    """A point drawn evenly from an area that isn't empty."""
    shapely.prepare(area)
    low, high = np.reshape(area.bounds, (2, 2))
    for _ in range(100):
        points = rng.uniform(low, high, (32, 2))
        inside = points[shapely.contains_xy(area, points[:, 0], points[:, 1])]
        if len(inside):
            x, y = inside[0].tolist()
            return x, y
    # A sliver that thousands of draws miss.
    point = area.representative_point()
    return float(point.x), float(point.y)


def _sample_among(
    passages: Passages,
    clutter: Clutter,
    plan: "FloorPlan",
    robot: RobotConfig,
    rng: np.random.Generator,
) -> Pose2D:
    """Draw from the cells of the largest part that furniture, doors and people leave."""
    radius = _room_for(robot)
    cells = passages.largest_part(radius)
    for _ in range(_DRAWS if cells.any() else 0):
        x, y = passages.sample_point(cells, rng)
        distances = [math.dist((x, y), person.start) for person in clutter.people]
        if all(distance >= radius + PERSON_RADIUS for distance in distances):
            return Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))
    raise _fits_nowhere(plan, robot)


def _room_for(robot: RobotConfig) -> float:
    return robot.radius + SKIN + _MARGIN


def _fits_nowhere(plan: "FloorPlan", robot: RobotConfig) -> PlanError:
    return PlanError(plan.id, f"a robot of radius {robot.radius:.2f} m fits nowhere in it")
