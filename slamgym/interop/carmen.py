"""CARMEN logs: the text format of the public 2D SLAM benchmarks.

FLASER messages carry no beam angles. Where neither a ``laser_front_laser_resolution`` parameter nor a comment
gives them, the scanner is taken for a SICK LMS that covers 180 degrees: 180 beams start at -90 degrees and
step by 1 degree, 181 beams cover -90..90 degrees, 360 and 361 beams are the same at half a degree.

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
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import between, wrap_angle
from slamgym.core.limits import SCANS
from slamgym.core.streams import DAMAGED, open_expanded
from slamgym.core.types import Float32Array, LaserGeometry, LaserScan, Pose2D
from slamgym.interop.records import (
    MAX_ABS_COORDINATE,
    MAX_ANGLE,
    MAX_ANGLE_STEP,
    MAX_BEAMS,
    MAX_STAMP,
    Log,
    LogRecord,
    LogWarnings,
    OdometryTrack,
    usable_scans,
)

SCAN_MESSAGES = ("FLASER", "ROBOTLASER1")
IGNORED_MESSAGES = re.compile(
    r"RLASER|R?LASER\d|(RAW|ROBOT)LASER\d|SYNC|TRUEPOS|MARKER|NMEA\w+|GPS\w*|IMU|SONAR|BUMPER|PIXEL|"
    r"VECTORMOVE|ROBOTVELOCITY|FOLLOWTRAJECTORY|BASEVELOCITY|RFID|POSITION"
)
"""Messages of CARMEN's logger that hold no front laser scan (FLASER and ROBOTLASER1 carry their odometry)."""

DEFAULT_RANGE_MAX = 80.0
"""A SICK LMS reports 81.91 m or so where nothing came back [m]."""

MAX_LINE_BYTES = 1 << 22

_NUMBER = r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)"
_BEAMS_COMMENT = re.compile(rf"beams from {_NUMBER} rad in steps of {_NUMBER} rad")
_RANGE_COMMENT = re.compile(rf"ranges from {_NUMBER} m mean no return")
_MINIMUM_COMMENT = re.compile(rf"ranges below {_NUMBER} m are invalid")


class _Scan(NamedTuple):
    """One laser message, as it stands in the log."""

    line: int
    kind: str  # FLASER or ROBOTLASER1
    stamp: float  # [s]
    ranges: Float32Array  # (n,) [m], as logged
    laser_pose: Pose2D
    robot_pose: Pose2D
    angle_min: float | None = None  # [rad], where the message says so
    angle_increment: float | None = None  # [rad]
    range_max: float | None = None  # [m]


class _Odometry(NamedTuple):
    """One ODOM message."""

    line: int
    stamp: float  # [s]
    pose: Pose2D


class _MalformedError(ValueError):
    """A line that can't be used; the text says what kind of fault it has."""


@dataclass
class _Hints:
    """Properties of the laser by a log's parameters and comments."""

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


def read_carmen(path: Path | str) -> Log:
    """Read the front laser's scans and the odometry, at the scans and (ODOM lines) between them.

    Args:
        path: A log, plain or compressed by gzip, xz or bzip2 (known by its content, not by its name).

    Returns:
        The scans in the order of time. Readings at or beyond the laser's maximum are ``+inf``, zero, negative
        and unreadable ones ``nan``. Faulty lines are left out and counted in ``warnings``.

    Raises:
        InputFileError: If the file can't be read or holds no usable scan.
    """
    path = Path(path)
    warnings = LogWarnings()
    hints, messages, odometry = _read_messages(path, warnings)
    messages = _of_one_kind(path, messages, warnings)
    if not messages:
        faults = "; ".join(warnings.sentences()[:3])
        raise InputFileError(
            path, "holds no usable laser scan (FLASER or ROBOTLASER1)" + (f": {faults}" if faults else "")
        )
    places = [f"{path}:{message.line}" for message in messages]
    stamps, poses = [message.stamp for message in messages], [message.robot_pose for message in messages]
    messages = [messages[index] for index in usable_scans(stamps, poses, places, warnings)]
    geometry = _geometry(messages, hints)
    records = [_record(path, message, geometry, warnings) for message in messages]
    track = _track(odometry, messages, records) if odometry else None
    return Log(str(path), records, geometry, warnings, track)


def _read_messages(path: Path, warnings: LogWarnings) -> tuple[_Hints, list[_Scan], list[_Odometry]]:
    hints = _Hints()
    messages: list[_Scan] = []
    odometry: list[_Odometry] = []
    for number, raw in enumerate(_read_lines(path, warnings), start=1):
        if not raw:
            continue
        if b"\0" in raw:
            if number == 1 and not messages:
                raise InputFileError(f"{path}:1", "holds binary data; a CARMEN log is text")
            warnings.add("line with binary data", f"{path}:{number}")
            continue
        text = raw.decode("latin-1")
        fields = text.split()
        if not fields:
            continue
        if fields[0] in (*SCAN_MESSAGES, "ODOM"):
            try:
                message = _parse(fields, number)
            except _MalformedError as error:
                warnings.add(str(error), f"{path}:{number}")
                continue
            if isinstance(message, _Odometry):
                odometry.append(message)
            else:
                messages.append(message)
                SCANS.check(path, len(messages))
        elif fields[0] == "PARAM":
            hints.read_parameter(fields)
        elif text.startswith("#"):
            hints.read_comment(text)
        elif not IGNORED_MESSAGES.fullmatch(fields[0]):
            warnings.add("line of unknown message type", f"{path}:{number}")
    return hints, messages, odometry


def _read_lines(path: Path, warnings: LogWarnings) -> Iterator[bytes]:
    """Lines of a plain or compressed file; what is readable before a fault of compressed data is kept."""
    try:
        with open_expanded(path) as file:
            lines = [b""]
            while chunk := file.read1():
                lines = (lines[-1] + chunk).split(b"\n")
                if max(len(lines[0]), len(lines[-1])) > MAX_LINE_BYTES:
                    raise InputFileError(path, "has a line of several megabytes; a CARMEN log is expected")
                yield from lines[:-1]
            yield lines[-1]
    except DAMAGED as error:
        fault = "end early" if isinstance(error, EOFError) else "are damaged"
        warnings.add(f"compressed data that {fault}, the rest of which is lost", path)
    except OSError as error:
        raise InputFileError(path, f"can't be read ({error.strerror or error})") from error


def _parse(fields: Sequence[str], line: int) -> _Scan | _Odometry:
    """Parse a FLASER, ROBOTLASER1 or ODOM line, split at white space; ``line`` is its number, from 1.

    Raises:
        _MalformedError: If it is truncated or holds a broken number, pose or stamp.
    """
    kind = fields[0]
    try:
        if kind == "ODOM":
            return _Odometry(line, _stamp(fields[7]), _pose(fields, 1))
        if kind == "FLASER":
            after = 2 + _count(fields[1], kind)
            ranges = _ranges(fields[2:after], after - 2, kind)
            return _Scan(
                line, kind, _stamp(fields[after + 6]), ranges, _pose(fields, after), _pose(fields, after + 3)
            )
        start, resolution, range_max = float(fields[2]), float(fields[4]), float(fields[5])
        if not (abs(start) <= MAX_ANGLE and 0.0 < resolution <= MAX_ANGLE_STEP):
            raise _MalformedError(f"{kind} line with impossible beam angles")
        after = 9 + _count(fields[8], kind)
        ranges = _ranges(fields[9:after], after - 9, kind)
        after += 1 + _count(fields[after], kind, least=0)  # the remissions
        laser_pose, robot_pose = _pose(fields, after), _pose(fields, after + 3)
        limit = range_max if 0.0 < range_max <= MAX_ABS_COORDINATE else None
        stamp = _stamp(fields[after + 11])
        return _Scan(line, kind, stamp, ranges, laser_pose, robot_pose, start, resolution, limit)
    except _MalformedError:
        raise
    except IndexError as error:
        raise _MalformedError(f"truncated {kind} line") from error
    except (ValueError, OverflowError) as error:
        raise _MalformedError(f"unreadable {kind} line") from error


def _count(text: str, kind: str, least: int = 1) -> int:
    count = int(text)
    if not least <= count <= MAX_BEAMS:
        raise _MalformedError(f"{kind} line with an impossible number of readings")
    return count


def _ranges(fields: Sequence[str], count: int, kind: str) -> Float32Array:
    if len(fields) < count:
        raise _MalformedError(f"truncated {kind} line")
    with np.errstate(over="ignore"):
        return np.array([float(text) for text in fields], dtype=np.float64).astype(np.float32)


def _pose(fields: Sequence[str], start: int) -> Pose2D:
    x, y, theta = float(fields[start]), float(fields[start + 1]), float(fields[start + 2])
    if not all(abs(value) < MAX_ABS_COORDINATE for value in (x, y, theta)):  # false for nan
        raise _MalformedError("pose that is not finite")
    return Pose2D(x, y, theta)


def _stamp(text: str) -> float:
    stamp = float(text)
    if not abs(stamp) <= MAX_STAMP:  # false for nan
        raise _MalformedError("stamp that is not a time")
    return stamp


def _number(text: str, most: float) -> float | None:
    """A number of a size up to ``most``; None for anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) <= most else None


def _of_one_kind(path: Path, messages: list[_Scan], warnings: LogWarnings) -> list[_Scan]:
    """Keep the scans of the most frequent message type and beam count.

    Some loggers write each scan twice, as FLASER and as ROBOTLASER1; at a tie the latter, which has the
    angles, is kept.
    """
    if not messages:
        return []
    kinds = Counter(message.kind for message in messages)
    kind = max(kinds, key=lambda name: (kinds[name], name))
    beams = Counter(len(message.ranges) for message in messages if message.kind == kind).most_common(1)[0][0]
    kept: list[_Scan] = []
    for message in messages:
        if message.kind != kind:
            warnings.add(f"{message.kind} message beside more {kind} messages", f"{path}:{message.line}")
        elif len(message.ranges) != beams:
            warnings.add("scan with another number of beams", f"{path}:{message.line}")
        else:
            kept.append(message)
    return kept


def _track(odometry: list[_Odometry], scans: list[_Scan], records: list[LogRecord]) -> OdometryTrack:
    """ODOM lines and scans in the order of the file."""
    lines = np.array([message.line for message in odometry] + [message.line for message in scans])
    stamps = np.array([message.stamp for message in odometry] + [record.stamp for record in records])
    poses = np.array([message.pose for message in odometry] + [record.odometry for record in records])
    order = np.argsort(lines)
    return OdometryTrack(stamps[order], poses[order], np.flatnonzero(order >= len(odometry)))


def _geometry(messages: list[_Scan], hints: _Hints) -> LaserGeometry:
    first = messages[0]
    num_beams = len(first.ranges)
    angle_min = first.angle_min if first.angle_min is not None else hints.angle_min
    increment = first.angle_increment if first.angle_increment is not None else hints.angle_increment
    if increment is None or increment * num_beams > 2.1 * math.pi:
        increment = math.pi / (num_beams if num_beams % 2 == 0 else max(num_beams - 1, 1))
    if angle_min is None:
        # An even count covers [-90, 90) degrees, an odd one [-90, 90]; other fans are taken as symmetric.
        covered = increment * (num_beams if num_beams % 2 == 0 else num_beams - 1)
        symmetric = -0.5 * increment * (num_beams - 1)
        angle_min = -0.5 * math.pi if abs(covered - math.pi) < 0.02 else symmetric
    range_max = first.range_max if first.range_max is not None else hints.range_max
    if range_max is None:
        range_max = _guess_range_max(messages)
    return LaserGeometry(
        num_beams, angle_min, increment, hints.range_min or 0.0, range_max, _mount(messages, hints)
    )


def _guess_range_max(messages: list[_Scan]) -> float:
    """Without a parameter: the largest reading, if so many beams share it that it means "no return"."""
    ranges = np.concatenate([message.ranges for message in messages])
    ranges = ranges[np.isfinite(ranges)]
    if ranges.size == 0:
        return DEFAULT_RANGE_MAX
    largest = float(ranges.max())
    sharing = np.count_nonzero(ranges > largest - 0.01)
    return largest if largest > 5.0 and sharing >= max(20, 0.0005 * ranges.size) else DEFAULT_RANGE_MAX


def _mount(messages: list[_Scan], hints: _Hints) -> Pose2D:
    """The laser in the robot's frame, where the logged pose pairs agree on one.

    In "corrected" logs the first pose is a SLAM result instead; then the parameter counts.
    """
    offsets = np.array([between(message.robot_pose, message.laser_pose) for message in messages])
    middle = np.median(offsets, axis=0)
    difference = np.abs(offsets - middle)
    agreeing = (difference[:, :2].max(axis=1) < 0.02) & (np.abs(wrap_angle(difference[:, 2])) < 0.02)
    if agreeing.mean() >= 0.95 and np.hypot(middle[0], middle[1]) < 3.0:
        x, y, theta = (round(float(value), 5) + 0.0 for value in middle)
        return Pose2D(x, y, theta)
    return Pose2D(hints.offset or 0.0, 0.0, 0.0)


def _record(path: Path, message: _Scan, geometry: LaserGeometry, warnings: LogWarnings) -> LogRecord:
    ranges = message.ranges.copy()
    # Zero is how a writer marks an invalid reading; what is below it or no number is a fault of the log.
    if np.isnan(ranges).any() or (ranges < 0.0).any():
        warnings.add("scan with NaN or negative ranges", f"{path}:{message.line}")
    ranges[~(ranges > 0.0)] = np.nan
    ranges[ranges >= geometry.range_max - 1e-4] = np.inf
    x, y, theta = message.robot_pose
    scan = LaserScan(message.stamp, ranges, geometry)
    return LogRecord(message.stamp, Pose2D(x, y, wrap_angle(theta)), scan)
