from .config import ParametricConfig, SensingConfig, preset, realistic
from .model import Deformation, deform
from .paths import (
    TimedTrajectory,
    Waypoints,
    drive,
    from_recorded,
    plan_trajectory,
    read_waypoints,
    trajectory_from_file,
)
from .warp import densify, invert, warp

__all__ = [
    "Deformation",
    "ParametricConfig",
    "SensingConfig",
    "TimedTrajectory",
    "Waypoints",
    "deform",
    "densify",
    "drive",
    "from_recorded",
    "invert",
    "plan_trajectory",
    "preset",
    "read_waypoints",
    "realistic",
    "trajectory_from_file",
    "warp",
]
