"""Where an exploration begins."""

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from slamgym.core.errors import PlanError
from slamgym.core.types import Pose2D
from slamgym.sim.clutter import Clutter, fitting_area, largest_part, sample_point
from slamgym.sim.contact import SKIN
from slamgym.sim.people import PERSON_RADIUS
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

# Room to spare around the robot at the start [m].
_MARGIN = 0.02


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
    return sample_pose(start_area(plan, robot, clutter), rng)


def start_area(plan: "FloorPlan", robot: RobotConfig, clutter: Clutter | None = None) -> shapely.Polygon:
    """Where :func:`sample_start` draws from, for a caller who draws often.

    Raises:
        PlanError: If the robot fits nowhere.
    """
    radius = robot.circumscribed_radius + SKIN + _MARGIN
    furniture = clutter.furniture if clutter else ()
    area = largest_part(fitting_area(plan, radius, furniture))
    if clutter and clutter.people:
        people = [shapely.Point(person.start).buffer(radius + PERSON_RADIUS) for person in clutter.people]
        area = largest_part(area.difference(shapely.union_all(people)))
    if area.is_empty:
        raise PlanError(plan.id, f"a robot of radius {robot.circumscribed_radius:.2f} m fits nowhere in it")
    return area


def sample_pose(area: shapely.Polygon, rng: np.random.Generator) -> Pose2D:
    """A pose whose place is drawn evenly from an area and whose heading from the full turn."""
    x, y = sample_point(area, rng)
    return Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))
