"""ROS messages and the records that they stand for, whoever makes the messages: a bag's reader or a running node.

What is read may be any object with the attributes of the message. What is written are mappings of a message's fields;
what isn't named is zero.
"""

import math
from typing import Any

import numpy as np

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    Float32Array,
    FloatArray,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.interop.records import (
    MAX_ABS_COORDINATE,
    BrokenMessageError,
    possible_angles,
    possible_count,
)
from slamgym.interop.transforms import planar, rigid_transform

POSE_VARIANCES = (1e-5, 1e-5, 1e12, 1e12, 1e12, 1e-3)
"""x, y, z [m2], roll, pitch, yaw [rad2] of odometry: the defaults of gazebo_ros_diff_drive. Filters refuse zeros."""

Fields = dict[str, Any]


# --- read ---


def stamp_of(header: Any, otherwise: float) -> float:
    """The header's stamp, or the moment of recording where the driver left it at zero [s]."""
    stamp = header.stamp.sec + header.stamp.nanosec * 1e-9
    return float(stamp) if stamp > 0.0 else otherwise


def matrix_of(position: Any, orientation: Any, what: str) -> FloatArray:
    """The 4 x 4 matrix of a message's position and quaternion.

    Raises:
        BrokenMessageError: Named by ``what``, if the quaternion is zero.
        ValueError: If a value is no number or absurdly large.
    """
    place = [position.x, position.y, position.z]
    turn = [orientation.x, orientation.y, orientation.z, orientation.w]
    translation = np.array(place, dtype=np.float64)
    quaternion = np.array(turn, dtype=np.float64)
    return rigid_transform(translation, quaternion, what)


def pose_of(pose: Any, what: str) -> Pose2D:
    """A Pose message seen from above; raises as :func:`matrix_of`."""
    return planar(matrix_of(pose.position, pose.orientation, what))


def check_scan(message: Any) -> None:
    """Refuse a LaserScan that no laser sends.

    Raises:
        BrokenMessageError: If its angles, its number of readings or its limits are impossible.
    """
    if not possible_angles(float(message.angle_min), float(message.angle_increment)):
        raise BrokenMessageError("scan left out because of impossible beam angles")
    if not possible_count(len(message.ranges)):
        raise BrokenMessageError("scan left out because of an impossible number of readings")
    if not abs(float(message.range_min)) <= MAX_ABS_COORDINATE:  # false for nan
        raise BrokenMessageError("scan left out because of impossible range limits")


def _fan(message: Any, flipped: bool) -> tuple[float, float]:
    """First angle and step of a scan seen from above; below 0, it is stored clockwise."""
    sign = -1.0 if flipped else 1.0
    return sign * float(message.angle_min), sign * float(message.angle_increment)


def geometry_of(message: Any, mount: Pose2D, flipped: bool, range_max: float) -> LaserGeometry:
    """The laser that a LaserScan shows, with its mount and the range from which on a reading means no return [m].

    How long a scan takes is left at 0: what drivers write has to be checked
    (:func:`slamgym.interop.scan_times.believed_scan_time`). Their ``scan_time`` doesn't say it: it is the time from a
    scan to the next, also of simulated lasers, which measure all beams at once.
    """
    first, step = _fan(message, flipped)
    count = len(message.ranges)
    last = first + (count - 1) * step
    range_min = max(float(message.range_min), 0.0)
    at_once = math.copysign(0.0, step)  # beams that are stored clockwise are measured so
    angle_min = min(first, last)
    return LaserGeometry(count, angle_min, abs(step), range_min, range_max, mount, at_once)


def ranges_of(message: Any, geometry: LaserGeometry, flipped: bool) -> Float32Array:
    """Ranges at the angles of a geometry, as those of rotating scanners vary, shape (num_beams,) [m]."""
    first, step = _fan(message, flipped)
    stored = np.array(message.ranges, dtype=np.float32)
    last = len(stored) - 1
    beam = np.rint((geometry.angles - first) / step).astype(np.int64)
    inside = (beam >= 0) & (beam <= last)
    nearest = stored[beam.clip(0, last)]
    ranges = np.where(inside, nearest, np.float32(np.nan))
    ranges[ranges >= geometry.range_max] = np.inf
    # Some drivers report 0 for "nothing came back" and for errors alike: neither space nor wall is known.
    shortest = max(geometry.range_min, 1e-6)
    ranges[ranges < shortest] = np.nan
    return ranges


# --- write ---


def time_fields(nanoseconds: int) -> Fields:
    """The fields of a Time message."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return {"sec": seconds, "nanosec": rest}


def header_fields(nanoseconds: int, frame: str) -> Fields:
    """The fields of a Header message."""
    return {"stamp": time_fields(nanoseconds), "frame_id": frame}


def pose_fields(pose: Pose2D) -> dict[str, Fields]:
    """The fields of a Pose message."""
    half = 0.5 * pose.theta
    position = {"x": float(pose.x), "y": float(pose.y)}
    orientation = {"z": math.sin(half), "w": math.cos(half)}
    return {"position": position, "orientation": orientation}


def transform_fields(header: Fields, child: str, pose: Pose2D, height: float = 0.0) -> Fields:
    """The fields of a TransformStamped message: the pose and height of a frame, ``child``, in that of the header."""
    place = pose_fields(pose)
    translation = {**place["position"], "z": height}
    transform = {"translation": translation, "rotation": place["orientation"]}
    return {"header": header, "child_frame_id": child, "transform": transform}


def odometry_fields(header: Fields, child: str, pose: Pose2D, twist: FloatArray) -> Fields:
    """The fields of an Odometry message: a pose, and the speeds [m/s, rad/s] in the robot's own frame, ``child``."""
    covariance = np.diag(POSE_VARIANCES).ravel()
    linear = {"x": float(twist[0])}
    angular = {"z": float(twist[1])}
    speeds = {"linear": linear, "angular": angular}
    return {
        "header": header,
        "child_frame_id": child,
        "pose": {"pose": pose_fields(pose), "covariance": covariance},
        "twist": {"twist": speeds, "covariance": covariance},
    }


def scan_fields(
    header: Fields, ranges: Float32Array, laser: LaserGeometry, scan_time: float
) -> Fields:
    """The fields of a LaserScan message; no return is +inf, as REP 117 has it.

    Args:
        header: Of the first beam.
        ranges: (num_beams,) [m].
        laser: The laser.
        scan_time: Time until the next scan [s].
    """
    first = laser.angle_min
    last = laser.angle_min + laser.field_of_view
    step = laser.angle_increment
    if laser.time_increment < 0.0:  # the beam that is measured first comes first
        first, last = last, first
        step = -step
        ranges = ranges[::-1]
    return {
        "header": header,
        "angle_min": first,
        "angle_max": last,
        "angle_increment": step,
        "time_increment": abs(laser.time_increment),
        "scan_time": scan_time,
        "range_min": laser.range_min,
        "range_max": laser.range_max,
        "ranges": np.ascontiguousarray(ranges, dtype=np.float32),
        "intensities": np.zeros(0, dtype=np.float32),
    }


def grid_fields(header: Fields, grid: OccupancyGrid) -> Fields:
    """The fields of an OccupancyGrid message: 0 free, 100 occupied, -1 unknown, row 0 at the bottom."""
    data = np.full(grid.cells.shape, -1, dtype=np.int8)
    data[grid.cells == FREE] = 0
    data[grid.cells == OCCUPIED] = 100
    frame = grid.frame
    corner = Pose2D(frame.origin_x, frame.origin_y, 0.0)
    info = {
        "resolution": frame.resolution,
        "width": frame.width_px,
        "height": frame.height_px,
        "origin": pose_fields(corner),
        "map_load_time": header["stamp"],
    }
    return {"header": header, "info": info, "data": data[::-1].ravel()}
