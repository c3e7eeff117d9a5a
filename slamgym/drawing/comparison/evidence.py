"""What a map says about walls: points on the faces of what is occupied, and from which side they were seen."""

from dataclasses import dataclass

import cv2
import numpy as np

from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)

_BLUR = 1.5
"""Of the free space whose gradient gives the normals [cells]."""


@dataclass(frozen=True)
class MapEvidence:
    """A map in the frame of a plan."""

    points: FloatArray  # (N, 2) [m] on the faces of walls, plan frame
    normals: FloatArray  # (N, 2) towards the free space
    cells: ByteArray
    frame: GridFrame
    plan_from_map: Pose2D
    scale: float = 1.0

    def values(self, points: FloatArray) -> ByteArray:
        """The map's cells at points of the plan's frame, any shape (..., 2); unknown beyond the map."""
        flat = transform_points(inverse(self.plan_from_map), points.reshape(-1, 2)) / self.scale
        row, col = self.frame.to_cell(flat[:, 0], flat[:, 1])
        inside = (row >= 0) & (row < self.cells.shape[0]) & (col >= 0) & (col < self.cells.shape[1])
        found = np.full(len(flat), UNKNOWN, np.uint8)
        found[inside] = self.cells[row[inside], col[inside]]
        return found.reshape(points.shape[:-1])

    def moved(self, plan_from_map: Pose2D, scale: float = 1.0) -> "MapEvidence":
        """The same map laid over the plan in another way."""
        back = transform_points(inverse(self.plan_from_map), self.points) / self.scale
        turn = plan_from_map.theta - self.plan_from_map.theta
        return MapEvidence(
            transform_points(plan_from_map, scale * back),
            transform_points(Pose2D(0.0, 0.0, turn), self.normals),
            self.cells,
            self.frame,
            plan_from_map,
            scale,
        )


def map_evidence(grid: OccupancyGrid) -> MapEvidence:
    """The faces of a map's walls, in its own frame.

    A cell of a thin wall is a point for each side from which it was seen.
    """
    free = grid.cells == FREE
    occupied = grid.cells == OCCUPIED
    blurred = cv2.GaussianBlur(free.astype(np.float32), (0, 0), _BLUR)
    down, right = np.gradient(blurred)
    found = []
    for row_step, col_step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = np.zeros_like(free)
        source = free[max(row_step, 0) or None : row_step or None] if row_step < 0 else free[row_step:]
        source = source[:, max(col_step, 0) :] if col_step >= 0 else source[:, :col_step]
        target = beside[: len(free) - row_step] if row_step >= 0 else beside[-row_step:]
        target = target[:, : free.shape[1] - col_step] if col_step >= 0 else target[:, -col_step:]
        target[:] = source
        row, col = np.nonzero(occupied & beside)
        normal = np.stack(
            [right[row + row_step, col + col_step], -down[row + row_step, col + col_step]], axis=1
        )
        # Pointing away from the free cell: the blur of a thin wall's other side.
        wrong = normal @ [col_step, -row_step] <= 0.0
        normal[wrong] = [col_step, -row_step]
        x, y = grid.frame.to_point(row, col)
        found.append(np.column_stack([x, y, normal / np.maximum(np.hypot(*normal.T), 1e-6)[:, None]]))
    points = np.vstack(found)
    return MapEvidence(points[:, :2], points[:, 2:], grid.cells, grid.frame, Pose2D(0.0, 0.0, 0.0))
