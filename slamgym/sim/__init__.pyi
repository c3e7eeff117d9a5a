from .clutter import Clutter, ClutterConfig, make_clutter
from .lidar import Lidar, LidarConfig, LidarLevel, Sighting, lidar_level
from .people import Crowd, Person
from .raycast import cast_rays
from .robot import RobotConfig
from .space import Motion, World
from .start import sample_start
from .surfaces import SurfaceConfig, Surfaces, make_surfaces
from .wheel_odometry import (
    OdometryConfig,
    OdometryLevel,
    WheelOdometry,
    name_of_odometry,
    odometry_level,
)

__all__ = [
    "Clutter",
    "ClutterConfig",
    "Crowd",
    "Lidar",
    "LidarConfig",
    "LidarLevel",
    "Motion",
    "OdometryConfig",
    "OdometryLevel",
    "Person",
    "RobotConfig",
    "Sighting",
    "SurfaceConfig",
    "Surfaces",
    "WheelOdometry",
    "World",
    "cast_rays",
    "lidar_level",
    "make_clutter",
    "make_surfaces",
    "name_of_odometry",
    "odometry_level",
    "sample_start",
]
