"""From an exploration to a pair of images: A, what an architect drew, and B, what the robot believes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from slamgym.core.config import Settings, Within
from slamgym.core.types import UNKNOWN, ByteArray, GridFrame, OccupancyGrid, Pose2D

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan


class PairConfig(Settings, section="pair"):
    """How the images are made."""

    margin: Annotated[float, Within(ge=0.0, lt=100.0)] = 0.5
    """Free border around plan and SLAM map [m]."""


@dataclass(frozen=True)
class MapPair:
    """Two aligned images of one place."""

    cad: ByteArray  # (rows, cols): 0 walls and outside, 254 inside
    slam: ByteArray  # (rows, cols): 0 occupied, 205 unknown, 254 free
    frame: GridFrame  # of both, map frame


def make_pair(plan: FloorPlan, start: Pose2D, slam_map: OccupancyGrid, config: PairConfig) -> MapPair:
    """Draw the plan and place the SLAM map in the smallest common frame.

    The SLAM map's cells are copied, never resampled: the plan is drawn onto the SLAM map's own lattice.

    Args:
        plan: The floor plan, world frame.
        start: Where the robot began, world frame: the origin of the map frame.
        slam_map: The robot's map, map frame.
        config: The border.

    Convention: a world point is ``(start.x, start.y) + map point``; both images share ``frame``, row 0 is at
    the top (largest y).
    """
    min_x, min_y, max_x, max_y = plan.bounds
    in_map = (min_x - start.x, min_y - start.y, max_x - start.x, max_y - start.y)
    frame = common_frame(in_map, slam_map.frame, config.margin)
    cad = plan.raster(frame.resolution, frame=frame, offset=(start.x, start.y))
    return MapPair(cad=cad.cells, slam=place(slam_map, frame), frame=frame)


def common_frame(bounds: tuple[float, float, float, float], grid: GridFrame, margin: float) -> GridFrame:
    """The smallest frame on the lattice of ``grid`` that covers bounds [m], the grid and a margin [m]."""
    low = [min(a, b) - margin for a, b in zip(bounds[:2], grid.bounds[:2], strict=True)]
    high = [max(a, b) + margin for a, b in zip(bounds[2:], grid.bounds[2:], strict=True)]
    step, anchor = grid.resolution, (grid.origin_x, grid.origin_y)
    # The small number keeps a border that lies on the lattice from being pushed out by rounding.
    first = [int(np.floor((a - o) / step + 1e-6)) for a, o in zip(low, anchor, strict=True)]
    last = [int(np.ceil((a - o) / step - 1e-6)) for a, o in zip(high, anchor, strict=True)]
    return GridFrame(
        resolution=step,
        origin_x=anchor[0] + first[0] * step,
        origin_y=anchor[1] + first[1] * step,
        height_px=last[1] - first[1],
        width_px=last[0] - first[0],
    )


def place(grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """Copy a grid into a frame that covers it and shares its lattice; cells around it are unknown."""
    left = round((grid.frame.origin_x - frame.origin_x) / frame.resolution)
    bottom = round((grid.frame.origin_y - frame.origin_y) / frame.resolution)
    top = frame.height_px - bottom - grid.frame.height_px
    cells = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
    cells[top : top + grid.frame.height_px, left : left + grid.frame.width_px] = grid.cells
    return cells
