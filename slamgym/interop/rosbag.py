"""ROS bags (rosbag1; rosbag2 in sqlite3 and MCAP) as logs, through the ``rosbags`` library.

A scan is taken from ``sensor_msgs/LaserScan``; the odometry at its moment is interpolated from
``nav_msgs/Odometry`` or, without such a topic, from the transform of the robot's base in the odometry frame.
The laser's mount is the transform from the base to the scan's frame.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from slamgym.core.errors import InputFileError, needing_extra
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
    interpolated,
    longest_ordered,
    usable_scans,
)

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
USUAL_SCAN_TOPICS = ("/scan", "/base_scan", "/front/scan", "/laser_scan")
USUAL_ODOMETRY_TOPICS = ("/odom", "/odometry", "/wheel/odometry")

ODOMETRY_GAP = 0.5
"""A scan further from the nearest odometry message than this is left out [s]."""

FINEST_ANGLE_STEP = 1e-6
"""Beams closer together than this are a broken number [rad]."""
ODOMETRY_FRAME = "odom"
"""With tf alone: the frame in which the robot's base moves smoothly."""


def clean_frame(name: str) -> str:
    """A frame's name without the leading slash that ROS 1 allowed."""
    return name.lstrip("/")


def rigid_transform(translation: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Return the 4 x 4 matrix of a translation [m] and a quaternion (x, y, z, w).

    Raises:
        ValueError: If a value is no number, absurdly large, or the quaternion is zero.
    """
    is_bounded = (np.abs([*translation, *quaternion]) < MAX_ABS_COORDINATE).all()  # false for nan
    if not is_bounded or np.linalg.norm(quaternion) <= 1e-6:
        raise ValueError("transform with broken numbers")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = translation
    return matrix


def planar(matrix: FloatArray) -> Pose2D:
    """Position and heading of a transform, seen from above."""
    return Pose2D(float(matrix[0, 3]), float(matrix[1, 3]), float(np.arctan2(matrix[1, 0], matrix[0, 0])))


class TransformTree:
    """Edges from child frames to their parents, with their history.

    Convention: the transform of an edge expresses points of the child frame in the parent frame.
    """

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._latest: dict[str, FloatArray] = {}
        self._history: dict[str, list[tuple[float, Pose2D]]] = defaultdict(list)

    def add(self, parent: str, child: str, stamp: float, matrix: FloatArray, *, static: bool) -> None:
        """Take one published transform."""
        parent, child = clean_frame(parent), clean_frame(child)
        self._parents[child] = parent
        self._latest[child] = matrix
        if not static:
            self._history[child].append((stamp, planar(matrix)))

    def moving(self) -> dict[str, str]:
        """Frames that move, each with the frame that it moves in."""
        return {child: self._parents[child] for child, history in self._history.items() if len(history) > 1}

    def motion(self, parent: str) -> tuple[str, Trajectory]:
        """The frame with the longest history of those that move in ``parent``, and its planar poses, by time."""
        children = [child for child, above in self.moving().items() if above == parent]
        child = max(children, key=lambda one: len(self._history[one]))
        stamps, poses = zip(*sorted(self._history[child], key=lambda entry: entry[0]), strict=True)
        return child, Trajectory(np.array(stamps), np.array(poses))

    def lookup(self, frame: str, ancestor: str) -> FloatArray | None:
        """The latest transform of ``frame`` in ``ancestor``, or in a frame above which both hang; 4 x 4.

        None where the tree doesn't connect the two.
        """
        up, up_ancestor = self._chain(clean_frame(frame)), self._chain(clean_frame(ancestor))
        for name, matrix in up.items():
            if name in up_ancestor:
                return np.linalg.inv(up_ancestor[name]) @ matrix
        return None

    def _chain(self, frame: str) -> dict[str, FloatArray]:
        """Each frame above ``frame`` (itself included) and the transform of ``frame`` in it."""
        matrix = np.eye(4)
        chain = {frame: matrix}
        while frame in self._parents and self._parents[frame] not in chain:
            matrix = self._latest[frame] @ matrix
            frame = self._parents[frame]
            chain[frame] = matrix
        return chain


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
    with needing_extra("reading and writing ROS bags", "ros"):
        import rosbags.highlevel
        import rosbags.rosbag2
        import rosbags.typesys
    return rosbags


def read_rosbag(path: Path | str, *, scan_topic: str | None = None, odometry_topic: str | None = None) -> Log:
    """Read the scans and the odometry of a bag.

    Args:
        path: A ``.bag`` file, a rosbag2 folder, or a single ``.mcap`` or ``.db3`` file.
        scan_topic: The LaserScan topic; by default ``/scan`` or a usual name, else the one with most
            messages.
        odometry_topic: The Odometry topic; by default ``/odom`` or a usual name, else the one with most
            messages, else tf.

    Raises:
        InputFileError: If the bag can't be read, or lacks scans or odometry, or the topic named.
        ConfigError: If ``rosbags`` isn't installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(path, "doesn't exist")
    warnings = LogWarnings()
    contents = _read_contents(path, scan_topic, odometry_topic, warnings)
    odometry, base_frame = _odometry(path, contents)
    mount, flipped = _mount(path, contents, base_frame, warnings)
    geometry = _geometry(contents, mount, flipped)
    stamps = np.array([stamp for stamp, _ in contents.scans])
    poses = [Pose2D(*pose) for pose in interpolated(odometry, stamps).tolist()]
    records: list[LogRecord] = []
    for index, (stamp, message) in enumerate(contents.scans):
        if float(np.min(np.abs(odometry.stamps - stamp))) > ODOMETRY_GAP:
            warnings.add("scan left out because no odometry is near in time", f"{path} scan {index + 1}")
        else:
            scan = LaserScan(stamp, _ranges(message, geometry, flipped), geometry)
            records.append(LogRecord(stamp, poses[index], scan))
    if not records:
        raise InputFileError(path, f"holds no usable scan: {'; '.join(warnings.sentences()[:3])}")
    places = [f"{path} at {record.stamp:.3f} s" for record in records]
    kept = usable_scans([record.stamp for record in records], [r.odometry for r in records], places, warnings)
    return Log(str(path), [records[index] for index in kept], geometry, warnings)


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
                    fault = f"message on {connection.topic} that can't be decoded"
                    warnings.add(fault, f"{path} at {stamp_ns} ns")
    except InputFileError:
        raise
    except Exception as error:  # on a damaged file the library may raise any exception
        if not contents.scans:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputFileError(path, f"is not a readable ROS bag ({reason[:200]})") from error
        warnings.add("damage in the bag, the rest of which is lost", path)
    if not contents.scans:
        raise InputFileError(path, f"holds no usable scan: {'; '.join(warnings.sentences()[:3])}")
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
    most = max(topics, key=lambda topic: (topics[topic], topic), default=None)
    return next((name for name in usual if name in topics), most)


def _take(contents: _Contents, connection: Any, message: Any, stamp_ns: int) -> None:
    if connection.msgtype == SCAN_TYPE:
        _check_scan(message)
        contents.scans.append((_stamp(message.header, stamp_ns), message))
        SCANS.check(connection.topic, len(contents.scans))
    elif connection.msgtype == ODOMETRY_TYPE:
        pose = message.pose.pose
        place = planar(_matrix(pose.position, pose.orientation))
        contents.odometry.append((_stamp(message.header, stamp_ns), place))
        contents.base_frame = contents.base_frame or clean_frame(message.child_frame_id)
    elif connection.msgtype in TRANSFORM_TYPES:
        static = connection.topic.endswith("tf_static")
        for entry in message.transforms:
            header, matrix = entry.header, _matrix(entry.transform.translation, entry.transform.rotation)
            stamp = _stamp(header, stamp_ns)
            contents.transforms.add(header.frame_id, entry.child_frame_id, stamp, matrix, static=static)


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
    place, turn = (position.x, position.y, position.z), [getattr(orientation, axis) for axis in "xyzw"]
    return rigid_transform(np.array(place, dtype=np.float64), np.array(turn, dtype=np.float64))


def _odometry(path: Path, contents: _Contents) -> tuple[Trajectory, str]:
    """The base's motion in the odometry frame, and the name of the base's frame."""
    if contents.odometry:
        ordered = longest_ordered([stamp for stamp, _ in contents.odometry])
        stamps, poses = zip(*(contents.odometry[index] for index in ordered), strict=True)
        return Trajectory(np.array(stamps), np.array(poses)), contents.base_frame
    parents = contents.transforms.moving().values()
    if ODOMETRY_FRAME not in parents:
        moving = ", ".join(sorted(set(parents))) or "none"
        raise InputFileError(
            path,
            f"holds neither Odometry messages nor a frame that moves in {ODOMETRY_FRAME!r} (frames with moving "
            f"children: {moving})",
        )
    base, motion = contents.transforms.motion(ODOMETRY_FRAME)
    return motion, base


def _mount(path: Path, contents: _Contents, base_frame: str, warnings: LogWarnings) -> tuple[Pose2D, bool]:
    """The laser in the base's frame, and true if it hangs upside down."""
    laser_frame, base_frame = clean_frame(contents.scans[0][1].header.frame_id), base_frame or "base_link"
    matrix = contents.transforms.lookup(laser_frame, base_frame)
    if matrix is None:
        fault = f"missing transform from {base_frame!r} to {laser_frame!r}; the mount is taken as 0"
        warnings.add(fault, path)
        return Pose2D(0.0, 0.0, 0.0), False
    return planar(matrix), bool(matrix[2, 2] < 0.0)


def _geometry(contents: _Contents, mount: Pose2D, flipped: bool) -> LaserGeometry:
    """The geometry of the most frequent kind of scan."""
    usual = Counter(_kind(message) for _, message in contents.scans).most_common(1)[0][0]
    message = next(message for _, message in contents.scans if _kind(message) == usual)
    ranges, angle_min, increment = _fan(message, flipped)
    range_min, range_max = max(float(message.range_min), 0.0), float(message.range_max)
    return LaserGeometry(len(ranges), angle_min, increment, range_min, range_max, mount)


def _fan(message: Any, flipped: bool) -> tuple[Float32Array, float, float]:
    """Ranges, first angle and step of a scan, counter-clockwise seen from above."""
    ranges = np.array(message.ranges, dtype=np.float32)
    angle_min, increment = float(message.angle_min), float(message.angle_increment)
    if flipped:
        angle_min, increment = -angle_min, -increment
    if increment < 0.0:  # stored clockwise: counted from the other end
        ranges, angle_min, increment = ranges[::-1], angle_min + (len(ranges) - 1) * increment, -increment
    return ranges, angle_min, increment


def _kind(message: Any) -> tuple[float, ...]:
    """Parts that must agree between scans; the angles are float32 in the message."""
    digits = {"angle_min": 5, "angle_increment": 7, "range_min": 5, "range_max": 5}
    return len(message.ranges), *(round(float(getattr(message, name)), digits[name]) for name in digits)


def _ranges(message: Any, geometry: LaserGeometry, flipped: bool) -> Float32Array:
    """Ranges on the log's geometry; a scan with other angles (rotating scanners vary) is resampled."""
    ranges, angle_min, increment = _fan(message, flipped)
    same_angles = (
        abs(angle_min - geometry.angle_min) + abs(increment - geometry.angle_increment) * len(ranges) < 0.005
    )
    if len(ranges) != geometry.num_beams or not same_angles:
        beam = np.rint((geometry.angles - angle_min) / increment).astype(np.int64)
        inside = (beam >= 0) & (beam < len(ranges))
        ranges = np.where(inside, ranges[np.clip(beam, 0, len(ranges) - 1)], np.float32(np.nan))
    ranges = np.ascontiguousarray(ranges, dtype=np.float32)
    ranges[ranges < 0.0] = np.nan
    ranges[ranges >= geometry.range_max] = np.inf
    # Some drivers report 0 for "nothing came back" and for errors alike: neither space nor wall is known.
    ranges[ranges < max(geometry.range_min, 1e-6)] = np.nan
    return ranges
