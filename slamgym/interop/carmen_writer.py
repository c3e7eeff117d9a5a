"""CARMEN logs, written; see :mod:`slamgym.interop.carmen` for the format."""

import gzip
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from slamgym.core.files import write_bytes
from slamgym.core.geometry import compose
from slamgym.core.types import Float32Array, LaserGeometry, Pose2D
from slamgym.interop.records import LogRecord

COMPRESSION = 4
"""Level of zlib for written logs: 8 % more bytes than at level 6 in a quarter of the time."""


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
