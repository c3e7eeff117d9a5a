"""CARMEN logs, written; see :mod:`slamgym.interop.carmen` for the format."""

import functools
import gzip
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from slamgym.core.files import write_bytes
from slamgym.core.geometry import compose
from slamgym.core.types import Float32Array, LaserGeometry, Pose2D
from slamgym.interop.records import LogRecord

COMPRESSION = 4
"""Level of zlib for written logs: 8 % more bytes than at level 6 in a quarter of the time."""


def write_carmen(
    path: Path | str,
    records: Iterable[LogRecord],
    geometry: LaserGeometry,
    *,
    message: str | None = None,
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

    Where a scan takes its time, a comment says how long, and the odometry at its last beam follows it. Ranges are
    written in millimetres' precision; no return becomes the laser's maximum range, a reading that
    is too close or erroneous becomes 0.
    """
    lines = carmen_lines(records, geometry, message)
    content = "".join(lines).encode()
    # mtime=0: the same log gives the same bytes.
    if Path(path).suffix == ".gz":
        content = gzip.compress(content, COMPRESSION, mtime=0)
    write_bytes(path, content)


def carmen_lines(
    records: Iterable[LogRecord], geometry: LaserGeometry, message: str | None = None
) -> Iterator[str]:
    """The lines of a log, as :func:`write_carmen` writes them, one record after the other."""
    if message is None:
        message = "FLASER" if _looks_like_flaser(geometry) else "ROBOTLASER1"
    limit = geometry.range_max
    head = [
        f"# CARMEN log. FLASER n r1..rn x y theta odom_x odom_y odom_theta t host t; "
        f"beams from {geometry.angle_min:.9f} rad in steps of {geometry.angle_increment:.9f} rad; "
        f"ranges from {limit:.6g} m mean no return; ranges below {geometry.range_min:.6g} m are invalid",
        f"PARAM laser_front_laser_resolution {math.degrees(geometry.angle_increment):.6f} 0 host 0",
        f"PARAM robot_front_laser_max {limit:.6g} 0 host 0",
        f"PARAM robot_frontlaser_offset {geometry.mount.x:.6g} 0 host 0",
    ]
    takes_time = geometry.scan_time > 0.0
    if takes_time:
        head.append(f"# a beam every {geometry.time_increment:.12g} s")
    before = "FLASER"
    between = ""
    after = ""
    if message == "ROBOTLASER1":
        view = geometry.field_of_view
        beams = f"{geometry.angle_min:.9f} {view:.9f} {geometry.angle_increment:.9f}"
        before = f"ROBOTLASER1 0 {beams} {limit:.6g} 0.01 0"
        between = "0 "
        after = "0 0 0 0 0 "
    yield "".join(f"{line}\n" for line in head)
    for record in records:
        stamp = f"{record.stamp:.6f}"
        odometry = _format_pose(record.odometry)
        laser = _format_pose(compose(record.odometry, geometry.mount))
        ranges = f"{len(record.scan.ranges)} {_format_ranges(record.scan.ranges, limit)}"
        yield f"ODOM {odometry} 0 0 0 {stamp} host {stamp}\n"
        yield f"{before} {ranges} {between}{laser} {odometry} {after}{stamp} host {stamp}\n"
        if takes_time:
            odometry = _format_pose(compose(record.odometry, record.scan.motion))
            stamp = f"{record.stamp + geometry.scan_time:.6f}"
            yield f"ODOM {odometry} 0 0 0 {stamp} host {stamp}\n"


def _looks_like_flaser(geometry: LaserGeometry) -> bool:
    span = geometry.angle_increment * geometry.num_beams
    return abs(geometry.angle_min + 0.5 * math.pi) < 0.02 and abs(span - math.pi) < 0.02


def _format_pose(pose: Pose2D) -> str:
    return f"{pose.x:.6f} {pose.y:.6f} {pose.theta:.6f}"


def _format_ranges(ranges: Float32Array, limit: float) -> str:
    """The ranges of a scan, separated by blanks; no return becomes ``limit`` [m]."""
    exact = np.asarray(ranges, dtype=np.float64)
    # A float32 times 1000 is exact in a float64, so this rounds as the format does.
    millimetres = np.rint(1000.0 * np.clip(exact, 0.0, limit))
    # A return just inside the limit must not be rounded up to it: that would mean no return.
    millimetres[exact > limit - 0.001] = round(1000.0 * limit - 1.0)
    millimetres[~(exact < limit)] = round(1000.0 * limit)
    millimetres[~(exact > 0.0)] = 0.0
    return " ".join(map(_metres, millimetres.astype(np.int64).tolist()))


@functools.lru_cache(maxsize=1 << 17)
def _metres(millimetres: int) -> str:
    """The text of a range, formatted once: formatting took most of the writing."""
    return f"{millimetres / 1000.0:.3f}"
