"""True paths that are planned over a probabilistic roadmap: through all rooms, or between two points."""

from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely

from slamgym.core.errors import PlanError, SlamgymError
from slamgym.core.types import FloatArray, Trajectory
from slamgym.parametric.paths import Waypoints, drive
from slamgym.planning.prm import (
    DrivableArea,
    build_roadmap,
    drivable_area,
    random_path,
    spread_stops,
    tour,
)
from slamgym.sim.clutter import Clutter
from slamgym.sim.passages import ROUNDING, Passages
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_ROBOT = RobotConfig()
_CLEARANCE = RobotConfig.radius + ROUNDING
"""Distance that a planned path keeps from walls [m], so that it leads through every doorway that the robot fits in."""
_STOP_SPACING = 5.0
"""Distance between stops in a plan without rooms [m]; the LIDAR sees what lies between."""


def plan_trajectory(
    plan: "FloorPlan",
    rng: np.random.Generator,
    kind: Literal["tour", "pair"] = "tour",
    robot: RobotConfig = _ROBOT,
    clutter: Clutter | None = None,
) -> Trajectory:
    """Plan a true path over a roadmap.

    Args:
        plan: The building.
        rng: Draws the roadmap and the ends.
        kind: ``tour``: through all rooms; ``pair``: between two random points, as in the paper.
        robot: Who drives.
        clutter: What stands in the way.

    Raises:
        PlanError: If the robot fits nowhere.
    """
    passages = None if clutter is None else clutter.passages
    if passages is None:
        passages = Passages(plan, 2.0 * _CLEARANCE)
    try:
        # Rows of passages grow upwards.
        area = drivable_area(passages.clearance[::-1], passages.frame, _CLEARANCE)
    except SlamgymError as error:
        raise PlanError(plan.id, str(error)) from error
    if kind == "pair":
        points = random_path(build_roadmap(area, rng), rng)
    else:
        middles = _room_middles(plan, area)
        roadmap = build_roadmap(area, rng, middles)
        stops = np.concatenate([spread_stops(roadmap, _STOP_SPACING, rng), middles])
        points = tour(roadmap, stops, rng)
    return drive(Waypoints(points), f"the path planned in {plan.id}", robot)


def _room_middles(plan: "FloorPlan", area: DrivableArea) -> FloatArray:
    """Of each room that the area reaches into, the cell nearest to the middle of its free part; (R, 2) [m]."""
    points = area.points
    middles = []
    for room in plan.rooms:
        free = shapely.intersection(room.polygon, plan.free_space)
        shapely.prepare(free)
        inside = points[shapely.intersects_xy(free, *points.T)]
        if len(inside):
            away = inside - shapely.get_coordinates(free.centroid)
            middles.append(inside[np.argmin(np.square(away).sum(axis=1))])
    return np.array(middles).reshape(-1, 2)


def rooms_left_out(plan: "FloorPlan", trajectory: Trajectory) -> list[str]:
    """Names of the rooms that a path doesn't enter, with their middles."""
    x, y, _ = trajectory.poses.T
    left_out = []
    for room in plan.rooms:
        if not shapely.intersects_xy(room.polygon, x, y).any():
            middle = room.polygon.centroid
            left_out.append(f"{room.category} at ({middle.x:.1f}, {middle.y:.1f})")
    return left_out
