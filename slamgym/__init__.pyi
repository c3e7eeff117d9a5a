from . import (
    agents,
    cad,
    dataset,
    envs,
    gan,
    interop,
    metrics,
    parametric,
    planning,
    sim,
    slam,
    viz,
)
from .agents import make_explorer
from .cad import FloorPlan, open_plans
from .core.errors import SlamgymError
from .dataset import DatasetConfig, build_dataset, load_pair, read_manifest, render_images
from .envs import ExploreConfig, ExploreEnv, ExploreFrontiersEnv, RewardConfig
from .interop import open_log, read_ros_map, write_ros_map
from .parametric import deform
from .sim import LidarConfig, RobotConfig
from .slam import SlamConfig, make_mapper

__version__: str
__all__ = [
    "DatasetConfig",
    "ExploreConfig",
    "ExploreEnv",
    "ExploreFrontiersEnv",
    "FloorPlan",
    "LidarConfig",
    "RewardConfig",
    "RobotConfig",
    "SlamConfig",
    "SlamgymError",
    "agents",
    "build_dataset",
    "cad",
    "dataset",
    "deform",
    "envs",
    "gan",
    "interop",
    "load_pair",
    "make_explorer",
    "make_mapper",
    "metrics",
    "open_log",
    "open_plans",
    "parametric",
    "planning",
    "read_manifest",
    "read_ros_map",
    "render_images",
    "sim",
    "slam",
    "viz",
    "write_ros_map",
]
