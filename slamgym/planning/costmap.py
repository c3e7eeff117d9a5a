"""Costmap: an occupancy grid with obstacles inflated by the robot's body.

The cost values and the exponential decay are those of ROS costmap_2d (Lu, Hershberger, Smart: "Layered
Costmaps for Context-Sensitive Navigation", IROS 2014; wiki.ros.org/costmap_2d, section Inflation).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np

from slamgym.core.config import Positive, Settings, Within
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import paste
from slamgym.core.jit import kernel
from slamgym.core.portable import exp
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    IntArray,
    OccupancyGrid,
    Pose2D,
)

FREE_COST = 0
INSCRIBED_COST = 253
LETHAL_COST = 254
NO_INFORMATION = 255
"""Costs as costmap_2d defines them: the robot's centre may stand on a cell below ``INSCRIBED_COST``."""

_COST_SCALING = 3.0
"""Exponential decay of the cost with the distance beyond the inscribed radius [1/m] (TurtleBot3 navigation)."""
_COASTAL_COST = 252
"""Cost of cells out of sight of all obstacles: as much as those at the inscribed radius."""
FARTHEST_WALL = 3.0
"""Distances from obstacles are right up to here, or as far as obstacles cost something, if that is farther [m]."""


class CostmapConfig(Settings, section="costmap"):
    """Settings for the inflation of obstacles."""

    inscribed_radius: Positive = 0.22
    """A robot's centre closer than this to an obstacle is a collision [m]; its radius if it is round."""
    inflation_radius: float = 1.0
    """Obstacles cost something up to this distance [m] (TurtleBot3 navigation default)."""
    coastal_distance: Annotated[float, Within(ge=0.0, infinite=True)] = math.inf
    """Cells farther than this from every obstacle cost again [m]: a scanner that sees nothing can't localise
    the robot (Roy et al., "Coastal navigation", ICRA 1999)."""

    def _check(self) -> None:
        if self.inflation_radius < self.inscribed_radius:
            raise ConfigError(
                f"inflation_radius {self.inflation_radius} m must not be less than inscribed_radius "
                f"{self.inscribed_radius} m"
            )


@dataclass(frozen=True)
class Costmap:
    """Costs of the known part of a map."""

    costs: ByteArray
    """(H, W): 0 free, 1..252 inflated, 253 inscribed, 254 lethal, 255 unknown."""
    distance: Float32Array
    """(H, W) to the nearest occupied cell, between centres [cells]; inf: it is far."""
    frame: GridFrame
    cells: ByteArray
    """(H, W) the map that it was made of."""
    config: CostmapConfig

    @property
    def known_area(self) -> float:
        """Area of the cells that are not unknown [m2]."""
        known = np.count_nonzero(self.costs != NO_INFORMATION)
        return float(known) * self.frame.resolution**2


class _Window(NamedTuple):
    """A box of cells."""

    top: int
    """First row."""
    bottom: int
    """Row after the last one."""
    left: int
    """First column."""
    right: int
    """Column after the last one."""

    @property
    def slices(self) -> tuple[slice, slice]:
        """Its rows and columns, to take it out of an array."""
        rows = slice(self.top, self.bottom)
        cols = slice(self.left, self.right)
        return rows, cols

    def joined(self, other: "_Window") -> "_Window":
        """The smallest box that holds both."""
        top = min(self.top, other.top)
        bottom = max(self.bottom, other.bottom)
        left = min(self.left, other.left)
        right = max(self.right, other.right)
        return _Window(top, bottom, left, right)

    def widened(self, margin: int, shape: tuple[int, ...]) -> "_Window":
        """The box with a margin about it, as far as an array goes."""
        height, width = shape
        top = max(0, self.top - margin)
        bottom = min(height, self.bottom + margin)
        left = max(0, self.left - margin)
        right = min(width, self.right + margin)
        return _Window(top, bottom, left, right)

    def within(self, outer: "_Window") -> "_Window":
        """The same box, counted from where one begins that holds it."""
        top = self.top - outer.top
        bottom = self.bottom - outer.top
        left = self.left - outer.left
        right = self.right - outer.left
        return _Window(top, bottom, left, right)


def crop_known(grid: OccupancyGrid, pose: Pose2D, margin: float = 0.5) -> OccupancyGrid:
    """Copy the part of a map that is known or under the robot, so that later steps don't pay for the rest.

    Args:
        grid: A map, however large.
        pose: The robot, in the frame of the map.
        margin: Kept around the known part and around the robot, as far as the map goes [m].
    """
    frame = grid.frame
    size = frame.resolution
    height, width = frame.shape
    pose_row, pose_col = frame.to_cell(pose.x, pose.y)
    row = min(max(int(pose_row), 0), height - 1)
    col = min(max(int(pose_col), 0), width - 1)
    window = _Window(row, row + 1, col, col + 1)
    known = _known_window(grid.cells)
    if known is not None:
        window = window.joined(known)
    margin_px = math.ceil(margin / size)
    window = window.widened(margin_px, frame.shape)
    rows_below = height - window.bottom
    origin_x = frame.origin_x + window.left * size
    origin_y = frame.origin_y + rows_below * size
    cells = np.array(grid.cells[window.slices], order="C")
    cropped_height, cropped_width = cells.shape
    cropped = GridFrame(size, origin_x, origin_y, cropped_height, cropped_width)
    return OccupancyGrid(cells, cropped)


def free_body(grid: OccupancyGrid, pose: Pose2D, radius: float) -> OccupancyGrid:
    """Copy a map with the cells under the robot set free, as costmap_2d's footprint clearing does.

    The robot stands there, so unknown cells under it are free; occupied ones are kept unless they lie well
    inside the body, because a wall that the robot touches must stay.
    """
    cells = grid.cells.copy()
    row, col = grid.frame.to_cell(pose.x, pose.y)
    radius_px = radius / grid.frame.resolution
    _clear_body(cells, int(row), int(col), radius_px, 0.6 * radius_px)
    return OccupancyGrid(cells, grid.frame)


def cells_inside(frame: GridFrame, points: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows and columns of those points (N, 2) [m] that lie on a grid, and a mask of them, shape (N,)."""
    x = points[:, 0]
    y = points[:, 1]
    row, col = frame.to_cell(x, y)
    in_rows = (row >= 0) & (row < frame.height_px)
    in_cols = (col >= 0) & (col < frame.width_px)
    inside = in_rows & in_cols
    return row[inside], col[inside], inside


def make_costmap(
    grid: OccupancyGrid, config: CostmapConfig | None = None, before: Costmap | None = None
) -> Costmap:
    """Inflate the obstacles of a map.

    A cell nearer than the inscribed radius to an occupied cell costs 253; farther off the cost is
    ``252 exp(-3 / m (d - inscribed_radius))``; unknown cells stay unknown.

    Args:
        grid: The map, which must not be written to afterwards; crop it first (:func:`crop_known`) where most of it is
            unknown.
        config: Radii and decay.
        before: A costmap of an older version of the map on the same lattice. Only what differs from it, and what lies
            near that, is computed again; the result is the same, but for distances of unknown cells beyond its border.
    """
    config = config or CostmapConfig()
    frame = grid.frame
    cells = grid.cells
    costs = np.full(frame.shape, NO_INFORMATION, np.uint8)
    distance = np.full(frame.shape, np.inf, np.float32)
    older = np.full(frame.shape, UNKNOWN, np.uint8)
    offset = None if before is None else _offset_in(before, frame, config)
    if before is not None and offset is not None:
        top, left = offset
        paste(older, before.cells, top, left)
        paste(costs, before.costs, top, left)
        paste(distance, before.distance, top, left)
    table = _cost_table(config, frame.resolution)
    farthest_wall = FARTHEST_WALL / frame.resolution - 1e-9
    farthest_cost = math.sqrt(len(table) - 2)
    reach = math.ceil(max(farthest_wall, farthest_cost))
    changed = _box(cells != older) or _Window(0, 0, 0, 0)
    near = changed.widened(reach, frame.shape)
    around = changed.widened(2 * reach, frame.shape)
    to_occupied = _distance_to_occupied(cells[around.slices])[near.within(around).slices]
    near_cells = cells[near.slices]
    _inflate(to_occupied, near_cells, table, reach, distance[near.slices], costs[near.slices])
    return Costmap(costs, distance, frame, cells, config)


def touched_cells(cells: ByteArray, reach: float) -> ByteArray:
    """1 where an occupied cell lies within ``reach`` cells, else 0: for bodies alone, without distances."""
    import cv2

    half = math.floor(reach)
    squares = np.arange(-half, half + 1) ** 2
    is_within = squares + squares[:, np.newaxis] <= reach**2
    occupied = (cells == OCCUPIED).view(np.uint8)
    return cv2.dilate(occupied, is_within.view(np.uint8)).astype(np.uint8, copy=False)


def _offset_in(before: Costmap, frame: GridFrame, config: CostmapConfig) -> tuple[int, int] | None:
    """Row and column of an older costmap's corner on a frame; None if nothing of it can be taken over.

    The frame must hold the older costmap: else obstacles may have gone beyond the border.
    """
    old = before.frame
    size = frame.resolution
    if before.config != config or old.resolution != size:
        return None
    _, _, _, frame_top = frame.bounds
    _, _, _, old_top = old.bounds
    top = round((old_top - frame_top) / size)
    left = round((frame.origin_x - old.origin_x) / size)
    height, width = frame.shape
    old_height, old_width = old.shape
    holds_rows = old_height - height <= top <= 0
    holds_cols = old_width - width <= left <= 0
    return (top, left) if holds_rows and holds_cols else None


def _distance_to_occupied(cells: ByteArray) -> Float32Array:
    """Distance of each cell to the nearest occupied one, between centres, shape (H, W) [cells]."""
    import cv2  # here, because help pages read the settings above

    is_open = cells != OCCUPIED
    image = is_open.view(np.uint8)
    distance: Float32Array = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance


@kernel
def _inflate(
    to_occupied: Float32Array,
    cells: ByteArray,
    table: ByteArray,
    reach: int,
    distance: Float32Array,
    costs: ByteArray,
) -> None:
    """Write distances and costs of cells.

    Args:
        to_occupied: Distance to the nearest occupied cell, shape (H, W) [cells].
        cells: The map, shape (H, W).
        table: Cost by squared distance.
        reach: What is farther than this counts as infinitely far [cells].
        distance: Out: shape (H, W) [cells].
        costs: Out: shape (H, W).
    """
    farthest = len(table) - 1
    height, width = cells.shape
    for row in range(height):
        for col in range(width):
            # Squared it must be a whole number: the last bit of what OpenCV computes depends on the processor.
            # Without obstacles OpenCV says 2^64, whose square overflows on some processors.
            straight = min(to_occupied[row, col], np.float32(1e6))
            squared = np.rint(straight * straight)
            is_far = squared > reach * reach
            distance[row, col] = np.float32(np.inf) if is_far else np.sqrt(squared)
            is_known = cells[row, col] == FREE or cells[row, col] == OCCUPIED
            entry = farthest if is_far or squared > farthest else int(squared)
            costs[row, col] = table[entry] if is_known else NO_INFORMATION


def _known_window(cells: ByteArray) -> _Window | None:
    """A box round the known cells; None if there is none.

    Its columns come in eights where the map's do: where a box begins decides how places in it are rounded.
    """
    if not cells.flags.c_contiguous or cells.shape[1] % 8:
        return _box(cells != UNKNOWN)
    unknown = np.full(8, UNKNOWN, np.uint8)
    eight_unknown = unknown.view(np.uint64)
    eights = cells.view(np.uint64)
    box = _box(eights != eight_unknown)
    if box is None:
        return None
    return box._replace(left=8 * box.left, right=8 * box.right)


def _box(mask: BoolArray) -> _Window | None:
    """The smallest box that holds a mask; None if it is empty."""
    in_row = mask.any(axis=1)
    rows = np.flatnonzero(in_row)
    if len(rows) == 0:
        return None
    top = int(rows[0])
    bottom = int(rows[-1]) + 1
    in_col = mask[top:bottom].any(axis=0)
    cols = np.flatnonzero(in_col)
    left = int(cols[0])
    right = int(cols[-1]) + 1
    return _Window(top, bottom, left, right)


@lru_cache(maxsize=16)
def _cost_table(config: CostmapConfig, resolution: float) -> ByteArray:
    """Cost by squared distance [cells^2]; the last entry holds for all that is farther."""
    is_coastal = math.isfinite(config.coastal_distance)
    coast = config.coastal_distance if is_coastal else 0.0
    end = max(config.inflation_radius, coast)
    last = math.floor((end / resolution) ** 2 + 1e-9)
    squares = np.arange(last + 1)
    distance = np.sqrt(squares) * resolution
    beyond_body = distance - config.inscribed_radius
    costs = (INSCRIBED_COST - 1) * exp(-_COST_SCALING * beyond_body)
    costs[distance > config.inflation_radius + 1e-9] = FREE_COST
    costs[distance <= config.inscribed_radius + 1e-9] = INSCRIBED_COST
    costs[0] = LETHAL_COST
    beyond = _COASTAL_COST if is_coastal else FREE_COST
    return np.append(costs.astype(np.uint8), np.uint8(beyond))


@kernel
def _clear_body(cells: ByteArray, row: int, col: int, radius_px: float, core_px: float) -> None:
    """Free the cells under the robot: unknown ones within ``radius_px``, all within ``core_px``."""
    height, width = cells.shape
    half = int(radius_px) + 1
    top = max(0, row - half)
    bottom = min(height, row + half + 1)
    left = max(0, col - half)
    right = min(width, col + half + 1)
    for r in range(top, bottom):
        for c in range(left, right):
            squared = (r - row) ** 2 + (c - col) ** 2
            is_unknown = cells[r, c] != OCCUPIED and cells[r, c] != FREE
            farthest = radius_px if is_unknown else core_px
            if squared <= farthest**2:
                cells[r, c] = FREE
