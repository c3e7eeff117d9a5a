"""Where a robot starts: a place in a building that it fits in, and from which it can reach most of it."""

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import largest_part
from slamgym.core.errors import PlanError
from slamgym.core.types import Pose2D
from slamgym.sim.clutter import Clutter
from slamgym.sim.contact import SKIN
from slamgym.sim.passages import Passages
from slamgym.sim.people import PERSON_RADIUS
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_MARGIN = 0.02
"""Room to spare around the robot at the start [m]."""

_DRAWS = 200
"""So many places are drawn at most until one is away from all people."""

_SIMPLIFICATION = 0.01
"""Detail of the plan's outline that doesn't matter for where a robot fits [m]."""


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
