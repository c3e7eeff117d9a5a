from .context import ExplorerContext
from .costmap import Costmap, CostmapConfig, crop_known, free_body, make_costmap
from .frontiers import Frontier, Reachable, expected_gain, find_frontiers, reachable_space
from .grid_path import path_is_free, place_near, plan_path
from .navigator import Goal, GoalStatus, Navigator, NavigatorConfig
from .path_follower import FollowerConfig, PathFollower
from .unmapped import mark_obstacles

__all__ = [
    "Costmap",
    "CostmapConfig",
    "ExplorerContext",
    "FollowerConfig",
    "Frontier",
    "Goal",
    "GoalStatus",
    "Navigator",
    "NavigatorConfig",
    "PathFollower",
    "Reachable",
    "crop_known",
    "expected_gain",
    "find_frontiers",
    "free_body",
    "make_costmap",
    "mark_obstacles",
    "path_is_free",
    "place_near",
    "plan_path",
    "reachable_space",
]
