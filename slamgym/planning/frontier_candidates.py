"""Frontiers as candidates for a choice: cut into handy parts, each with the path that leads to it."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.types import ByteArray, Float32Array, FloatArray, GridFrame, Int32Array, IntArray, Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, NO_INFORMATION, Costmap
from slamgym.planning.frontiers import Frontier, Point, Reachable, find_frontiers
from slamgym.planning.grid_path import COST_FACTOR, place_near
from slamgym.planning.grid_path_kernels import search_path, trace_path

COARSENING = 2
"""Paths to candidates are measured on a grid whose cells are so many cells of the map wide."""

_BEND = 0.5  # a frontier whose centroid is farther than this from its cells is visited at one of them [m]


@dataclass(frozen=True)
class FrontierCandidate:
    """A frontier that may be chosen, and where the robot would go for it."""

    frontier: Frontier
    points: FloatArray  # (size, 2) centres of its cells, map frame [m]
    target: Point  # where the robot would go [m]
    place: tuple[int, int]  # the cell (row, col) of the costmap where its path ends
    path_length: float  # [m]
    path_cost: float  # the same, weighted by the costs along it [m]
    path: FloatArray  # (N, 2) the path on the coarse grid, from the robot, map frame [m]

    def is_still_there(self, costmap: Costmap) -> bool:
        """Whether at least half of its cells are still unknown on a newer map."""
        row, col = costmap.frame.to_cell(self.points[:, 0], self.points[:, 1])
        height, width = costmap.costs.shape
        inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        unknown = costmap.costs[row[inside], col[inside]] == NO_INFORMATION
        left = int(np.count_nonzero(unknown)) + int(np.count_nonzero(~inside))
        return left >= 0.5 * len(self.points)


@dataclass(frozen=True)
class PathTree:
    """Cheapest paths from the robot to every cell of a coarsened costmap."""

    costs: ByteArray  # (h, w)
    distance: Float32Array  # (h, w) cost of the path [coarse cells], inf where none leads
    parent: Int32Array  # (h * w,) flat index of the cell before, -1 where there is none
    start: int  # flat index of the robot's cell
    frame: GridFrame

    @staticmethod
    def search(costmap: Costmap, reachable: Reachable, places: Sequence[tuple[int, int]] = ()) -> "PathTree":
        """Search the paths from the robot's cell.

        Args:
            costmap: The costmap.
            reachable: The robot's reachable space.
            places: Cells (row, col) of the costmap; no others need a path. Every cell gets one where left out.
        """
        costs, frame = coarsen_costmap(costmap.costs, costmap.frame)
        row, col = divmod(int(reachable.order[0]), costmap.frame.width_px)
        start = (row // COARSENING) * frame.width_px + col // COARSENING
        wanted = [row * frame.width_px + col for row, col in (_coarse_cell(place, frame) for place in places)]
        distance, parent = search_path(
            costs, start, -1, np.array(wanted, dtype=np.int64), INSCRIBED_COST, COST_FACTOR
        )
        return PathTree(costs, distance.reshape(costs.shape), parent, start, frame)

    def path_to(self, row: int, col: int) -> FloatArray | None:
        """The path to a cell of this grid, shape (N, 2) [m]; None where none leads."""
        if not math.isfinite(self.distance[row, col]):
            return None
        cells: IntArray = trace_path(self.parent, self.start, row * self.frame.width_px + col)
        return self.frame.to_points(*np.divmod(cells, self.frame.width_px))


def coarsen_costmap(costs: ByteArray, frame: GridFrame) -> tuple[ByteArray, GridFrame]:
    """Join cells of a costmap by their lowest cost, so that narrow doors stay open.

    Rows and columns that don't fill a coarse cell are left out at the bottom and the right; the margin of a
    cropped costmap is wider than that.
    """
    height, width = costs.shape[0] // COARSENING, costs.shape[1] // COARSENING
    cut = costs[: height * COARSENING, : width * COARSENING]
    steps = range(COARSENING)
    joined: ByteArray = functools.reduce(
        np.minimum, [cut[r::COARSENING, c::COARSENING] for r in steps for c in steps]
    )
    size = frame.resolution * COARSENING
    return joined, GridFrame(
        size,
        frame.origin_x,
        frame.origin_y + frame.height_px * frame.resolution - height * size,
        height,
        width,
    )


def make_candidates(
    costmap: Costmap,
    reachable: Reachable,
    pose: Pose2D,
    min_size: float,
    split_extent: float,
    tolerance: float,
    keep: Point | None = None,
) -> list[FrontierCandidate]:
    """Search the frontiers and the paths to them.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        pose: The robot, in the frame of the costmap.
        min_size: Frontiers shorter than this are left out [m].
        split_extent: A frontier that extends farther than this is cut into parts [m].
        tolerance: How far from a frontier its path may end [m].
        keep: Where the robot is going [m]: a frontier that passes there keeps this place, so that a
            target drawn again from every map doesn't send the robot back and forth.

    Returns:
        The candidates that a path leads to, the cheapest path first.
    """
    places: list[tuple[Frontier, tuple[int, int]]] = []
    for whole in find_frontiers(costmap, pose, min_size, reachable=reachable):
        for frontier in split_frontier(whole, costmap.frame, pose, split_extent):
            place = place_near(costmap, frontier.middle, tolerance, reachable)
            place = place or place_near(costmap, frontier.nearest, tolerance, reachable)
            if place is not None:
                places.append((frontier, place))
    if not places:
        return []
    paths = PathTree.search(costmap, reachable, [place for _, place in places])
    found = [_candidate(frontier, place, costmap, paths, keep) for frontier, place in places]
    return sorted((one for one in found if one is not None), key=lambda one: one.path_cost)


def split_frontier(frontier: Frontier, frame: GridFrame, pose: Pose2D, extent: float) -> list[Frontier]:
    """Cut a frontier in halves, across its longer side, until no part extends farther than an extent [m]."""
    parts, done = [frontier.cells], []
    while parts:
        cells = parts.pop()
        spread = cells.max(axis=0) - cells.min(axis=0)
        if float(spread.max()) * frame.resolution <= extent:
            done.append(cells)
            continue
        order = np.argsort(cells[:, int(np.argmax(spread))], kind="stable")
        parts += [cells[order[: len(order) // 2]], cells[order[len(order) // 2 :]]]
    if len(done) == 1:
        return [frontier]
    return [_describe(cells, frame, pose) for cells in done]


def _describe(cells: Int32Array, frame: GridFrame, pose: Pose2D) -> Frontier:
    """A frontier of given cells."""
    points = frame.to_points(cells[:, 0], cells[:, 1])
    centroid = points.mean(axis=0)
    from_robot = np.hypot(*(points - np.array(pose[:2])).T)
    nearest, middle = np.argmin(from_robot), np.argmin(np.hypot(*(points - centroid).T))

    def point(values: FloatArray) -> Point:
        return float(values[0]), float(values[1])

    return Frontier(
        size=len(cells),
        min_distance=float(from_robot[nearest]),
        initial=point(points[0]),
        centroid=point(centroid),
        nearest=point(points[nearest]),
        middle=point(points[middle]),
        cells=cells,
    )


def _coarse_cell(place: tuple[int, int], frame: GridFrame) -> tuple[int, int]:
    """The coarse cell of a cell (row, col)."""
    return min(place[0] // COARSENING, frame.height_px - 1), min(place[1] // COARSENING, frame.width_px - 1)


def _candidate(
    frontier: Frontier,
    place: tuple[int, int],
    costmap: Costmap,
    paths: PathTree,
    keep: Point | None,
) -> FrontierCandidate | None:
    """A frontier with the path to the place from which it is visited; None where none leads."""
    row, col = _coarse_cell(place, paths.frame)
    path = paths.path_to(row, col)
    if path is None:
        return None
    points = costmap.frame.to_points(frontier.cells[:, 0], frontier.cells[:, 1])
    target = frontier.middle if math.dist(frontier.centroid, frontier.middle) > _BEND else frontier.centroid
    if keep is not None and np.abs(points - np.array(keep)).max(axis=1).min() <= 0.25:
        target = keep
    return FrontierCandidate(
        frontier=frontier,
        points=points,
        target=target,
        place=place,
        path_length=float(np.hypot(*(path[1:] - path[:-1]).T).sum()),
        path_cost=float(paths.distance[row, col]) * paths.frame.resolution,
        path=path,
    )
