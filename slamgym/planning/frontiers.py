"""Frontiers: where the space that the robot can get to meets the unknown (Yamauchi 1997).

Two searches share their kernels. :func:`find_frontiers` is the breadth-first search of Explore Lite
(wiki.ros.org/explore_lite) on a costmap, by default with a rule of entry that doesn't stop at inflated
doorways. :func:`wavefront_frontiers` is the wavefront frontier detector (Keidar and Kaminka, "Robot
exploration with fast frontier detection", AAMAS 2012), which needs no costmap.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    Int32Array,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.costmap import (
    FREE_COST,
    INSCRIBED_COST,
    LETHAL_COST,
    NO_INFORMATION,
    Costmap,
)
from slamgym.planning.frontier_kernels import (
    collect_frontiers,
    describe_frontiers,
    flood,
    nearest_open_cell,
)

_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


@kernel
def visible_unknown(costs: ByteArray, row: int, col: int, max_range: float) -> float:
    """Unknown area in sight of a cell, by 72 rays that end at lethal cells [cells^2].

    Its rays run clockwise and are added up in this order, on which the last bit of the sum depends.
    """
    step = 2.0 * np.pi / 72
    area = 0.0
    for i in range(72):
        area = _add_unknown(costs, row, col, np.sin(i * step), np.cos(i * step), max_range, step, area)
    return area


@kernel
def unknown_by_ray(costs: ByteArray, row: int, col: int, max_range: float) -> FloatArray:
    """Unknown area in sight of a cell in each direction, shape (72,) [cells^2].

    Ray i points i * 5 degrees counter-clockwise from +x.
    """
    step = 2.0 * np.pi / 72
    areas = np.zeros(72)
    for i in range(72):
        areas[i] = _add_unknown(costs, row, col, -np.sin(i * step), np.cos(i * step), max_range, step, 0.0)
    return areas


@kernel
def _add_unknown(
    costs: ByteArray, row: int, col: int, dr: float, dc: float, max_range: float, step: float, area: float
) -> float:
    """An area with the unknown along a ray added to it [cells^2].

    The ray stands for its sector, so a cell at distance r counts r times the angle between two rays. It ends at
    a lethal cell; beyond the costmap all is unknown.
    """
    height, width = costs.shape
    for r in range(1, int(max_range) + 1):
        rr, cc = int(np.floor(row + r * dr + 0.5)), int(np.floor(col + r * dc + 0.5))
        cost = _NO_INFORMATION
        if 0 <= rr < height and 0 <= cc < width:
            cost = costs[rr, cc]
        if cost == _LETHAL:
            break
        if cost == _NO_INFORMATION:
            area += r * step
    return area


Point = tuple[float, float]
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
_ANY: BoolArray = np.zeros(0, dtype=np.bool_)


@dataclass(frozen=True)
class Frontier:
    """A connected run of unknown cells that border reachable free space. Points are in the map frame [m]."""

    size: int  # number of cells
    min_distance: float  # straight from the robot to the nearest cell [m]
    initial: Point  # the first cell that the search touched
    centroid: Point  # mean of the cells; may lie anywhere, even where the robot stands
    nearest: Point  # the cell nearest to the robot
    middle: Point  # the cell nearest to the centroid
    cells: Int32Array  # (size, 2) rows and columns in the searched grid


class Reachable(NamedTuple):
    """The cells that a robot can get to, from :func:`reachable_space`."""

    order: Int32Array  # (N,) flat indices in the order of the search
    mask: BoolArray  # (H * W,) the same as a mask
    num_centre: int  # the robot's centre can stand on the first so many cells; its body covers the others


def reachable_space(
    costmap: Costmap,
    pose: Pose2D,
    margin: float = 0.3,
    rule: Literal["passable", "descending"] = "passable",
) -> Reachable | None:
    """Cells connected with the robot, or None if it stands on no map or is walled in.

    Args:
        costmap: The costmap.
        pose: The robot, in the frame of the costmap.
        margin: Free cells this near to a place of the robot's centre count too, so that the strips beside
            walls, where no centre can be, are part of the reachable space [m].
        rule: ``"passable"`` enters every cell where the robot's centre can be. ``"descending"`` is Explore
            Lite's own rule: a neighbour is entered if it costs no more than the cell. It can't climb over the
            saddle of cost in an inflated doorway.
    """
    import cv2

    row, col = costmap.frame.to_cell(pose.x, pose.y)
    descending = rule == "descending"
    limit = FREE_COST + 1 if descending else INSCRIBED_COST
    start = nearest_open_cell(costmap.costs, int(row), int(col), limit, _ANY, costmap.costs.size)
    if start < 0:
        return None
    margin_px = 0 if descending else math.ceil(margin / costmap.frame.resolution)
    order, mask = flood(costmap.costs, start, limit, descending)
    widened = mask.reshape(costmap.costs.shape).view(np.uint8)
    passable = (costmap.costs < LETHAL_COST).view(np.uint8)
    for _ in range(margin_px):
        widened = cv2.dilate(widened, _CROSS) & passable
    beside = np.flatnonzero(widened.reshape(-1) > mask.view(np.uint8)).astype(np.int32)
    return Reachable(np.append(order, beside), widened.reshape(-1).view(np.bool_), len(order))


@dataclass(frozen=True)
class Surroundings:
    """A costmap and where the robot stood when it was made."""

    costmap: Costmap
    pose: Pose2D

    @cached_property
    def reachable(self) -> Reachable | None:
        """What the robot can get to: searched when first asked for, which only decisions and plans do."""
        return reachable_space(self.costmap, self.pose)


def frontier_cells(costs: ByteArray, open_cells: BoolArray) -> BoolArray:
    """Unknown cells with an open 4-neighbour, shape (H, W): what all frontiers together consist of.

    Args:
        costs: Costmap, shape (H, W).
        open_cells: What the robot can get to, shape (H * W,).
    """
    import cv2

    opened = open_cells.reshape(costs.shape).view(np.uint8)
    edge: BoolArray = (cv2.dilate(opened, _CROSS) & (costs == NO_INFORMATION).view(np.uint8)).view(np.bool_)
    return edge


def find_frontiers(
    costmap: Costmap,
    pose: Pose2D,
    min_size: float = 0.75,
    rule: Literal["passable", "descending"] = "passable",
    reachable: Reachable | None = None,
) -> list[Frontier]:
    """Explore Lite's search for frontiers.

    Breadth-first, 4-connected from the robot's cell (or the nearest one that it can stand on). An unknown
    cell with a free 4-neighbour starts a frontier, which is grown 8-connected over such cells.

    Args:
        costmap: The costmap.
        pose: The robot, in the frame of the costmap.
        min_size: Frontiers shorter than this are dropped [m] (0.75 in Explore Lite's launch file).
        rule: See :func:`reachable_space`. With ``"descending"`` only cells without any cost make a frontier,
            as in the original.
        reachable: The reachable space, where the caller has it already.

    Returns:
        The frontiers in the order in which the search touched them, which is that of the path length.
    """
    space = reachable or reachable_space(costmap, pose, rule=rule)
    if space is None:
        return []
    open_cells = space.mask if rule == "passable" else (costmap.costs == FREE_COST).reshape(-1)
    return _frontiers(costmap.costs, costmap.frame, pose, space.order, open_cells, min_size)


def wavefront_frontiers(grid: OccupancyGrid, pose: Pose2D, min_size: float = 0.0) -> list[Frontier]:
    """Wavefront frontier detection on a map without a costmap: every free cell is open to the search.

    Args:
        grid: The map.
        pose: The robot, in the frame of the map.
        min_size: Frontiers shorter than this are dropped [m].
    """
    costs = np.full(grid.cells.shape, NO_INFORMATION, dtype=np.uint8)
    costs[grid.cells == FREE] = FREE_COST
    costs[grid.cells == OCCUPIED] = LETHAL_COST
    row, col = grid.frame.to_cell(pose.x, pose.y)
    start = nearest_open_cell(costs, int(row), int(col), FREE_COST + 1, _ANY, costs.size)
    if start < 0:
        return []
    order, mask = flood(costs, start, FREE_COST + 1, False)
    return _frontiers(costs, grid.frame, pose, order, mask, min_size)


def occluded_views(
    costmap: Costmap,
    reachable: Reachable,
    min_area: float = 1.0,
    max_range: float = 1.0,
    spacing: float = 1.0,
) -> list[tuple[Point, Point]]:
    """Views of free space that the map cuts off from the robot, e.g. by a wall drawn across a doorway.

    Looking again may open it. What rays through walls cleared is too narrow to be taken for a room.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        min_area: Smaller regions are left out [m2].
        max_range: Farther than this from a region there is nothing to see of it [m].
        spacing: Smallest distance between two places to look at the same region from [m].

    Returns:
        Where to stand and what point of the region to look at [m]; the largest region first, and of each
        region the nearest places first.
    """
    import cv2

    resolution, frame = costmap.frame.resolution, costmap.frame
    isolated = (costmap.costs < LETHAL_COST) & ~reachable.mask.reshape(costmap.costs.shape)
    opened = cv2.morphologyEx(isolated.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    places = np.column_stack(np.divmod(reachable.order[: reachable.num_centre], frame.width_px))
    views: list[tuple[Point, Point]] = []
    for label in sorted(range(1, count), key=lambda k: -int(stats[k, cv2.CC_STAT_AREA])):
        if stats[label, cv2.CC_STAT_AREA] * resolution**2 < min_area:
            break
        distance = cv2.distanceTransform((labels != label).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        distance = distance[places[:, 0], places[:, 1]] * resolution
        near = np.flatnonzero(distance <= max_range)
        near = near[np.argsort(distance[near], kind="stable")]
        region = np.argwhere(labels == label)
        while len(near):
            place = places[near[0]]
            looked_at = region[np.argmin(((region - place) ** 2).sum(axis=1))]
            x, y = frame.to_point([place[0], looked_at[0]], [place[1], looked_at[1]])
            views.append(((float(x[0]), float(y[0])), (float(x[1]), float(y[1]))))
            apart = np.hypot(*(places[near] - place).T) * resolution
            near = near[apart >= spacing]
    return views


def expected_gain(costmap: Costmap, point: Point, range_max: float) -> float:
    """Unknown area in sight of a point, which a scan from there could reveal at most [m2].

    Sight ends at occupied cells; unknown ones are taken to be free.

    Args:
        costmap: The costmap.
        point: Where the scanner would be [m].
        range_max: Its range [m].
    """
    frame = costmap.frame
    row, col = frame.to_cell(*point)
    seen = visible_unknown(costmap.costs, int(row), int(col), range_max / frame.resolution)
    return float(seen) * frame.resolution**2


def view_gain(costmap: Costmap, point: Point, max_range: float, geometry: LaserGeometry) -> float:
    """Unknown area that a scanner would see from a place in the heading that shows most [m2].

    The optimistic measure of Gonzalez-Banos and Latombe ("Navigation strategies for exploring indoor environments",
    IJRR 21(10-11), 2002): whatever is unknown is taken to be free.

    Args:
        costmap: The costmap.
        point: Where the robot would stand [m].
        max_range: How far the scanner is trusted [m].
        geometry: The scanner, whose field is turned as a whole.
    """
    row, col = costmap.frame.to_cell(*point)
    by_ray = unknown_by_ray(costmap.costs, int(row), int(col), max_range / costmap.frame.resolution)
    field = geometry.angle_increment * (geometry.num_beams - 1)
    width = min(len(by_ray), max(1, round(field / (2.0 * math.pi) * len(by_ray))))
    around = np.concatenate([by_ray, by_ray[: width - 1]])
    sums = np.convolve(around, np.ones(width), mode="valid")
    return float(sums.max()) * costmap.frame.resolution**2


def _frontiers(
    costs: ByteArray,
    frame: GridFrame,
    pose: Pose2D,
    order: Int32Array,
    open_cells: BoolArray,
    min_size: float,
) -> list[Frontier]:
    """Collect and describe the frontiers of a flooded grid."""
    import cv2

    # Only cells beside a frontier matter to the search, which are few.
    edge = frontier_cells(costs, open_cells).view(np.uint8)
    beside = cv2.dilate(edge, _CROSS).reshape(-1).view(np.bool_)
    order = order[beside[order]]
    # A tiny amount is subtracted, so that 15 cells of 0.05 m are not less than 0.75 m by rounding.
    members, starts = collect_frontiers(costs, order, open_cells, min_size / frame.resolution - 1e-6)
    row = frame.height_px - 0.5 - (pose.y - frame.origin_y) / frame.resolution
    col = (pose.x - frame.origin_x) / frame.resolution - 0.5
    described = describe_frontiers(members, starts, frame.width_px, row, col)

    def point(row: float, col: float) -> Point:
        x, y = frame.to_point(row, col)
        return float(x), float(y)

    frontiers = []
    for values, first, end in zip(described, starts[:-1], starts[1:], strict=True):
        cells = np.column_stack(np.divmod(members[first:end], frame.width_px))
        frontiers.append(
            Frontier(
                size=int(values[0]),
                min_distance=float(values[1]) * frame.resolution,
                initial=point(cells[0, 0], cells[0, 1]),
                centroid=point(values[2], values[3]),
                nearest=point(values[4], values[5]),
                middle=point(values[6], values[7]),
                cells=cells,
            )
        )
    return frontiers
