"""What the results are judged by: trajectories, relations, consistency, maps."""

from slamgym.metrics.alignment import AlignedError, Similarity, aligned_error, apply_similarity
from slamgym.metrics.consistency import nees_interval, normalised_estimation_error_squared
from slamgym.metrics.maps import (
    WallScore,
    coverage,
    free_space,
    known_area,
    squared_error,
    wall_cells,
    wall_score,
)
from slamgym.metrics.relations import RelationError, relation_error
from slamgym.metrics.revisits import end_points, revisit_disagreement
from slamgym.metrics.trajectory import (
    ErrorStatistics,
    PoseError,
    absolute_trajectory_error,
    align_se2,
    poses_at,
    relative_pose_error,
    relative_poses,
)

__all__ = [
    "AlignedError",
    "ErrorStatistics",
    "PoseError",
    "RelationError",
    "Similarity",
    "WallScore",
    "absolute_trajectory_error",
    "align_se2",
    "aligned_error",
    "apply_similarity",
    "coverage",
    "end_points",
    "free_space",
    "known_area",
    "nees_interval",
    "normalised_estimation_error_squared",
    "poses_at",
    "relation_error",
    "relative_pose_error",
    "relative_poses",
    "revisit_disagreement",
    "squared_error",
    "wall_cells",
    "wall_score",
]
