"""Contents of a recorded log, independent of its file format."""

import bisect
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LaserGeometry,
    LaserScan,
    Pose2D,
    Trajectory,
)

MAX_ABS_COORDINATE = 1e6
"""A pose or a range further away is a broken number [m]."""
MAX_STAMP = 1e12
"""A stamp beyond this is a broken number [s]; today's are below 2e9."""


class BrokenMessageError(ValueError):
    """A message that can't be used; the text says what kind of fault it has."""


def possible_angles(start: float, step: float) -> bool:
    """Whether beams of a laser begin within a turn, and lie between 1e-6 and 1 rad apart; False for nan."""
    return abs(start) <= 7.0 and 1e-6 <= abs(step) <= 1.0


def possible_count(count: float) -> bool:
    """Whether a laser can have so many beams; False for nan."""
    return 1 <= count <= 100_000


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
        kinds = sorted(self.counts.items())
        return [f"{count} x {kind} (first: {self.first[kind]})" for kind, count in kinds]


class LogFinding(NamedTuple):
    """A fault of a log that bears on its map, and what was done about it."""

    kind: str
    """One or two words, for scripts."""
    sentence: str
    """For the user: what is wrong, mostly a colon, what was done about it, and the option that changes it."""

    @property
    def fault(self) -> str:
        """What is wrong, without what was done about it."""
        return self.sentence.partition(": ")[0]

    def __str__(self) -> str:
        return f"{self.kind}: {self.sentence}"


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
    findings: Sequence[LogFinding] = ()
    """Faults of the log as a whole, in the order in which they were found."""
    has_odometry: bool = True
    """False where there is none, or one that lies throughout: all odometry poses are the same then, and only the scans
    tell how the robot moved."""
    distrusted: Sequence[tuple[float, float]] = ()
    """Stretches of time [s] over which the scans contradict the odometry; in order, apart from each other."""
    doubted: Sequence[tuple[float, float]] = ()
    """Stretches of time [s] over which the scans are wrong or missing: a path through them is in doubt."""
    since: float | None = None
    """When the recording began, which findings count from [s], where that isn't the first scan."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Topics and frames that a bag was read from, by their role."""

    @property
    def track(self) -> OdometryTrack:
        """The odometry, at the scans alone where the log holds no other."""
        if self.recorded_track is not None:
            return self.recorded_track
        stamps = np.array([record.stamp for record in self.records], dtype=np.float64)
        poses = np.array([record.odometry for record in self.records], dtype=np.float64)
        return OdometryTrack(stamps, poses.reshape(-1, 3), np.arange(len(stamps)))

    def noting(self, kind: str, sentence: str) -> "Log":
        """The log with another finding."""
        finding = LogFinding(kind, sentence)
        return replace(self, findings=(*self.findings, finding))

    def within(self, spans: Sequence[tuple[float, float]]) -> BoolArray:
        """Which of the scans (N,) were taken in stretches of time [s]."""
        stamps = np.array([record.stamp for record in self.records])
        inside = np.zeros(len(stamps), dtype=np.bool_)
        for begin, end in spans:
            inside |= (stamps >= begin) & (stamps <= end)
        return inside

    def __iter__(self) -> Iterator[LogRecord]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    @property
    def start(self) -> float:
        """When the recording began [s]."""
        return self.records[0].stamp if self.since is None else self.since

    @property
    def duration(self) -> float:
        """Time between the first and the last scan [s]."""
        if not self.records:
            return 0.0
        return self.records[-1].stamp - self.records[0].stamp


def usable_scans(
    stamps: Sequence[float], places: Sequence[str], warnings: LogWarnings
) -> list[int]:
    """Indices of the scans whose time runs forwards.

    Args:
        stamps: In the order of the file [s].
        places: Where each scan stands in the file.
        warnings: Collects what is left out.
    """
    ordered = longest_ordered(stamps)
    for index in sorted(set(range(len(stamps))) - set(ordered)):
        warnings.add("scan left out because time goes backwards", places[index])
    return ordered


def interpolated(track: Trajectory, stamps: FloatArray) -> FloatArray:
    """Poses of a track at other moments, shape (N, 3): linear, along the shorter arc; beyond its ends they stay."""
    x = np.interp(stamps, track.stamps, track.poses[:, 0])
    y = np.interp(stamps, track.stamps, track.poses[:, 1])
    headings = np.unwrap(track.poses[:, 2])
    theta = np.interp(stamps, track.stamps, headings)
    return np.column_stack([x, y, wrap_angle(theta)])


class _Chain(NamedTuple):
    place: int
    before: "_Chain | None"


def longest_ordered(stamps: Sequence[float]) -> list[int]:
    """Indices of a longest subsequence of ``stamps`` that doesn't decrease.

    Dropping the rest makes the time of a log run forwards with the fewest losses, wherever the faulty stamps
    lie: one that is far ahead costs one message, not all that follow it. (Fredman 1975: patience sorting.)
    """
    tails: list[float] = []  # the smallest last stamp of a subsequence of each length
    chains: list[_Chain] = []  # its indices, the last one first
    for index, stamp in enumerate(stamps):
        length = bisect.bisect_right(tails, stamp)
        before = chains[length - 1] if length else None
        chains[length : length + 1] = [_Chain(index, before)]
        tails[length : length + 1] = [stamp]
    ordered: list[int] = []
    chain = chains[-1] if chains else None
    while chain is not None:
        ordered.append(chain.place)
        chain = chain.before
    return ordered[::-1]
