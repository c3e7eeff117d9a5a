"""ROS bags (rosbag1; rosbag2 in sqlite3 and MCAP) as logs, through the ``rosbags`` library.

A scan is taken from ``sensor_msgs/LaserScan``; the odometry at its moment is interpolated from
``nav_msgs/Odometry`` or, without such a topic, from the transform of the robot's base in the odometry frame; without
either the log has its scans alone. The laser's mount is the transform from the base to the scan's frame.
"""

import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.errors import InputFileError, needing_extra
from slamgym.core.limits import SCANS
from slamgym.core.parallel.budget import read_apart
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop.bag_expansion import Expansion
from slamgym.interop.bag_remains import whole_part
from slamgym.interop.bag_repair import bag_fault
from slamgym.interop.bag_topics import (
    BAG_SUFFIXES,
    NO_ODOMETRY,
    BagChoices,
    BagContents,
    choose_topics,
    take_message,
)
from slamgym.interop.odometry import merged_track, without_jumps
from slamgym.interop.ranges import range_limit
from slamgym.interop.records import (
    BrokenMessageError,
    Log,
    LogRecord,
    OdometryTrack,
    longest_ordered,
    usable_scans,
)
from slamgym.interop.ros_messages import geometry_of, ranges_of
from slamgym.interop.scan_times import StampedMessages, by_rate, seconds_apart, with_told_scan_time
from slamgym.interop.transforms import clean_frame, planar

TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

ODOMETRY_GAP = 0.5
"""A scan further from the nearest odometry message than this is left out [s]."""


def import_rosbags() -> Any:
    """The ``rosbags`` package.

    Raises:
        ConfigError: If it isn't installed.
    """
    with needing_extra("reading and writing ROS bags", "ros"):
        import rosbags.highlevel
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    return rosbags


def read_rosbag(path: Path | str, choices: BagChoices = BagChoices()) -> Log:  # noqa: B008 - it can't change
    """Read the scans and the odometry of a bag.

    Args:
        path: A ``.bag`` file, a rosbag2 folder, or a single ``.mcap`` or ``.db3`` file.
        choices: What to read. By default the scan topic is ``/scan`` or a usual name, else the one with most
            messages; the odometry topic likewise, in the scan topic's namespace; without odometry messages the motion
            in the frame ``odom`` is taken, or in the only other one that the laser moves in.

    Raises:
        InputFileError: If the bag can't be read, lacks scans or what ``choices`` names, leaves the choice of the
            odometry frame open, or takes the library more time or memory than it may.
        ConfigError: If ``rosbags`` isn't installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(path, "doesn't exist")
    return read_apart(_read, (path, choices), path)


def _read(bag: tuple[Path, BagChoices]) -> Log:
    path, choices = bag
    contents = _read_contents(path, choices)
    own = StampedMessages(contents.scans, contents.odometry)
    timed = by_rate(own, contents.is_scan, choices.scan_rate)
    contents.scans, contents.odometry, clock = timed
    contents.findings += clock
    odometry, base_frame = _odometry(contents)
    mount, flipped = _mount(contents, base_frame)
    geometry = _geometry(contents, mount, flipped)
    stamps = np.array([stamp for stamp, _ in contents.scans])
    places = [f"{path} at {stamp:.3f} s" for stamp in stamps.tolist()]
    kept = np.array(usable_scans(stamps.tolist(), places, contents.warnings))
    if odometry is not None:
        far = seconds_apart(odometry.stamps, stamps[kept]) > ODOMETRY_GAP
        if far.mean() > 0.5:
            late = odometry.stamps[0] - stamps[0]
            contents.find(
                "odometry",
                f"the clocks of odometry and scans differ by {late:.1f} s or so: the laser alone is used "
                f"(--time-offset {late:.1f} sets the odometry back)",
            )
            odometry = None
        else:
            for index in kept[far].tolist():
                contents.warnings.add(
                    "scan left out because no odometry is near in time", places[index]
                )
            kept = kept[~far]
    if odometry is not None:
        track = merged_track(odometry, stamps[kept])
    else:
        track = OdometryTrack(stamps[kept], np.zeros((len(kept), 3)), np.arange(len(kept)))
    records = []
    for index, pose in zip(kept.tolist(), track.poses[track.scans].tolist(), strict=True):
        stamp, message = contents.scans[index]
        scan = LaserScan(stamp, ranges_of(message, geometry, flipped), geometry)
        records.append(LogRecord(stamp, Pose2D(*pose), scan))
    log = Log(
        source=str(path),
        records=records,
        geometry=geometry,
        warnings=contents.warnings,
        recorded_track=track,
        findings=contents.findings,
        has_odometry=odometry is not None,
        sources=contents.sources,
    )
    return with_told_scan_time(log, [float(scan.time_increment) for _, scan in contents.scans])


def _read_contents(path: Path, choices: BagChoices) -> BagContents:
    """Read a bag; of one that was cut off, what is whole."""
    rosbags = import_rosbags()
    contents = BagContents(path, choices)
    try:
        _read_bag(contents, _bag_path(path), Expansion(path, rosbags))
    except (InputFileError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - on a damaged file the library may raise any
        if contents.scans:
            contents.warnings.add("damage in the bag, the rest of which is lost", path)
        else:
            contents = _read_remains(path, choices, error)
    if not contents.scans:
        faults = "; ".join(contents.warnings.sentences()[:3])
        raise InputFileError(path, f"holds no usable scan: {faults}")
    return contents


def _read_remains(path: Path, choices: BagChoices, error: Exception) -> BagContents:
    """Read what is whole of a bag that the library refuses for an error."""
    expansion = Expansion(path, import_rosbags())
    contents = BagContents(path, choices)
    with tempfile.TemporaryDirectory() as folder:
        try:
            remains = whole_part(path, Path(folder), expansion.expanded)
            if remains is None:
                raise error
            _read_bag(contents, remains.path, expansion)
        except (InputFileError, MemoryError):
            raise
        except Exception:  # noqa: BLE001 - the library's, or that of a file that is damaged otherwise
            raise InputFileError(path, bag_fault(path, error)) from error
    seconds = contents.scans[-1][0] - contents.scans[0][0] if contents.scans else 0.0
    contents.find(
        "cut off",
        f"the recording was cut off: what is whole is read, {len(contents.scans)} scans in {seconds:.0f} s "
        f"({remains.kept:,} of {remains.total:,} bytes)",
    )
    return contents


def _read_bag(contents: BagContents, bag: Path, expansion: Expansion) -> None:
    rosbags = import_rosbags()
    # ROS 2 bags before Iron carry no message definitions; those of Humble serve all that is read here.
    typestore = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
    expansion.check(bag)
    with rosbags.highlevel.AnyReader([bag], default_typestore=typestore) as reader:
        _read_messages(contents, reader, expansion)


def _read_messages(contents: BagContents, reader: Any, expansion: Expansion) -> None:
    """Take scans, odometry and transforms; those that can't be read are counted."""
    topics = choose_topics(contents, reader)

    def is_wanted(connection: Any) -> bool:
        return connection.topic in topics or connection.msgtype in TRANSFORM_TYPES

    wanted = [connection for connection in reader.connections if is_wanted(connection)]
    for connection, stamp_ns, raw in expansion.messages(reader, wanted):
        try:
            message = reader.deserialize(raw, connection.msgtype)
            take_message(contents, connection, message, stamp_ns)
        except Exception as error:  # noqa: BLE001 - a damaged message makes the decoder stumble anywhere
            fault = f"message on {connection.topic} that can't be decoded"
            if isinstance(error, BrokenMessageError):
                fault = str(error)
            contents.warnings.add(fault, f"{contents.path} at {stamp_ns} ns")
        SCANS.check(connection.topic, len(contents.scans))


def _bag_path(path: Path) -> Path:
    """The path as the library wants it: a folder without metadata stands for the one storage file in it."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    storage = [file for file in path.iterdir() if file.suffix in BAG_SUFFIXES]
    if len(storage) != 1:
        raise InputFileError(
            path,
            f"is no episode and no ROS bag (no metadata.yaml), and {len(storage)} bags are in it; name the log itself",
        )
    return storage[0]


def _odometry(contents: BagContents) -> tuple[Trajectory | None, str]:
    """The base's motion in the odometry frame, None where there is none to use, and the name of the base's frame."""
    tree = contents.transforms
    sources = contents.sources
    if contents.odometry:
        ordered = longest_ordered([stamp for stamp, _ in contents.odometry])
        messages = [contents.odometry[index] for index in ordered]
        stamps, poses = zip(*messages, strict=True)
        motion = Trajectory(np.array(stamps), np.array(poses))
        base = contents.base_frame
    else:
        frame = _odometry_frame(contents)
        if frame is None:
            sources["odometry from"] = "none"
            return None, tree.base_of(contents.laser_frame)
        base, motion = tree.motion(frame)
        sources["odometry from"] = f"tf, {base} in {frame}"
    joined, findings = without_jumps(motion)
    contents.findings += findings
    seconds = max(float(motion.stamps[-1] - motion.stamps[0]), 1e-9)
    rate = (len(motion) - 1) / seconds
    sources["odometry from"] += f", {rate:.1f} Hz"
    return Trajectory(motion.stamps - contents.choices.time_offset, joined), base


def _odometry_frame(contents: BagContents) -> str | None:
    """The frame of tf that the laser moves in; None, and a finding, without one."""
    choices = contents.choices
    if choices.odometry_topic == NO_ODOMETRY:
        return None
    if choices.odometry_frame is not None:
        return _wanted_frame(contents, clean_frame(choices.odometry_frame))
    frames = contents.transforms.odometry_frames(contents.laser_frame)
    if len(frames) > 1:
        raise InputFileError(
            contents.path,
            "holds no usable Odometry message and several frames that the laser may move in: "
            f"{', '.join(frames)}; choose by --odometry-frame",
        )
    if frames:
        return frames[0]
    faults = []
    for kind, count in contents.warnings.counts.items():
        if "quaternion" in kind:
            faults.append(f"{count} x {kind}")
    reason = "; ".join(faults[:2]) or "no Odometry messages, and the laser moves in no frame of tf"
    contents.find(
        "odometry",
        f"there is none ({reason}): the laser alone is used (--odometry-topic, --odometry-frame choose)",
    )
    return None


def _wanted_frame(contents: BagContents, wanted: str) -> str:
    """The odometry frame that the user names."""
    frames = sorted({*contents.transforms.moving().values()})
    if wanted not in frames:
        raise InputFileError(
            contents.path,
            f"holds no frame that moves in {wanted!r} (--odometry-frame may be: {', '.join(frames) or 'none'})",
        )
    return wanted


def _mount(contents: BagContents, base_frame: str) -> tuple[Pose2D, bool]:
    """The laser in the base's frame, and true if it hangs upside down."""
    laser_frame = contents.laser_frame
    base_frame = base_frame or "base_link"
    contents.sources["laser"] = f"{laser_frame} on {base_frame}"
    matrix = contents.transforms.lookup(laser_frame, base_frame)
    if matrix is None:
        contents.warnings.add(
            f"missing transform from {base_frame!r} to {laser_frame!r}; the mount is taken as 0",
            contents.path,
        )
        return Pose2D(0.0, 0.0, 0.0), False
    return planar(matrix), bool(matrix[2, 2] < 0.0)


def _geometry(contents: BagContents, mount: Pose2D, flipped: bool) -> LaserGeometry:
    """The geometry of the first scan with the most frequent number of beams."""
    messages = [message for _, message in contents.scans]
    ranges = [message.ranges for message in messages]
    counts = [len(each) for each in ranges]
    usual, _ = Counter(counts).most_common(1)[0]
    message = messages[counts.index(usual)]
    limit, findings = range_limit(ranges, float(message.range_max), contents.choices.range_max)
    contents.findings += findings
    return geometry_of(message, mount, flipped, limit)
