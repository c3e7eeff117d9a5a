"""The simulated world and its sensors: robot, contacts, furniture, people, laser, wheel odometry."""

from slamgym.sim.clutter import Clutter, ClutterConfig, make_clutter
from slamgym.sim.lidar import Lidar, LidarConfig, LidarLevel, lidar_level
from slamgym.sim.people import Crowd, Person
from slamgym.sim.raycast import cast_rays
from slamgym.sim.robot import RobotConfig
from slamgym.sim.space import Motion, World
from slamgym.sim.start import sample_start
from slamgym.sim.wheel_odometry import (
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
    "WheelOdometry",
    "World",
    "cast_rays",
    "lidar_level",
    "make_clutter",
    "name_of_odometry",
    "odometry_level",
    "sample_start",
]
