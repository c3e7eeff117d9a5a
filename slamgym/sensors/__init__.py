"""What the robot senses: laser ranges and the turning of its wheels."""

from slamgym.sensors.lidar import Lidar, LidarConfig, lidar_level
from slamgym.sensors.raycast import cast_rays
from slamgym.sensors.wheel_odometry import OdometryConfig, WheelOdometry, odometry_level

__all__ = [
    "Lidar",
    "LidarConfig",
    "OdometryConfig",
    "WheelOdometry",
    "cast_rays",
    "lidar_level",
    "odometry_level",
]
