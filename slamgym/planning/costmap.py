"""Costmap: an occupancy grid with obstacles inflated by the robot's body.

The cost values and the exponential decay are those of ROS costmap_2d (Lu, Hershberger, Smart: "Layered
Costmaps for Context-Sensitive Navigation", IROS 2014; wiki.ros.org/costmap_2d, section Inflation).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from slamgym.core.config import NonNegative, Positive, Settings, Within
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import compose
from slamgym.core.portable import exp
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.costmap_kernels import (
    clear_beams,
    clear_body,
    cost_cells,
    distance_to_occupied,
    stand_apart,
)

FREE_COST = 0
INSCRIBED_COST = 253
LETHAL_COST = 254
NO_INFORMATION = 255
"""Costs as costmap_2d defines them: the robot's centre may stand on a cell below ``INSCRIBED_COST``."""


class CostmapConfig(Settings):
    """How obstacles are inflated."""

    inscribed_radius: Positive = 0.22
    """A robot's centre closer than this to an obstacle is a collision [m]; its radius if it is round."""
    inflation_radius: float = 1.0
    """Obstacles cost something up to this distance [m] (TurtleBot3 navigation default)."""
    cost_scaling: NonNegative = 3.0
    """Exponential decay of the cost with the distance beyond the inscribed radius [1/m] (same source)."""
    coastal_distance: Annotated[float, Within(ge=0.0, infinite=True)] = math.inf
    """Cells farther than this from every obstacle cost again [m]: a scanner that sees nothing can't localise
    the robot (Roy et al., "Coastal navigation", ICRA 1999)."""
    coastal_cost: Annotated[int, Within(ge=1, le=252)] = 100
    """What they cost, 1 to 252."""

    def _check(self) -> None:
        if self.inflation_radius < self.inscribed_radius:
            raise ConfigError(
                f"inflation_radius {self.inflation_radius} m must not be less than "
                f"inscribed_radius {self.inscribed_radius} m"
            )


@dataclass(frozen=True)
class Costmap:
    """Costs of the known part of a map."""

    costs: ByteArray  # (H, W): 0 free, 1..252 inflated, 253 inscribed, 254 lethal, 255 unknown
    distance: Float32Array  # (H, W) distance to the nearest occupied cell, between centres [cells]
    frame: GridFrame

    def cost_at(self, x: float, y: float) -> int:
        """Cost of the cell that holds a point [m]; unknown outside the map."""
        row, col = self.frame.to_cell(x, y)
        if 0 <= row < self.frame.height_px and 0 <= col < self.frame.width_px:
            return int(self.costs[row, col])
        return NO_INFORMATION


def crop_known(grid: OccupancyGrid, pose: Pose2D, margin: float = 0.5) -> OccupancyGrid:
    """Copy the part of a map that is known or under the robot, so that later steps don't pay for the rest.

    Args:
        grid: A map, however large.
        pose: The robot, in the frame of the map.
        margin: Kept around the known part and around the robot, as far as the map goes [m].
    """
    frame = grid.frame
    first_row, end_row, first_col, end_col = _known_window(grid.cells)
    row, col = (int(i) for i in frame.to_cell(pose.x, pose.y))
    row, col = min(max(row, 0), frame.height_px - 1), min(max(col, 0), frame.width_px - 1)
    if end_row == 0:
        first_row, end_row, first_col, end_col = row, row + 1, col, col + 1
    pad = math.ceil(margin / frame.resolution)
    top, bottom = max(0, min(first_row, row) - pad), min(frame.height_px, max(end_row, row + 1) + pad)
    left, right = max(0, min(first_col, col) - pad), min(frame.width_px, max(end_col, col + 1) + pad)
    window = GridFrame(
        resolution=frame.resolution,
        origin_x=frame.origin_x + left * frame.resolution,
        origin_y=frame.origin_y + (frame.height_px - bottom) * frame.resolution,
        height_px=bottom - top,
        width_px=right - left,
    )
    return OccupancyGrid(np.ascontiguousarray(grid.cells[top:bottom, left:right]).copy(), window)


def free_body(grid: OccupancyGrid, pose: Pose2D, radius: float) -> OccupancyGrid:
    """Copy a map with the cells under the robot set free, as costmap_2d's footprint clearing does.

    The robot stands there, so unknown cells under it are free; occupied ones are kept unless they lie well
    inside the body, because a wall that the robot touches must stay.
    """
    cells = grid.cells.copy()
    row, col = grid.frame.to_cell(pose.x, pose.y)
    radius_px = radius / grid.frame.resolution
    clear_body(cells, int(row), int(col), radius_px, 0.6 * radius_px)
    return OccupancyGrid(cells, grid.frame)


def mark_obstacles(grid: OccupancyGrid, points: FloatArray, apart: float = 0.15) -> OccupancyGrid:
    """Copy a map with points seen just now, e.g. on a person, entered as occupied.

    Points nearer than ``apart`` [m] to a wall of the map are taken for that wall and left out, so that small
    errors of the pose don't thicken walls and close doors.

    Args:
        grid: The map.
        points: Points in the frame of the map, shape (N, 2) [m].
        apart: Smallest distance from what the map knows [m].
    """
    cells = grid.cells.copy()
    if len(points):
        row, col = grid.frame.to_cell(*unmapped_points(grid, points, apart).T)
        cells[row, col] = OCCUPIED
    return OccupancyGrid(cells, grid.frame)


def unmapped_points(grid: OccupancyGrid, points: FloatArray, apart: float = 0.15) -> FloatArray:
    """The points (N, 2) [m] that lie on a map and farther than ``apart`` [m] from its walls."""
    row, col = grid.frame.to_cell(points[:, 0], points[:, 1])
    inside = (row >= 0) & (row < grid.frame.height_px) & (col >= 0) & (col < grid.frame.width_px)
    is_apart = stand_apart(grid.cells, row[inside], col[inside], grid.frame.resolution, apart)
    return points[inside][is_apart]


def clear_seen(
    grid: OccupancyGrid,
    pose: Pose2D,
    ranges: Float32Array,
    geometry: LaserGeometry,
    margin: float = 0.3,
    longest: float = 2.5,
) -> OccupancyGrid:
    """Copy a map with walls taken out that a scan sees through, as costmap_2d's raytracing does.

    Args:
        grid: The map.
        pose: The robot, in the frame of the map.
        ranges: Scan, shape (num_beams,) [m].
        geometry: The scanner.
        margin: The last stretch of each beam clears nothing [m].
        longest: Nor does what lies beyond [m].
    """
    frame, cells = grid.frame, grid.cells.copy()
    sensor = compose(pose, geometry.mount)
    clear_beams(
        cells,
        (sensor.x - frame.origin_x) / frame.resolution - 0.5,
        frame.height_px - 0.5 - (sensor.y - frame.origin_y) / frame.resolution,
        sensor.theta,
        ranges / np.float32(frame.resolution),
        geometry.angle_min,
        geometry.angle_increment,
        longest / frame.resolution,
        margin / frame.resolution,
    )
    return OccupancyGrid(cells, frame)


def make_costmap(grid: OccupancyGrid, config: CostmapConfig | None = None) -> Costmap:
    """Inflate the obstacles of a map.

    A cell nearer than the inscribed radius to an occupied cell costs 253; farther off the cost is
    ``252 exp(-cost_scaling (d - inscribed_radius))``; unknown cells stay unknown.

    Args:
        grid: The map; crop it first (:func:`crop_known`) where most of it is unknown.
        config: Radii and decay.
    """
    config = config or CostmapConfig()
    distance = distance_to_occupied(grid.cells)
    table = _cost_table(config, grid.frame.resolution)
    return Costmap(cost_cells(grid.cells, distance, table), distance, grid.frame)


def _known_window(cells: ByteArray) -> tuple[int, int, int, int]:
    """A box (first row, end row, first col, end col) round the known cells; all 0 if there is none.

    Its columns come in eights where the map's do: where a box begins decides how places in it are rounded.
    """
    import cv2  # here, because help pages read the settings above

    step = 8 if cells.flags.c_contiguous and cells.shape[1] % 8 == 0 else 1
    col, row, width, height = cv2.boundingRect((cells != UNKNOWN).view(np.uint8))
    return row, row + height, col // step * step, -(-(col + width) // step) * step


@lru_cache(maxsize=16)
def _cost_table(config: CostmapConfig, resolution: float) -> ByteArray:
    """Cost by squared distance [cells^2]; the last entry holds for all that is farther."""
    coastal = math.isfinite(config.coastal_distance)
    end = max(config.inflation_radius, config.coastal_distance if coastal else 0.0)
    distance = np.sqrt(np.arange(math.floor((end / resolution) ** 2 + 1e-9) + 1)) * resolution
    decayed = (INSCRIBED_COST - 1) * exp(-config.cost_scaling * (distance - config.inscribed_radius))
    decayed[distance > config.inflation_radius + 1e-9] = FREE_COST
    table = np.where(distance <= config.inscribed_radius + 1e-9, INSCRIBED_COST, decayed).astype(np.uint8)
    table[0] = LETHAL_COST
    return np.append(table, np.uint8(config.coastal_cost if coastal else FREE_COST))
