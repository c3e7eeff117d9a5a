"""CARMEN logs: the text format of the public 2D SLAM benchmarks, read and written.

FLASER messages carry no beam angles. Where neither a ``laser_front_laser_resolution`` parameter nor a comment
gives them, the scanner is taken for a SICK LMS that covers 180 degrees: 180 beams start at -90 degrees and
step by 1 degree, 181 beams cover -90..90 degrees, 360 and 361 beams are the same at half a degree.
"""

import gzip
import itertools
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import open_regular, write_bytes
from slamgym.core.geometry import between, compose, wrap_angle
from slamgym.core.limits import SCANS, check_expansion
from slamgym.core.types import Float32Array, LaserGeometry, LaserScan, Pose2D
from slamgym.interop.carmen_messages import (
    LaserHints,
    MalformedMessageError,
    OdometryMessage,
    ScanMessage,
    parse_odometry,
    parse_scan,
)
from slamgym.interop.records import (
    Log,
    LogRecord,
    LogWarnings,
    OdometryTrack,
    longest_ordered,
    without_jumps,
)

SCAN_MESSAGES = ("FLASER", "ROBOTLASER1")
IGNORED_MESSAGES = re.compile(
    r"RLASER|R?LASER\d|(RAW|ROBOT)LASER\d|SYNC|TRUEPOS|MARKER|NMEA\w+|GPS\w*|IMU|SONAR|BUMPER|PIXEL|"
    r"VECTORMOVE|ROBOTVELOCITY|FOLLOWTRAJECTORY|BASEVELOCITY|RFID|POSITION"
)
"""Messages of CARMEN's logger that hold no front laser scan (FLASER and ROBOTLASER1 carry their odometry)."""

DEFAULT_RANGE_MAX = 80.0
"""A SICK LMS reports 81.91 m or so where nothing came back [m]."""

COMPRESSION = 4
"""Level of zlib for written logs: 8 % more bytes than at level 6 in a quarter of the time."""

CHUNK_BYTES = 1 << 16
MAX_LINE_BYTES = 1 << 22
GZIP_MAGIC = b"\x1f\x8b"


def read_carmen(path: Path | str) -> Log:
    """Read the front laser's scans and the odometry, at the scans and (ODOM lines) between them.

    Args:
        path: A log, plain or compressed by gzip (known by its content, not by its name).

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
    kept = longest_ordered([message.stamp for message in messages])
    kept_set = set(kept)
    for index, message in enumerate(messages):
        if index not in kept_set:
            warnings.add("scan left out because time goes backwards", f"{path}:{message.line}")
    messages = [messages[index] for index in kept]
    places = [f"{path}:{message.line}" for message in messages]
    near = without_jumps([message.robot_pose for message in messages], places, warnings)
    messages = [messages[index] for index in near]
    geometry = _geometry(messages, hints)
    records = [_record(path, message, geometry, warnings) for message in messages]
    track = _track(odometry, messages, records) if odometry else None
    return Log(str(path), records, geometry, warnings, track)


def write_carmen(
    path: Path | str, records: Iterable[LogRecord], geometry: LaserGeometry, *, message: str | None = None
) -> None:
    """Write a log that CARMEN, GMapping and other SLAM programs replay.

    Args:
        path: The file; compressed if its name ends in ``.gz``.
        records: The scans; all have the given geometry.
        geometry: The laser.
        message: ``"FLASER"``, which every program knows, or ``"ROBOTLASER1"``, which carries the angles. By
            default the former where the scanner covers about 180 degrees ahead, as FLASER implies.

    Raises:
        InputFileError: If the file can't be written.

    Ranges are written in millimetres' precision; no return becomes the laser's maximum range, a reading that
    is too close or erroneous becomes 0.
    """
    if message is None:
        message = "FLASER" if _looks_like_flaser(geometry) else "ROBOTLASER1"
    limit = geometry.range_max
    lines = [
        f"# CARMEN log. FLASER n r1..rn x y theta odom_x odom_y odom_theta t host t; "
        f"beams from {geometry.angle_min:.9f} rad in steps of {geometry.angle_increment:.9f} rad; "
        f"ranges from {limit:.6g} m mean no return; ranges below {geometry.range_min:.6g} m are invalid",
        f"PARAM laser_front_laser_resolution {math.degrees(geometry.angle_increment):.6f} 0 host 0",
        f"PARAM robot_front_laser_max {limit:.6g} 0 host 0",
        f"PARAM robot_frontlaser_offset {geometry.mount.x:.6g} 0 host 0",
    ]
    texts = _RangeText(limit)
    for record in records:
        stamp = f"{record.stamp:.6f}"
        odometry = _format_pose(record.odometry)
        laser = _format_pose(compose(record.odometry, geometry.mount))
        ranges = texts.line(record.scan.ranges)
        lines.append(f"ODOM {odometry} 0 0 0 {stamp} host {stamp}")
        if message == "FLASER":
            lines.append(f"FLASER {len(record.scan.ranges)} {ranges} {laser} {odometry} {stamp} host {stamp}")
        else:
            beams = (
                f"{geometry.angle_min:.9f} {geometry.angle_increment * (geometry.num_beams - 1):.9f} "
                f"{geometry.angle_increment:.9f} {limit:.6g} 0.01 0 {len(record.scan.ranges)}"
            )
            lines.append(
                f"ROBOTLASER1 0 {beams} {ranges} 0 {laser} {odometry} 0 0 0 0 0 {stamp} host {stamp}"
            )
    content = ("\n".join(lines) + "\n").encode()
    # mtime=0: the same log gives the same bytes.
    compressed = Path(path).suffix == ".gz"
    write_bytes(path, gzip.compress(content, COMPRESSION, mtime=0) if compressed else content)


def _read_messages(
    path: Path, warnings: LogWarnings
) -> tuple[LaserHints, list[ScanMessage], list[OdometryMessage]]:
    hints = LaserHints()
    messages: list[ScanMessage] = []
    odometry: list[OdometryMessage] = []
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
        if fields[0] in SCAN_MESSAGES or fields[0] == "ODOM":
            try:
                if fields[0] == "ODOM":
                    odometry.append(parse_odometry(fields, number))
                else:
                    messages.append(parse_scan(fields, number))
                SCANS.check(path, len(messages))
            except MalformedMessageError as error:
                warnings.add(str(error), f"{path}:{number}")
        elif fields[0] == "PARAM":
            hints.read_parameter(fields)
        elif text.startswith("#"):
            hints.read_comment(text)
        elif not IGNORED_MESSAGES.fullmatch(fields[0]):
            warnings.add("line of unknown message type", f"{path}:{number}")
    return hints, messages, odometry


def _read_lines(path: Path, warnings: LogWarnings) -> Iterator[bytes]:
    """The lines of a plain or gzip file; damaged compressed data end the file with a warning."""
    rest = b""
    for chunk in _read_chunks(path, warnings):
        lines = (rest + chunk).split(b"\n")
        rest = lines.pop()
        if len(rest) > MAX_LINE_BYTES:
            raise InputFileError(path, "has a line of several megabytes; a CARMEN log is expected")
        yield from lines
    if rest:
        yield rest


def _read_chunks(path: Path, warnings: LogWarnings) -> Iterator[bytes]:
    try:
        with open_regular(path) as file:
            chunks = iter(lambda: file.read(CHUNK_BYTES), b"")
            first = next(chunks, b"")
            everything = itertools.chain([first], chunks)
            yield from _inflate(path, everything, warnings) if first.startswith(GZIP_MAGIC) else everything
    except OSError as error:
        raise InputFileError(path, f"can't be read ({error.strerror or error})") from error


def _inflate(path: Path, chunks: Iterator[bytes], warnings: LogWarnings) -> Iterator[bytes]:
    """Decompress gzip data of one or more members; what was readable before a fault is kept."""
    stream = zlib.decompressobj(16 + zlib.MAX_WBITS)  # 16: with a gzip header
    compressed = expanded = 0
    for chunk in chunks:
        data = chunk
        compressed += len(chunk)
        while data:
            try:
                content = stream.decompress(data, CHUNK_BYTES)
            except zlib.error:
                warnings.add("damage in the compressed data, the rest of which is lost", path)
                return
            expanded += len(content)
            check_expansion(path, expanded, compressed)
            yield content
            data = stream.unused_data if stream.eof else stream.unconsumed_tail
            if stream.eof and data:
                stream = zlib.decompressobj(16 + zlib.MAX_WBITS)
    if not stream.eof:
        warnings.add("compressed data that end early, the rest of which is lost", path)


def _of_one_kind(path: Path, messages: list[ScanMessage], warnings: LogWarnings) -> list[ScanMessage]:
    """Keep the scans of the most frequent message type and beam count.

    Some loggers write each scan twice, as FLASER and as ROBOTLASER1; at a tie the latter, which has the
    angles, is kept.
    """
    if not messages:
        return []
    kinds = Counter(message.kind for message in messages)
    kind = max(kinds, key=lambda name: (kinds[name], name))
    beams = Counter(len(message.ranges) for message in messages if message.kind == kind).most_common(1)[0][0]
    kept: list[ScanMessage] = []
    for message in messages:
        if message.kind != kind:
            warnings.add(f"{message.kind} message beside more {kind} messages", f"{path}:{message.line}")
        elif len(message.ranges) != beams:
            warnings.add("scan with another number of beams", f"{path}:{message.line}")
        else:
            kept.append(message)
    return kept


def _track(
    odometry: list[OdometryMessage], scans: list[ScanMessage], records: list[LogRecord]
) -> OdometryTrack:
    """ODOM lines and scans in the order of the file."""
    lines = np.array([message.line for message in odometry] + [message.line for message in scans])
    stamps = np.array([message.stamp for message in odometry] + [record.stamp for record in records])
    poses = np.array([message.pose for message in odometry] + [record.odometry for record in records])
    order = np.argsort(lines)
    return OdometryTrack(stamps[order], poses[order], np.flatnonzero(order >= len(odometry)))


def _geometry(messages: list[ScanMessage], hints: LaserHints) -> LaserGeometry:
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


def _guess_range_max(messages: list[ScanMessage]) -> float:
    """Without a parameter: the largest reading, if so many beams share it that it means "no return"."""
    ranges = np.concatenate([message.ranges for message in messages])
    ranges = ranges[np.isfinite(ranges)]
    if ranges.size == 0:
        return DEFAULT_RANGE_MAX
    largest = float(ranges.max())
    sharing = np.count_nonzero(ranges > largest - 0.01)
    return largest if largest > 5.0 and sharing >= max(20, 0.0005 * ranges.size) else DEFAULT_RANGE_MAX


def _mount(messages: list[ScanMessage], hints: LaserHints) -> Pose2D:
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


def _record(path: Path, message: ScanMessage, geometry: LaserGeometry, warnings: LogWarnings) -> LogRecord:
    ranges = message.ranges.copy()
    # Zero is how a writer marks an invalid reading; what is below it or no number is a fault of the log.
    if np.isnan(ranges).any() or (ranges < 0.0).any():
        warnings.add("scan with NaN or negative ranges", f"{path}:{message.line}")
    ranges[~(ranges > 0.0)] = np.nan
    ranges[ranges >= geometry.range_max - 1e-4] = np.inf
    x, y, theta = message.robot_pose
    scan = LaserScan(message.stamp, ranges, geometry)
    return LogRecord(message.stamp, Pose2D(x, y, wrap_angle(theta)), scan)


def _looks_like_flaser(geometry: LaserGeometry) -> bool:
    span = geometry.angle_increment * geometry.num_beams
    return abs(geometry.angle_min + 0.5 * math.pi) < 0.02 and abs(span - math.pi) < 0.02


def _format_pose(pose: Pose2D) -> str:
    return f"{pose.x:.6f} {pose.y:.6f} {pose.theta:.6f}"


class _RangeText(dict[int, str]):
    """Ranges as text by their millimetres, formatted once each: formatting took most of the writing.

    Args:
        limit: What no return becomes [m].
    """

    _JUST_INSIDE, _NO_RETURN = -1, -2

    def __init__(self, limit: float) -> None:
        self._limit = limit
        # A return just inside the limit must not be rounded up to it: that would mean no return.
        super().__init__({self._JUST_INSIDE: f"{limit - 0.001:.3f}", self._NO_RETURN: f"{limit:.3f}"})

    def __missing__(self, millimetres: int) -> str:
        text = self[millimetres] = f"{millimetres / 1000.0:.3f}"
        return text

    def line(self, ranges: Float32Array) -> str:
        """The ranges of a scan, separated by blanks."""
        exact = np.asarray(ranges, dtype=np.float64)
        # A float32 times 1000 is exact in a float64, so this rounds as the format does.
        millimetres = np.rint(1000.0 * np.clip(exact, 0.0, self._limit))
        millimetres[exact > self._limit - 0.001] = self._JUST_INSIDE
        millimetres[~(exact < self._limit)] = self._NO_RETURN
        millimetres[~(exact > 0.0)] = 0.0
        return " ".join(map(self.__getitem__, millimetres.astype(np.int64).tolist()))
