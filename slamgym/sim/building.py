"""A building with what stands, walks and changes in it, for all robots that drive there."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.types import FloatArray, Pose2D
from slamgym.sim.changes import Changes
from slamgym.sim.clutter import Clutter
from slamgym.sim.contact import SKIN, ContactSolver, Solved, Velocity
from slamgym.sim.people import Crowd
from slamgym.sim.robot import RobotConfig
from slamgym.sim.surfaces import Surfaces, no_surfaces

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan


class Building:
    """Walls, furniture and people.

    Args:
        plan: The floor plan. Its walls are obstacles from both sides.
        clutter: Furniture and people; none where left out.
        surfaces: What all that is made of; plain where left out.

    Attributes:
        plan: As given.
        surfaces: The materials of the first of :meth:`segments`; people are plain.
        discs: People, who can be touched, shape (P, 3) as x, y, radius [m]; they follow them.
        num_obstacles: So many of :meth:`segments`, the first ones, can be touched.
        obstacles: These, shape (num_obstacles, 4) [m]; they follow what is moved.
        moves: How often obstacles have been moved.
    """

    def __init__(
        self, plan: "FloorPlan", clutter: Clutter | None = None, surfaces: Surfaces | None = None
    ) -> None:
        self.plan = plan
        self.surfaces = no_surfaces() if surfaces is None else surfaces
        walls = np.asarray(plan.segments(), dtype=np.float64)
        clutter = clutter or Clutter()
        self._crowd = Crowd(clutter.people, clutter.walkable) if clutter.walkable else None
        self.discs = self._crowd.discs if self._crowd else np.empty((0, 3))
        # One array: what stays, what may be moved, then the legs of those who walk.
        standing = np.vstack([walls, clutter.segments()])
        legs = self._crowd.legs() if self._crowd else np.empty((0, 4))
        segments = np.vstack([standing, legs])
        self.num_obstacles = len(standing)
        self.moves = 0
        self._legs = segments[len(standing) :]
        self._changes = Changes(clutter, segments[len(walls) : len(standing)])
        self._visible = segments.view()
        self._visible.flags.writeable = False
        self.obstacles = self._visible[: self.num_obstacles]

    def segments(self) -> FloatArray:
        """All that a laser sees now, shape (S, 4) as x0, y0, x1, y1 [m], world frame.

        The array is read-only for the caller, and its last rows follow what is moved and the people as they walk.
        """
        return self._visible

    def furniture(self) -> tuple[FloatArray, ...]:
        """Solids that stand on the floor now, chairs and doors' leaves too: corners of each, shape (K, 2) [m]."""
        return self._changes.furniture()

    def reset(self) -> None:
        """Back to the start, to change in the same way again."""
        if self._crowd:
            self._crowd.reset()
            self._legs[:] = self._crowd.legs()
        self._changes.reset()
        self.moves += 1

    @property
    def is_lively(self) -> bool:
        """True if people walk or things are moved while time passes."""
        return bool(self._crowd or self._changes.movables)

    def let_time_pass(self, dt: float, robots: FloatArray) -> None:
        """People walk and things are moved while the robots stand.

        Args:
            dt: Duration [s].
            robots: With their skin, shape (R, 3) as x, y, radius [m].
        """
        if self._crowd:
            self._crowd.advance(dt, robots)
            self._legs[:] = self._crowd.legs()
        if self._changes.movables:
            people = self.discs + np.array([0.0, 0.0, SKIN])
            self.moves += self._changes.advance(dt, np.vstack([robots, people]))


class Contacts:
    """The contact solver of robots in a building as it stands now, made when something is touched.

    Args:
        building: What the robots drive in.
        robot: Each robot.
        count: How many there are.
    """

    def __init__(self, building: Building, robot: RobotConfig, count: int) -> None:
        self._building = building
        self._robot = robot
        self._count = count
        self._moves = -1
        self._solver: ContactSolver | None = None

    def reset(self) -> None:
        """Forget all contacts."""
        self._solver = None

    def release(self) -> None:
        """Note that the robots have driven on freely: the push of their last contact is over."""
        if self._solver is not None:
            self._solver.release()

    def solve(self, poses: Sequence[Pose2D], wishes: Sequence[Velocity]) -> list[Solved]:
        """What contact leaves of wished velocities; see :meth:`ContactSolver.solve`."""
        building = self._building
        if self._solver is None or self._moves != building.moves:
            self._moves = building.moves
            self._solver = ContactSolver(
                building.obstacles, building.discs, self._robot, self._count
            )
        if len(building.discs):
            self._solver.place_discs(building.discs)
        return self._solver.solve(poses, wishes)
