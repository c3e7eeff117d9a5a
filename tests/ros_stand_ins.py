"""Messages without ROS for its tests: tf2_msgs, nav2_msgs and map_msgs have no wheels, and reading needs none."""

import math
from types import SimpleNamespace

import numpy as np

from slamgym.core.types import LaserGeometry, Pose2D
from slamgym.interop.ros_messages import header_fields, odometry_fields, pose_fields, scan_fields

LASER = LaserGeometry(90, -math.pi / 2, math.pi / 89, 0.12, 3.5, Pose2D(-0.064, 0.0, 0.0))


class Message(SimpleNamespace):
    """A message by its fields; those that aren't named are zero."""

    def __init__(self, **fields):
        super().__init__(**{name: _value(value) for name, value in fields.items()})

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return 0.0


def _value(value):
    return Message(**value) if isinstance(value, dict) else value


def header(stamp, frame):
    """The fields of a header."""
    return header_fields(round(stamp * 1e9), frame)


def scan(stamp, ranges, laser=LASER, frame="base_scan", **others):
    """A LaserScan."""
    return Message(
        **{**scan_fields(header(stamp, frame), np.asarray(ranges), laser, 0.2), **others}
    )


def odometry(stamp, pose, frame="odom"):
    """An Odometry message."""
    return Message(**odometry_fields(header(stamp, frame), "base_footprint", pose, np.zeros(2)))


def pose_on_map(stamp, pose, frame="map"):
    """A PoseWithCovarianceStamped."""
    return Message(header=header(stamp, frame), pose={"pose": pose_fields(pose)})


def transform(stamp, parent, child, pose, *, flipped=False, z=0.0):
    """A TransformStamped; ``flipped`` is turned half about the x axis of the child first."""
    half = 0.5 * pose.theta
    turn = (
        (math.cos(half), math.sin(half), 0.0, 0.0)
        if flipped
        else (0.0, 0.0, math.sin(half), math.cos(half))
    )
    return Message(
        header=header(stamp, parent),
        child_frame_id=child,
        transform={
            "translation": {"x": pose.x, "y": pose.y, "z": z},
            "rotation": dict(zip("xyzw", turn, strict=True)),
        },
    )


class Transforms(Message):
    """A TFMessage."""

    def __init__(self, transforms=()):
        super().__init__(transforms=list(transforms))
