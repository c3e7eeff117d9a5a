"""Logs as rosbag2, for replay in ROS 2.

``/scan``, ``/odom``, ``/tf``, ``/tf_static`` and ``/clock``; where they are known ``/map`` and ``/ground_truth``.
Frames are called as on a TurtleBot3.
"""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import storage_errors
from slamgym.core.geometry import compose, inverse, unit_vectors, wrap_angle
from slamgym.core.types import FloatArray, LaserGeometry, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import LogRecord, interpolated
from slamgym.interop.ros_messages import (
    Fields,
    grid_fields,
    header_fields,
    odometry_fields,
    scan_fields,
    transform_fields,
)
from slamgym.interop.rosbag import import_rosbags

TOPICS = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/ground_truth": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/map": "nav_msgs/msg/OccupancyGrid",
}
Storage = Literal["sqlite3", "mcap"]


class BagTracks(NamedTuple):
    """Other trajectories of a run, in the map frame."""

    truth: Trajectory | None = None
    """Where the robot truly was: ``/ground_truth``."""
    estimate: Trajectory | None = None
    """Where SLAM says that it was: ``map`` -> ``odom`` on ``/tf``. Leave it out to replay the bag to a SLAM program,
    which publishes that transform itself."""


def write_rosbag2(
    path: Path | str,
    records: Sequence[LogRecord],
    geometry: LaserGeometry,
    *,
    grid: OccupancyGrid | None = None,
    tracks: BagTracks = BagTracks(),  # noqa: B008 - it can't change
    first_stamp: float | None = None,
    storage: Storage = "sqlite3",
) -> None:
    """Write a rosbag2 folder.

    Args:
        path: The folder to make; it must not exist yet.
        records: The scans, in the order of time; at least one.
        geometry: The laser.
        grid: A map, published once on ``/map`` (transient local, as map_server does).
        tracks: Truth and estimate.
        first_stamp: Time of the first scan [s since 1970]; None keeps the log's stamps.
        storage: How the messages are stored.

    Raises:
        InputFileError: If the folder exists or can't be written, or there is no record.
        ConfigError: If ``rosbags`` isn't installed.
    """
    path = Path(path)
    rosbags = import_rosbags()
    if not records:
        raise InputFileError(path, "isn't written because the log holds no scan")
    if path.exists():
        raise InputFileError(path, "exists already; remove it or choose another name")
    shift = 0.0 if first_stamp is None else first_stamp - records[0].stamp
    plugin = rosbags.rosbag2.StoragePlugin[storage.upper()]
    with (
        _staged_folder(path) as part,
        rosbags.rosbag2.Writer(part, version=8, storage_plugin=plugin) as writer,
    ):
        typestore = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        bag = _Bag(writer, typestore, shift)
        first = records[0].stamp
        bag.write_transform("/tf_static", first, ("base_footprint", "base_scan"), geometry.mount)
        if grid is not None:
            bag.write("/map", first, grid_fields(bag.header(first, "map"), grid))
        _write_records(bag, records, geometry, tracks)


def _write_records(
    bag: "_Bag", records: Sequence[LogRecord], laser: LaserGeometry, tracks: BagTracks
) -> None:
    """Write what changes from scan to scan."""
    stamps = np.array([record.stamp for record in records])
    odometry = _Motion.at(stamps, np.array([record.odometry for record in records]))
    truth = None
    if tracks.truth is not None:
        truth = _Motion.at(stamps, interpolated(tracks.truth, stamps))
    estimates = None if tracks.estimate is None else interpolated(tracks.estimate, stamps)
    scan_time = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    for i, record in enumerate(records):
        stamp = record.stamp
        pose = record.odometry
        # For nodes with use_sim_time.
        bag.write("/clock", stamp, {"clock": bag.header(stamp, "")["stamp"]})
        bag.write_transform("/tf", stamp, ("odom", "base_footprint"), pose)
        if estimates is not None:
            map_to_odom = compose(Pose2D(*estimates[i]), inverse(pose))
            bag.write_transform("/tf", stamp, ("map", "odom"), map_to_odom)
        bag.write_odometry("/odom", stamp, "odom", pose, odometry.twists[i])
        if truth is not None:
            true_pose = Pose2D(*truth.poses[i])
            bag.write_odometry("/ground_truth", stamp, "map", true_pose, truth.twists[i])
        header = bag.header(stamp, "base_scan")
        bag.write("/scan", stamp, scan_fields(header, record.scan.ranges, laser, scan_time))
        if laser.scan_time > 0.0:
            last = compose(pose, record.scan.motion)
            at_last = stamp + laser.scan_time
            bag.write_transform("/tf", at_last, ("odom", "base_footprint"), last)
            bag.write_odometry("/odom", at_last, "odom", last, odometry.twists[i])


class _Motion(NamedTuple):
    """Poses at the scans, and the speeds of the robot in its own frame."""

    poses: FloatArray  # (N, 3)
    twists: FloatArray  # (N, 2)

    @staticmethod
    def at(stamps: FloatArray, poses: FloatArray) -> "_Motion":
        """The speeds follow from the poses."""
        return _Motion(poses, _twists(stamps, poses))


def _twists(stamps: FloatArray, poses: FloatArray) -> FloatArray:
    """Forward speed [m/s] and turning rate [rad/s] since the pose before, shape (N, 2); at first at rest."""
    twists = np.zeros((len(poses), 2))
    if len(poses) < 2:
        return twists
    dt = np.maximum(np.diff(stamps), 1e-9)
    steps = np.diff(poses[:, :2], axis=0)
    turns = wrap_angle(np.diff(poses[:, 2]))
    half = 0.5 * turns
    directions = unit_vectors(poses[:-1, 2] + half)
    forward = np.einsum("ij,ij->i", steps, directions)
    twists[1:, 0] = forward / np.sinc(half / np.pi) / dt  # the arc is longer than its chord
    twists[1:, 1] = turns / dt
    return twists


@contextmanager
def _staged_folder(path: Path) -> Iterator[Path]:
    """A folder of the final name inside a temporary one, moved into place when the bag is complete.

    The library names the storage file after its folder, so the name has to be the final one from the start.
    """
    staging = path.with_name(f".{path.name}.part")
    with storage_errors(path):
        try:
            shutil.rmtree(staging, ignore_errors=True)
            staging.mkdir(parents=True)
            yield staging / path.name
            (staging / path.name).rename(path)
        finally:
            shutil.rmtree(staging, ignore_errors=True)


def _latched_qos() -> Any:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    forever = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=forever,
        lifespan=forever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


class _Bag:
    """Writes messages, given as mappings of their fields, through the ``rosbags`` library.

    Args:
        writer: The library's writer.
        typestore: The library's typestore.
        shift: Added to all stamps [s].
    """

    def __init__(self, writer: Any, typestore: Any, shift: float) -> None:
        self._writer = writer
        self._typestore = typestore
        self._shift_ns = round(shift * 1e9)
        self._connections: dict[str, Any] = {}

    def write(self, topic: str, stamp: float, fields: Fields) -> None:
        """Write a message; a field that isn't given is zero."""
        kind = TOPICS[topic]
        if topic not in self._connections:
            # Their last message also reaches who subscribes later.
            qos = [_latched_qos()] if topic in ("/tf_static", "/map") else []
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._typestore, offered_qos_profiles=qos
            )
        content = self._typestore.serialize_cdr(self._message(kind, fields), kind)
        self._writer.write(self._connections[topic], self._nanoseconds(stamp), content)

    def _message(self, kind: str, fields: dict[str, Any]) -> Any:
        values = {}
        for name, (_, inner) in self._typestore.fielddefs[kind][1]:
            value = fields.get(name, {} if isinstance(inner, str) else 0)
            if isinstance(value, dict):
                value = self._message(inner, value)
            elif isinstance(value, list):
                value = [self._message(inner[0][1], item) for item in value]
            values[name] = value
        return self._typestore.types[kind](**values)

    def _nanoseconds(self, stamp: float) -> int:
        return round(stamp * 1e9) + self._shift_ns

    def header(self, stamp: float, frame: str) -> Fields:
        """The fields of a Header message."""
        return header_fields(self._nanoseconds(stamp), frame)

    def write_transform(
        self, topic: str, stamp: float, frames: tuple[str, str], pose: Pose2D
    ) -> None:
        """Write the pose of a frame, the second, in its parent."""
        parent, child = frames
        transform = transform_fields(self.header(stamp, parent), child, pose)
        self.write(topic, stamp, {"transforms": [transform]})

    def write_odometry(
        self, topic: str, stamp: float, frame: str, pose: Pose2D, twist: FloatArray
    ) -> None:
        """Write a pose in ``frame`` and the speeds [m/s, rad/s] in the robot's own."""
        header = self.header(stamp, frame)
        self.write(topic, stamp, odometry_fields(header, "base_footprint", pose, twist))
