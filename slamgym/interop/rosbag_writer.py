"""Logs as rosbag2, for replay in ROS 2.

``/scan``, ``/odom``, ``/tf``, ``/tf_static`` and ``/clock``; where they are known ``/map`` and ``/ground_truth``.
"""

import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import compose, inverse, unit_vectors, wrap_angle
from slamgym.core.types import FREE, OCCUPIED, FloatArray, LaserGeometry, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import LogRecord
from slamgym.interop.rosbag import import_rosbags

ODOMETRY_FRAME, BASE_FRAME, LASER_FRAME, MAP_FRAME = "odom", "base_footprint", "base_scan", "map"
"""Frame names of a TurtleBot3."""

Storage = Literal["sqlite3", "mcap"]
_UNOBSERVED = 1e12
POSE_VARIANCES = (1e-5, 1e-5, _UNOBSERVED, _UNOBSERVED, _UNOBSERVED, 1e-3)
"""x, y, z [m2], roll, pitch, yaw [rad2] of odometry: the defaults of gazebo_ros_diff_drive. Filters refuse zeros."""


class BagTracks(NamedTuple):
    """What else is known about a run, in the map frame."""

    truth: Trajectory | None = None
    """Where the robot truly was: ``/ground_truth``."""
    estimate: Trajectory | None = None
    """Where SLAM says that it was: ``map`` -> ``odom`` on ``/tf``. Leave it out to replay the bag to a SLAM program,
    which publishes that transform itself."""


NO_TRACKS = BagTracks()


def write_rosbag2(
    path: Path | str,
    records: Sequence[LogRecord],
    geometry: LaserGeometry,
    *,
    grid: OccupancyGrid | None = None,
    tracks: BagTracks = NO_TRACKS,
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
        first_stamp: Of the first scan [s since 1970]; None leaves the log's stamps as they are.
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
    make = _MessageFactory(rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE), shift)
    plugin = rosbags.rosbag2.StoragePlugin[storage.upper()]
    with (
        _staged_folder(path) as part,
        rosbags.rosbag2.Writer(part, version=8, storage_plugin=plugin) as writer,
    ):

        def connect(topic: str, msgtype: str, latched: bool = False) -> Any:
            qos = [_latched_qos()] if latched else []
            return writer.add_connection(topic, msgtype, typestore=make.typestore, offered_qos_profiles=qos)

        def write(connection: Any, stamp: float, message: Any) -> None:
            writer.write(
                connection, make.nanoseconds(stamp), make.typestore.serialize_cdr(message, connection.msgtype)
            )

        scan = connect("/scan", "sensor_msgs/msg/LaserScan")
        odometry = connect("/odom", "nav_msgs/msg/Odometry")
        transform = connect("/tf", "tf2_msgs/msg/TFMessage")
        static = connect("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
        clock = connect("/clock", "rosgraph_msgs/msg/Clock")
        truth = connect("/ground_truth", "nav_msgs/msg/Odometry") if tracks.truth is not None else None
        start = records[0].stamp
        write(static, start, make.transform(start, BASE_FRAME, LASER_FRAME, geometry.mount))
        if grid is not None:
            write(connect("/map", "nav_msgs/msg/OccupancyGrid", latched=True), start, make.map(start, grid))
        stamps = np.array([record.stamp for record in records])
        odometry_poses = np.array([record.odometry for record in records])
        twists = _twists(stamps, odometry_poses)
        true_poses = _at(tracks.truth, stamps)
        true_twists = _twists(stamps, true_poses) if true_poses is not None else twists
        estimates = _at(tracks.estimate, stamps)
        scan_time = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
        for i, record in enumerate(records):
            stamp, pose = record.stamp, record.odometry
            write(clock, stamp, make.clock(stamp))
            write(transform, stamp, make.transform(stamp, ODOMETRY_FRAME, BASE_FRAME, pose))
            if estimates is not None:
                map_to_odom = compose(Pose2D(*estimates[i]), inverse(pose))
                write(transform, stamp, make.transform(stamp, MAP_FRAME, ODOMETRY_FRAME, map_to_odom))
            write(odometry, stamp, make.odometry(stamp, ODOMETRY_FRAME, pose, twists[i]))
            if truth is not None and true_poses is not None:
                write(truth, stamp, make.odometry(stamp, MAP_FRAME, Pose2D(*true_poses[i]), true_twists[i]))
            write(scan, stamp, make.scan(record, geometry, scan_time))


def _at(track: Trajectory | None, stamps: FloatArray) -> FloatArray | None:
    """Poses of a track at other moments, shape (N, 3), by linear interpolation; beyond its ends they stay."""
    if track is None:
        return None
    theta = np.unwrap(track.poses[:, 2])
    columns = [*track.poses[:, :2].T, theta]
    poses = np.column_stack([np.interp(stamps, track.stamps, column) for column in columns])
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def _twists(stamps: FloatArray, poses: FloatArray) -> FloatArray:
    """Forward speed [m/s] and turning rate [rad/s] since the pose before, shape (N, 2); at first at rest."""
    twists = np.zeros((len(poses), 2))
    if len(poses) < 2:
        return twists
    dt = np.maximum(np.diff(stamps), 1e-9)
    steps, turns = np.diff(poses[:, :2], axis=0), wrap_angle(np.diff(poses[:, 2]))
    middle = poses[:-1, 2] + 0.5 * turns
    forward = np.einsum("ij,ij->i", steps, unit_vectors(middle))
    half = 0.5 * turns
    twists[1:, 0] = forward / np.sinc(half / np.pi) / dt  # the arc is longer than its chord
    twists[1:, 1] = turns / dt
    return twists


@contextmanager
def _staged_folder(path: Path) -> Iterator[Path]:
    """A folder of the final name inside a temporary one, moved into place when the bag is complete.

    The library names the storage file after its folder, so the name has to be the final one from the start.
    """
    staging = path.with_name(f".{path.name}.part")
    try:
        shutil.rmtree(staging, ignore_errors=True)
        staging.mkdir(parents=True)
        yield staging / path.name
        (staging / path.name).rename(path)
    except OSError as error:
        raise InputFileError(path, f"can't be written ({error.strerror or error})") from error
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
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        forever, forever, QosLiveliness.AUTOMATIC, forever, False,
    )  # fmt: skip


class _MessageFactory:
    """Builds the messages from a typestore of the ``rosbags`` library; ``shift`` is added to all stamps [s]."""

    def __init__(self, typestore: Any, shift: float) -> None:
        self.typestore = typestore
        self._types = typestore.types
        self._shift_ns = round(shift * 1e9)

    def nanoseconds(self, stamp: float) -> int:
        """A stamp of the log as the bag has it."""
        return round(stamp * 1e9) + self._shift_ns

    def _time(self, stamp: float) -> Any:
        total_ns = self.nanoseconds(stamp)
        return self._types["builtin_interfaces/msg/Time"](sec=total_ns // 10**9, nanosec=total_ns % 10**9)

    def clock(self, stamp: float) -> Any:
        """A Clock message, for nodes with ``use_sim_time``."""
        return self._types["rosgraph_msgs/msg/Clock"](clock=self._time(stamp))

    def _header(self, stamp: float, frame: str) -> Any:
        return self._types["std_msgs/msg/Header"](stamp=self._time(stamp), frame_id=frame)

    def _quaternion(self, theta: float) -> Any:
        return self._types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(0.5 * theta), w=math.cos(0.5 * theta)
        )

    def transform(self, stamp: float, parent: str, child: str, pose: Pose2D) -> Any:
        """A TFMessage with one transform."""
        translation = self._types["geometry_msgs/msg/Vector3"](x=float(pose.x), y=float(pose.y), z=0.0)
        transform = self._types["geometry_msgs/msg/Transform"](
            translation=translation, rotation=self._quaternion(pose.theta)
        )
        stamped = self._types["geometry_msgs/msg/TransformStamped"](
            header=self._header(stamp, parent), child_frame_id=child, transform=transform
        )
        return self._types["tf2_msgs/msg/TFMessage"](transforms=[stamped])

    def _pose(self, pose: Pose2D) -> Any:
        point = self._types["geometry_msgs/msg/Point"](x=float(pose.x), y=float(pose.y), z=0.0)
        return self._types["geometry_msgs/msg/Pose"](position=point, orientation=self._quaternion(pose.theta))

    def odometry(self, stamp: float, frame: str, pose: Pose2D, twist: FloatArray) -> Any:
        """An Odometry message: a pose in ``frame``, the speeds [m/s, rad/s] in the robot's own."""
        vector = self._types["geometry_msgs/msg/Vector3"]
        speeds = self._types["geometry_msgs/msg/Twist"](
            linear=vector(x=float(twist[0]), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=float(twist[1]))
        )
        covariance = np.diag(POSE_VARIANCES).ravel()
        return self._types["nav_msgs/msg/Odometry"](
            header=self._header(stamp, frame),
            child_frame_id=BASE_FRAME,
            pose=self._types["geometry_msgs/msg/PoseWithCovariance"](
                pose=self._pose(pose), covariance=covariance
            ),
            twist=self._types["geometry_msgs/msg/TwistWithCovariance"](twist=speeds, covariance=covariance),
        )

    def scan(self, record: LogRecord, geometry: LaserGeometry, scan_time: float) -> Any:
        """A LaserScan message, with no return as +inf (REP 117)."""
        return self._types["sensor_msgs/msg/LaserScan"](
            header=self._header(record.stamp, LASER_FRAME),
            angle_min=geometry.angle_min,
            angle_max=geometry.angle_min + geometry.angle_increment * (geometry.num_beams - 1),
            angle_increment=geometry.angle_increment,
            time_increment=0.0,
            scan_time=scan_time,
            range_min=geometry.range_min,
            range_max=geometry.range_max,
            ranges=np.asarray(record.scan.ranges, dtype=np.float32),
            intensities=np.zeros(0, dtype=np.float32),
        )

    def map(self, stamp: float, grid: OccupancyGrid) -> Any:
        """An OccupancyGrid message: 0 free, 100 occupied, -1 unknown, row 0 at the bottom."""
        data = np.full(grid.cells.shape, -1, dtype=np.int8)
        data[grid.cells == FREE] = 0
        data[grid.cells == OCCUPIED] = 100
        header = self._header(stamp, MAP_FRAME)
        frame = grid.frame
        info = self._types["nav_msgs/msg/MapMetaData"](
            map_load_time=header.stamp,
            resolution=frame.resolution,
            width=frame.width_px,
            height=frame.height_px,
            origin=self._pose(Pose2D(frame.origin_x, frame.origin_y, 0.0)),
        )
        return self._types["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=data[::-1].ravel())
