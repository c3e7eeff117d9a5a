"""Options of the commands that read a recorded log, and the findings about it that they show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, Positive, Within
from slamgym.core.progress import say

if TYPE_CHECKING:
    from slamgym.interop.records import Log


class LogAndOut(Arguments):
    """The log of a command that writes results."""

    log: tyro.conf.Positional[Path]
    """CARMEN log (.log, .clf, also .gz), ROS bag (.bag, .mcap, .db3 or a rosbag2 folder), or the folder of an
    episode that `slamgym generate` wrote."""

    out: Out
    """Where the results go."""


class LogReading(Arguments):
    """How a log is read."""

    scan_topic: str | None = None
    """ROS bags: the LaserScan topic. By default /scan or the one with most messages."""

    odometry_topic: str | None = None
    """ROS bags: the Odometry topic. By default /odom or the one with most messages, else tf. Of any log: `none` reads
    the laser alone."""

    odometry_frame: str | None = None
    """ROS bags: take the odometry from tf, in this frame. By default odom, or the only one that the laser moves in."""

    range_max: Positive | None = None
    """Readings from here on mean no return [m]. By default the log's, if its readings agree."""

    time_offset: Literal["auto"] | Annotated[float, Within(ge=-1e10, le=1e10)] = "auto"
    """How late the odometry's stamps are against the scans' [s]; below 0 they are early. By default it is estimated."""

    scan_time: Annotated[float, Within(ge=0.0, le=10.0)] | None = None
    """Time from the first beam of a scan to the last [s]; 0: they are made at once. By default the log's; where it has
    none, it is estimated."""

    scan_rate: Annotated[float, Within(gt=0.0, le=1e4)] | None = None
    """Scans come so often, in the order of the file [Hz]: for logs whose clock stands still or is wrong."""


def read_log(path: Path, reading: LogReading) -> Log:
    """A recorded log as it stands; faults of the file are said.

    Raises:
        InputFileError: If it can't be read.
    """
    from slamgym.interop.bag_topics import BagChoices
    from slamgym.interop.logs import open_log

    choices = BagChoices(
        scan_topic=reading.scan_topic,
        odometry_topic=reading.odometry_topic,
        odometry_frame=reading.odometry_frame,
        range_max=reading.range_max,
        time_offset=0.0 if isinstance(reading.time_offset, str) else reading.time_offset,
        scan_time=reading.scan_time,
        scan_rate=reading.scan_rate,
    )
    log = open_log(path, choices)
    for sentence in log.warnings.sentences():
        say(f"slamgym: warning: {sentence}")
    return log


def checked_log(path: Path, reading: LogReading, is_said: bool = True) -> Log:
    """The same with its odometry checked against its scans; the findings are said.

    Raises:
        InputFileError: If it can't be read.
    """
    from slamgym.slam.odometry_check import check_odometry

    log = check_odometry(
        read_log(path, reading),
        estimate_offset=reading.time_offset == "auto",
        estimate_scan_time=reading.scan_time is None,
    )
    for finding in log.findings if is_said else ():
        say(f"slamgym: {finding}")
    return log


def faults_of(log: Log) -> dict[str, Any]:
    """What the summary says of a log's faults."""
    return {
        "warnings": dict(sorted(log.warnings.counts.items())),
        "findings": [finding._asdict() for finding in log.findings],
        "has_odometry": log.has_odometry,
        "distrusted_seconds": [list(stretch) for stretch in log.distrusted],
    }
