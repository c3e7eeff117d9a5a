"""Frontiers: where the space that the robot can get to meets the unknown (Yamauchi 1997)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    Int32Array,
    IntArray,
    LaserGeometry,
    Pose2D,
)
from slamgym.planning.costmap import INSCRIBED_COST, LETHAL_COST, NO_INFORMATION, Costmap
from slamgym.planning.frontier_feature_kernels import unknown_by_ray, unknown_by_rays

_BODY_SIDE = 0.3
"""Free cells this near to a place of the robot's centre count as reachable, too [m]: the strips along walls, where no
centre can be."""

Point = tuple[float, float]
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
ANY: BoolArray = np.zeros(0, dtype=np.bool_)
"""Mask for :func:`nearest_open_cell` that omits no cell."""


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
    farthest: Any = np.float32(_farthest_from_walls(costmap.distance, frontier.cells))
    room = min(0.5 * frontier.size, farthest)
    return bool(room * costmap.frame.resolution >= radius)


def describe_frontier(cells: Int32Array, frame: GridFrame, pose: Pose2D) -> Frontier:
    """A frontier of given cells (N, 2), seen from the robot; all in one frame."""
    right = pose.x - frame.origin_x
    up = pose.y - frame.origin_y
    row = frame.height_px - 0.5 - up / frame.resolution
    col = right / frame.resolution - 0.5
    centroid, nearest, middle, squared = _find_centres(cells, row, col)
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
    field = geometry.angle_increment * (geometry.num_beams - 1)
    share_of_turn = field / (2.0 * math.pi)
    seen_rays = round(share_of_turn * rays)
    width = min(rays, max(1, seen_rays))
    around = np.concatenate([by_ray, by_ray[: width - 1]])
    sums = np.convolve(around, np.ones(width), mode="valid")
    return float(sums.max()) * size**2


@kernel
def _find_centres(
    cells: Int32Array, row: float, col: float
) -> tuple[tuple[float, float], int, int, float]:
    """Mean of some cells (N, 2), which is nearest to a place and which to the mean, and how near squared [cells^2]."""
    count = len(cells)
    rows = 0.0
    cols = 0.0
    nearest = 0
    near = np.inf
    for i in range(count):
        rows += cells[i, 0]
        cols += cells[i, 1]
        squared = (cells[i, 0] - row) ** 2 + (cells[i, 1] - col) ** 2
        if squared < near:
            near = squared
            nearest = i
    rows /= count
    cols /= count
    middle = 0
    least = np.inf
    for i in range(count):
        squared = (cells[i, 0] - rows) ** 2 + (cells[i, 1] - cols) ** 2
        if squared < least:
            least = squared
            middle = i
    return (rows, cols), nearest, middle, near


@kernel
def _farthest_from_walls(distance: Float32Array, cells: Int32Array) -> float:
    """The largest distance of some cells (N, 2) from an obstacle, of a costmap's (H, W) [cells]."""
    farthest = np.float32(0.0)
    for i in range(len(cells)):
        farthest = max(farthest, distance[cells[i, 0], cells[i, 1]])
    return float(farthest)


@kernel
def nearest_open_cell(
    costs: ByteArray, row: int, col: int, limit: int, mask: BoolArray, max_steps: int
) -> int:
    """Flat index of the nearest cell with a cost below ``limit``; -1 if there is none.

    The search spreads 8-connected from a cell and doesn't cross lethal cells, so that it never ends on the
    other side of a wall. Among the cells found it takes the one nearest in a straight line.

    Args:
        costs: Costmap, shape (H, W).
        row: Where the search begins.
        col: Where the search begins.
        limit: The cell found costs less than this.
        mask: The cell found must be in it, shape (H * W,); of shape (0,) for any cell.
        max_steps: How far to search [cells].
    """
    height, width = costs.shape
    if row < 0 or row >= height or col < 0 or col >= width:
        return -1
    # What the search can come to: its marks, and its queue, are no larger than that.
    top = max(0, row - max_steps - 1)
    left = max(0, col - max_steps - 1)
    span = min(width, col + max_steps + 2) - left
    cells = (min(height, row + max_steps + 2) - top) * span
    seen = np.zeros(cells, np.bool_)
    queue = np.empty(cells, np.int32)
    queue[0] = row * width + col
    seen[(row - top) * span + col - left] = True
    head = 0
    tail = 1
    end = 1
    best = np.inf
    found = -1
    ring = 0
    while head < end and ring <= max_steps:
        while head < end:
            cell = queue[head]
            head += 1
            r = cell // width
            c = cell % width
            if costs[r, c] < limit and (mask.size == 0 or mask[cell]):
                squared = (r - row) ** 2 + (c - col) ** 2
                if squared < best:
                    best = squared
                    found = cell
                continue
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    rr = r + dr
                    cc = c + dc
                    if rr < 0 or rr >= height or cc < 0 or cc >= width:
                        continue
                    mark = (rr - top) * span + cc - left
                    if not seen[mark] and costs[rr, cc] != LETHAL_COST:
                        seen[mark] = True
                        queue[tail] = rr * width + cc
                        tail += 1
        end = tail
        ring += 1
        if ring * ring > best:
            break  # all farther rings are farther in a straight line too
    return found


@kernel
def nearest_open_cells(costs: ByteArray, rows: IntArray, cols: IntArray, limit: int) -> IntArray:
    """:func:`nearest_open_cell` of cells, however far, shape (N,)."""
    found = np.empty(len(rows), np.int64)
    for i in range(len(rows)):
        found[i] = nearest_open_cell(costs, rows[i], cols[i], limit, ANY, costs.size)
    return found


@kernel
def flood(costs: ByteArray, start: int, limit: int) -> tuple[Int32Array, BoolArray]:
    """Breadth-first, 4-connected search from a cell.

    Args:
        costs: Costmap, shape (H, W).
        start: Flat index of the first cell.
        limit: Cells below this cost are entered, where the robot's centre can be.

    Returns:
        The cells in the order of the search (flat indices), and a mask of them, shape (H * W,).
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    reached = np.zeros(height * width, np.bool_)
    queue = np.empty(height * width, np.int32)
    queue[0] = start
    reached[start] = True
    head = 0
    tail = 1
    while head < tail:
        cell = queue[head]
        head += 1
        row = cell // width
        col = cell - row * width
        # Written out, because this innermost step is most of the cost of a search; an unsigned index isn't asked
        # whether it counts from the end.
        above = np.uint64(cell - width)
        left = np.uint64(cell - 1)
        right = np.uint64(cell + 1)
        below = np.uint64(cell + width)
        if row > 0 and not reached[above] and flat[above] < limit:
            reached[above] = True
            queue[tail] = above
            tail += 1
        if col > 0 and not reached[left] and flat[left] < limit:
            reached[left] = True
            queue[tail] = left
            tail += 1
        if col < width - 1 and not reached[right] and flat[right] < limit:
            reached[right] = True
            queue[tail] = right
            tail += 1
        if row < height - 1 and not reached[below] and flat[below] < limit:
            reached[below] = True
            queue[tail] = below
            tail += 1
    return queue[:tail], reached


@kernel
def collect_frontiers(
    edge: BoolArray, order: Int32Array, min_size: float
) -> tuple[Int32Array, IntArray]:
    """Group the frontier cells next to the flooded ones, 8-connected.

    Args:
        edge: Mask from :func:`frontier_cells`, shape (H, W); cells are taken out as they are grouped.
        order: Flooded cells (flat indices) in the order of the search, at least those next to unknown ones.
        min_size: Frontiers of fewer cells are dropped.

    Returns:
        Frontier cells (flat indices), frontier after frontier, the first-contact cell first, and the position
        where each frontier begins, with the end appended.
    """
    height, width = edge.shape
    left = edge.reshape(-1)
    members = np.empty(height * width, np.int32)
    starts = np.empty(height * width + 1, np.int64)
    count = 0
    end = 0
    for position in range(len(order)):
        cell = order[position]
        row = cell // width
        col = cell % width
        for dr, dc in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            r = row + dr
            c = col + dc
            if r < 0 or r >= height or c < 0 or c >= width:
                continue
            seed = r * width + c
            if not left[seed]:
                continue
            first = end
            members[end] = seed
            left[seed] = False
            end += 1
            head = first
            while head < end:
                rr = members[head] // width
                cc = members[head] % width
                head += 1
                for er in range(-1, 2):
                    for ec in range(-1, 2):
                        nr = rr + er
                        nc = cc + ec
                        if nr < 0 or nr >= height or nc < 0 or nc >= width:
                            continue
                        neighbour = nr * width + nc
                        if left[neighbour]:
                            left[neighbour] = False
                            members[end] = neighbour
                            end += 1
            if end - first >= min_size:
                starts[count] = first
                count += 1
            else:
                end = first
    starts[count] = end
    return members[:end].copy(), starts[: count + 1].copy()
