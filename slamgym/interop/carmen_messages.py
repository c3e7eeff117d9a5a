"""The messages of a CARMEN log, line by line, and the laser's geometry that follows from them.

Formats (http://carmen.sourceforge.net, logger module):

- ``FLASER n r1..rn x y theta odom_x odom_y odom_theta stamp host logger_stamp``: the laser's pose, then the
  robot's, both in the odometry frame. It has no angles.
- ``ROBOTLASER1 type start_angle field_of_view resolution max_range accuracy remission_mode n r1..rn
  m remission1..m laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv ... stamp host logger_stamp``.
- ``ODOM x y theta tv rv acceleration stamp host logger_stamp``: odometry, mostly several times between scans.
- ``PARAM name value ...`` and comments that start with ``#``.
"""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.types import Float32Array, Pose2D
from slamgym.interop.records import MAX_ABS_COORDINATE, MAX_ANGLE, MAX_ANGLE_STEP, MAX_BEAMS, MAX_STAMP

_NUMBER = r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)"
_BEAMS_COMMENT = re.compile(rf"beams from {_NUMBER} rad in steps of {_NUMBER} rad")
_RANGE_COMMENT = re.compile(rf"ranges from {_NUMBER} m mean no return")
_MINIMUM_COMMENT = re.compile(rf"ranges below {_NUMBER} m are invalid")


class ScanMessage(NamedTuple):
    """One laser message, as it stands in the log."""

    line: int
    kind: str  # FLASER or ROBOTLASER1
    stamp: float  # [s]
    ranges: Float32Array  # (n,) [m], as logged
    laser_pose: Pose2D
    robot_pose: Pose2D
    angle_min: float | None  # [rad], where the message says so
    angle_increment: float | None  # [rad]
    range_max: float | None  # [m]


class OdometryMessage(NamedTuple):
    """One ODOM message."""

    line: int
    stamp: float  # [s]
    pose: Pose2D


class MalformedMessageError(ValueError):
    """A line that can't be used; the text says what kind of fault it has."""


@dataclass
class LaserHints:
    """What parameters and comments of a log say about its laser."""

    angle_min: float | None = None  # [rad]
    angle_increment: float | None = None  # [rad]
    range_min: float | None = None  # [m]
    range_max: float | None = None  # [m]
    offset: float | None = None  # [m], laser ahead of the robot's centre

    def read_parameter(self, fields: Sequence[str]) -> None:
        """Take what a PARAM line says, if it is about the front laser."""
        value = _number(fields[2], MAX_ABS_COORDINATE) if len(fields) > 2 else None
        if value is None:
            return
        if fields[1] == "robot_frontlaser_offset":
            self.offset = value
        elif fields[1] in ("robot_front_laser_max", "robot_front_laser_max_range") and value > 0.0:
            self.range_max = value
        elif fields[1] == "laser_front_laser_resolution" and value > 0.0 and self.angle_min is None:
            # In degrees. A comment that names the angles (and so sets angle_min) is more precise.
            self.angle_increment = math.radians(value)

    def read_comment(self, text: str) -> None:
        """Take the angles and range limits that a comment names in words, as the writer here puts them."""
        if match := _BEAMS_COMMENT.search(text):
            start, step = _number(match[1], MAX_ANGLE), _number(match[2], MAX_ANGLE_STEP)
            if start is not None and step is not None and step > 0.0:
                self.angle_min, self.angle_increment = start, step
        if match := _RANGE_COMMENT.search(text):
            self.range_max = _number(match[1], MAX_ABS_COORDINATE) or self.range_max
        if match := _MINIMUM_COMMENT.search(text):
            self.range_min = _number(match[1], MAX_ABS_COORDINATE)


def parse_scan(fields: Sequence[str], line: int) -> ScanMessage:
    """Parse a FLASER or ROBOTLASER1 line.

    Args:
        fields: The line, split at white space.
        line: Its number, from 1.

    Raises:
        MalformedMessageError: If it is truncated or holds a broken number, pose or stamp.
    """
    with _malformed(fields[0]):
        return _parse_flaser(fields, line) if fields[0] == "FLASER" else _parse_robotlaser(fields, line)


def parse_odometry(fields: Sequence[str], line: int) -> OdometryMessage:
    """Parse an ODOM line.

    Args:
        fields: The line, split at white space.
        line: Its number, from 1.

    Raises:
        MalformedMessageError: If it is truncated or holds a broken number, pose or stamp.
    """
    with _malformed(fields[0]):
        x, y, theta = _pose(fields, 1)
        return OdometryMessage(line, _stamp(fields[7]), Pose2D(x, y, theta))


@contextmanager
def _malformed(kind: str) -> Iterator[None]:
    """Say of a line that it is cut short or holds no numbers."""
    try:
        yield
    except IndexError as error:
        raise MalformedMessageError(f"truncated {kind} line") from error
    except (ValueError, OverflowError) as error:
        if isinstance(error, MalformedMessageError):
            raise
        raise MalformedMessageError(f"unreadable {kind} line") from error


def _parse_flaser(fields: Sequence[str], line: int) -> ScanMessage:
    count = _count(fields[1], fields[0])
    after = 2 + count
    ranges = _ranges(fields[2:after], count, fields[0])
    laser_pose = _pose(fields, after)
    robot_pose = _pose(fields, after + 3)
    stamp = _stamp(fields[after + 6])
    return ScanMessage(line, fields[0], stamp, ranges, laser_pose, robot_pose, None, None, None)


def _parse_robotlaser(fields: Sequence[str], line: int) -> ScanMessage:
    start, resolution, range_max = float(fields[2]), float(fields[4]), float(fields[5])
    if not (abs(start) <= MAX_ANGLE and 0.0 < resolution <= MAX_ANGLE_STEP):
        raise MalformedMessageError(f"{fields[0]} line with impossible beam angles")
    count = _count(fields[8], fields[0])
    after = 9 + count
    ranges = _ranges(fields[9:after], count, fields[0])
    after += 1 + _count(fields[after], fields[0], least=0)  # the remissions
    laser_pose = _pose(fields, after)
    robot_pose = _pose(fields, after + 3)
    stamp = _stamp(fields[after + 11])
    limit = range_max if 0.0 < range_max <= MAX_ABS_COORDINATE else None
    return ScanMessage(line, fields[0], stamp, ranges, laser_pose, robot_pose, start, resolution, limit)


def _count(text: str, kind: str, least: int = 1) -> int:
    count = int(text)
    if not least <= count <= MAX_BEAMS:
        raise MalformedMessageError(f"{kind} line with an impossible number of readings")
    return count


def _ranges(fields: Sequence[str], count: int, kind: str) -> Float32Array:
    if len(fields) < count:
        raise MalformedMessageError(f"truncated {kind} line")
    with np.errstate(over="ignore"):
        return np.array([float(text) for text in fields], dtype=np.float64).astype(np.float32)


def _pose(fields: Sequence[str], start: int) -> Pose2D:
    x, y, theta = float(fields[start]), float(fields[start + 1]), float(fields[start + 2])
    if not all(abs(value) < MAX_ABS_COORDINATE for value in (x, y, theta)):  # false for nan
        raise MalformedMessageError("pose that is not finite")
    return Pose2D(x, y, theta)


def _stamp(text: str) -> float:
    stamp = float(text)
    if not abs(stamp) <= MAX_STAMP:  # false for nan
        raise MalformedMessageError("stamp that is not a time")
    return stamp


def _number(text: str, most: float) -> float | None:
    """A number of a size up to ``most``; None for anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) <= most else None
