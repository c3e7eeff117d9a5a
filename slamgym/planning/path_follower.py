"""Path follower: pure pursuit that turns in place at sharp corners and avoids what the scanner sees.

Pure pursuit is Coulter's (CMU-RI-TR-92-01). Where its arc is blocked by something that the map doesn't know
yet, a person say, the free arc that leads nearest to the target is taken instead (dynamic window approach,
Fox, Burgard, Thrun 1997).
"""

import math

import numpy as np

from slamgym.core.config import Settings
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Float32Array, FloatArray, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import INSCRIBED_COST, Costmap
from slamgym.planning.path_follower_kernels import (
    best_arc,
    free_travel,
    lookahead_on_path,
    nearest_on_path,
    points_within,
    scan_points,
)


class FollowerConfig(Settings):
    """How a path is followed."""

    lookahead: float = 0.5
    """Distance of the pursued point, less where a straight line to it isn't free [m]."""
    turn_in_place: float = 0.9
    """A heading error above this is corrected by a turn on the spot [rad]."""
    turned: float = 0.25
    """A turn on the spot ends below this heading error [rad]."""
    turn_rate: float = 1.2
    """Largest rate of turn used [rad/s], less than the robot can, so that scans overlap well."""
    turn_gain: float = 2.5
    """Rate of turn per heading error [1/s]; a turn must not overshoot in one control step."""
    clearance: float = 0.03
    """Kept between the robot's body and what the scanner sees [m]."""
    squeeze_speed: float = 0.1
    """Speed in a gap that leaves less than the clearance [m/s]."""
    horizon: float = 1.2
    """How far ahead arcs are checked against the scan [s]."""


class PathFollower:
    """Turns a path, a pose and a scan into velocities within the robot's limits."""

    def __init__(self, context: ExplorerContext, config: FollowerConfig | None = None) -> None:
        self.context = context
        self.config = config or FollowerConfig()
        self.path: FloatArray = np.zeros((0, 2))
        self.blocked = False  # the last command was held back by something in the scan
        self._index = 0
        self._along: FloatArray = np.zeros(1)  # length of the path up to each point [m]
        self._turn_sign = 0.0  # direction of the turn on the spot in progress, else 0

    def set_path(self, path: FloatArray) -> None:
        """Begin a path, shape (N, 2) [m]."""
        self.path = path
        self._along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
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
        return math.hypot(x - pose.x, y - pose.y) + float(self._along[-1] - self._along[self._index])

    def points(self, ranges: Float32Array) -> FloatArray:
        """Obstacles that a scan shows, in the robot's frame, shape (N, 2) [m]."""
        laser = self.context.geometry
        points: FloatArray = scan_points(
            ranges, laser.angle_min, laser.angle_increment, laser.range_min, laser.range_max, *laser.mount
        )
        return points

    def turn_towards(self, pose: Pose2D, x: float, y: float) -> Twist2D | None:
        """Turn on the spot towards a point; None once the robot faces it."""
        error = float(wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.theta))
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
        config, context = self.config, self.context
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
        turn_rate = min(config.turn_rate, context.max_angular)
        linear = min(
            context.max_linear, turn_rate / max(abs(curvature), 1e-6), distance / context.control_step
        )
        angular = linear * curvature
        near = points_within(obstacles, self._sight)
        free = self._free_travel(near, linear, angular)
        if free >= config.horizon:
            return Twist2D(linear, angular)
        # Slow down so that the body would still stand clear when the horizon is over.
        slowed = linear * free / config.horizon
        if slowed > 0.25 * context.max_linear:
            return Twist2D(slowed, slowed * curvature)
        for speed, apart in (
            (context.max_linear, self._keep_apart),
            (config.squeeze_speed, context.robot_radius),
        ):
            step = context.control_step / 2
            linear, angular, gain = best_arc(near, x, y, speed, turn_rate, apart, config.horizon, step)
            if gain > 0.02:
                return Twist2D(linear, angular)
        self.blocked = slowed < 0.02
        return Twist2D(slowed, slowed * curvature)

    @property
    def _keep_apart(self) -> float:
        """Distance of the robot's centre to what the scanner sees [m]."""
        return self.context.robot_radius + self.config.clearance

    @property
    def _sight(self) -> float:
        """Obstacles farther off don't matter within the horizon [m]."""
        return self.context.max_linear * self.config.horizon + self._keep_apart

    def _free_travel(self, near: FloatArray, linear: float, angular: float) -> float:
        config = self.config
        return float(
            free_travel(
                near, linear, angular, self._keep_apart, config.horizon, self.context.control_step / 2
            )
        )

    def _pursued_point(self, costmap: Costmap, pose: Pose2D) -> tuple[float, float]:
        """The path point to steer to, in the robot's frame [m]."""
        self._index = nearest_on_path(self.path, pose.x, pose.y, self._index, 40)
        frame = costmap.frame
        chosen = lookahead_on_path(
            self.path,
            self._index,
            pose.x,
            pose.y,
            self.config.lookahead,
            costmap.costs,
            INSCRIBED_COST,
            frame.origin_x,
            frame.origin_y + frame.height_px * frame.resolution,
            frame.resolution,
        )
        x, y = self.path[chosen].tolist()
        dx, dy = x - pose.x, y - pose.y
        cos, sin = math.cos(pose.theta), math.sin(pose.theta)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def _turn(self, error: float) -> Twist2D:
        """Turn on the spot; near a half turn the direction once chosen is kept."""
        sign = math.copysign(1.0, error)
        if self._turn_sign and abs(error) > 2.4:
            sign = self._turn_sign
        self._turn_sign = sign
        rate = min(self.config.turn_rate, self.context.max_angular, self.config.turn_gain * abs(error))
        return Twist2D(0.0, sign * rate)
