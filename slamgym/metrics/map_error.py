"""Error of a robot's map: the mean distance of its occupied cells from the true walls or obstacles [m].

Two truths give two figures. :func:`wall_error` takes the CAD drawing's walls alone, cell by cell, as a dataset
has them: what stands in the rooms counts as an error. :class:`ObstacleDistance` takes the exact outlines of
walls and furniture, as an environment has them: a map without error reaches about a quarter of its cell size,
because hits lie on an outline and the centres of cells lie off it.
"""

import math

import cv2
import numpy as np

from slamgym.core.geometry import transform_points
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

_SHIFT = 6
"""Fractional bits of OpenCV's drawing coordinates."""


def wall_faces(free: BoolArray) -> BoolArray:
    """The wall cells that touch free space (8-neighbours), shape (rows, cols), of a drawing's free cells."""
    cells = free.astype(np.uint8)
    around = np.ones((3, 3), np.uint8)
    widened = cv2.dilate(cells, around)
    is_face = widened > cells
    return is_face.astype(np.bool_)


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
    away = distance_to(wall_faces(cad == FREE))
    return float(away[occupied].mean() * resolution)


class ObstacleDistance:
    """Distance to the nearest obstacle, for every place in and round a building.

    Args:
        segments: True outlines of walls and furniture, shape (S, 4) [m], world frame.
    """

    def __init__(self, segments: FloatArray) -> None:
        ends = segments.reshape(-1, 2)
        low_x, low_y = ends.min(axis=0)
        high_x, high_y = ends.max(axis=0)
        bounds = (low_x, low_y, high_x, high_y)
        frame = GridFrame.covering(bounds, _CELL, _MARGIN)
        self.frame = frame
        canvas = np.full(frame.shape, 255, dtype=np.uint8)
        # Pixels with row 0 at the bottom; a pixel's centre is at a whole number.
        origin = [frame.origin_x, frame.origin_y]
        pixels = (ends - origin) / _CELL - 0.5
        fine = np.rint(pixels * (1 << _SHIFT))
        fixed_point = fine.astype(np.int32)
        pairs = fixed_point.reshape(-1, 2, 2)
        lines = list(pairs)
        cv2.polylines(canvas, lines, False, 0, 1, cv2.LINE_8, _SHIFT)
        pixels_away = cv2.distanceTransform(canvas, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        metres_away = pixels_away[::-1] * _CELL
        self._field: Float32Array = metres_away.astype(np.float32)

    def mean_error(self, grid: OccupancyGrid, world_from_map: Pose2D) -> float:
        """Mean distance of a map's occupied cells from the nearest obstacle [m]; 0 if there are none.

        Args:
            grid: The map, map frame.
            world_from_map: The map frame in the world.
        """
        occupied = grid.cells == OCCUPIED
        occupied_row, occupied_col = np.nonzero(occupied)
        places = grid.frame.to_points(occupied_row, occupied_col)
        if not len(places):
            return 0.0
        in_world = transform_points(world_from_map, places)
        x, y = in_world.T
        row, col = self.frame.to_cell(x, y)
        rows, cols = self.frame.shape
        nearest_row = np.clip(row, 0, rows - 1)
        nearest_col = np.clip(col, 0, cols - 1)
        away = self._field[nearest_row, nearest_col]
        total = math.fsum(away.tolist())  # the same on every processor
        return total / len(away)
