"""Driving along planned paths without physics, for training: no wheels, no contacts, a scan a second.

A decision of :class:`~slamgym.envs.explore_frontiers_env.ExploreFrontiersEnv` lasts some 18 control steps, each with
physics, a scan and a look at the clock. Here the robot is put a second farther along its path, which leads over floor
that the map knows, and scans there.
"""

import math
from typing import NamedTuple

from slamgym.core.geometry import between
from slamgym.core.types import FloatArray, Pose2D
from slamgym.envs.batch.fleet import Fleet
from slamgym.planning.exploration_loop import ExplorationLoop

STRIDE = 1.0
"""Time between two scans [s]: the robot drives 0.26 m in it, a little more than the 0.2 m after which a mapper takes
the next scan anyway."""

_TURN_TIME = 0.4
"""A turn towards something is commanded at 2.5 times the angle that is left, per second: it takes so long [s]."""
_AT_END = 0.15
"""A path is driven to its end within this distance, as the navigator has it [m]."""


class Stride(NamedTuple):
    """Where a stride leads."""

    pose: Pose2D  # map frame
    length: float  # of the way there [m]


class Limits(NamedTuple):
    """What a robot can do, and how it follows paths."""

    speed: float  # [m/s]
    rate: float  # of turning [rad/s]
    sharp: float  # a sharper bend is turned on the spot [rad] ...
    slight: float  # ... until so much is left, which the robot turns as it drives [rad]


def stride(loop: ExplorationLoop, seconds: float) -> Stride:
    """Where the robot is after a stride: along its path, or turned on the spot as the loop commands.

    Args:
        loop: The exploration; its command for this moment is taken.
        seconds: Duration of the stride.
    """
    follower = loop.navigator.follower
    command = loop.command()
    pose = loop.pose
    if not loop.navigator.is_active:  # it looks around, or stands
        return _turned(pose, command.angular * seconds)
    if follower.remaining(pose) <= _AT_END or command.linear < 0.0:
        return _turned(pose, command.angular * _TURN_TIME)
    if follower.blocked:
        return Stride(pose, 0.0)
    limits = Limits(
        loop.context.max_linear,
        follower.fastest_turn,
        follower.config.turn_in_place,
        follower.config.turned,
    )
    return along_path(follower.ahead, pose, seconds, limits)


def _turned(pose: Pose2D, angle: float) -> Stride:
    """A turn on the spot."""
    return Stride(Pose2D(pose.x, pose.y, math.remainder(pose.theta + angle, 2.0 * math.pi)), 0.0)


def along_path(path: FloatArray, pose: Pose2D, seconds: float, limits: Limits) -> Stride:
    """Drive along a path at full speed; sharp bends are turned on the spot, slight ones cost no time.

    Args:
        path: Points still ahead, shape (N, 2) [m].
        pose: The robot.
        seconds: How long.
        limits: Of the robot.
    """
    speed, rate, sharp, slight = limits
    x, y, theta = pose
    left = seconds
    length = 0.0
    points = path.tolist()
    if len(points) > 1:
        (ax, ay), (bx, by) = points[:2]
        if (ax - x) * (bx - ax) + (ay - y) * (by - ay) <= 0.0:
            del points[0]  # the robot has passed it
    for px, py in points:
        apart = math.hypot(px - x, py - y)
        if apart < 1e-6:
            continue
        heading = math.atan2(py - y, px - x)
        error = math.remainder(heading - theta, 2.0 * math.pi)
        if abs(error) > sharp:
            wanted = abs(error) - slight
            turned = min(wanted, rate * left)
            left -= turned / rate
            if turned < wanted or left <= 1e-9:
                theta += math.copysign(turned, error)
                break
        theta = heading
        moved = min(apart, speed * left)
        x += moved * math.cos(heading)
        y += moved * math.sin(heading)
        length += moved
        left -= moved / speed
        if left <= 1e-9:
            break
    return Stride(Pose2D(x, y, math.remainder(theta, 2.0 * math.pi)), length)


def put_robot(fleet: Fleet, pose: Pose2D, length: float, steps: int) -> None:
    """Put a single robot where so many control steps have brought it.

    Args:
        fleet: Has that robot alone.
        pose: Where, world frame.
        length: Of the way there [m].
        steps: Control steps.
    """
    robots = fleet.robots
    robots.driven[0] = between(Pose2D(*robots.pose[0].tolist()), pose)
    robots.pose[0] = pose
    robots.path[0] += length
    robots.steps[0] += steps
