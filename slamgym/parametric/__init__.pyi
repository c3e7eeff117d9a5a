from .config import ParametricConfig
from .generator import map_along_path
from .model import Deformation, deform
from .paths import Waypoints, check_recorded, drive, read_waypoints, trajectory_from_file
from .tours import plan_trajectory
from .warp import densify, invert, warp

__all__ = [
    "Deformation",
    "ParametricConfig",
    "Waypoints",
    "check_recorded",
    "deform",
    "densify",
    "drive",
    "invert",
    "map_along_path",
    "plan_trajectory",
    "read_waypoints",
    "trajectory_from_file",
    "warp",
]
