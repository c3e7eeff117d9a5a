"""How far the walls of a map lie from the true ones, in metres.

The wall of a map is taken to be the boundary of its free space: it exists in every kind of map (a CAD drawing
with solid walls, a SLAM map with one cell of wall and unknown space behind, the output of a network), and a
missing inner wall is a missing boundary, which the mean squared error of the free space hardly notices.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from slamgym.core.types import BoolArray
from slamgym.metrics.maps import WallScore, check_same_shape, distance_to, wall_score

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


@dataclass(frozen=True)
class WallDistance:
    """Distances between two sets of walls [m]; infinite if one of them is empty and the other isn't."""

    chamfer: float
    """Mean distance to the nearest wall of the other map, averaged over both directions."""
    hausdorff_95: float
    """95th percentile of those distances, the larger of both directions."""


def free_boundary(free: BoolArray) -> BoolArray:
    """The free cells that touch a cell which isn't free, or the border of the image (4-neighbours).

    Args:
        free: Free cells, shape (rows, cols).
    """
    inner = cv2.erode(free.astype(np.uint8), _CROSS, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    boundary: BoolArray = free & (inner == 0)
    return boundary


def boundary_score(
    free: BoolArray, true_free: BoolArray, metres_per_px: float, tolerance: float = 0.1
) -> WallScore:
    """Precision, recall and F1 of the walls, within a tolerance in metres.

    Args:
        free: Free cells of the map, shape (rows, cols).
        true_free: Free cells of the CAD map, same shape and frame.
        metres_per_px: Scale of both [m].
        tolerance: How far a wall may lie from its counterpart [m]. Never less than one pixel is used: two
            rasterisations of the same wall may differ by that.

    Raises:
        ValueError: If the shapes differ.
    """
    tolerance_px = max(1.0, tolerance / metres_per_px)
    return wall_score(free_boundary(free), free_boundary(true_free), tolerance_px)


def boundary_distance(free: BoolArray, true_free: BoolArray, metres_per_px: float) -> WallDistance:
    """Chamfer distance and 95 % Hausdorff distance of the walls.

    Args:
        free: Free cells of the map, shape (rows, cols).
        true_free: Free cells of the CAD map, same shape and frame.
        metres_per_px: Scale of both [m].

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(free, true_free)
    walls, true_walls = free_boundary(free), free_boundary(true_free)
    if not walls.any() or not true_walls.any():
        distance = 0.0 if walls.any() == true_walls.any() else float("inf")
        return WallDistance(distance, distance)
    to_truth, to_map = distance_to(true_walls)[walls], distance_to(walls)[true_walls]
    return WallDistance(
        chamfer=metres_per_px * 0.5 * float(to_truth.mean() + to_map.mean()),
        hausdorff_95=metres_per_px * float(max(np.percentile(to_truth, 95), np.percentile(to_map, 95))),
    )


def intersection_over_union(free: BoolArray, true_free: BoolArray) -> float:
    """Cells that are free in both over cells that are free in either; 1 if nothing is free in both.

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(free, true_free)
    union = np.count_nonzero(free | true_free)
    return float(np.count_nonzero(free & true_free) / union) if union else 1.0
