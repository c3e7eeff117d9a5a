"""Agreement of a map with the true one: walls found, image error.

Convention: both maps are images of one shape on one frame (row 0 at the top); only :func:`aligned_error`
first searches for the motion that brings one onto the other.

The wall of a map is its occupied cells, or the boundary of its free space: that exists in every kind of map (a
CAD drawing with solid walls, a SLAM map with one cell of wall and unknown space behind, the output of a network),
and a missing inner wall is a missing boundary, which the mean squared error of the free space hardly notices.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from slamgym.core.thin_walls import SHARE_STEPS, close_thin_walls
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
)

MIN_OCCUPIED_SHARE = 0.3
"""A shrunk cell is occupied if this share of it was: a wall one cell thick survives shrinking to a third."""

CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
"""A cell and its four neighbours."""


@dataclass(frozen=True)
class WallScore:
    """Agreement of wall cells within a tolerance; all values lie in [0, 1]."""

    precision: float
    """Share of the map's wall cells that lie near a true wall."""
    recall: float
    """Share of the true wall cells that lie near a wall of the map."""

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        total = self.precision + self.recall
        if total <= 0.0:
            return 0.0
        return 2.0 * self.precision * self.recall / total


def wall_score(walls: BoolArray, true_walls: BoolArray, tolerance_px: float = 2.0) -> WallScore:
    """Compare wall cells.

    Args:
        walls: Wall cells of the map, shape (rows, cols).
        true_walls: True wall cells, same shape.
        tolerance_px: How far a cell may lie from its counterpart and still count as found [cells].

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(walls, true_walls)
    if not walls.any() or not true_walls.any():
        same = float(walls.any() == true_walls.any())
        return WallScore(same, same)
    to_truth = distance_to(true_walls)
    to_walls = distance_to(walls)
    is_true = to_truth[walls] <= tolerance_px
    is_found = to_walls[true_walls] <= tolerance_px
    precision = float(is_true.mean())
    recall = float(is_found.mean())
    return WallScore(precision, recall)


def free_space(cells: ByteArray) -> FloatArray:
    """The image on which the paper's Table I is computed: 1 where free, 0 in walls and the unknown."""
    is_free = cells == FREE
    return is_free.astype(np.float64)


def squared_error(image: FloatArray, target: FloatArray) -> float:
    """Mean squared error of two images with values in [0, 1]."""
    check_same_shape(image, target)
    exact = np.asarray(image, dtype=np.float64)
    difference = exact - target
    return float(np.mean(difference**2))


def crop_to_known(cells: ByteArray, margin_px: int) -> ByteArray:
    """The known part of a map with so many unknown cells around it; the map as it is if nothing is known."""
    known = cells != UNKNOWN
    in_row = known.any(axis=1)
    in_col = known.any(axis=0)
    rows = np.flatnonzero(in_row)
    cols = np.flatnonzero(in_col)
    if len(rows) == 0:
        return cells
    in_rows = slice(rows[0], rows[-1] + 1)
    in_cols = slice(cols[0], cols[-1] + 1)
    part = cells[in_rows, in_cols]
    return np.pad(part, margin_px, constant_values=UNKNOWN)


def resample_slam(
    cells: ByteArray, shape: tuple[int, int], min_occupied: float = MIN_OCCUPIED_SHARE
) -> ByteArray:
    """Resample a SLAM map to (rows, cols); values stay 0, 205, 254.

    Args:
        cells: Map values, any shape.
        shape: Rows and columns wanted.
        min_occupied: Share of a shrunk cell from which on it is occupied.
    """
    if cells.shape == shape:
        return cells
    rows, cols = shape
    size = (cols, rows)
    if rows >= cells.shape[0] and cols >= cells.shape[1]:
        grown = cv2.resize(cells, size, interpolation=cv2.INTER_NEAREST_EXACT)
        return np.asarray(grown, dtype=np.uint8)
    occupied = _shrunk(cells == OCCUPIED, size)
    free = _shrunk(cells == FREE, size)
    is_occupied = occupied >= min_occupied
    is_free = free >= 0.5 * (1.0 - occupied)
    result = np.where(is_free, FREE, UNKNOWN)
    # Nothing of it known: neither share may decide.
    result[(free == 0.0) & ~is_occupied] = UNKNOWN
    return np.where(is_occupied, OCCUPIED, result).astype(np.uint8)


def _shrunk(mask: BoolArray, size: tuple[int, int]) -> Float32Array:
    """Share of a mask in each cell of a coarser picture of a size (columns, rows)."""
    image = mask.astype(np.float32)
    share = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(share, dtype=np.float32)


def keep_thin_walls(share: Float32Array, drawing: Float32Array, matrix: FloatArray) -> Float32Array:
    """Close the walls of a drawing that resampling has opened, since they are hardly thicker than a cell.

    Args:
        share: Share of floor of each cell after resampling, shape (rows, cols).
        drawing: The same before that, any shape.
        matrix: (2, 3), from (col, row) of the drawing to that of ``share``.
    """
    kept = share.copy()
    _close_along_rows(kept, drawing, matrix)
    transposed = matrix[::-1, [1, 0, 2]]
    _close_along_rows(kept.T, drawing.T, transposed)
    return kept


def _close_along_rows(share: Float32Array, drawing: Float32Array, matrix: FloatArray) -> None:
    """Close the walls that rows of the drawing cross; ``share`` is changed in place."""
    rows, cols = share.shape
    finer_cols = SHARE_STEPS * (cols - 1) + 1
    size = (finer_cols, rows)
    factors = np.array([[SHARE_STEPS], [1.0]])
    finer = factors * matrix
    image = np.ascontiguousarray(drawing)
    # Cubic: linear interpolation would lift a wall of one cell to a half next to its middle.
    line = cv2.warpAffine(image, finer, size, flags=cv2.INTER_CUBIC)
    close_thin_walls(share, line >= 0.5)


def free_boundary(free: BoolArray) -> BoolArray:
    """The free cells that touch a cell which isn't free, or the border of the image (4-neighbours).

    Args:
        free: Free cells, shape (rows, cols).
    """
    image = free.astype(np.uint8)
    inner = cv2.erode(image, CROSS, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return free & (inner == 0)


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


def boundary_distance(free: BoolArray, true_free: BoolArray, metres_per_px: float) -> float:
    """95 % Hausdorff distance of the walls [m]: the 95th percentile of the distances to the other map's walls.

    The larger of both directions; infinite if one of the maps has no walls and the other has.

    Args:
        free: Free cells of the map, shape (rows, cols).
        true_free: Free cells of the CAD map, same shape and frame.
        metres_per_px: Scale of both [m].

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(free, true_free)
    walls = free_boundary(free)
    true_walls = free_boundary(true_free)
    if not walls.any() or not true_walls.any():
        return 0.0 if walls.any() == true_walls.any() else math.inf
    to_truth = distance_to(true_walls)
    to_map = distance_to(walls)
    from_map = np.percentile(to_truth[walls], 95)
    from_truth = np.percentile(to_map[true_walls], 95)
    worse = float(max(from_map, from_truth))
    return metres_per_px * worse


def intersection_over_union(free: BoolArray, true_free: BoolArray) -> float:
    """Cells that are free in both over cells that are free in either; 1 if nothing is free in both.

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(free, true_free)
    union = np.count_nonzero(free | true_free)
    intersection = np.count_nonzero(free & true_free)
    return float(intersection / union) if union else 1.0


def distance_to(mask: BoolArray) -> FloatArray:
    """Euclidean distance of each cell's centre from that of the nearest true cell [cells]."""
    others = ~mask
    image = others.astype(np.uint8)
    distance = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance, dtype=np.float64)


def check_same_shape(a: np.ndarray, b: np.ndarray) -> None:
    """Refuse two maps that can't lie on one frame.

    Raises:
        ValueError: If the shapes differ.
    """
    if a.shape != b.shape:
        raise ValueError(
            f"the maps have different shapes: {a.shape} and {b.shape}; put them on one frame"
        )
