"""Path follower: pure pursuit that turns in place at sharp corners and avoids what the scanner sees.

Pure pursuit is Coulter's (CMU-RI-TR-92-01). Where its arc is blocked by something that the map doesn't know
yet, a person say, the free arc that leads nearest to the target is taken instead (dynamic window approach,
Fox, Burgard, Thrun 1997).
"""

import math

import numpy as np

from slamgym.core.config import Settings
from slamgym.core.geometry import between, wrap_angle
from slamgym.core.jit import kernel, plain
from slamgym.core.types import ByteArray, Float32Array, FloatArray, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import INSCRIBED_COST, Costmap

_LOOKAHEAD = 0.5
"""Distance of the pursued point, less where a straight line to it isn't free [m]: two body widths keep turns smooth."""
_TURN_GAIN = 2.5
"""Rate of turn per heading error [1/s]; a turn must not overshoot in one control step."""
_CLEARANCE = 0.03
"""Kept between the robot's body and what the scanner sees [m]: three standard deviations of its noise."""
_SQUEEZE_SPEED = 0.1
"""Speed in a gap that is too narrow for the clearance [m/s]."""
_SQUEEZE_CLEARANCE = 0.02
"""Kept there [m]. In two rooms parted by posts, in gaps as wide as the robot, ``tour`` touched them 31 times in five
explorations with 0, else never; with 0.03 it didn't fit through gaps 0.04 m wider in two of five. In
16 homes it took 0.99 [0.97, 1.00] of the time."""
_STANDSTILL = 0.02
"""A robot slower than this is held back [m/s]."""
_HORIZON = 1.2
"""Time ahead for which arcs are checked against the scan [s]: the robot comes to rest within it."""
_WAYS_OUT = tuple(
    sorted((math.tau * k / 24 for k in range(-11, 13)), key=lambda turn: (abs(turn), -turn))
)
"""Turns to directions in which a robot that can't go where it should looks for a way out, the least first [rad]."""
_LEAST_GAIN = 0.02
"""An arc that ends less than this nearer to where the robot wants to go isn't worth driving [m]."""
_SEARCHED = 40
"""So many points of the path, one a cell, are searched for the one nearest to the robot: it drives one in a step."""


class FollowerConfig(Settings, section="follower"):
    """Settings for following a path."""

    turn_in_place: float = 0.9
    """A heading error above this is corrected by a turn on the spot [rad]."""
    turned: float = 0.25
    """A turn on the spot ends below this heading error [rad]."""
    turn_rate: float = 1.2
    """Largest rate of turn used [rad/s], less than the robot can, so that scans overlap well."""


class PathFollower:
    """Turns a path, a pose and a scan into velocities within the robot's limits."""

    def __init__(self, context: ExplorerContext, config: FollowerConfig | None = None) -> None:
        self.context = context
        self.config = config or FollowerConfig()
        self.path: FloatArray = np.zeros((0, 2))
        self.blocked = False  # the last command was held back by something in the scan
        self._laser = plain(context.geometry)
        self.fastest_turn = min(self.config.turn_rate, context.max_angular)  # [rad/s]
        # Of the robot's centre from what the scanner sees [m].
        self._apart = context.robot_radius + _CLEARANCE
        self._index = 0
        self._along: FloatArray = np.zeros(1)  # length of the path up to each point [m]
        self._turn_sign = 0.0  # direction of the turn on the spot in progress, else 0

    def set_path(self, path: FloatArray) -> None:
        """Begin a path, shape (N, 2) [m]."""
        steps = np.diff(path, axis=0)
        dx, dy = steps.T
        lengths = np.hypot(dx, dy)
        self.path = path
        self._along = np.append(0.0, np.cumsum(lengths))
        self.blocked = False
        self._index = 0

    @property
    def ahead(self) -> FloatArray:
        """The part of the path that is still to go, shape (M, 2) [m]."""
        return self.path[self._index :]

    def remaining(self, pose: Pose2D) -> float:
        """Length still to go [m]."""
        if not len(self.path):
            return 0.0
        x, y = self.path[self._index]
        after = float(self._along[-1] - self._along[self._index])
        return math.hypot(x - pose.x, y - pose.y) + after

    def points(self, ranges: Float32Array) -> FloatArray:
        """Obstacles that a scan shows, in the robot's frame, shape (N, 2) [m]."""
        return scan_points(ranges, self._laser)

    def is_free_ahead(self, obstacles: FloatArray) -> bool:
        """True if the robot could drive straight on at full speed up to the horizon; arguments as for :meth:`step`."""
        return self._free_time(obstacles, self.context.max_linear, 0.0) >= _HORIZON

    def turn_rate(self, error: float) -> float:
        """Rate at which a heading error is corrected on the spot [rad/s], without its sign."""
        return min(self.fastest_turn, _TURN_GAIN * abs(error))

    def turn_towards(self, pose: Pose2D, x: float, y: float) -> Twist2D | None:
        """Turn on the spot towards a point; None once the robot faces it."""
        bearing = math.atan2(y - pose.y, x - pose.x)
        error = float(wrap_angle(bearing - pose.theta))
        if abs(error) < self.config.turned:
            self._turn_sign = 0.0
            return None
        return self._turn(error)

    def step(self, costmap: Costmap, pose: Pose2D, obstacles: FloatArray) -> Twist2D:
        """Velocity for the next control step along the path.

        Args:
            costmap: Keeps the pursuit from cutting corners.
            pose: The robot, in the frame of the path.
            obstacles: What the scan shows, in the robot's frame, shape (N, 2) [m].
        """
        config = self.config
        context = self.context
        self.blocked = False
        if not len(self.path):
            return Twist2D(0.0, 0.0)
        x, y = self._pursued_point(costmap, pose)
        distance = math.hypot(x, y)
        error = math.atan2(y, x)
        if self._turn_sign and abs(error) < config.turned:
            self._turn_sign = 0.0
        if self._turn_sign or abs(error) > config.turn_in_place:
            return self._turn(error)

        # The arc through the pursued point has curvature 2 sin(error) / distance.
        curvature = 2.0 * math.sin(error) / max(distance, 1e-3)
        fastest = context.max_linear
        turns_in_time = self.fastest_turn / max(abs(curvature), 1e-6)
        stops_there = distance / context.control_step
        linear = min(fastest, turns_in_time, stops_there)
        near = self._near(obstacles)
        free = self._free_time(near, linear, linear * curvature)
        if free >= _HORIZON:
            return Twist2D(linear, linear * curvature)
        # Slow down so that the body would still stand clear when the horizon is over.
        slowed = linear * free / _HORIZON
        if slowed > 0.25 * fastest:
            return Twist2D(slowed, slowed * curvature)
        step = context.control_step / 2
        squeezed = context.robot_radius + _SQUEEZE_CLEARANCE
        for speed, apart in ((fastest, self._apart), (_SQUEEZE_SPEED, squeezed)):
            limits = (speed, self.fastest_turn)
            linear, angular, gain = best_arc(near, (x, y), limits, apart, step)
            if gain > _LEAST_GAIN:
                return Twist2D(linear, angular)
        self.blocked = slowed < _STANDSTILL
        return Twist2D(slowed, slowed * curvature)

    def avoid(self, command: Twist2D, ranges: Float32Array) -> Twist2D:
        """A velocity or, where the scan shows that it isn't free, the free arc that ends nearest to where it leads.

        Where none is free, or something ahead seems to touch the body, it turns to the nearest way out: who only stops
        stands there forever, and noise lets it creep on. Nothing is seen behind, so it never drives back.
        """
        linear, angular = command
        if linear <= 0.0:
            return Twist2D(0.0, angular)
        near = self._near(self.points(ranges))
        if self._touches_ahead(near):
            return self._way_out(near, angular)
        free = self._free_time(near, linear, angular)
        if free >= _HORIZON:
            return command
        turned = 0.5 * angular * _HORIZON
        shortening = math.sin(turned) / turned if abs(turned) > 1e-9 else 1.0
        chord = linear * _HORIZON * shortening
        end = (chord * math.cos(turned), chord * math.sin(turned))
        fastest = (self.context.max_linear, self.context.max_angular)
        step = self.context.control_step / 2
        free_linear, free_angular, gain = best_arc(near, end, fastest, self._apart, step)
        if gain > _LEAST_GAIN:
            return Twist2D(free_linear, free_angular)
        slowed = linear * free / _HORIZON
        if slowed > _STANDSTILL:
            return Twist2D(slowed, angular)
        return self._way_out(near, angular)

    def _touches_ahead(self, obstacles: FloatArray) -> bool:
        """True if something in front of the axle seems to touch the body."""
        x, y = obstacles.T
        touched = np.hypot(x, y) < self.context.robot_radius
        return bool(touched[x > 0.0].any())

    def _way_out(self, obstacles: FloatArray, preferred: float) -> Twist2D:
        """Turn to the nearest direction in which it could drive straight on; of two the one to the preferred side.

        While the robot turns there, it stays the nearest.
        """
        x, y = obstacles.T
        for to_left in _WAYS_OUT:
            turn = math.copysign(1.0, preferred) * to_left
            cos = math.cos(turn)
            sin = math.sin(turn)
            turned = np.column_stack([x * cos + y * sin, y * cos - x * sin])
            free = self._free_time(turned, _SQUEEZE_SPEED, 0.0)
            if free >= _HORIZON and not self._touches_ahead(turned):
                linear = 0.0 if turn else _SQUEEZE_SPEED
                return Twist2D(linear, math.copysign(self.turn_rate(turn), turn))
        return Twist2D(0.0, math.copysign(self.fastest_turn, preferred))

    def _near(self, obstacles: FloatArray) -> FloatArray:
        """Those obstacles that the robot could come to within the horizon."""
        reach = self.context.max_linear * _HORIZON + self._apart
        return obstacles[(obstacles**2).sum(axis=1) < reach**2]

    def _free_time(self, obstacles: FloatArray, linear: float, angular: float) -> float:
        """For how long a velocity can be held, up to the horizon [s]."""
        step = self.context.control_step / 2
        return float(free_travel(obstacles, linear, angular, self._apart, step))

    def _pursued_point(self, costmap: Costmap, pose: Pose2D) -> tuple[float, float]:
        """The path point to steer to, in the robot's frame [m]."""
        here = pose[:2]
        frame = costmap.frame
        size = frame.resolution
        top = frame.origin_y + frame.height_px * size
        corner = (frame.origin_x, top)
        next_ones = self.path[self._index : self._index + _SEARCHED]
        away = next_ones - np.array(here)
        squared = (away**2).sum(axis=1)
        self._index += int(np.argmin(squared))
        chosen = lookahead_on_path(self.path, self._index, here, costmap.costs, corner, size)
        x, y = self.path[chosen].tolist()
        point = between(pose, Pose2D(x, y, 0.0))
        return point.x, point.y

    def _turn(self, error: float) -> Twist2D:
        """Turn on the spot; near a half turn the direction once chosen is kept."""
        if not self._turn_sign or abs(error) <= 2.4:
            self._turn_sign = math.copysign(1.0, error)
        return Twist2D(0.0, self._turn_sign * self.turn_rate(error))


@kernel
def scan_points(
    ranges: Float32Array,
    laser: tuple[int, float, float, float, float, tuple[float, float, float], float],
) -> FloatArray:
    """End points of the beams that hit something, in the robot's frame, shape (N, 2) [m].

    A hit counts only if a beam at most two places aside ends within 0.2 m of its range: single short or
    random readings (Thrun et al., Probabilistic Robotics, section 6.3) are no obstacles.

    Args:
        ranges: The scan, shape (num_beams,) [m].
        laser: A :class:`~slamgym.core.types.LaserGeometry` without names (:func:`slamgym.core.jit.plain`).
    """
    _, angle_min, angle_increment, range_min, range_max, mount, _ = laser
    n = len(ranges)
    points = np.empty((n, 2))
    count = 0
    for i in range(n):
        r = ranges[i]
        if not (r > range_min and r < 0.999 * range_max):
            continue
        agrees = False
        for j in range(max(0, i - 2), min(n, i + 3)):
            if j != i and abs(ranges[j] - r) < 0.2:
                agrees = True
        if agrees:
            angle = mount[2] + angle_min + i * angle_increment
            points[count, 0] = mount[0] + r * np.cos(angle)
            points[count, 1] = mount[1] + r * np.sin(angle)
            count += 1
    return points[:count].copy()


@kernel
def lookahead_on_path(
    path: FloatArray,
    begin: int,
    here: tuple[float, float],
    costs: ByteArray,
    corner: tuple[float, float],
    resolution: float,
) -> int:
    """Index of the farthest path point within the lookahead that a straight line reaches over free cells.

    Args:
        path: Points [m], shape (N, 2).
        begin: Index of the point where the robot is.
        here: The robot [m].
        costs: Costmap, shape (H, W).
        corner: Its left and its upper border [m].
        resolution: [m/cell].
    """
    x, y = here
    left, top = corner
    height, width = costs.shape
    chosen = min(begin + 1, len(path) - 1)
    for i in range(chosen, len(path)):
        length = np.hypot(path[i, 0] - x, path[i, 1] - y)
        if length > _LOOKAHEAD and i > chosen:
            break
        steps = max(1, int(np.ceil(2.0 * length / resolution)))
        free = True
        left_start = False
        for k in range(1, steps + 1):
            px = x + (path[i, 0] - x) * k / steps
            py = y + (path[i, 1] - y) * k / steps
            row = int(np.floor((top - py) / resolution))
            col = int(np.floor((px - left) / resolution))
            open_cell = 0 <= row < height and 0 <= col < width and costs[row, col] < INSCRIBED_COST
            # Where the robot already stands too near to an obstacle the line may lead out, but not in again.
            if not open_cell and (left_start or k == steps):
                free = False
                break
            left_start = left_start or open_cell
        if free:
            chosen = i
    return chosen


@kernel
def free_travel(
    points: FloatArray, linear: float, angular: float, radius: float, time_step: float
) -> float:
    """For how long a round robot can hold a velocity before it comes too near to a point, up to the horizon [s].

    Args:
        points: Obstacles in the robot's frame, shape (N, 2) [m].
        linear: [m/s].
        angular: [rad/s].
        radius: Distance to keep [m]; if a point is nearer already, then no step may bring the robot nearer.
        time_step: [s].
    """
    nearest = np.inf
    for i in range(len(points)):
        nearest = min(nearest, points[i, 0] ** 2 + points[i, 1] ** 2)
    keep = min(radius, np.sqrt(nearest) - 1e-3)
    keep_squared = keep * keep if keep > 0.0 else 0.0
    x = 0.0
    y = 0.0
    theta = 0.0
    time = 0.0
    while time < _HORIZON - 1e-9:
        x += linear * time_step * np.cos(theta + 0.5 * angular * time_step)
        y += linear * time_step * np.sin(theta + 0.5 * angular * time_step)
        theta += angular * time_step
        for i in range(len(points)):
            if (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 < keep_squared:
                return time
        time += time_step
    return _HORIZON


@kernel
def best_arc(
    points: FloatArray,
    target: tuple[float, float],
    fastest: tuple[float, float],
    radius: float,
    time_step: float,
) -> tuple[float, float, float]:
    """The free arc that ends nearest to a target, as in the dynamic window approach (Fox et al. 1997).

    Args:
        points: As for :func:`free_travel`, like the last two.
        target: In the robot's frame [m].
        fastest: Forward speed [m/s] and rate of turn [rad/s].
        radius: See above.
        time_step: See above.

    Returns:
        Forward speed [m/s], rate of turn [rad/s], and how much nearer to the target the arc ends [m]; all 0 if every
        arc is blocked or leads away.
    """
    best_linear = 0.0
    best_angular = 0.0
    best_gain = 0.0
    start = np.hypot(target[0], target[1])
    for i in range(1, 4):
        linear = fastest[0] * i / 3.0
        for j in range(-6, 7):
            angular = fastest[1] * j / 6.0
            turned = 0.5 * angular * _HORIZON
            shortening = np.sin(turned) / turned if abs(turned) > 1e-9 else 1.0
            chord = linear * _HORIZON * shortening
            left_x = target[0] - chord * np.cos(turned)
            left_y = target[1] - chord * np.sin(turned)
            gain = start - np.hypot(left_x, left_y)
            if gain <= best_gain:
                continue
            if free_travel(points, linear, angular, radius, time_step) >= _HORIZON:
                best_linear = linear
                best_angular = angular
                best_gain = gain
    return best_linear, best_angular, best_gain
