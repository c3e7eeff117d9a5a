"""Where a true path comes from: a file of waypoints, a recorded trajectory, or a probabilistic roadmap."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely

from slamgym.core.errors import InputFileError, PlanError, SlamgymError
from slamgym.core.files import read_text
from slamgym.core.limits import shown
from slamgym.core.types import FREE, FloatArray
from slamgym.interop.tum import read_tum
from slamgym.parametric.config import MotionConfig
from slamgym.parametric.trajectory import TimedTrajectory, Waypoints, check_path_is_free, drive, from_recorded
from slamgym.planning.prm import PrmConfig, Roadmap, build_roadmap, random_path, spread_stops, tour

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_ROADMAP_RESOLUTION = 0.05  # [m] of the grid that a roadmap is made on
_STOP_SPACING = (
    5.0  # [m] along the path between stops in a plan without rooms; the LIDAR sees what lies between
)


def read_waypoints(path: Path | str) -> Waypoints:
    """Read waypoints from a CSV file: x, y and optionally the time of arrival; a header line may stand first.

    Raises:
        InputFileError: If the file can't be read or a line has not two or three numbers.
    """
    lines = read_text(path).splitlines()
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        fields = [field.strip() for field in line.split("#", 1)[0].replace(";", ",").split(",")]
        if fields == [""]:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError as error:
            if not rows and number == 1:
                continue  # the header
            raise InputFileError(
                f"{path}:{number}", f"is not a line of numbers x,y[,t]: {shown(line)}"
            ) from error
        if len(row) not in (2, 3) or (rows and len(row) != len(rows[0])):
            raise InputFileError(
                f"{path}:{number}", "has not two (x,y) or three (x,y,t) numbers like the rest"
            )
        rows.append(row)
    if not rows:
        raise InputFileError(path, "has no waypoint; give one line x,y[,t] per waypoint")
    table = np.array(rows, dtype=np.float64)
    return Waypoints(table[:, :2], table[:, 2] if table.shape[1] == 3 else None)


def trajectory_from_file(path: Path | str, plan: "FloorPlan", motion: MotionConfig) -> TimedTrajectory:
    """The true path that a file holds: waypoints (``.csv``) or recorded poses (``.tum`` or ``.txt``).

    Convention: the numbers are in the world frame of the plan.

    Raises:
        InputFileError: If the file can't be read.
        ConfigError: If the path makes no sense or leaves the free space.
    """
    if Path(path).suffix.lower() in (".tum", ".txt"):
        recorded = from_recorded(read_tum(path), str(path))
        check_path_is_free(recorded.poses[:, :2], plan.free_space, str(path), "pose")
        return recorded
    waypoints = read_waypoints(path)
    trajectory = drive(waypoints, motion, str(path))
    check_path_is_free(waypoints.points, plan.free_space, str(path))
    return trajectory


def roadmap_of(plan: "FloorPlan", clearance: float, rng: np.random.Generator) -> Roadmap:
    """A roadmap of a plan.

    Raises:
        PlanError: If the plan has no free space that the robot fits in.
    """
    grid = plan.raster(_ROADMAP_RESOLUTION)
    if not (grid.cells == FREE).any():
        raise PlanError(plan.id, "has no free space")
    try:
        return build_roadmap(grid, PrmConfig(clearance=clearance), rng)
    except SlamgymError as error:
        raise PlanError(plan.id, str(error)) from error


def plan_trajectory(
    plan: "FloorPlan",
    motion: MotionConfig,
    rng: np.random.Generator,
    kind: Literal["tour", "pair"] = "tour",
) -> TimedTrajectory:
    """Plan a true path over a roadmap.

    Args:
        plan: The building.
        motion: Speeds, and the clearance to keep.
        rng: Draws the roadmap and the ends.
        kind: ``tour``: through all rooms; ``pair``: between two random points, as in the paper.

    Raises:
        PlanError: If the robot fits nowhere.
    """
    roadmap = roadmap_of(plan, motion.clearance, rng)
    if kind == "pair":
        points = random_path(roadmap, rng)
    else:
        stops = [spread_stops(roadmap, _STOP_SPACING, rng)]
        stops += [room_centre(plan, roadmap, room.polygon) for room in plan.rooms]
        points = tour(roadmap, np.concatenate(stops), rng)
    return drive(Waypoints(points), motion, f"the path planned in {plan.id}")


def room_centre(plan: "FloorPlan", roadmap: Roadmap, room: shapely.Polygon) -> FloatArray:
    """The roadmap's node nearest to the middle of a room's free part, (1, 2), or (0, 2) if none is inside."""
    free = shapely.intersection(room, plan.free_space)
    if free.is_empty:
        return np.empty((0, 2))
    inside = np.flatnonzero(shapely.intersects_xy(free, roadmap.nodes[:, 0], roadmap.nodes[:, 1]))
    if len(inside) == 0:
        return np.empty((0, 2))
    centre = free.centroid
    away = [math.hypot(x - centre.x, y - centre.y) for x, y in roadmap.nodes[inside]]
    return roadmap.nodes[inside[[int(np.argmin(away))]]]
