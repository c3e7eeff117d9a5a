"""Views: from where a frontier can be seen, and how much unknown space a view would show.

The gain of a view is the unknown area within the scanner's range and field that no known obstacle hides, the
optimistic measure of Gonzalez-Banos and Latombe ("Navigation strategies for exploring indoor environments",
IJRR 21(10-11), 2002): whatever is unknown is taken to be free.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.jit import kernel
from slamgym.planning.costmap import Costmap
from slamgym.planning.frontiers import Point, Reachable
from slamgym.types import BoolArray, ByteArray, FloatArray, IntArray, LaserGeometry

NUM_RAYS = 72
"""Rays of a full turn that stand for a scan."""

_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


class View(NamedTuple):
    """What a robot would see of the unknown at a place."""

    heading: float  # where to look to see most [rad]
    gain: float  # unknown area in sight then [m2]


def best_view(costmap: Costmap, point: Point, reach: float, geometry: LaserGeometry) -> View:
    """The heading that shows most of the unknown from a place.

    Args:
        costmap: The costmap.
        point: Where the robot would stand [m].
        reach: How far the scanner is trusted [m].
        geometry: The scanner, whose field is turned as a whole.
    """
    row, col = costmap.frame.to_cell(*point)
    by_ray = unknown_by_ray(costmap.costs, int(row), int(col), reach / costmap.frame.resolution)
    field = geometry.angle_increment * (geometry.num_beams - 1)
    width = min(NUM_RAYS, max(1, round(field / (2.0 * math.pi) * NUM_RAYS)))
    around = np.concatenate([by_ray, by_ray[: width - 1]])
    sums = np.convolve(around, np.ones(width), mode="valid")
    first = int(np.argmax(sums))
    # Within the field the heading is the mean direction of what is seen: it stays if the field has room to spare.
    angles = 2.0 * math.pi / NUM_RAYS * (first + np.arange(width))
    seen = around[first : first + width]
    direction = math.atan2(float(seen @ np.sin(angles)), float(seen @ np.cos(angles)))
    middle = geometry.angle_min + 0.5 * field
    heading = math.remainder(direction - middle, 2.0 * math.pi)
    return View(heading, float(sums[first]) * costmap.frame.resolution**2)


def viewing_places(costmap: Costmap, reachable: Reachable, point: Point, reach: float) -> IntArray:
    """Cells where the robot's centre can be and from which a point at the border of the unknown is seen.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        point: What is to be seen, such as the middle of a frontier [m].
        reach: From no farther than this [m].

    Returns:
        Rows and columns, shape (N, 2), those at the point first.
    """
    centre = np.zeros(costmap.costs.size, dtype=np.bool_)
    centre[reachable.order[: reachable.num_centre]] = True
    row, col = costmap.frame.to_cell(*point)
    cells: IntArray = seen_from(costmap.costs, centre, int(row), int(col), reach / costmap.frame.resolution)
    return cells


@kernel
def unknown_by_ray(costs: ByteArray, row: int, col: int, reach: float) -> FloatArray:
    """Unknown area in sight of a cell in each direction, shape (72,) [cells^2].

    Ray i points i * 5 degrees counter-clockwise from +x and stands for its sector, so a cell at distance r
    counts r times the angle between two rays. Rays end at lethal cells; beyond the costmap all is unknown.
    """
    height, width = costs.shape
    step = 2.0 * np.pi / 72
    areas = np.zeros(72)
    for i in range(72):
        dr, dc = -np.sin(i * step), np.cos(i * step)
        for r in range(1, int(reach) + 1):
            rr, cc = int(np.floor(row + r * dr + 0.5)), int(np.floor(col + r * dc + 0.5))
            cost = _NO_INFORMATION
            if 0 <= rr < height and 0 <= cc < width:
                cost = costs[rr, cc]
            if cost == _LETHAL:
                break
            if cost == _NO_INFORMATION:
                areas[i] += r * step
    return areas


@kernel
def seen_from(costs: ByteArray, wanted: BoolArray, row: int, col: int, reach: float) -> IntArray:
    """Wanted cells in sight of a cell that borders on the unknown, nearest first, shape (N, 2).

    Sight ends at lethal and at unknown cells, but for unknown ones within 2 cells of the first.

    Args:
        costs: Costmap, shape (H, W).
        wanted: Cells to list, shape (H * W,).
        row: Where to look from.
        col: Where to look from.
        reach: Range [cells].
    """
    height, width = costs.shape
    num_rays = 120
    step = 2.0 * np.pi / num_rays
    alive = np.ones(num_rays, np.bool_)
    found = np.empty((num_rays * (int(reach) + 1), 2), np.int64)
    count = 0
    for r in range(int(reach) + 1):
        for i in range(num_rays):
            if not alive[i]:
                continue
            rr = int(np.floor(row - r * np.sin(i * step) + 0.5))
            cc = int(np.floor(col + r * np.cos(i * step) + 0.5))
            if not (0 <= rr < height and 0 <= cc < width):
                alive[i] = False
                continue
            cost = costs[rr, cc]
            if cost == _LETHAL or (cost == _NO_INFORMATION and r > 2):
                alive[i] = False
            elif wanted[rr * width + cc]:
                found[count, 0], found[count, 1] = rr, cc
                count += 1
    return found[:count].copy()
