from .alignment import AlignedError, Similarity, aligned_error, apply_similarity
from .improvement import Improvement, Interval, improvement, mean_interval, wilson_interval
from .map_statistics import displacement_statistics, map_statistics
from .maps import (
    WallScore,
    coverage,
    free_space,
    known_area,
    squared_error,
    wall_cells,
    wall_score,
)
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
from .walls import (
    WallDistance,
    boundary_distance,
    boundary_score,
    free_boundary,
    intersection_over_union,
)

__all__ = [
    "AlignedError",
    "ErrorStatistics",
    "Improvement",
    "Interval",
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
    "mean_interval",
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
    "wall_cells",
    "wall_score",
    "wilson_interval",
]
