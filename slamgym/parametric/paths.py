"""The true path: from a file of waypoints, a recorded trajectory or a probabilistic roadmap to poses over time.

The counterpart of MATLAB's ``waypointTrajectory``, for a robot on wheels: it turns in place
and then drives straight, each with a trapezoidal speed, because the odometry model (eqs. 13-20 of the paper)
is written for exactly these two motions.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely

from slamgym.core.errors import ConfigError, InputFileError, PlanError, SlamgymError
from slamgym.core.files import read_text
from slamgym.core.geometry import wrap_angle
from slamgym.core.limits import shown
from slamgym.core.types import FREE, OCCUPIED, FloatArray, OccupancyGrid, Trajectory
from slamgym.interop.tum import read_tum
from slamgym.parametric.config import MotionConfig
from slamgym.planning.prm import Roadmap, build_roadmap, random_path, spread_stops, tour
from slamgym.sim.clutter import Clutter
from slamgym.sim.passages import PASSAGE_CELL
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_ROBOT = RobotConfig()
_SAMPLE_INTERVAL = 0.05  # [s] of the fine trajectory that scans are picked from
_CLEARANCE = 0.25  # [m] that the path keeps from walls: the radius of the robot and 3 cm
_STOP_SPACING = 5.0  # [m] between stops in a plan without rooms; the LIDAR sees what lies between


@dataclass(frozen=True)
class Waypoints:
    """A path to drive: points in the world frame and, if the user set them, times of arrival."""

    points: FloatArray  # (M, 2) [m]
    times: FloatArray | None = None  # (M,) [s]


def _require(is_right: bool | np.bool_, name: str, fault: str) -> None:
    if not is_right:
        raise ConfigError(f"{name}: {fault}")


def check_waypoints(waypoints: Waypoints, name: str) -> None:
    """Refuse waypoints that describe no motion.

    Raises:
        ConfigError: If there are fewer than two, or one is not a number, or time doesn't grow, or all lie in
            one place.
    """
    points, times = waypoints.points, waypoints.times
    _require(len(points) >= 2, name, f"has {len(points)} waypoint(s); give at least two")
    finite = np.isfinite(points).all(axis=1)
    _require(
        finite.all(), name, f"waypoint {np.argmin(finite) + 1} is not a pair of finite numbers"
    )
    _require(
        np.diff(points, axis=0).any(),
        name,
        "all waypoints lie in one place; give two different ones",
    )
    if times is not None:
        known = times.shape == (len(points),) and np.isfinite(times).all()
        _require(known, name, "every waypoint needs one finite time of arrival")
        growing = np.diff(times) > 0.0
        i = int(np.argmin(growing))
        grows = f"{times[i]:g} s to {times[i + 1]:g} s at waypoint {i + 2}; times of arrival must increase"
        _require(growing.all(), name, f"time goes from {grows}")


def _duration(length: float, top_speed: float, acceleration: float) -> float:
    """Shortest time [s] of a move from rest to rest over ``length``."""
    if length == 0.0:
        return 0.0
    ramp = min(top_speed / acceleration, math.sqrt(length / acceleration))
    return length / (acceleration * ramp) + ramp


def _trapezoid(
    length: float, top_speed: float, acceleration: float, n: int
) -> tuple[FloatArray, FloatArray]:
    """Time and distance of a move from rest to rest over ``length``, n + 1 samples."""
    ramp = min(top_speed / acceleration, math.sqrt(length / acceleration))  # [s]
    speed, total = acceleration * ramp, _duration(length, top_speed, acceleration)
    t = np.linspace(0.0, total, n + 1)
    left = total - t
    distance = np.select(
        [t < ramp, t > total - ramp],
        [0.5 * acceleration * t**2, length - 0.5 * acceleration * left**2],
        speed * (t - 0.5 * ramp),
    )
    return t, distance


def drive(
    waypoints: Waypoints, name: str = "the trajectory", robot: RobotConfig = _ROBOT
) -> Trajectory:
    """Drive along waypoints: turn in place, drive straight; slower than the robot can where times allow it.

    Args:
        waypoints: Where to pass, and when if times are given.
        name: What to call the waypoints in an error.
        robot: Who drives.

    Returns:
        A trajectory sampled every 0.05 s, from the first waypoint to the last; the robot starts facing its
        second waypoint.

    Raises:
        ConfigError: If the waypoints describe no motion or the times of arrival ask for more than the limits.
    """
    check_waypoints(waypoints, name)
    points, times = waypoints.points, waypoints.times
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    heading = math.atan2(*steps[np.argmax(lengths > 0.0)][::-1])
    clock = 0.0 if times is None else float(times[0])
    rows = [np.array([[clock, *points[0], heading]])]
    for i, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        turn = float(wrap_angle(math.atan2(step[1], step[0]) - heading)) if length > 0.0 else 0.0
        moves = (
            (abs(turn), robot.max_angular, robot.angular_acceleration),
            (length, robot.max_linear, robot.linear_acceleration),
        )
        turning, driving = durations = [_duration(*move) for move in moves]
        stretch = 1.0
        if times is not None:
            allowed = float(times[i + 1] - times[i])
            speeds = f"{robot.max_linear:g} m/s and {robot.max_angular:g} rad/s"
            needs = f"{allowed:.2f} s; the robot needs {turning + driving:.2f} s at {speeds}"
            is_slow = turning + driving <= allowed + 1e-9
            _require(is_slow, name, f"waypoint {i + 2} can't be reached in {needs}")
            if turning + driving == 0.0:
                clock += allowed
                continue
            stretch = allowed / (turning + driving)
        for drives, (duration, move) in enumerate(zip(durations, moves, strict=True)):
            if duration == 0.0:
                continue
            n = max(2, math.ceil(duration * stretch / _SAMPLE_INTERVAL))
            t, distance = _trapezoid(*move, n)
            block = np.zeros((n, 4))
            block[:, 0] = clock + stretch * t[1:]
            block[:, 1:3] = points[i]
            block[:, 3] = heading
            if drives:
                block[:, 1:3] += (distance[1:, None] / length) * step
            else:
                block[:, 3] += math.copysign(1.0, turn) * distance[1:]
                heading += turn
            rows.append(block)
            clock += stretch * duration
    table = np.concatenate(rows)
    table[:, 3] = wrap_angle(table[:, 3])
    return Trajectory(table[:, 0], table[:, 1:])


def check_recorded(recorded: Trajectory, name: str = "the recorded path") -> None:
    """Refuse a recorded path that describes no motion.

    Raises:
        ConfigError: If it has fewer than two poses, a number that is not finite, or time that doesn't grow.
    """
    stamps, poses = recorded.stamps, recorded.poses
    _require(len(stamps) >= 2, name, f"has {len(stamps)} pose(s); give at least two")
    finite = np.isfinite(stamps).all() and np.isfinite(poses).all()
    _require(finite, name, "holds a number that is not finite")
    growing = np.diff(stamps) > 0.0
    late = f"time doesn't grow at pose {np.argmin(growing) + 2}; sort the poses by time"
    _require(growing.all(), name, late)


def sampled(trajectory: Trajectory, interval: float) -> Trajectory:
    """The poses at equal intervals [s], between those that are known."""
    stamps = np.arange(trajectory.stamps[0], trajectory.stamps[-1] + 1e-6, interval)
    turned = np.cumsum(wrap_angle(np.diff(trajectory.poses[:, 2], prepend=0.0)))
    columns = *trajectory.poses[:, :2].T, turned
    poses = np.column_stack([np.interp(stamps, trajectory.stamps, column) for column in columns])
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Trajectory(stamps, poses)


def pick_scans(trajectory: Trajectory, config: MotionConfig) -> Trajectory:
    """Keep the poses at which a scan enters the map: after enough driving or turning, and the last."""
    poses = trajectory.poses
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    turn = np.concatenate([[0.0], np.cumsum(np.abs(wrap_angle(np.diff(poses[:, 2]))))])
    passed = np.column_stack([way, turn]).tolist()
    spacing, angle = config.scan_spacing - 1e-9, config.scan_angle - 1e-9
    kept = [0]
    for i, (driven, turned) in enumerate(passed):
        last = passed[kept[-1]]
        if driven - last[0] >= spacing or turned - last[1] >= angle:
            kept.append(i)
    if passed[kept[-1]] != passed[-1]:
        kept.append(len(passed) - 1)
    return Trajectory(trajectory.stamps[kept], poses[kept])


def check_path_is_free(
    points: FloatArray, free_space: shapely.Polygon, name: str, what: str = "waypoint"
) -> None:
    """Check every point and every straight piece of a path.

    Args:
        points: (M, 2) [m], the frame of the plan.
        free_space: Where a robot's centre can be.
        name: What to call the path in the error.
        what: What to call one point.

    Raises:
        ConfigError: If a point lies outside the plan or in a wall, or a piece leads through a wall.
    """
    shapely.prepare(free_space)
    inside = shapely.intersects_xy(free_space, points[:, 0], points[:, 1])
    i = int(np.argmin(inside))
    (x, y), (min_x, min_y, max_x, max_y) = points[i], free_space.bounds
    where = "in a wall; move it to free space"
    if not (min_x <= x <= max_x and min_y <= y <= max_y):
        spans = f"({min_x:.2f}, {min_y:.2f}) to ({max_x:.2f}, {max_y:.2f})"
        where = f"outside the plan, which spans {spans}"
    _require(inside.all(), name, f"{what} {i + 1} at ({x:.2f}, {y:.2f}) lies {where}")
    pieces = np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
    clear = shapely.covers(free_space, pieces)
    if not clear.all():
        i = int(np.argmin(clear))
        x, y = shapely.get_coordinates(shapely.difference(pieces[i], free_space))[0]
        wall = f"leads through a wall at ({x:.2f}, {y:.2f}); add a point that goes round it"
        raise ConfigError(f"{name}: the path from {what} {i + 1} to {i + 2} {wall}")


def read_waypoints(path: Path | str) -> Waypoints:
    """Read waypoints from a CSV file: x, y and optionally the time of arrival; a header line may stand first.

    Raises:
        InputFileError: If the file can't be read or a line has not two or three numbers.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        values = line.split("#", 1)[0].replace(";", ",").strip()
        if not values:
            continue
        try:
            row = [float(value) for value in values.split(",")]
        except ValueError as error:
            if number == 1:
                continue  # the header
            where = f"{path}:{number}"
            raise InputFileError(
                where, f"is not a line of numbers x,y[,t]: {shown(line)}"
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


def trajectory_from_file(
    path: Path | str, plan: "FloorPlan", robot: RobotConfig = _ROBOT
) -> Trajectory:
    """The true path that a file holds: waypoints (``.csv``) or recorded poses (``.tum`` or ``.txt``).

    Convention: the numbers are in the world frame of the plan.

    Raises:
        InputFileError: If the file can't be read.
        ConfigError: If the path makes no sense or leaves the free space.
    """
    if Path(path).suffix.lower() in (".tum", ".txt"):
        recorded = read_tum(path)
        check_recorded(recorded, str(path))
        check_path_is_free(recorded.poses[:, :2], plan.free_space, str(path), "pose")
        return recorded
    waypoints = read_waypoints(path)
    trajectory = drive(waypoints, str(path), robot)
    check_path_is_free(waypoints.points, plan.free_space, str(path))
    return trajectory


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
    grid = plan.raster(PASSAGE_CELL)
    if clutter is not None and clutter.passages is not None:
        clearance = clutter.passages.clearance[::-1]
        grid = OccupancyGrid(np.where(clearance > 0.0, FREE, OCCUPIED), clutter.passages.frame)
    if not (grid.cells == FREE).any():
        raise PlanError(plan.id, "has no free space")
    try:
        roadmap = build_roadmap(grid, _CLEARANCE, rng)
    except SlamgymError as error:
        raise PlanError(plan.id, str(error)) from error
    if kind == "pair":
        points = random_path(roadmap, rng)
    else:
        stops = [spread_stops(roadmap, _STOP_SPACING, rng)]
        stops += [_room_centre(plan, roadmap, room.polygon) for room in plan.rooms]
        points = tour(roadmap, np.concatenate(stops), rng)
    return drive(Waypoints(points), f"the path planned in {plan.id}", robot)


def _room_centre(plan: "FloorPlan", roadmap: Roadmap, room: shapely.Polygon) -> FloatArray:
    """The roadmap's node nearest to the middle of a room's free part, (1, 2), or (0, 2) if none is inside."""
    free = shapely.intersection(room, plan.free_space)
    nodes = roadmap.nodes[shapely.intersects_xy(free, roadmap.nodes[:, 0], roadmap.nodes[:, 1])]
    if len(nodes) == 0:
        return nodes
    away = [math.hypot(x - free.centroid.x, y - free.centroid.y) for x, y in nodes]
    return nodes[[int(np.argmin(away))]]
