"""What of a bag is read: which topics hold the scans and the odometry, and what their messages say."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from slamgym.core.errors import InputFileError
from slamgym.core.types import Pose2D
from slamgym.interop.records import BrokenMessageError, LogFinding, LogWarnings
from slamgym.interop.ros_messages import check_scan, matrix_of, pose_of, stamp_of
from slamgym.interop.transforms import TransformTree, clean_frame

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
USUAL_SCAN_TOPICS = ("/scan", "/base_scan", "/front/scan", "/laser_scan")
USUAL_ODOMETRY_TOPICS = ("/odom", "/odometry", "/wheel/odometry")

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
"""Endings of the files in which bags are stored."""
NO_ODOMETRY = "none"
"""Given as the odometry's topic: only the scans are read."""


class BagChoices(NamedTuple):
    """Parts of a bag that are read; None leaves the choice to the reader."""

    scan_topic: str | None = None
    odometry_topic: str | None = None
    odometry_frame: str | None = None
    range_max: float | None = None  # [m]
    time_offset: float = 0.0  # by which the odometry's stamps are late [s]
    scan_time: float | None = None  # from the first beam of a scan to the last [s]
    scan_rate: float | None = None  # of the scans, in place of their stamps [Hz]


@dataclass
class BagContents:
    """The messages of a bag that matter."""

    path: Path
    choices: BagChoices
    scans: list[tuple[float, Any]] = field(default_factory=list)
    odometry: list[tuple[float, Pose2D]] = field(default_factory=list)
    base_frame: str = ""
    transforms: TransformTree = field(default_factory=TransformTree)
    is_scan: list[bool] = field(default_factory=list)  # of the scans and odometry, in file order
    sources: dict[str, str] = field(default_factory=dict)
    findings: list[LogFinding] = field(default_factory=list)
    warnings: LogWarnings = field(default_factory=LogWarnings)

    @property
    def laser_frame(self) -> str:
        """Frame of the scans."""
        return clean_frame(self.scans[0][1].header.frame_id)

    def find(self, kind: str, sentence: str) -> None:
        """Add a finding."""
        self.findings.append(LogFinding(kind, sentence))


def choose_topics(contents: BagContents, reader: Any) -> set[str]:
    """The topics of the scans and of the odometry, if there is one to read; what is left out becomes a finding."""
    kinds: dict[str, Counter[str]] = {SCAN_TYPE: Counter(), ODOMETRY_TYPE: Counter()}
    for connection in reader.connections:
        if connection.msgtype in kinds and connection.msgcount:
            kinds[connection.msgtype][connection.topic] += connection.msgcount
    choices = contents.choices
    scans = kinds[SCAN_TYPE]
    scan = _choose_topic(contents.path, scans, choices.scan_topic, USUAL_SCAN_TOPICS)
    if scan is None:
        topics = ", ".join(sorted(reader.topics)) or "none"
        raise InputFileError(contents.path, f"holds no LaserScan message (topics: {topics})")
    contents.sources["scan topic"] = scan
    if len(scans) > 1 and choices.scan_topic is None:
        others = ", ".join(sorted(scans.keys() - {scan}))
        contents.find(
            "lasers", f"of several lasers {scan} is used, not {others} (--scan-topic chooses)"
        )
    if choices.odometry_topic == NO_ODOMETRY or choices.odometry_frame is not None:
        return {scan}
    usual = (f"{scan.rpartition('/')[0]}/odom", *USUAL_ODOMETRY_TOPICS)
    odometry = _choose_topic(contents.path, kinds[ODOMETRY_TYPE], choices.odometry_topic, usual)
    if odometry is None:
        return {scan}
    contents.sources["odometry from"] = odometry
    return {scan, odometry}


def _choose_topic(
    path: Path, topics: Counter[str], wanted: str | None, usual: tuple[str, ...]
) -> str | None:
    """The wanted topic, else a usual one, else that with most messages."""
    if wanted is not None and wanted not in topics:
        known = ", ".join(sorted(topics)) or "none"
        raise InputFileError(
            path, f"holds no such message on the topic {wanted!r} (such topics: {known})"
        )
    if wanted is not None:
        return wanted
    for name in usual:
        if name in topics:
            return name
    return max(topics, key=lambda topic: (topics[topic], topic), default=None)


def take_message(contents: BagContents, connection: Any, message: Any, stamp_ns: int) -> None:
    """Add a message to the contents of a bag.

    Raises:
        BrokenMessageError: If it can't be used.
    """
    topic = connection.topic
    recorded = stamp_ns * 1e-9
    if connection.msgtype == SCAN_TYPE:
        check_scan(message)
        contents.scans.append((stamp_of(message.header, recorded), message))
        contents.is_scan.append(True)
    elif connection.msgtype == ODOMETRY_TYPE:
        place = pose_of(message.pose.pose, f"pose on {topic}")
        contents.odometry.append((stamp_of(message.header, recorded), place))
        contents.is_scan.append(False)
        contents.base_frame = contents.base_frame or clean_frame(message.child_frame_id)
    else:
        is_static = topic.endswith("tf_static")
        for entry in message.transforms:
            parent = entry.header.frame_id
            child = entry.child_frame_id
            stamp = stamp_of(entry.header, recorded)
            transform = entry.transform
            try:
                matrix = matrix_of(
                    transform.translation, transform.rotation, f"transform from {parent} to {child}"
                )
            except BrokenMessageError as error:
                contents.warnings.add(str(error), f"{stamp:.3f} s")
                continue
            contents.transforms.add(parent, child, stamp, matrix, static=is_static)
