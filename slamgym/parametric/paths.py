"""The true path: from waypoints or a recorded trajectory to poses over time, and the scans on the way.

The counterpart of MATLAB's ``waypointTrajectory``, for a robot on wheels: it turns in place
and then drives straight, each with a trapezoidal speed, because the odometry model (eqs. 13-20 of the paper)
is written for exactly these two motions.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_text
from slamgym.core.geometry import wrap_angle
from slamgym.core.limits import shown
from slamgym.core.types import FloatArray, Trajectory
from slamgym.interop.tum import read_tum
from slamgym.parametric.config import MotionConfig
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_ROBOT = RobotConfig()
_SAMPLE_INTERVAL = 0.05
"""Time between two poses of the fine trajectory that scans are picked from [s]."""


@dataclass(frozen=True)
class Waypoints:
    """A path to drive: points in the world frame and, if the user set them, times of arrival."""

    points: FloatArray  # (M, 2) [m]
    times: FloatArray | None = None  # (M,) [s]


def check_waypoints(waypoints: Waypoints, name: str) -> None:
    """Refuse waypoints that describe no motion.

    Raises:
        ConfigError: If there are fewer than two, or one is not a number, or time doesn't grow, or all lie in
            one place.
    """
    points = waypoints.points
    times = waypoints.times
    if len(points) < 2:
        raise ConfigError(f"{name}: has {len(points)} waypoint(s); give at least two")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        number = np.argmin(finite) + 1
        raise ConfigError(f"{name}: waypoint {number} is not a pair of finite numbers")
    if not np.diff(points, axis=0).any():
        raise ConfigError(f"{name}: all waypoints lie in one place; give two different ones")
    if times is None:
        return
    if times.shape != (len(points),) or not np.isfinite(times).all():
        raise ConfigError(f"{name}: every waypoint needs one finite time of arrival")
    growing = np.diff(times) > 0.0
    if not growing.all():
        i = int(np.argmin(growing))
        raise ConfigError(
            f"{name}: time goes from {times[i]:g} s to {times[i + 1]:g} s at waypoint {i + 2}; "
            "times of arrival must increase"
        )


class _Move(NamedTuple):
    """A move from rest to rest with a trapezoidal speed: straight on [m], or turning in place [rad]."""

    length: float
    top_speed: float
    acceleration: float

    @property
    def ramp(self) -> float:
        """Time [s] to gain speed, and again to lose it."""
        to_top_speed = self.top_speed / self.acceleration
        return min(to_top_speed, math.sqrt(self.length / self.acceleration))

    @property
    def duration(self) -> float:
        """Shortest time [s] of the move."""
        if self.length == 0.0:
            return 0.0
        return self.length / (self.acceleration * self.ramp) + self.ramp

    def samples(self, stretch: float) -> tuple[FloatArray, FloatArray]:
        """Time [s], not stretched, and way at equal intervals after the start, for a move that is so much slower."""
        n = max(2, math.ceil(self.duration * stretch / _SAMPLE_INTERVAL))
        ramp = self.ramp
        speed = self.acceleration * ramp
        t = np.linspace(0.0, self.duration, n + 1)[1:]
        left = self.duration - t
        speeding_up = 0.5 * self.acceleration * t**2
        slowing_down = self.length - 0.5 * self.acceleration * left**2
        way = np.select(
            [t < ramp, t > self.duration - ramp],
            [speeding_up, slowing_down],
            speed * (t - 0.5 * ramp),
        )
        return t, way


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
    points = waypoints.points
    times = waypoints.times
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    first_x, first_y = steps[np.argmax(lengths > 0.0)]
    heading = math.atan2(first_y, first_x)
    clock = 0.0 if times is None else float(times[0])
    rows = [np.array([[clock, *points[0], heading]])]
    for i, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        turn = 0.0
        if length > 0.0:
            turn = float(wrap_angle(math.atan2(step[1], step[0]) - heading))
        turning = _Move(abs(turn), robot.max_angular, robot.angular_acceleration)
        driving = _Move(length, robot.max_linear, robot.linear_acceleration)
        needed = turning.duration + driving.duration
        stretch = 1.0
        if times is not None:
            allowed = float(times[i + 1] - times[i])
            if needed > allowed + 1e-9:
                raise ConfigError(
                    f"{name}: waypoint {i + 2} can't be reached in {allowed:.2f} s; the robot needs {needed:.2f} s "
                    f"at {robot.max_linear:g} m/s and {robot.max_angular:g} rad/s"
                )
            if needed == 0.0:
                clock += allowed
                continue
            stretch = allowed / needed
        if turning.duration > 0.0:
            t, turned = turning.samples(stretch)
            block = _standing(clock + stretch * t, points[i], heading)
            block[:, 3] += math.copysign(1.0, turn) * turned
            rows.append(block)
            heading += turn
            clock += stretch * turning.duration
        if driving.duration > 0.0:
            t, driven = driving.samples(stretch)
            block = _standing(clock + stretch * t, points[i], heading)
            block[:, 1:3] += (driven[:, None] / length) * step
            rows.append(block)
            clock += stretch * driving.duration
    table = np.concatenate(rows)
    table[:, 3] = wrap_angle(table[:, 3])
    return Trajectory(table[:, 0], table[:, 1:])


def _standing(times: FloatArray, point: FloatArray, heading: float) -> FloatArray:
    """Rows (n, 4) of time, x, y and heading of a robot that stands still."""
    rows = np.empty((len(times), 4))
    rows[:, 0] = times
    rows[:, 1:3] = point
    rows[:, 3] = heading
    return rows


def check_recorded(recorded: Trajectory, name: str = "the recorded path") -> None:
    """Refuse a recorded path that describes no motion.

    Raises:
        ConfigError: If it has fewer than two poses, a number that is not finite, or time that doesn't grow.
    """
    stamps = recorded.stamps
    if len(stamps) < 2:
        raise ConfigError(f"{name}: has {len(stamps)} pose(s); give at least two")
    if not np.isfinite(stamps).all() or not np.isfinite(recorded.poses).all():
        raise ConfigError(f"{name}: holds a number that is not finite")
    growing = np.diff(stamps) > 0.0
    if not growing.all():
        number = np.argmin(growing) + 2
        raise ConfigError(f"{name}: time doesn't grow at pose {number}; sort the poses by time")


def sampled(trajectory: Trajectory, interval: float) -> Trajectory:
    """The poses at equal intervals [s], between those that are known."""
    known = trajectory.stamps
    x, y, heading = trajectory.poses.T
    turned = np.cumsum(wrap_angle(np.diff(heading, prepend=0.0)))
    stamps = np.arange(known[0], known[-1] + 1e-6, interval)
    poses = np.empty((len(stamps), 3))
    poses[:, 0] = np.interp(stamps, known, x)
    poses[:, 1] = np.interp(stamps, known, y)
    poses[:, 2] = wrap_angle(np.interp(stamps, known, turned))
    return Trajectory(stamps, poses)


def pick_scans(trajectory: Trajectory, config: MotionConfig) -> Trajectory:
    """Keep the poses at which a scan enters the map: after enough driving or turning, and the last."""
    poses = trajectory.poses
    dx, dy, dtheta = np.diff(poses, axis=0, prepend=poses[:1]).T
    way = np.cumsum(np.hypot(dx, dy)).tolist()
    turn = np.cumsum(np.abs(wrap_angle(dtheta))).tolist()
    passed = list(zip(way, turn, strict=True))
    spacing = config.scan_spacing - 1e-9
    angle = config.scan_angle - 1e-9
    kept = [0]
    for i, (driven, turned) in enumerate(passed):
        last_driven, last_turned = passed[kept[-1]]
        if driven - last_driven >= spacing or turned - last_turned >= angle:
            kept.append(i)
    if passed[kept[-1]] != passed[-1]:
        kept.append(len(passed) - 1)
    return Trajectory(trajectory.stamps[kept], poses[kept])


def thinned_scans(
    trajectory: Trajectory, config: MotionConfig, most: int
) -> tuple[Trajectory, MotionConfig]:
    """Pick scans wider apart, so that there are at most so many; also the distances between them."""
    wider = config
    picked = pick_scans(trajectory, wider)
    while len(picked) > most:
        factor = 1.05 * len(picked) / most
        wider = MotionConfig(factor * wider.scan_spacing, factor * wider.scan_angle)
        picked = pick_scans(trajectory, wider)
    return picked, wider


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
    if not inside.all():
        i = int(np.argmin(inside))
        x, y = points[i]
        min_x, min_y, max_x, max_y = free_space.bounds
        if min_x <= x <= max_x and min_y <= y <= max_y:
            raise ConfigError(
                f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies in a wall; move it to free space"
            )
        raise ConfigError(
            f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies outside the plan, "
            f"which spans ({min_x:.2f}, {min_y:.2f}) to ({max_x:.2f}, {max_y:.2f})"
        )
    pieces = np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
    clear = shapely.covers(free_space, pieces)
    if not clear.all():
        i = int(np.argmin(clear))
        in_wall = shapely.difference(pieces[i], free_space)
        x, y = shapely.get_coordinates(in_wall)[0]
        raise ConfigError(
            f"{name}: the path from {what} {i + 1} to {i + 2} leads through a wall at ({x:.2f}, {y:.2f}); "
            "add a point that goes round it"
        )


def read_waypoints(path: Path | str) -> Waypoints:
    """Read waypoints from a CSV file: x, y and optionally the time of arrival; a header line may stand first.

    Raises:
        InputFileError: If the file can't be read or a line has not two or three numbers.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        without_comment = line.partition("#")[0]
        values = without_comment.replace(";", ",").strip()
        if not values:
            continue
        try:
            row = [float(value) for value in values.split(",")]
        except ValueError as error:
            if number == 1:
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
    if table.shape[1] == 2:
        return Waypoints(table)
    return Waypoints(table[:, :2], table[:, 2])


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
