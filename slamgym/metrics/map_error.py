"""Error of a robot's map: the mean distance of its occupied cells from the true walls or obstacles [m].

Two truths give two figures. :func:`wall_error` takes the CAD drawing's walls alone, cell by cell, as a dataset
has them: what stands in the rooms counts as an error. :class:`ObstacleDistance` takes the exact outlines of
walls and furniture, as an environment has them: a map without error reaches about a quarter of its cell size,
because hits lie on an outline and the centres of cells lie off it.
"""

import math

import cv2
import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)
from slamgym.metrics.maps import distance_to

_CELL = 0.025
"""Cell size of the distance field [m]; half of the maps', so that its rounding doesn't show."""

_MARGIN = 1.0
"""The field extends this far beyond the building [m]; farther off, the distance at its border is taken."""

_SHIFT = 6  # fractional bits of OpenCV's drawing coordinates


def wall_faces(free: BoolArray) -> BoolArray:
    """The wall cells that touch free space (8-neighbours), shape (rows, cols), of a drawing's free cells."""
    cells = free.astype(np.uint8)
    return (cv2.dilate(cells, np.ones((3, 3), np.uint8)) > cells).astype(np.bool_)


def wall_error(cells: ByteArray, cad: ByteArray, resolution: float) -> float:
    """Mean distance of a map's occupied cells from the nearest face of a CAD wall [m]; 0 if there are none.

    Furniture and people are no part of the CAD map, so with clutter the figure is larger.

    Args:
        cells: Values of the map, shape (rows, cols).
        cad: Values of the CAD map, same shape and frame.
        resolution: [m/cell].
    """
    occupied = cells == OCCUPIED
    if not occupied.any():
        return 0.0
    return float(distance_to(wall_faces(cad == FREE))[occupied].mean() * resolution)


class ObstacleDistance:
    """Distance to the nearest obstacle, for every place in and round a building.

    Args:
        segments: True outlines of walls and furniture, shape (S, 4) [m], world frame.
    """

    def __init__(self, segments: FloatArray) -> None:
        low, high = segments.reshape(-1, 2).min(axis=0), segments.reshape(-1, 2).max(axis=0)
        self.frame = GridFrame.covering((low[0], low[1], high[0], high[1]), _CELL, _MARGIN)
        canvas = np.full(self.frame.shape, 255, dtype=np.uint8)
        # Pixels with row 0 at the bottom; a pixel's centre is at a whole number.
        pixels = (segments.reshape(-1, 2) - [self.frame.origin_x, self.frame.origin_y]) / _CELL - 0.5
        lines = np.rint(pixels * (1 << _SHIFT)).astype(np.int32).reshape(-1, 2, 2)
        cv2.polylines(
            canvas, list(lines), isClosed=False, color=0, thickness=1, lineType=cv2.LINE_8, shift=_SHIFT
        )
        pixels_away = cv2.distanceTransform(canvas, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self._field: Float32Array = (pixels_away * _CELL).astype(np.float32)  # row 0 at the bottom

    def mean_error(self, grid: OccupancyGrid, world_from_map: Pose2D) -> float:
        """Mean distance of a map's occupied cells from the nearest obstacle [m]; 0 if there are none.

        Args:
            grid: The map, map frame.
            world_from_map: The map frame in the world.
        """
        total, count = sum_of_distances(grid.cells, grid.frame, world_from_map, self._field, self.frame)
        return total / count if count else 0.0


@kernel
def sum_of_distances(
    cells: ByteArray, frame: GridFrame, world_from_map: Pose2D, field: Float32Array, field_frame: GridFrame
) -> tuple[float, int]:
    """Sum of the distances [m] of the occupied cells, and their number.

    Convention: ``cells`` has row 0 at the top, ``field`` at the bottom; ``world_from_map`` is the frame of the
    cells in that of the field.
    """
    x, y, theta = world_from_map
    cos, sin = math.cos(theta), math.sin(theta)
    rows, cols = cells.shape
    total, count = 0.0, 0
    for row in range(rows):
        map_y = frame.origin_y + (rows - row - 0.5) * frame.resolution
        for col in range(cols):
            if cells[row, col] != OCCUPIED:
                continue
            map_x = frame.origin_x + (col + 0.5) * frame.resolution
            away_x = x + cos * map_x - sin * map_y - field_frame.origin_x
            away_y = y + sin * map_x + cos * map_y - field_frame.origin_y
            field_col = math.floor(away_x / field_frame.resolution)
            field_row = math.floor(away_y / field_frame.resolution)
            field_col = min(max(field_col, 0), field.shape[1] - 1)
            field_row = min(max(field_row, 0), field.shape[0] - 1)
            total += field[field_row, field_col]
            count += 1
    return total, count
