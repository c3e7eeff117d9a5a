"""The finished map that a robot is given to localise on: a file, or the plan as a drawing."""

from slamgym.cad import FloorPlan
from slamgym.core.types import UNKNOWN, OccupancyGrid, Pose2D
from slamgym.envs.config import ExploreConfig
from slamgym.interop import read_ros_map


def finished_map(plan: FloorPlan, start: Pose2D, config: ExploreConfig) -> OccupancyGrid | None:
    """The map, in the map frame; None where the settings ask for none.

    Args:
        plan: The building.
        start: Where the robot stands at first, world frame.
        config: Whether a map is given, and which.

    Raises:
        InputFileError: If the map's file can't be read.
    """
    if config.slam.mode != "map":
        return None
    if config.finished_map is None:
        return plan.raster(config.slam.resolution, offset=(start.x, start.y), outside=UNKNOWN)
    grid = read_ros_map(config.finished_map)
    frame = grid.frame._replace(
        origin_x=grid.frame.origin_x - start.x, origin_y=grid.frame.origin_y - start.y
    )
    return OccupancyGrid(grid.cells, frame)
