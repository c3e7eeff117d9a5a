"""Planning on the map that the robot believes in: frontiers, costmap, paths, and the navigation stack.

Nothing here sees a floor plan or a true pose: the inputs are an occupancy grid, an estimated pose and a scan.
"""

from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import (
    Costmap,
    CostmapConfig,
    clear_seen,
    crop_known,
    footprint_radii,
    free_body,
    make_costmap,
    mark_obstacles,
)
from slamgym.planning.frontiers import (
    Frontier,
    Reachable,
    expected_gain,
    find_frontiers,
    occluded_views,
    reachable_space,
    wavefront_frontiers,
)
from slamgym.planning.grid_path import GridPath, path_is_free, place_near, plan_path
from slamgym.planning.navigator import Goal, GoalStatus, Navigator, NavigatorConfig
from slamgym.planning.path_follower import FollowerConfig, PathFollower

__all__ = [
    "Costmap",
    "CostmapConfig",
    "ExplorerContext",
    "FollowerConfig",
    "Frontier",
    "Goal",
    "GoalStatus",
    "GridPath",
    "Navigator",
    "NavigatorConfig",
    "PathFollower",
    "Reachable",
    "clear_seen",
    "crop_known",
    "occluded_views",
    "expected_gain",
    "find_frontiers",
    "footprint_radii",
    "free_body",
    "make_costmap",
    "mark_obstacles",
    "path_is_free",
    "place_near",
    "plan_path",
    "reachable_space",
    "wavefront_frontiers",
]
