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

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import between, wrap_angle
from slamgym.core.limits import SCANS
from slamgym.core.streams import DAMAGED, open_expanded
from slamgym.core.types import Float32Array, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop.odometry import without_jumps
from slamgym.interop.ranges import range_limit
from slamgym.interop.records import (
    MAX_ABS_COORDINATE,
    MAX_STAMP,
    BrokenMessageError,
    Log,
    LogRecord,
    LogWarnings,
    OdometryTrack,
    possible_angles,
    possible_count,
    usable_scans,
)
from slamgym.interop.scan_times import even_stamps, rate_without_clock, with_told_scan_time

MESSAGES = ("FLASER", "ROBOTLASER1", "ODOM")
IGNORED_MESSAGES = re.compile(
    r"RLASER|R?LASER\d|(RAW|ROBOT)LASER\d|SYNC|TRUEPOS|MARKER|NMEA\w+|GPS\w*|IMU|SONAR|BUMPER|PIXEL|"
    r"VECTORMOVE|ROBOTVELOCITY|FOLLOWTRAJECTORY|BASEVELOCITY|RFID|POSITION"
)
"""Messages of CARMEN's logger that hold no front laser scan (FLASER and ROBOTLASER1 carry their odometry)."""
PARAMETERS = {
    "robot_frontlaser_offset": "offset",
    "robot_front_laser_max": "range_max",
    "robot_front_laser_max_range": "range_max",
    "laser_front_laser_resolution": "degrees",
}
"""Parameters of a log that say something of its laser, and what."""
MAX_LINE_BYTES = 1 << 22
"""A longer line is none of a log."""

_BEFORE_STAMP = {"FLASER": 0, "ROBOTLASER1": 5, "ODOM": 3}
"""So many numbers between the poses and the stamp of a message are passed over."""

_NUMBER = r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?"
_COMMENT = re.compile(
    rf"beams from (?P<start>{_NUMBER}) rad in steps of (?P<step>{_NUMBER}) rad|"
    rf"ranges from (?P<range_max>{_NUMBER}) m mean no return|"
    rf"ranges below (?P<range_min>{_NUMBER}) m are invalid|"
    r"a beam every (?P<time_increment>\S+) s"
)
"""What our own writer says of the laser."""


class _Message(NamedTuple):
    """A laser message, or one of odometry."""

    line: int
    kind: str
    stamp: float  # [s]
    robot_pose: Pose2D
    laser_pose: Pose2D
    ranges: Float32Array  # (n,) [m], as logged
    beams: tuple[float, float] | None  # angle of the first and step [rad], if the message says so
    range_max: float | None  # [m]


def read_carmen(
    path: Path | str, range_max: float | None = None, scan_rate: float | None = None
) -> Log:
    """Read the front laser's scans and the odometry, at the scans and (ODOM lines) between them.

    Args:
        path: A log, plain or compressed by gzip, xz or bzip2 (known by its content, not by its name).
        range_max: Readings from here on are no return [m]; by default what the log says or shows.
        scan_rate: The scans are taken to come so often, in the order of the file [Hz]; by default their stamps count.

    Returns:
        The scans in the order of time. Readings at or beyond the laser's maximum are ``+inf``, zero, negative
        and unreadable ones ``nan``. Faulty lines are left out and counted in ``warnings``.

    Raises:
        InputFileError: If the file can't be read or holds no usable scan.
    """
    path = Path(path)
    warnings = LogWarnings()
    hints, messages = _read_messages(path, warnings)
    every_scan = [message for message in messages if message.kind != "ODOM"]
    of_one_kind = _of_one_kind(path, every_scan, warnings)
    if not of_one_kind:
        raise InputFileError(
            path,
            "; ".join(
                ["holds no usable laser scan (FLASER or ROBOTLASER1)", *warnings.sentences()[:3]]
            ),
        )
    rate, clock = rate_without_clock([scan.stamp for scan in of_one_kind], scan_rate)
    if rate is not None:
        messages = _evenly_stamped(messages, of_one_kind, rate)
        kept = {scan.line for scan in of_one_kind}
        of_one_kind = [message for message in messages if message.line in kept]
    scan_stamps = [scan.stamp for scan in of_one_kind]
    places = [f"{path}:{scan.line}" for scan in of_one_kind]
    scans = [of_one_kind[index] for index in usable_scans(scan_stamps, places, warnings)]
    declared = scans[0].range_max
    if declared is None:
        declared = hints.get("range_max")
    limit, findings = range_limit([scan.ranges for scan in scans], declared, range_max)
    geometry = _geometry(scans, hints, limit)
    lines = {scan.line for scan in scans}
    driven = [message for message in messages if message.kind == "ODOM" or message.line in lines]
    stamps = np.array([message.stamp for message in driven])
    logged = Trajectory(stamps, np.array([message.robot_pose for message in driven]))
    poses, jumps = without_jumps(logged)
    is_scan = [message.kind != "ODOM" for message in driven]
    track = OdometryTrack(stamps, poses, np.flatnonzero(is_scan))
    records = []
    for scan, pose in zip(scans, poses[track.scans].tolist(), strict=True):
        ranges = _ranges(path, scan, limit, warnings)
        laser_scan = LaserScan(scan.stamp, ranges, geometry)
        records.append(LogRecord(scan.stamp, Pose2D(*pose), laser_scan))
    log = Log(str(path), records, geometry, warnings, track, (*clock, *findings, *jumps))
    increment = abs(hints.get("time_increment", 0.0))
    return with_told_scan_time(log, [increment])


def _evenly_stamped(messages: list[_Message], scans: list[_Message], rate: float) -> list[_Message]:
    """The messages with stamps by their place in the file, so that the scans come at a rate [Hz]."""
    lines = {scan.line for scan in scans}
    stamps = even_stamps(np.array([message.line in lines for message in messages]), rate)
    even = zip(messages, stamps.tolist(), strict=True)
    return [message._replace(stamp=stamp) for message, stamp in even]


def _read_messages(path: Path, warnings: LogWarnings) -> tuple[dict[str, float], list[_Message]]:
    """What parameters and comments say of the laser, and all messages that count."""
    hints: dict[str, float] = {}
    messages: list[_Message] = []
    for number, raw in enumerate(_read_lines(path, warnings), start=1):
        if not raw:
            continue  # as fast as can be: a damaged file may hold millions
        if b"\0" in raw:
            if number == 1:
                raise InputFileError(f"{path}:1", "holds binary data; a CARMEN log is text")
            warnings.add("line with binary data", f"{path}:{number}")
            continue
        text = raw.decode("latin-1")
        fields = text.split()
        if not fields:
            continue
        if fields[0] in MESSAGES:
            try:
                messages.append(_parse(fields, number))
            except BrokenMessageError as error:
                warnings.add(str(error), f"{path}:{number}")
            SCANS.check(path, len(messages))
        elif fields[0] == "PARAM":
            if len(fields) > 2 and fields[1] in PARAMETERS:
                _note(hints, PARAMETERS[fields[1]], fields[2])
        elif text.startswith("#"):
            for match in _COMMENT.finditer(text):
                for name, value in match.groupdict().items():
                    _note(hints, name, value or "")
        elif not IGNORED_MESSAGES.fullmatch(fields[0]):
            warnings.add("line of unknown message type", f"{path}:{number}")
    return hints, messages


def _note(hints: dict[str, float], name: str, text: str) -> None:
    """Keep a number if it makes sense; only places, angles and times of beams that aren't in order are negative."""
    try:
        value = float(text)
    except ValueError:
        return
    is_possible = abs(value) <= MAX_ABS_COORDINATE
    if name == "time_increment" or (is_possible and (value > 0.0 or name in ("start", "offset"))):
        hints[name] = value


def _read_lines(path: Path, warnings: LogWarnings) -> Iterator[bytes]:
    """Lines of a plain or compressed file; what is readable before a fault of compressed data is kept."""
    try:
        with open_expanded(path) as file:
            lines = [b""]
            while chunk := file.read1():
                lines = (lines[-1] + chunk).split(b"\n")
                if max(len(lines[0]), len(lines[-1])) > MAX_LINE_BYTES:
                    raise InputFileError(
                        path, "has a line of several megabytes; a CARMEN log is expected"
                    )
                yield from lines[:-1]
            yield lines[-1]
    except EOFError:
        warnings.add("compressed data that end early, the rest of which is lost", path)
    except DAMAGED:
        warnings.add("compressed data that are damaged, the rest of which is lost", path)
    except OSError as error:
        raise InputFileError(path, f"can't be read ({error.strerror or error})") from error


def _parse(fields: Sequence[str], line: int) -> _Message:
    """Parse a line, split at white space; ``line`` is its number, from 1.

    Raises:
        BrokenMessageError: If it is truncated or holds a broken number, pose or stamp.
    """
    kind = fields[0]
    rest = iter(fields[1:])

    def take(count: float) -> list[float]:
        found = [float(text) for text in itertools.islice(rest, int(count))]
        if len(found) < count:
            raise BrokenMessageError(f"truncated {kind} line")
        return found

    ranges: list[float] = []
    beams: tuple[float, float] | None = None
    limit: float | None = None
    try:
        if kind == "ROBOTLASER1":
            _, start, _, step, limit, _, _ = take(7)
            beams = (start, step)
        if kind != "ODOM":
            (count,) = take(1)
            if beams is not None and not possible_angles(*beams):
                raise BrokenMessageError(f"{kind} line with impossible beam angles")
            if not possible_count(count):
                raise BrokenMessageError(f"{kind} line with an impossible number of readings")
            ranges = take(count)
        if kind == "ROBOTLASER1":
            take(take(1)[0])  # remissions
        laser_pose = _pose(take(3))
        robot_pose = laser_pose if kind == "ODOM" else _pose(take(3))
        take(_BEFORE_STAMP[kind])
        (stamp,) = take(1)
    except BrokenMessageError:
        raise
    except (ValueError, OverflowError) as error:
        raise BrokenMessageError(f"unreadable {kind} line") from error
    if not abs(stamp) <= MAX_STAMP:  # false for nan
        raise BrokenMessageError("stamp that is not a time")
    if limit is not None and not 0.0 < limit <= MAX_ABS_COORDINATE:
        limit = None
    with np.errstate(over="ignore"):
        logged = np.array(ranges, dtype=np.float64).astype(np.float32)
    return _Message(line, kind, stamp, robot_pose, laser_pose, logged, beams, limit)


def _pose(values: list[float]) -> Pose2D:
    if not all(abs(value) < MAX_ABS_COORDINATE for value in values):  # false for nan
        raise BrokenMessageError("pose that is not finite")
    return Pose2D(values[0], values[1], wrap_angle(values[2]))


def _of_one_kind(path: Path, scans: list[_Message], warnings: LogWarnings) -> list[_Message]:
    """Keep the scans of the most frequent message type and beam count.

    Some loggers write each scan twice, as FLASER and as ROBOTLASER1; at a tie the latter, which has the
    angles, is kept.
    """
    kinds = Counter((scan.kind, len(scan.ranges)) for scan in scans)
    usual = max(kinds, key=lambda kind: (kinds[kind], kind), default=None)
    kept: list[_Message] = []
    for scan in scans:
        if (scan.kind, len(scan.ranges)) == usual:
            kept.append(scan)
        else:
            warnings.add("scan of another type or number of beams than most", f"{path}:{scan.line}")
    return kept


def _geometry(scans: list[_Message], hints: dict[str, float], range_max: float) -> LaserGeometry:
    count = len(scans[0].ranges)
    step = hints.get("step", math.radians(hints.get("degrees", 0.0)))
    start = hints.get("start", math.nan)
    if scans[0].beams is not None:
        start, step = scans[0].beams
    # An even count covers [-90, 90) degrees, an odd one [-90, 90].
    steps = count if count % 2 == 0 else count - 1
    if not 0.0 < step * count <= 2.1 * math.pi:
        step = math.pi / max(steps, 1)
    if not abs(start) <= 2.1 * math.pi:
        covers_half_turn = abs(step * steps - math.pi) < 0.02
        # Other fans are taken as symmetric.
        start = -0.5 * math.pi if covers_half_turn else -0.5 * step * (count - 1)
    return LaserGeometry(
        num_beams=count,
        angle_min=start,
        angle_increment=step,
        range_min=hints.get("range_min", 0.0),
        range_max=range_max,
        mount=_mount(scans, hints),
        time_increment=math.copysign(0.0, hints.get("time_increment", 0.0)),
    )


def _mount(scans: list[_Message], hints: dict[str, float]) -> Pose2D:
    """The laser in the robot's frame, where the logged pose pairs agree on one.

    In "corrected" logs the first pose is a SLAM result instead; then the parameter counts.
    """
    offsets = np.array([between(scan.robot_pose, scan.laser_pose) for scan in scans])
    middle = np.median(offsets, axis=0)
    difference = np.abs(offsets - middle)
    is_near = difference[:, :2].max(axis=1) < 0.02
    is_parallel = np.abs(wrap_angle(difference[:, 2])) < 0.02
    agreeing = is_near & is_parallel
    if agreeing.mean() >= 0.95 and np.hypot(middle[0], middle[1]) < 3.0:
        x, y, theta = (round(float(value), 5) + 0.0 for value in middle)
        return Pose2D(x, y, theta)
    return Pose2D(hints.get("offset", 0.0), 0.0, 0.0)


def _ranges(path: Path, scan: _Message, range_max: float, warnings: LogWarnings) -> Float32Array:
    ranges = scan.ranges.copy()
    # Zero is how a writer marks an invalid reading; what is below it or no number is a fault of the log.
    if np.isnan(ranges).any() or (ranges < 0.0).any():
        warnings.add("scan with NaN or negative ranges", f"{path}:{scan.line}")
    ranges[~(ranges > 0.0)] = np.nan
    ranges[ranges >= range_max - 1e-4] = np.inf
    return ranges
