"""The map of what was merged: scans drawn where the graph has them, pictures wherever those say nothing."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)


class Picture(NamedTuple):
    """A bare map and where it lies."""

    grid: OccupancyGrid
    pose: FloatArray  # (3,) of the grid's frame in the frame of the merged map


def paint(pictures: Sequence[Picture], lattice: GridFrame) -> OccupancyGrid:
    """Lay pictures on each other: what the first ones know stands.

    Args:
        pictures: The first ones count most.
        lattice: The map has its cells, as many as are needed.
    """
    step = lattice.resolution
    left = bottom = np.inf
    right = top = -np.inf
    for grid, pose in pictures:
        x0, y0, x1, y1 = grid.frame.bounds
        corners = np.array([(x0, y0), (x0, y1), (x1, y0), (x1, y1)])
        placed = transform_points(Pose2D(*pose.tolist()), corners)
        left, bottom = np.minimum((left, bottom), placed.min(axis=0))
        right, top = np.maximum((right, top), placed.max(axis=0))
    x, y = lattice.origin_x, lattice.origin_y
    before = np.ceil(np.array([x - left, y - bottom]) / step - 1e-6)
    beyond = np.ceil(np.array([right - x, top - y]) / step - 1e-6)
    cols, rows = (before + beyond).astype(int).tolist()
    frame = GridFrame(step, float(x - before[0] * step), float(y - before[1] * step), rows, cols)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    for picture in reversed(pictures):
        layer = _on_frame(picture, frame)
        is_known = layer != UNKNOWN
        cells[is_known] = layer[is_known]
    return OccupancyGrid(cells, frame)


def _on_frame(picture: Picture, frame: GridFrame) -> ByteArray:
    """A picture on another grid: the nearest cell, and every wall."""
    grid = picture.grid
    pose = Pose2D(*picture.pose.tolist())
    rows, cols = np.indices(frame.shape)
    x, y = frame.to_point(rows, cols)
    points = transform_points(inverse(pose), np.stack([x, y], axis=-1))
    seen_rows, seen_cols = grid.frame.to_cell(points[..., 0] + 1e-9, points[..., 1] + 1e-9)
    height, width = grid.cells.shape
    is_inside = (seen_rows >= 0) & (seen_rows < height) & (seen_cols >= 0) & (seen_cols < width)
    layer = np.full(frame.shape, UNKNOWN, np.uint8)
    layer[is_inside] = grid.cells[seen_rows[is_inside], seen_cols[is_inside]]
    walls = np.column_stack(grid.frame.to_point(*np.nonzero(grid.cells == OCCUPIED)))
    placed = transform_points(pose, walls)
    rows, cols = frame.to_cell(placed[:, 0], placed[:, 1])
    layer[np.clip(rows, 0, frame.height_px - 1), np.clip(cols, 0, frame.width_px - 1)] = OCCUPIED
    return layer
