"""Frontiers: where the space that the robot can get to meets the unknown (Yamauchi 1997)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.types import (
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    Int32Array,
    LaserGeometry,
    Pose2D,
)
from slamgym.planning.costmap import INSCRIBED_COST, LETHAL_COST, NO_INFORMATION, Costmap
from slamgym.planning.frontier_feature_kernels import unknown_by_ray, unknown_by_rays
from slamgym.planning.frontier_kernels import (
    ANY,
    collect_frontiers,
    farthest_from_walls,
    find_centres,
    flood,
    nearest_open_cell,
)

_BODY_SIDE = 0.3
"""Free cells this near to a place of the robot's centre count as reachable, too [m]: the strips along walls, where no
centre can be."""

Point = tuple[float, float]
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


@dataclass(frozen=True)
class Frontier:
    """A connected run of unknown cells that border reachable free space. Points are in the map frame [m]."""

    size: int  # number of cells
    min_distance: float  # straight from the robot to the nearest cell [m]
    centroid: Point  # mean of the cells; may lie anywhere, even where the robot stands
    nearest: Point  # the cell nearest to the robot
    middle: Point  # the cell nearest to the centroid
    cells: Int32Array  # (size, 2) rows and columns in the searched grid


class Reachable(NamedTuple):
    """The cells that a robot can get to, from :func:`reachable_space`."""

    order: Int32Array
    """(N,) flat indices in the order of the search."""
    mask: BoolArray
    """(H * W,) the same as a mask."""
    num_centre: int
    """The robot's centre can stand on the first so many cells; its body covers the others."""


def reachable_space(costmap: Costmap, pose: Pose2D) -> Reachable | None:
    """Cells connected with the robot, or None if it stands on no map or is walled in.

    Args:
        costmap: The costmap.
        pose: The robot, in the frame of the costmap.
    """
    import cv2

    costs = costmap.costs
    row, col = costmap.frame.to_cell(pose.x, pose.y)
    start = nearest_open_cell(costs, int(row), int(col), INSCRIBED_COST, ANY, costs.size)
    if start < 0:
        return None
    order, mask = flood(costs, start, INSCRIBED_COST)
    is_reached = mask.view(np.uint8)
    widened = is_reached.reshape(costs.shape).copy()
    passable = (costs < LETHAL_COST).view(np.uint8)
    grown = np.empty_like(widened)
    for _ in range(math.ceil(_BODY_SIDE / costmap.frame.resolution)):
        cv2.dilate(widened, _CROSS, grown)
        np.bitwise_and(grown, passable, out=widened)
    covered = widened.reshape(-1)
    beside = np.flatnonzero(covered > is_reached)
    cells = np.append(order, beside.astype(np.int32))
    return Reachable(cells, covered.view(np.bool_), len(order))


def frontier_cells(costs: ByteArray, open_cells: BoolArray) -> BoolArray:
    """Unknown cells with an open 4-neighbour, shape (H, W): what all frontiers together consist of.

    Args:
        costs: Costmap, shape (H, W).
        open_cells: What the robot can get to, shape (H * W,).
    """
    import cv2

    opened = open_cells.reshape(costs.shape).view(np.uint8)
    beside = cv2.dilate(opened, _CROSS)
    unknown = (costs == NO_INFORMATION).view(np.uint8)
    return (beside & unknown).view(np.bool_)


def find_frontiers(
    costmap: Costmap, pose: Pose2D, min_size: float = 0.75, reachable: Reachable | None = None
) -> list[Frontier]:
    """The search for frontiers of Explore Lite (wiki.ros.org/explore_lite), which doesn't stop at inflated doorways.

    Breadth-first, 4-connected from the robot's cell (or the nearest one that it can stand on). An unknown
    cell with a free 4-neighbour starts a frontier, which is grown 8-connected over such cells.

    Args:
        costmap: The costmap.
        pose: The robot, in the frame of the costmap.
        min_size: Frontiers shorter than this are dropped [m] (0.75 in Explore Lite's launch file).
        reachable: The reachable space, where the caller has it already.

    Returns:
        The frontiers in the order in which the search touched them, which is that of the path length.
    """
    space = reachable or reachable_space(costmap, pose)
    runs = frontier_runs(costmap, space, min_size) if space else []
    return [describe_frontier(cells, costmap.frame, pose) for cells in runs]


def frontier_runs(costmap: Costmap, space: Reachable, min_size: float) -> list[Int32Array]:
    """Rows and columns of the cells of each frontier of :func:`find_frontiers`, shapes (size, 2)."""
    import cv2

    # Most reachable cells border nothing unknown: what is collected are frontiers' neighbours in the order of the
    # search, which are few.
    edge = frontier_cells(costmap.costs, space.mask)
    widened = cv2.dilate(edge.view(np.uint8), _CROSS)
    near_edge = widened.reshape(-1).view(np.bool_)
    is_near_edge = near_edge[space.order]
    # A tiny amount is subtracted, so that 15 cells of 0.05 m are not less than 0.75 m by rounding.
    fewest = min_size / costmap.frame.resolution - 1e-6
    members, starts = collect_frontiers(edge, space.order[is_near_edge], fewest)
    rows, cols = np.divmod(members, costmap.frame.width_px)
    cells = np.column_stack([rows, cols])
    return [cells[first:end] for first, end in itertools.pairwise(starts)]


def fits_through(costmap: Costmap, frontier: Frontier, radius: float) -> bool:
    """True if a robot of a radius [m] fits through a frontier of a costmap: one as wide as it, away from walls."""
    farthest: Any = np.float32(farthest_from_walls(costmap.distance, frontier.cells))
    room = min(0.5 * frontier.size, farthest)
    return bool(room * costmap.frame.resolution >= radius)


def describe_frontier(cells: Int32Array, frame: GridFrame, pose: Pose2D) -> Frontier:
    """A frontier of given cells (N, 2), seen from the robot; all in one frame."""
    right = pose.x - frame.origin_x
    up = pose.y - frame.origin_y
    row = frame.height_px - 0.5 - up / frame.resolution
    col = right / frame.resolution - 0.5
    centroid, nearest, middle, squared = find_centres(cells, row, col)
    return Frontier(
        size=len(cells),
        min_distance=math.sqrt(squared) * frame.resolution,
        centroid=frame.to_point(*centroid),
        nearest=frame.to_point(*cells[nearest].tolist()),
        middle=frame.to_point(*cells[middle].tolist()),
        cells=cells,
    )


def expected_gain(costmap: Costmap, point: Point, range_max: float) -> float:
    """Unknown area in sight of a point, which a scan from there could reveal at most [m2].

    Sight ends at occupied cells; unknown ones are taken to be free.

    Args:
        costmap: The costmap.
        point: Where the scanner would be [m].
        range_max: Its range [m].
    """
    return float(expected_gains(costmap, [point], range_max)[0])


def expected_gains(costmap: Costmap, points: Sequence[Point], range_max: float) -> FloatArray:
    """:func:`expected_gain` of several points, shape (N,) [m2]."""
    frame = costmap.frame
    cells = np.array([frame.to_cell(*point) for point in points]).reshape(-1, 2)
    seen = unknown_by_rays(costmap.costs, cells, range_max / frame.resolution)
    return seen.sum(axis=1) * frame.resolution**2


def view_gain(costmap: Costmap, point: Point, max_range: float, geometry: LaserGeometry) -> float:
    """Unknown area that a scanner would see from a place in the heading that shows most [m2].

    The optimistic measure of Gonzalez-Banos and Latombe ("Navigation strategies for exploring indoor environments",
    IJRR 21(10-11), 2002): all that is unknown is taken to be free.

    Args:
        costmap: The costmap.
        point: Where the robot would stand [m].
        max_range: How far the scanner is trusted [m].
        geometry: The scanner, whose field is turned as a whole.
    """
    size = costmap.frame.resolution
    row, col = costmap.frame.to_cell(*point)
    range_px = max_range / size
    by_ray = unknown_by_ray(costmap.costs, int(row), int(col), range_px)
    rays = len(by_ray)
    share_of_turn = geometry.field_of_view / (2.0 * math.pi)
    seen_rays = round(share_of_turn * rays)
    width = min(rays, max(1, seen_rays))
    around = np.concatenate([by_ray, by_ray[: width - 1]])
    sums = np.convolve(around, np.ones(width), mode="valid")
    return float(sums.max()) * size**2
