"""The parametric CAD -> SLAM model: a floor plan and a trajectory in, a SLAM-like map with its field out."""

from slamgym.parametric.config import ParametricConfig, preset
from slamgym.parametric.model import Deformation, deform
from slamgym.parametric.paths import plan_trajectory, read_waypoints, trajectory_from_file
from slamgym.parametric.trajectory import TimedTrajectory, Waypoints, drive, from_recorded
from slamgym.parametric.warp import densify, invert, warp

__all__ = [
    "Deformation",
    "ParametricConfig",
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
    "trajectory_from_file",
    "warp",
]
