"""Contents of a recorded log, independent of its file format."""

import bisect
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import wrap_angle
from slamgym.core.limits import JUMP
from slamgym.core.types import FloatArray, IntArray, LaserGeometry, LaserScan, Pose2D, Trajectory

MAX_BEAMS = 100_000
MAX_ABS_COORDINATE = 1e6
"""A pose or a range further away is a broken number [m]."""
MAX_ANGLE = 7.0
"""A beam that starts beyond this is a broken number [rad]; a full turn is 6.28."""
MAX_ANGLE_STEP = 1.0
"""Beams further apart than this are a broken number [rad]."""
MAX_STAMP = 1e12
"""A stamp beyond this is a broken number [s]; today's are below 2e9."""


class LogRecord(NamedTuple):
    """A scan and the odometry pose of the robot at the same moment."""

    stamp: float  # [s]
    odometry: Pose2D  # the robot's base in the odometry frame
    scan: LaserScan


@dataclass
class LogWarnings:
    """Faults of a log that were tolerated: how often each kind was met, and where first."""

    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)

    def add(self, kind: str, where: object) -> None:
        """Count one fault; ``where`` is ``file:line`` or the place in a bag."""
        self.counts[kind] += 1
        self.first.setdefault(kind, str(where))

    def sentences(self) -> list[str]:
        """One line per kind of fault, for the user."""
        return [
            f"{count} x {kind} (first: {self.first[kind]})" for kind, count in sorted(self.counts.items())
        ]


class OdometryTrack(NamedTuple):
    """All that a log holds of the odometry, at the scans and between them, in the order of the file.

    Stamps may step back where messages come in bursts; the order of the file is that of the driving.
    """

    stamps: FloatArray  # (N,) [s]
    poses: FloatArray  # (N, 3), the robot's base in the odometry frame
    scans: IntArray  # (S,), where in the track each of the log's scans stands; ascending


@dataclass(frozen=True)
class Log:
    """A recorded run: its scans in the order of time, and what was wrong with the file.

    All scans share one geometry.
    """

    source: str
    """The file or folder it was read from."""
    records: Sequence[LogRecord]
    geometry: LaserGeometry
    warnings: LogWarnings = field(default_factory=LogWarnings)
    """Errors in the file; the faulty messages were left out."""
    recorded_track: OdometryTrack | None = None
    """Separate odometry between the scans, if the log has it."""

    @property
    def track(self) -> OdometryTrack:
        """The odometry, at the scans alone where the log holds no other."""
        if self.recorded_track is not None:
            return self.recorded_track
        stamps = np.array([record.stamp for record in self.records], dtype=np.float64)
        poses = np.array([record.odometry for record in self.records], dtype=np.float64).reshape(-1, 3)
        return OdometryTrack(stamps, poses, np.arange(len(stamps)))

    def __iter__(self) -> Iterator[LogRecord]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    @property
    def duration(self) -> float:
        """Time between the first and the last scan [s]."""
        return self.records[-1].stamp - self.records[0].stamp if self.records else 0.0


def usable_scans(
    stamps: Sequence[float], poses: Sequence[Pose2D], places: Sequence[str], warnings: LogWarnings
) -> list[int]:
    """Indices of the scans whose time runs forwards and whose odometry follows from the one before.

    A single scan far away from those around it has a broken pose and is left out. Where the odometry stays away
    (the robot was carried, its odometry reset, or two logs were joined), no map can come of both parts.

    Args:
        stamps: In the order of the file [s].
        poses: Odometry.
        places: Where each scan stands in the file.
        warnings: Collects what is left out.

    Raises:
        InputFileError: If the odometry jumps and stays away; it names the place.
    """
    ordered = longest_ordered(stamps)
    for index in sorted({*range(len(stamps))} - {*ordered}):
        warnings.add("scan left out because time goes backwards", places[index])
    kept: list[int] = []
    for index, after in itertools.zip_longest(ordered, ordered[1:]):
        if not kept or _distance(poses[kept[-1]], poses[index]) <= JUMP.value:
            kept.append(index)
        elif after is not None and _distance(poses[kept[-1]], poses[after]) > JUMP.value:
            away = _distance(poses[kept[-1]], poses[index])
            raise InputFileError(
                places[index],
                f"the odometry jumps {away:,.0f} m from the scan before; cut the log there and replay the parts one "
                f"by one (or raise {JUMP.variable}, now {JUMP.value} m)",
            )
        else:
            warnings.add("scan left out because its odometry is far from its neighbours'", places[index])
    return kept


def _distance(a: Pose2D, b: Pose2D) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def interpolated(track: Trajectory, stamps: FloatArray) -> FloatArray:
    """Poses of a track at other moments, shape (N, 3): linear, along the shorter arc; beyond its ends they stay."""
    columns = [*track.poses[:, :2].T, np.unwrap(track.poses[:, 2])]
    poses = np.column_stack([np.interp(stamps, track.stamps, column) for column in columns])
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def longest_ordered(stamps: Sequence[float]) -> list[int]:
    """Indices of a longest subsequence of ``stamps`` that doesn't decrease.

    Dropping the rest makes the time of a log run forwards with the fewest losses, wherever the faulty stamps
    lie: one that is far ahead costs one message, not all that follow it. (Fredman 1975: patience sorting.)
    """
    tails: list[float] = []  # the smallest last stamp of a subsequence of each length
    tail_index: list[int] = []
    previous: list[int] = []
    for index, stamp in enumerate(stamps):
        length = bisect.bisect_right(tails, stamp)
        previous.append(tail_index[length - 1] if length else -1)
        if length == len(tails):
            tails.append(stamp)
            tail_index.append(index)
        else:
            tails[length] = stamp
            tail_index[length] = index
    ordered: list[int] = []
    index = tail_index[-1] if tail_index else -1
    while index >= 0:
        ordered.append(index)
        index = previous[index]
    return ordered[::-1]
