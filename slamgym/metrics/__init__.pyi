from .alignment import AlignedError, Similarity, aligned_error, apply_similarity
from .dimensions import Dimensions, measure_dimensions
from .improvement import Improvement, improvement
from .map_error import ObstacleDistance, wall_error, wall_faces
from .maps import (
    WallScore,
    boundary_distance,
    boundary_score,
    free_boundary,
    free_space,
    intersection_over_union,
    squared_error,
    wall_score,
)
from .openings import Openings, compare_openings, unseen_share
from .rooms import RoomScore, label_rooms, room_score
from .trajectory import (
    ErrorStatistics,
    PoseError,
    RelationError,
    absolute_trajectory_error,
    align_se2,
    normalised_estimation_error_squared,
    poses_at,
    relation_error,
    relative_pose_error,
    relative_poses,
)

__all__ = [
    "unseen_share",
    "measure_dimensions",
    "compare_openings",
    "Openings",
    "Dimensions",
    "AlignedError",
    "ErrorStatistics",
    "Improvement",
    "ObstacleDistance",
    "PoseError",
    "RelationError",
    "RoomScore",
    "Similarity",
    "WallScore",
    "absolute_trajectory_error",
    "align_se2",
    "aligned_error",
    "apply_similarity",
    "boundary_distance",
    "boundary_score",
    "free_boundary",
    "free_space",
    "improvement",
    "intersection_over_union",
    "label_rooms",
    "normalised_estimation_error_squared",
    "poses_at",
    "relation_error",
    "relative_pose_error",
    "relative_poses",
    "room_score",
    "squared_error",
    "wall_error",
    "wall_faces",
    "wall_score",
]
