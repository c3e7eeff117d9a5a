"""Views: from where a frontier can be seen, and how much unknown space a view would show.

The gain of a view is the unknown area within the scanner's range and field that no known obstacle hides, the
optimistic measure of Gonzalez-Banos and Latombe ("Navigation strategies for exploring indoor environments",
IJRR 21(10-11), 2002): whatever is unknown is taken to be free.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.types import IntArray, LaserGeometry
from slamgym.planning.costmap import Costmap
from slamgym.planning.frontiers import Point, Reachable
from slamgym.planning.sight_kernels import seen_from, unknown_by_ray

NUM_RAYS = 72
"""Rays of a full turn that stand for a scan."""


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
