"""The SLAM modes by their names in the settings."""

from collections.abc import Callable

import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.types import LaserGeometry, OccupancyGrid, Pose2D
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.mapper import PoseGraphMapper
from slamgym.slam.localization.localizer import MapLocalizer
from slamgym.slam.mapper import Mapper, PoseTracker
from slamgym.slam.particle_filter import ParticleFilter

MODES: dict[str, Callable[..., Mapper]] = {
    "rbpf": ParticleFilter,
    "pose_graph": PoseGraphMapper,
    "dead_reckoning": PoseTracker,
    "ground_truth": PoseTracker,
}


def make_mapper(
    config: SlamConfig,
    geometry: LaserGeometry,
    initial_pose: Pose2D,
    rng: np.random.Generator,
    finished: OccupancyGrid | None = None,
) -> Mapper:
    """Make the mapper that ``config.mode`` names.

    Args:
        config: Settings.
        geometry: The scanner.
        initial_pose: Where the robot starts in the map frame.
        rng: Source of all randomness; equal seeds and scans give equal maps.
        finished: The map on which mode ``map`` localises; its frame is that of the initial pose.

    Raises:
        ConfigError: If mode ``map`` is given no map.
    """
    if config.mode == "map":
        if finished is None:
            raise ConfigError(
                "slam.mode 'map' needs a finished map to find itself on, and is given none"
            )
        return MapLocalizer(config, geometry, initial_pose, rng, finished)
    return MODES[config.mode](config, geometry, initial_pose, rng)
