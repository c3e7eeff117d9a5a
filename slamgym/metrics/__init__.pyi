from .alignment import AlignedError, Similarity, aligned_error, apply_similarity
from .dimensions import Dimensions, measure_dimensions
from .improvement import Improvement, improvement
from .map_error import ObstacleDistance, wall_error, wall_faces
from .map_statistics import displacement_statistics, map_statistics
from .maps import (
    WallDistance,
    WallScore,
    boundary_distance,
    boundary_score,
    coverage,
    free_boundary,
    free_space,
    intersection_over_union,
    known_area,
    squared_error,
    wall_score,
)
from .openings import Openings, compare_openings, unseen_share, vertex_ratio
from .relations import RelationError, end_points, relation_error, revisit_disagreement
from .rooms import RoomRule, RoomScore, label_rooms, room_score
from .trajectory import (
    ErrorStatistics,
    PoseError,
    absolute_trajectory_error,
    align_se2,
    nees_interval,
    normalised_estimation_error_squared,
    poses_at,
    relative_pose_error,
    relative_poses,
)
from .two_sample import TwoSampleResult, two_sample_test

__all__ = [
    "vertex_ratio",
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
    "RoomRule",
    "RoomScore",
    "Similarity",
    "TwoSampleResult",
    "WallDistance",
    "WallScore",
    "absolute_trajectory_error",
    "align_se2",
    "aligned_error",
    "apply_similarity",
    "boundary_distance",
    "boundary_score",
    "coverage",
    "displacement_statistics",
    "end_points",
    "free_boundary",
    "free_space",
    "improvement",
    "intersection_over_union",
    "known_area",
    "label_rooms",
    "map_statistics",
    "nees_interval",
    "normalised_estimation_error_squared",
    "poses_at",
    "relation_error",
    "relative_pose_error",
    "relative_poses",
    "revisit_disagreement",
    "room_score",
    "squared_error",
    "two_sample_test",
    "wall_error",
    "wall_faces",
    "wall_score",
]
