from .clutter import Clutter, ClutterConfig, make_clutter
from .lidar import Lidar, LidarConfig, lidar_level
from .people import Crowd, Person
from .raycast import cast_rays
from .robot import RobotConfig
from .space import Motion, World
from .start import sample_start
from .wheel_odometry import OdometryConfig, WheelOdometry, odometry_level

__all__ = [
    "Clutter",
    "ClutterConfig",
    "Crowd",
    "Lidar",
    "LidarConfig",
    "Motion",
    "OdometryConfig",
    "Person",
    "RobotConfig",
    "WheelOdometry",
    "World",
    "cast_rays",
    "lidar_level",
    "make_clutter",
    "odometry_level",
    "sample_start",
]
