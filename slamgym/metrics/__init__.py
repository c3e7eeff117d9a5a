"""What the results are measured by: trajectories, relations, consistency, maps."""

from slamgym.metrics.alignment import AlignedError, Similarity, aligned_error, apply_similarity
from slamgym.metrics.improvement import Improvement, improvement
from slamgym.metrics.map_error import ObstacleDistance, wall_error, wall_faces
from slamgym.metrics.map_statistics import displacement_statistics, map_statistics
from slamgym.metrics.maps import (
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
    wall_cells,
    wall_score,
)
from slamgym.metrics.relations import RelationError, end_points, relation_error, revisit_disagreement
from slamgym.metrics.rooms import RoomRule, RoomScore, label_rooms, room_score
from slamgym.metrics.trajectory import (
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
from slamgym.metrics.two_sample import TwoSampleResult, two_sample_test

__all__ = [
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
    "wall_cells",
    "wall_error",
    "wall_faces",
    "wall_score",
]
