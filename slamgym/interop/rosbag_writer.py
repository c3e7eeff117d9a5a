"""Logs as rosbag2, for replay in ROS 2: ``/scan``, ``/odom``, ``/tf``, ``/tf_static`` and ``/map``."""

import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, LaserGeometry, OccupancyGrid, Pose2D
from slamgym.interop.records import LogRecord
from slamgym.interop.rosbag import import_rosbags

ODOMETRY_FRAME, BASE_FRAME, LASER_FRAME, MAP_FRAME = "odom", "base_footprint", "base_scan", "map"
"""Frame names of a TurtleBot3."""

Storage = Literal["sqlite3", "mcap"]


def write_rosbag2(
    path: Path | str,
    records: Sequence[LogRecord],
    geometry: LaserGeometry,
    *,
    grid: OccupancyGrid | None = None,
    storage: Storage = "sqlite3",
) -> None:
    """Write a rosbag2 folder.

    Args:
        path: The folder to make; it must not exist yet.
        records: The scans, in the order of time; at least one.
        geometry: The laser.
        grid: A map, published once on ``/map`` (transient local, as map_server does).
        storage: How the messages are stored.

    Raises:
        InputFileError: If the folder exists or can't be written, or there is no record.
        ConfigError: If ``rosbags`` isn't installed.

    ``/tf`` holds odom -> base_footprint only: map -> odom is left to the SLAM program that is replayed to.
    """
    path = Path(path)
    rosbags = import_rosbags()
    if not records:
        raise InputFileError(path, "isn't written because the log holds no scan")
    if path.exists():
        raise InputFileError(path, "exists already; remove it or choose another name")
    make = _MessageFactory(rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE))
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
                connection, round(stamp * 1e9), make.typestore.serialize_cdr(message, connection.msgtype)
            )

        scan = connect("/scan", "sensor_msgs/msg/LaserScan")
        odometry = connect("/odom", "nav_msgs/msg/Odometry")
        transform = connect("/tf", "tf2_msgs/msg/TFMessage")
        static = connect("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
        start = records[0].stamp
        write(static, start, make.transform(start, BASE_FRAME, LASER_FRAME, geometry.mount))
        if grid is not None:
            write(connect("/map", "nav_msgs/msg/OccupancyGrid", latched=True), start, make.map(start, grid))
        for record in records:
            pose = record.odometry
            write(transform, record.stamp, make.transform(record.stamp, ODOMETRY_FRAME, BASE_FRAME, pose))
            write(odometry, record.stamp, make.odometry(record.stamp, pose))
            write(scan, record.stamp, make.scan(record, geometry))


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
    """Builds the messages from a typestore of the ``rosbags`` library."""

    def __init__(self, typestore: Any) -> None:
        self.typestore = typestore
        self._types = typestore.types

    def _header(self, stamp: float, frame: str) -> Any:
        total_ns = round(stamp * 1e9)
        time = self._types["builtin_interfaces/msg/Time"](sec=total_ns // 10**9, nanosec=total_ns % 10**9)
        return self._types["std_msgs/msg/Header"](stamp=time, frame_id=frame)

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

    def odometry(self, stamp: float, pose: Pose2D) -> Any:
        """An Odometry message; velocities and covariances aren't logged and stay 0."""
        vector = self._types["geometry_msgs/msg/Vector3"]
        twist = self._types["geometry_msgs/msg/Twist"](
            linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
        )
        unknown = np.zeros(36)
        return self._types["nav_msgs/msg/Odometry"](
            header=self._header(stamp, ODOMETRY_FRAME),
            child_frame_id=BASE_FRAME,
            pose=self._types["geometry_msgs/msg/PoseWithCovariance"](
                pose=self._pose(pose), covariance=unknown
            ),
            twist=self._types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=unknown),
        )

    def scan(self, record: LogRecord, geometry: LaserGeometry) -> Any:
        """A LaserScan message, with no return as +inf (REP 117)."""
        return self._types["sensor_msgs/msg/LaserScan"](
            header=self._header(record.stamp, LASER_FRAME),
            angle_min=geometry.angle_min,
            angle_max=geometry.angle_min + geometry.angle_increment * (geometry.num_beams - 1),
            angle_increment=geometry.angle_increment,
            time_increment=0.0,
            scan_time=0.0,
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
