"""ROS bags (rosbag1; rosbag2 in sqlite3 and MCAP) as logs, through the ``rosbags`` library.

A scan is taken from ``sensor_msgs/LaserScan``; the odometry at its moment is interpolated from
``nav_msgs/Odometry`` or, without such a topic, from the transform of the robot's base in the odometry frame.
The laser's mount is the transform from the base to the scan's frame.
"""

import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.limits import SCANS
from slamgym.core.types import Float32Array, FloatArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop.records import (
    MAX_ABS_COORDINATE,
    MAX_ANGLE,
    MAX_ANGLE_STEP,
    MAX_BEAMS,
    Log,
    LogRecord,
    LogWarnings,
    longest_ordered,
    without_jumps,
)
from slamgym.interop.transform_tree import TransformTree, clean_frame, planar, rigid_transform

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
USUAL_SCAN_TOPICS = ("/scan", "/base_scan", "/front/scan", "/laser_scan")
USUAL_ODOMETRY_TOPICS = ("/odom", "/odometry", "/wheel/odometry")

ODOMETRY_GAP = 0.5
"""A scan further from the nearest odometry message than this is left out [s]."""

FINEST_ANGLE_STEP = 1e-6
"""Beams closer together than this are a broken number [rad]."""


@dataclass
class _Contents:
    """The messages of a bag that matter."""

    scans: list[tuple[float, Any]] = field(default_factory=list)
    odometry: list[tuple[float, Pose2D]] = field(default_factory=list)
    base_frame: str = ""
    transforms: TransformTree = field(default_factory=TransformTree)


class _ImpossibleScanError(ValueError):
    """A scan that can be decoded but not used; the text says why."""


def import_rosbags() -> Any:
    """The ``rosbags`` package.

    Raises:
        ConfigError: If it isn't installed.
    """
    try:
        import rosbags.highlevel
        import rosbags.rosbag2
        import rosbags.typesys
    except ImportError as error:
        raise ConfigError(
            "ROS bags need the package 'rosbags'; install it with: pip install 'slamgym[ros]'"
        ) from error
    return rosbags


def read_rosbag(
    path: Path | str,
    *,
    scan_topic: str | None = None,
    odometry_topic: str | None = None,
    odometry_frame: str = "odom",
) -> Log:
    """Read the scans and the odometry of a bag.

    Args:
        path: A ``.bag`` file, a rosbag2 folder, or a single ``.mcap`` or ``.db3`` file.
        scan_topic: The LaserScan topic; by default ``/scan`` or a usual name, else the one with most
            messages.
        odometry_topic: The Odometry topic; by default ``/odom`` or a usual name, else the one with most
            messages, else tf.
        odometry_frame: With tf alone: the frame in which the robot's base moves smoothly.

    Raises:
        InputFileError: If the bag can't be read, or lacks scans or odometry, or the topic named.
        ConfigError: If ``rosbags`` isn't installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(path, "doesn't exist")
    warnings = LogWarnings()
    contents = _read_contents(path, scan_topic, odometry_topic, warnings)
    odometry, base_frame = _odometry(path, contents, odometry_frame)
    mount, flipped = _mount(path, contents, base_frame, warnings)
    geometry = _geometry(contents, mount, flipped)
    kept = set(longest_ordered([stamp for stamp, _ in contents.scans]))
    records: list[LogRecord] = []
    for index, (stamp, message) in enumerate(contents.scans):
        where = f"{path} scan {index + 1}"
        gap = float(np.min(np.abs(odometry.stamps - stamp)))
        if index not in kept:
            warnings.add("scan left out because time goes backwards", where)
        elif gap > ODOMETRY_GAP:
            warnings.add("scan left out because no odometry is near in time", where)
        else:
            scan = LaserScan(stamp, _ranges(message, geometry, flipped), geometry)
            records.append(LogRecord(stamp, _interpolate(odometry, stamp), scan))
    if not records:
        faults = "; ".join(warnings.sentences()[:3])
        raise InputFileError(path, f"holds no usable scan: {faults}")
    places = [f"{path} at {record.stamp:.3f} s" for record in records]
    near = without_jumps([record.odometry for record in records], places, warnings)
    return Log(str(path), [records[index] for index in near], geometry, warnings)


def _read_contents(
    path: Path, scan_topic: str | None, odometry_topic: str | None, warnings: LogWarnings
) -> _Contents:
    rosbags = import_rosbags()
    contents = _Contents()
    try:
        # ROS 2 bags before Iron carry no message definitions; those of Humble serve all that is read here.
        typestore = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        with rosbags.highlevel.AnyReader([_bag_path(path)], default_typestore=typestore) as reader:
            counts = Counter[tuple[str, str]]()
            for connection in reader.connections:
                counts[connection.msgtype, connection.topic] += connection.msgcount
            scan = _choose_topic(path, counts, SCAN_TYPE, scan_topic, USUAL_SCAN_TOPICS)
            odometry = _choose_topic(path, counts, ODOMETRY_TYPE, odometry_topic, USUAL_ODOMETRY_TOPICS)
            if scan is None:
                topics = ", ".join(sorted({topic for _, topic in counts})) or "none"
                raise InputFileError(path, f"holds no LaserScan message (topics: {topics})")
            wanted = [
                connection
                for connection in reader.connections
                if connection.topic in (scan, odometry) or connection.msgtype in TRANSFORM_TYPES
            ]
            for connection, stamp_ns, raw in reader.messages(connections=wanted):
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                    _take(contents, connection, message, stamp_ns)
                except InputFileError:
                    raise
                except _ImpossibleScanError as error:
                    warnings.add(str(error), f"{path} at {stamp_ns} ns")
                except Exception:  # noqa: BLE001 - a damaged message makes the decoder stumble anywhere
                    warnings.add(
                        f"message on {connection.topic} that can't be decoded", f"{path} at {stamp_ns} ns"
                    )
    except InputFileError:
        raise
    except Exception as error:  # the library raises whatever a damaged file makes it stumble on
        if not contents.scans:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputFileError(path, f"is not a readable ROS bag ({reason[:200]})") from error
        warnings.add("damage in the bag, the rest of which is lost", path)
    if not contents.scans:
        faults = "; ".join(warnings.sentences()[:3])
        raise InputFileError(path, f"holds no usable scan: {faults}")
    return contents


def _bag_path(path: Path) -> Path:
    """The path as the library wants it: a folder without metadata stands for the one storage file in it."""
    if path.is_dir() and not (path / "metadata.yaml").exists():
        storage = sorted([*path.glob("*.mcap"), *path.glob("*.db3"), *path.glob("*.bag")])
        if not storage:
            raise InputFileError(path, "is a folder without a ROS bag (metadata.yaml, .mcap, .db3 or .bag)")
        if len(storage) > 1:
            raise InputFileError(path, "holds several bag files but no metadata.yaml; name one of the files")
        return storage[0]
    return path


def _choose_topic(
    path: Path, counts: Counter[tuple[str, str]], kind: str, wanted: str | None, usual: tuple[str, ...]
) -> str | None:
    topics = {topic: count for (msgtype, topic), count in counts.items() if msgtype == kind and count > 0}
    if wanted is not None:
        if wanted not in topics:
            known = ", ".join(sorted(topics)) or "none"
            raise InputFileError(path, f"holds no {kind} on the topic {wanted!r} (such topics: {known})")
        return wanted
    for name in usual:
        if name in topics:
            return name
    return max(topics, key=lambda topic: (topics[topic], topic), default=None)


def _take(contents: _Contents, connection: Any, message: Any, stamp_ns: int) -> None:
    if connection.msgtype == SCAN_TYPE:
        _check_scan(message)
        contents.scans.append((_stamp(message.header, stamp_ns), message))
        SCANS.check(connection.topic, len(contents.scans))
    elif connection.msgtype == ODOMETRY_TYPE:
        pose = message.pose.pose
        contents.odometry.append(
            (_stamp(message.header, stamp_ns), planar(_matrix(pose.position, pose.orientation)))
        )
        contents.base_frame = contents.base_frame or clean_frame(message.child_frame_id)
    elif connection.msgtype in TRANSFORM_TYPES:
        static = connection.topic.endswith("tf_static")
        for entry in message.transforms:
            transform = entry.transform
            contents.transforms.add(
                entry.header.frame_id,
                entry.child_frame_id,
                _stamp(entry.header, stamp_ns),
                _matrix(transform.translation, transform.rotation),
                static=static,
            )


def _check_scan(message: Any) -> None:
    """Refuse a scan whose numbers can't be those of a laser; ROS itself checks none of them."""
    angle_min, step = float(message.angle_min), float(message.angle_increment)
    range_min, range_max = float(message.range_min), float(message.range_max)
    # A comparison with nan is False.
    if not (abs(angle_min) <= MAX_ANGLE and FINEST_ANGLE_STEP <= abs(step) <= MAX_ANGLE_STEP):
        raise _ImpossibleScanError("scan left out because of impossible beam angles")
    if not (abs(range_min) <= MAX_ABS_COORDINATE and abs(range_max) <= MAX_ABS_COORDINATE):
        raise _ImpossibleScanError("scan left out because of impossible range limits")
    if not 1 <= len(message.ranges) <= MAX_BEAMS:
        raise _ImpossibleScanError("scan left out because of an impossible number of readings")


def _stamp(header: Any, stamp_ns: int) -> float:
    """The header's stamp, or the moment of recording where the driver left it at zero [s]."""
    stamp = header.stamp.sec + header.stamp.nanosec * 1e-9
    return float(stamp) if stamp > 0.0 else stamp_ns * 1e-9


def _matrix(position: Any, orientation: Any) -> FloatArray:
    return rigid_transform(
        np.array([position.x, position.y, position.z], dtype=np.float64),
        np.array([orientation.x, orientation.y, orientation.z, orientation.w], dtype=np.float64),
    )


def _odometry(path: Path, contents: _Contents, odometry_frame: str) -> tuple[Trajectory, str]:
    """The base's motion in the odometry frame, and the name of the base's frame."""
    if contents.odometry:
        ordered = longest_ordered([stamp for stamp, _ in contents.odometry])
        stamps = np.array([contents.odometry[index][0] for index in ordered])
        poses = np.array([contents.odometry[index][1] for index in ordered])
        return Trajectory(stamps, poses), contents.base_frame
    base = contents.transforms.moving_child(odometry_frame)
    if base is None:
        moving = ", ".join(contents.transforms.moving_parents()) or "none"
        raise InputFileError(
            path,
            f"holds neither Odometry messages nor a frame that moves in {odometry_frame!r} (frames with "
            f"moving children: {moving})",
        )
    return contents.transforms.motion(base), base


def _mount(path: Path, contents: _Contents, base_frame: str, warnings: LogWarnings) -> tuple[Pose2D, bool]:
    """The laser in the base's frame, and whether it hangs upside down."""
    laser_frame = clean_frame(contents.scans[0][1].header.frame_id)
    if laser_frame == base_frame:
        return Pose2D(0.0, 0.0, 0.0), False
    base_frame = base_frame or "base_link"
    matrix = contents.transforms.lookup(laser_frame, base_frame)
    if matrix is None:
        warnings.add(
            f"missing transform from {base_frame!r} to {laser_frame!r}; the mount is taken as 0", path
        )
        return Pose2D(0.0, 0.0, 0.0), False
    return planar(matrix), bool(matrix[2, 2] < 0.0)


def _geometry(contents: _Contents, mount: Pose2D, flipped: bool) -> LaserGeometry:
    """The geometry of the most frequent kind of scan."""
    usual = Counter(_kind(message) for _, message in contents.scans).most_common(1)[0][0]
    message = next(message for _, message in contents.scans if _kind(message) == usual)
    num_beams = len(message.ranges)
    angle_min, increment = float(message.angle_min), float(message.angle_increment)
    range_min, range_max = float(message.range_min), float(message.range_max)
    if flipped:
        angle_min, increment = -angle_min, -increment
    if increment < 0.0:  # stored clockwise: counted from the other end
        angle_min, increment = angle_min + (num_beams - 1) * increment, -increment
    return LaserGeometry(num_beams, angle_min, increment, max(range_min, 0.0), range_max, mount)


def _kind(message: Any) -> tuple[int, float, float, float, float]:
    """What must agree between scans; the angles are float32 in the message."""
    return (
        len(message.ranges),
        round(float(message.angle_min), 5),
        round(float(message.angle_increment), 7),
        round(float(message.range_min), 5),
        round(float(message.range_max), 5),
    )


def _ranges(message: Any, geometry: LaserGeometry, flipped: bool) -> Float32Array:
    """Ranges on the log's geometry; a scan with other angles (rotating scanners vary) is resampled."""
    ranges = np.array(message.ranges, dtype=np.float32)
    angle_min, increment = float(message.angle_min), float(message.angle_increment)
    if flipped:
        angle_min, increment = -angle_min, -increment
    if increment < 0.0:
        ranges = ranges[::-1]
        angle_min, increment = angle_min + (len(ranges) - 1) * increment, -increment
    same_angles = (
        abs(angle_min - geometry.angle_min) + abs(increment - geometry.angle_increment) * len(ranges) < 0.005
    )
    if len(ranges) != geometry.num_beams or not same_angles:
        beam = np.rint((geometry.angles - angle_min) / increment).astype(np.int64)
        inside = (beam >= 0) & (beam < len(ranges))
        ranges = np.where(inside, ranges[np.clip(beam, 0, len(ranges) - 1)], np.float32(np.nan))
    ranges = np.ascontiguousarray(ranges, dtype=np.float32)
    if np.isneginf(ranges).any() or (ranges < 0.0).any():
        ranges[ranges < 0.0] = np.nan
    ranges[ranges >= geometry.range_max] = np.inf
    # Some drivers report 0 for "nothing came back" and for errors alike: neither space nor wall is known.
    ranges[ranges < max(geometry.range_min, 1e-6)] = np.nan
    return ranges


def _interpolate(odometry: Trajectory, stamp: float) -> Pose2D:
    """Pose at a moment, linear between its neighbours, along the shorter arc."""
    after = int(np.searchsorted(odometry.stamps, stamp))
    if after == 0 or after == len(odometry.stamps):
        return Pose2D(*(float(value) for value in odometry.poses[min(after, len(odometry.stamps) - 1)]))
    t0, t1 = odometry.stamps[after - 1], odometry.stamps[after]
    a, b = odometry.poses[after - 1], odometry.poses[after]
    share = float((stamp - t0) / (t1 - t0)) if t1 > t0 else 0.0
    turn = math.remainder(float(b[2] - a[2]), 2.0 * math.pi)
    x, y = a[:2] + share * (b[:2] - a[:2])
    return Pose2D(float(x), float(y), math.remainder(float(a[2]) + share * turn, 2.0 * math.pi))
