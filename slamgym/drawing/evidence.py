"""The evidence that a map holds of what is drawn.

Along each wall its faces are looked at every few centimetres: where the map has an occupied cell nearby, the wall was
seen. Floor was observed where the map says free.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from slamgym.cad.floorplan import fill_segments, ring_segments
from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
)
from slamgym.drawing.contours import trace_patches
from slamgym.drawing.polygons import SMALLEST_HOLE
from slamgym.drawing.settings import DRAWN_DOORS, SMALLEST_ROOM, USUAL_CELL
from slamgym.drawing.walls import WallPiece
from slamgym.metrics.maps import distance_to

SEEN_WITHIN = 0.15
"""A piece of wall was seen if the map has an occupied cell within this, which is then the wall's [m]."""
HIDDEN_DEPTHS = (0.1, 0.2, 0.35)
"""Distances from a wall's other face at which the space behind it is looked at [m]."""


class Evidence:
    """A map, prepared for the question what was seen."""

    def __init__(self, grid: OccupancyGrid) -> None:
        """Measure distances in a map."""
        self.grid = grid
        self._to_wall = distance_to(grid.cells == OCCUPIED) * grid.frame.resolution

    def seen_along(self, piece: WallPiece) -> BoolArray:
        """True for places along a wall with an occupied cell within :data:`SEEN_WITHIN` of either face."""
        depths = [0.0, piece.thickness] if piece.known else [0.0]
        places = _places(piece, depths)
        distances = values_at(self._to_wall, self.grid.frame, places, math.inf)
        return distances.min(axis=0) <= SEEN_WITHIN

    def hidden_behind(self, piece: WallPiece) -> float:
        """Share of the space just behind a wall that is unknown."""
        depths = [piece.thickness + depth for depth in HIDDEN_DEPTHS]
        places = _places(piece, depths)
        cells = values_at(self.grid.cells, self.grid.frame, places, UNKNOWN)
        return float((cells == UNKNOWN).mean())


def _places(piece: WallPiece, depths: list[float]) -> FloatArray:
    """Where a wall is looked at: N places along it, a cell apart, at depths D behind its face, (D, N, 2) [m]."""
    count = max(2, math.ceil(piece.length / USUAL_CELL))
    shares = (np.arange(count) + 0.5) / count
    places = [piece.places(shares, depth) for depth in depths]
    return np.stack(places)


def values_at(
    picture: np.ndarray, frame: GridFrame, points: FloatArray, beyond: float
) -> np.ndarray:
    """Values of the cells under points (..., 2) [m]; ``beyond`` outside of the picture."""
    rows, cols = frame.to_cell(points[..., 0], points[..., 1])
    in_rows = (rows >= 0) & (rows < frame.height_px)
    in_cols = (cols >= 0) & (cols < frame.width_px)
    inside = in_rows & in_cols
    any_row = np.where(inside, rows, 0)
    any_col = np.where(inside, cols, 0)
    values = picture[any_row, any_col]
    return np.where(inside, values, beyond)


def filled(shape: shapely.Geometry, frame: GridFrame) -> BoolArray:
    """The cells of a frame whose centres lie in polygons."""
    rings = shapely.get_rings(polygon_parts(shape))
    return fill_segments(ring_segments(rings), frame)


class FilledPatch(NamedTuple):
    """A part of a map, and which of its cells are meant."""

    place: tuple[slice, slice]  # rows and columns
    inside: BoolArray


def filled_patch(shape: Polygon, frame: GridFrame) -> FilledPatch:
    """The cells of a frame whose centres lie in a polygon, and where: most of a large map is far from a room."""
    min_x, min_y, max_x, max_y = shape.bounds
    first_row, first_col = frame.to_cell(min_x, max_y)
    last_row, last_col = frame.to_cell(max_x, min_y)
    top, bottom = np.clip([first_row, last_row + 1], 0, frame.height_px).tolist()
    left, right = np.clip([first_col, last_col + 1], 0, frame.width_px).tolist()
    x = frame.origin_x + left * frame.resolution
    y = frame.origin_y + (frame.height_px - bottom) * frame.resolution
    part = GridFrame(frame.resolution, x, y, bottom - top, right - left)
    return FilledPatch((slice(top, bottom), slice(left, right)), filled(shape, part))


def unseen_floor(floor: MultiPolygon, grid: OccupancyGrid) -> list[Polygon]:
    """Patches of the floor that the robot never observed: not free in the map, and not next to a wall's face."""
    inside = filled(floor, grid.frame)
    unseen = inside & (grid.cells == UNKNOWN)
    three = np.ones((3, 3), np.uint8)
    closed = cv2.morphologyEx(unseen.astype(np.uint8), cv2.MORPH_CLOSE, three)
    closed &= inside
    # Between the map's last free cell and a wall's face there may be a single cell of unknown: patches have a width.
    two = np.ones((2, 2), np.uint8)
    wide = cv2.morphologyEx(closed, cv2.MORPH_OPEN, two) > 0
    return cell_polygons(wide, grid.frame, SMALLEST_HOLE)


def undrawn_cells(floor: MultiPolygon, seen: BoolArray, frame: GridFrame) -> BoolArray:
    """Cells of the free space that the robot saw (H, W) farther than :data:`SEEN_WITHIN` from the floor [m]."""
    lost = seen & (distance_to(filled(floor, frame)) > SEEN_WITHIN / frame.resolution)
    return np.asarray(lost, np.bool_)


def left_out_floor(lost: BoolArray, frame: GridFrame) -> list[Polygon]:
    """Patches of seen floor that isn't drawn, (H, W), the largest first; none narrower than a door, and none small."""
    half = 0.5 * DRAWN_DOORS[0] / frame.resolution
    wide = distance_to(distance_to(~np.pad(lost, 1)) > half) <= half
    patches = cell_polygons(wide[1:-1, 1:-1] & lost, frame, SMALLEST_ROOM)
    return sorted(patches, key=lambda patch: -patch.area)


def cell_polygons(cells: BoolArray, frame: GridFrame, smallest: float) -> list[Polygon]:
    """Patches of cells of at least an area [m2] as smooth polygons, without holes that are smaller."""
    return list(shapely.simplify(trace_patches(cells, frame, smallest), 0.5 * frame.resolution))


def echo_outlines(grid: OccupancyGrid) -> list[Polygon]:
    """What a map has of walls and things: its patches of occupied cells, down to a single one."""
    smallest = 0.25 * grid.frame.resolution**2
    return cell_polygons(grid.cells == OCCUPIED, grid.frame, smallest)


def share_known(shape: Polygon, grid: OccupancyGrid) -> float:
    """Share of a polygon of which the map says something."""
    patch = filled_patch(shape, grid.frame)
    if not patch.inside.any():
        return 0.0
    is_known = grid.cells[patch.place][patch.inside] != UNKNOWN
    return float(is_known.mean())


def share_seen_open(line: FloatArray, grid: OccupancyGrid) -> float:
    """Share of a line (2, 2) [m] that the map shows as free."""
    start, end = line
    share = np.linspace(0.1, 0.9, 17)[:, None]
    points = start + share * (end - start)
    cells = values_at(grid.cells, grid.frame, points, UNKNOWN)
    return float((cells == FREE).mean())
