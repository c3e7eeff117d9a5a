"""From waypoints and times of arrival to poses, velocities and accelerations over time.

The counterpart of MATLAB's ``waypointTrajectory``, for a robot on wheels: it turns in place
and then drives straight, each with a trapezoidal speed, because the odometry model (eqs. 13-20 of the paper)
is written for exactly these two motions.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray, Trajectory
from slamgym.parametric.config import MotionConfig

_SAMPLE_INTERVAL = 0.05  # [s] of the fine trajectory that scans are picked from


@dataclass(frozen=True)
class TimedTrajectory:
    """Poses of the robot's base with their derivatives, in the world frame."""

    stamps: FloatArray  # (T,) [s]
    poses: FloatArray  # (T, 3) x [m], y [m], theta [rad]
    twists: FloatArray  # (T, 2) forward [m/s], counter-clockwise [rad/s]
    accelerations: FloatArray  # (T, 2) [m/s^2], [rad/s^2]

    def __len__(self) -> int:
        return len(self.stamps)

    def as_trajectory(self) -> Trajectory:
        """The poses alone."""
        return Trajectory(self.stamps, self.poses)

    def pick(self, index: IntArray) -> "TimedTrajectory":
        """The samples at ``index`` (N,)."""
        return TimedTrajectory(
            self.stamps[index], self.poses[index], self.twists[index], self.accelerations[index]
        )


@dataclass(frozen=True)
class Waypoints:
    """A path to drive: points in the world frame and, if the user set them, times of arrival."""

    points: FloatArray  # (M, 2) [m]
    times: FloatArray | None = None  # (M,) [s]


def check_waypoints(waypoints: Waypoints, name: str = "the trajectory") -> None:
    """Refuse waypoints that describe no motion.

    Raises:
        ConfigError: If there are fewer than two, or one is not a number, or time doesn't grow, or all lie in
            one place.
    """
    points, times = waypoints.points, waypoints.times
    if points.ndim != 2 or points.shape[1] != 2:
        raise ConfigError(f"{name}: waypoints must have shape (M, 2), not {points.shape}")
    if len(points) < 2:
        raise ConfigError(f"{name}: has {len(points)} waypoint(s); give at least two")
    for i in range(len(points)):
        if not np.isfinite(points[i]).all():
            raise ConfigError(f"{name}: waypoint {i + 1} is not a pair of finite numbers")
    if float(np.abs(np.diff(points, axis=0)).sum()) == 0.0:
        raise ConfigError(f"{name}: all waypoints lie in one place; give at least two different ones")
    if times is None:
        return
    if times.shape != (len(points),) or not np.isfinite(times).all():
        raise ConfigError(f"{name}: every waypoint needs one finite time of arrival")
    for i in range(1, len(times)):
        if times[i] <= times[i - 1]:
            raise ConfigError(
                f"{name}: time goes from {times[i - 1]:g} s to {times[i]:g} s at waypoint {i + 1}; "
                "times of arrival must increase"
            )


def drive(waypoints: Waypoints, config: MotionConfig, name: str = "the trajectory") -> TimedTrajectory:
    """Drive along waypoints.

    Args:
        waypoints: Where to pass, and when if times are given.
        config: Speed and acceleration limits.
        name: What to call the waypoints in an error.

    Returns:
        A trajectory sampled every 0.05 s, from the first waypoint to the last; the robot starts facing its
        second waypoint.

    Raises:
        ConfigError: If the waypoints describe no motion or the times of arrival ask for more than the limits.
    """
    check_waypoints(waypoints, name)
    return _turn_and_go(waypoints, config, name)


def _trapezoid(length: float, top_speed: float, acceleration: float, n: int) -> tuple[FloatArray, ...]:
    """Time, distance, speed and acceleration of a move from rest to rest over ``length``, n + 1 samples."""
    ramp = min(top_speed / acceleration, math.sqrt(length / acceleration))  # [s]
    speed, total = acceleration * ramp, _duration(length, top_speed, acceleration)
    t = np.linspace(0.0, total, n + 1)
    rising, falling = t < ramp, t > total - ramp
    left = total - t
    distance = np.where(
        rising,
        0.5 * acceleration * t**2,
        np.where(falling, length - 0.5 * acceleration * left**2, speed * (t - 0.5 * ramp)),
    )
    velocity = np.where(rising, acceleration * t, np.where(falling, acceleration * left, speed))
    return t, distance, velocity, acceleration * (rising.astype(np.float64) - falling)


def _duration(length: float, top_speed: float, acceleration: float) -> float:
    """Shortest time [s] of a move from rest to rest over ``length``."""
    if length == 0.0:
        return 0.0
    ramp = min(top_speed / acceleration, math.sqrt(length / acceleration))
    return length / (acceleration * ramp) + ramp


def _turn_and_go(waypoints: Waypoints, config: MotionConfig, name: str) -> TimedTrajectory:
    """Turn in place, drive straight, for every waypoint; slower than the limits where times allow it."""
    points = waypoints.points
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    heading = math.atan2(*steps[np.argmax(lengths > 0.0)][::-1])
    clock = 0.0 if waypoints.times is None else float(waypoints.times[0])
    rows = [np.array([[clock, *points[0], heading, 0.0, 0.0, 0.0, 0.0]])]
    for i, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        turn = float(wrap_angle(math.atan2(step[1], step[0]) - heading)) if length > 0.0 else 0.0
        turning = _duration(abs(turn), config.max_angular, config.angular_acceleration)
        driving = _duration(length, config.max_linear, config.linear_acceleration)
        stretch = 1.0
        if waypoints.times is not None:
            allowed = float(waypoints.times[i + 1] - waypoints.times[i])
            if turning + driving > allowed + 1e-9:
                raise ConfigError(
                    f"{name}: waypoint {i + 2} can't be reached in {allowed:.2f} s; the robot needs "
                    f"{turning + driving:.2f} s at {config.max_linear:g} m/s and {config.max_angular:g} rad/s"
                )
            if turning + driving == 0.0:
                clock += allowed
                continue
            stretch = allowed / (turning + driving)
        moves = (
            (turning, abs(turn), config.max_angular, config.angular_acceleration, 1),
            (driving, length, config.max_linear, config.linear_acceleration, 0),
        )
        for duration, amount, top_speed, limit, turns in moves:
            if duration == 0.0:
                continue
            n = max(2, math.ceil(duration * stretch / _SAMPLE_INTERVAL))
            t, distance, speed, acceleration = _trapezoid(amount, top_speed, limit, n)
            sign = math.copysign(1.0, turn) if turns else 1.0
            block = np.zeros((n, 8))
            block[:, 0] = clock + stretch * t[1:]
            block[:, 1:3] = points[i]
            block[:, 3] = heading
            if turns:
                block[:, 3] += sign * distance[1:]
                heading += turn
            else:
                block[:, 1:3] += (distance[1:, None] / length) * step
            block[:, 4 + turns] = sign * speed[1:] / stretch
            block[:, 6 + turns] = sign * acceleration[1:] / stretch**2
            rows.append(block)
            clock += stretch * duration
    table = np.concatenate(rows)
    table[:, 3] = wrap_angle(table[:, 3])
    return TimedTrajectory(table[:, 0], table[:, 1:4], table[:, 4:6], table[:, 6:8])


def from_recorded(recorded: Trajectory, name: str = "the recorded path") -> TimedTrajectory:
    """Give a recorded path (an explorer's, in the world frame) its velocities and accelerations.

    Raises:
        ConfigError: If it has fewer than two poses, a number that is not finite, or time that doesn't grow.
    """
    stamps, poses = np.asarray(recorded.stamps, dtype=np.float64), np.asarray(recorded.poses)
    if len(stamps) < 2:
        raise ConfigError(f"{name}: has {len(stamps)} pose(s); give at least two")
    if not (np.isfinite(stamps).all() and np.isfinite(poses).all()):
        raise ConfigError(f"{name}: holds a number that is not finite")
    if (np.diff(stamps) <= 0.0).any():
        row = int(np.argmax(np.diff(stamps) <= 0.0)) + 2
        raise ConfigError(f"{name}: time doesn't grow at pose {row}; sort the poses by time")
    turned = np.concatenate([[0.0], np.cumsum(wrap_angle(np.diff(poses[:, 2])))])
    velocity = np.gradient(poses[:, :2], stamps, axis=0)
    forward = velocity[:, 0] * np.cos(poses[:, 2]) + velocity[:, 1] * np.sin(poses[:, 2])
    twists = np.column_stack([forward, np.gradient(turned, stamps)])
    return TimedTrajectory(stamps, poses, twists, np.gradient(twists, stamps, axis=0))


def pick_scans(trajectory: TimedTrajectory, config: MotionConfig) -> TimedTrajectory:
    """Keep the poses at which a scan enters the map: after enough driving, turning or time, and the last."""
    poses, stamps = trajectory.poses, trajectory.stamps
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    turn = np.concatenate([[0.0], np.cumsum(np.abs(wrap_angle(np.diff(poses[:, 2]))))])
    kept = [0]
    for i in range(1, len(stamps)):
        j = kept[-1]
        due = (
            distance[i] - distance[j] >= config.scan_spacing - 1e-9
            or turn[i] - turn[j] >= config.scan_angle - 1e-9
            or stamps[i] - stamps[j] >= config.scan_interval - 1e-9
        )
        if due or (i == len(stamps) - 1 and (distance[i] > distance[j] or turn[i] > turn[j])):
            kept.append(i)
    return trajectory.pick(np.array(kept))


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
        if not (min_x <= x <= max_x and min_y <= y <= max_y):
            raise ConfigError(
                f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies outside the plan, which spans "
                f"({min_x:.2f}, {min_y:.2f}) to ({max_x:.2f}, {max_y:.2f})"
            )
        raise ConfigError(
            f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies in a wall; move it to free space"
        )
    pieces = np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
    clear = shapely.covers(free_space, pieces)
    if not clear.all():
        i = int(np.argmin(clear))
        beyond = shapely.difference(pieces[i], free_space)
        x, y = shapely.get_coordinates(beyond)[0]
        raise ConfigError(
            f"{name}: the path from {what} {i + 1} to {i + 2} leads through a wall at ({x:.2f}, {y:.2f}); "
            "add a point that goes round it"
        )
