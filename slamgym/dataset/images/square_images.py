"""From an exploration to a pair of uniform images: square, of one size, in one frame.

The CAD side is drawn again from the vector plan at the images' own resolution. The SLAM side is resampled so
that no occupied cell is lost: where pixels are larger than cells, a pixel is occupied if the centre of an
occupied cell lies in it, which keeps walls as thin as pixels allow and never breaks one; where pixels are
smaller, each shows the cell at its centre. Between unknown and free the larger share of the area decides.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.config import CountOrZero, NonNegative, Settings, Within
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    IntArray,
    OccupancyGrid,
)
from slamgym.dataset.faults import MapFault
from slamgym.dataset.images.format import Scaling

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan

Bounds = tuple[float, float, float, float]
_SUB = 3
"""The plan is drawn so many times finer to measure distances from its faces."""
DRAWN_WALL = 0.15
"""Thickness of wall that an image shows around the floor, if the margin is 0 [m]: SLAM draws 1 to 3 cells."""
_SPIKE_WIDTH = 0.2
"""Narrower free space is no floor [m]: a stray beam clears a spike through the wall."""
_DIGITS = 6
"""Decimals of metres: micrometres, as manifests hold them."""


class DoesNotFitError(SlamgymError):
    """A pair is larger than an image of a fixed scale: both lengths [m]."""

    def __init__(self, length: float, shown: float) -> None:
        self.fault = MapFault("too_large", length, shown)
        super().__init__(self.fault.sentence)


class ImageConfig(Settings):
    """Settings for making the images."""

    size: Annotated[int, Within(ge=16, le=8192)] = 256
    """Rows and columns [px]; the paper's 256."""
    scaling: Scaling = "fit"
    """``fit``: both maps together fill the image, so every pair has its own scale, as in the paper;
    ``fixed``: all pairs have one scale, and what is larger than the image is left out."""
    metres_per_px: Annotated[float, Within(gt=0.0, lt=100.0)] = 0.1
    """The scale, if it is fixed."""
    margin_px: CountOrZero = 4
    """Free border around the plan and the floor of the SLAM map."""
    edge_px: NonNegative = 0.0
    """Thickness of a line along every face of a wall, half of it on the floor. Of a home that fills 256 px, 0, 3 and 7
    give walls of 3, 6 and 10 px; the targets that the paper shows have 10. 0 draws no line but the share of floor of
    every pixel in greys, so that faces are where the plan has them; walls that are thinner than a pixel stay closed."""

    def _check(self) -> None:
        if max(2 * self.margin_px, self.edge_px) >= self.size:
            raise ConfigError(
                f"margin_px and edge_px must leave room in {self.size} px, not {self.margin_px} and {self.edge_px}"
            )


def draw_pair(
    plan: FloorPlan, start: tuple[float, float], slam_map: OccupancyGrid, config: ImageConfig
) -> tuple[ByteArray, ByteArray, GridFrame]:
    """Draw the two images of a pair.

    Args:
        plan: The floor plan, world frame.
        start: Where the robot began, world frame [m]: the origin of the map frame.
        slam_map: The robot's map, map frame.
        config: The settings.

    Returns:
        A and B, each (size, size), and where their pixels lie in the map frame.

    Raises:
        DoesNotFitError: If the scale is fixed and the image too small for what the maps show.

    Convention: row 0 is at the top (largest y) in both.
    """
    start_x, start_y = start
    min_x, min_y, max_x, max_y = plan.bounds
    in_map = (min_x - start_x, min_y - start_y, max_x - start_x, max_y - start_y)
    frame = square_frame(union(in_map, mapped_bounds(slam_map)), config)
    if math.isclose(frame.resolution, slam_map.frame.resolution):
        frame = on_lattice(frame, slam_map.frame)
    segments = plan.segments() - np.array([start_x, start_y, start_x, start_y])
    return draw_plan_image(segments, frame, config.edge_px), resample_map(slam_map, frame), frame


def square_frame(bounds: Bounds, config: ImageConfig) -> GridFrame:
    """The frame of images that show these bounds [m] in their middle.

    Raises:
        DoesNotFitError: If the scale is fixed and the bounds are larger than the image.
    """
    min_x, min_y, max_x, max_y = bounds
    side = max(max_x - min_x, max_y - min_y)
    room = config.size - 2 * config.margin_px
    if config.scaling == "fit":
        scale = math.ceil(side / room * 10**_DIGITS) / 10**_DIGITS
    else:
        scale = config.metres_per_px
        if side > room * scale + 1e-9:
            raise DoesNotFitError(side, room * scale)
    half = 0.5 * config.size * scale
    return GridFrame(
        resolution=scale,
        origin_x=round(0.5 * (min_x + max_x) - half, _DIGITS),
        origin_y=round(0.5 * (min_y + max_y) - half, _DIGITS),
        height_px=config.size,
        width_px=config.size,
    )


def on_lattice(frame: GridFrame, grid: GridFrame) -> GridFrame:
    """A frame moved by less than a cell so that its cells are those of a grid of the same resolution."""
    step = grid.resolution
    cols = round((frame.origin_x - grid.origin_x) / step)
    rows = round((frame.origin_y - grid.origin_y) / step)
    return GridFrame(
        resolution=step,
        origin_x=round(grid.origin_x + step * cols, _DIGITS),
        origin_y=round(grid.origin_y + step * rows, _DIGITS),
        height_px=frame.height_px,
        width_px=frame.width_px,
    )


def mapped_bounds(grid: OccupancyGrid) -> Bounds | None:
    """Extent of the floor that a map shows, with its walls [m]; None if it shows none.

    The spikes of stray beams extend far beyond the building and don't count.
    """
    import cv2

    frame = grid.frame
    step = frame.resolution
    width = max(1, math.ceil(_SPIKE_WIDTH / step))
    free = np.pad((grid.cells == FREE).astype(np.uint8), width)
    floor = cv2.morphologyEx(free, cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    floor = floor[width:-width, width:-width]
    rows = np.flatnonzero(floor.any(axis=1))
    cols = np.flatnonzero(floor.any(axis=0))
    if len(rows) == 0:
        return None
    top = frame.origin_y + frame.height_px * step
    return (
        frame.origin_x + float(cols[0]) * step - DRAWN_WALL,
        top - float(rows[-1] + 1) * step - DRAWN_WALL,
        frame.origin_x + float(cols[-1] + 1) * step + DRAWN_WALL,
        top - float(rows[0]) * step + DRAWN_WALL,
    )


def union(first: Bounds, second: Bounds | None) -> Bounds:
    """The smallest bounds around two."""
    if second is None:
        return first
    min_x, min_y, max_x, max_y = first
    other_min_x, other_min_y, other_max_x, other_max_y = second
    return (
        min(min_x, other_min_x),
        min(min_y, other_min_y),
        max(max_x, other_max_x),
        max(max_y, other_max_y),
    )


def draw_plan_image(segments: FloatArray, frame: GridFrame, edge_px: float) -> ByteArray:
    """Draw the CAD side: 254 inside, 0 walls and outside, with a line of ``edge_px`` along the faces.

    With an ``edge_px`` of 0, pixels that faces cross have greys (:func:`slamgym.cad.floorplan.floor_share`).

    Args:
        segments: All edges of all rings of the plan, shape (S, 4) [m], map frame.
        frame: Where the pixels lie, map frame.
        edge_px: Thickness of the line.

    Returns:
        Shape ``frame.shape``.
    """
    import cv2

    from slamgym.cad.floorplan import fill_segments, floor_share

    if edge_px == 0.0:
        return np.rint(FREE * floor_share(segments, frame)).astype(np.uint8)
    fine = GridFrame(
        resolution=frame.resolution / _SUB,
        origin_x=frame.origin_x,
        origin_y=frame.origin_y,
        height_px=frame.height_px * _SUB,
        width_px=frame.width_px * _SUB,
    )
    inside = fill_segments(segments, fine).astype(np.uint8)
    # From a floor cell's centre to that of the nearest wall cell; the face lies half a cell before it.
    from_face = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - 0.5
    at_centres = from_face[_SUB // 2 :: _SUB, _SUB // 2 :: _SUB]
    return np.where(at_centres > 0.5 * edge_px * _SUB, FREE, OCCUPIED).astype(np.uint8)


def resample_map(grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """Bring a map to another frame and cell size without losing an occupied cell in it.

    Returns:
        Shape ``frame.shape``: 0 occupied, 205 unknown, 254 free; unknown where the map says nothing.
    """
    source = grid.frame
    ratio = frame.resolution / source.resolution
    # Where the new frame's first row and column begin, in cells of the map, from its top left corner.
    top = (source.bounds[3] - frame.bounds[3]) / source.resolution
    left = (frame.origin_x - source.origin_x) / source.resolution
    rows = _overlaps(frame.height_px, source.height_px, top, ratio)
    cols = _overlaps(frame.width_px, source.width_px, left, ratio)
    occupied = grid.cells == OCCUPIED
    free_share = rows @ (grid.cells == FREE).astype(np.float64) @ cols.T
    known_share = free_share + rows @ occupied.astype(np.float64) @ cols.T
    cells: ByteArray = np.where(free_share >= 1.0 - known_share, FREE, UNKNOWN).astype(np.uint8)
    if ratio >= 1.0:
        row, col = np.nonzero(occupied)
        new_row = _cells((row.astype(np.float64) + 0.5 - top) / ratio)
        new_col = _cells((col.astype(np.float64) + 0.5 - left) / ratio)
        there = _within(new_row, frame.height_px) & _within(new_col, frame.width_px)
        cells[new_row[there], new_col[there]] = OCCUPIED
        return cells
    old_row = _cells(top + (np.arange(frame.height_px) + 0.5) * ratio)
    old_col = _cells(left + (np.arange(frame.width_px) + 0.5) * ratio)
    in_rows = _within(old_row, source.height_px)
    in_cols = _within(old_col, source.width_px)
    shown = grid.cells[np.ix_(old_row[in_rows], old_col[in_cols])]
    cells[np.ix_(in_rows, in_cols)] = shown
    return cells


def _within(places: IntArray, count: int) -> BoolArray:
    return (places >= 0) & (places < count)


def _overlaps(count: int, source_count: int, first: float, ratio: float) -> FloatArray:
    """Share of each new pixel, along one axis, that each cell of the map covers, (count, source_count)."""
    low = first + np.arange(count)[:, None] * ratio
    cell = np.arange(source_count)[None, :]
    begin = np.maximum(low, cell)
    end = np.minimum(low + ratio, cell + 1)
    return np.clip(end - begin, 0.0, None) / ratio


def _cells(places: NDArray[np.floating[Any]]) -> IntArray:
    # The small number keeps a centre that lies on a border, but for rounding, on the same side everywhere.
    return np.floor(places + 1e-9).astype(np.int64)
