"""Frontiers as candidates for a choice: cut into handy parts, each with the path that leads to it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.types import ByteArray, FloatArray, GridFrame, Int32Array, IntArray, Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, NO_INFORMATION, Costmap, cells_inside
from slamgym.planning.frontier_feature_kernels import explore_unknown_regions
from slamgym.planning.frontiers import Frontier, Point, Reachable, describe_frontier, find_frontiers
from slamgym.planning.grid_path import COST_FACTOR, place_near
from slamgym.planning.grid_path_kernels import search_path, trace_path
from slamgym.planning.navigator import PLAN_TOLERANCE

COARSENING = 2
"""Paths to candidates are measured on a grid whose cells are so many cells of the map wide."""
_LARGEST_HOME = 100.0
"""Known floor of a usual home [m2]; more may be a hall."""

_SAME_TARGET = 0.01
"""Places nearer to one another than this are the same [m]."""
_BEND = 0.5
"""A frontier whose centroid is farther than this from its cells is visited at one of them [m]."""
_NEAR = 1.5
"""What is unknown within this distance behind a frontier is near [m]."""
_FAR = 4.0
"""The unknown behind a frontier is flooded up to this distance [m]."""
_KEPT_WITHIN = 0.25
"""A frontier one of whose cells is so near to a place, by both coordinates, passes there [m]."""


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

    def is_same_place(self, other: "FrontierCandidate | None") -> bool:
        """True if the robot would go to the same place for another one."""
        return other is not None and math.dist(self.target, other.target) < _SAME_TARGET

    def is_still_there(self, costmap: Costmap) -> bool:
        """True if at least half of its cells are still unknown on a newer map."""
        row, col, inside = cells_inside(costmap.frame, self.points)
        is_known = costmap.costs[row, col] != NO_INFORMATION
        unknown = len(inside) - np.count_nonzero(is_known)
        return bool(unknown >= 0.5 * len(self.points))


def coarsen_costmap(costs: ByteArray, frame: GridFrame) -> tuple[ByteArray, GridFrame]:
    """Join cells of a costmap by their lowest cost, so that narrow doors stay open.

    Rows and columns that don't fill a coarse cell are left out at the bottom and the right; the margin of a
    cropped costmap is wider than that.
    """
    height = costs.shape[0] // COARSENING
    width = costs.shape[1] // COARSENING
    cut = costs[: height * COARSENING, : width * COARSENING]
    steps = range(COARSENING)
    parts = [cut[row::COARSENING, col::COARSENING] for row in steps for col in steps]
    joined: ByteArray = np.minimum.reduce(parts)
    size = frame.resolution * COARSENING
    bottom = frame.origin_y + frame.height_px * frame.resolution - height * size
    return joined, GridFrame(size, frame.origin_x, bottom, height, width)


class FrontierInReach(NamedTuple):
    """A frontier, or a part of one, that a path leads to within ``PLAN_TOLERANCE``."""

    frontier: Frontier
    place: tuple[int, int]  # the cell (row, col) of the costmap where its path ends
    whole: int  # the number of the frontier that it was cut from
    is_by_wall: bool  # the costmap knows how far the place is from an obstacle


def frontiers_in_reach(
    costmap: Costmap, reachable: Reachable, pose: Pose2D, min_size: float, split_extent: float
) -> list[FrontierInReach]:
    """Search the frontiers.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        pose: The robot, in the frame of the costmap.
        min_size: Frontiers shorter than this are left out [m].
        split_extent: A frontier that extends farther than this is cut into parts [m].
    """
    found: list[FrontierInReach] = []
    for number, whole in enumerate(find_frontiers(costmap, pose, min_size, reachable=reachable)):
        for one in split_frontier(whole, costmap.frame, pose, split_extent):
            place = place_near(costmap, one.middle, PLAN_TOLERANCE, reachable)
            place = place or place_near(costmap, one.nearest, PLAN_TOLERANCE, reachable)
            if place is not None:
                is_by_wall = bool(costmap.distance[place] < np.inf)
                found.append(FrontierInReach(one, place, number, is_by_wall))
    return found


def walls_first(frontiers: list[FrontierInReach], known_area: float) -> list[FrontierInReach]:
    """Leave out the other parts of those frontiers that have parts by a wall, where a hall may be known.

    A robot that sees no wall soon doesn't know where it is: the middle of a hall comes after its walls.

    Args:
        frontiers: From :func:`frontiers_in_reach`.
        known_area: Of the map [m2].
    """
    if known_area <= _LARGEST_HOME:
        return frontiers
    with_wall = {one.whole for one in frontiers if one.is_by_wall}
    return [one for one in frontiers if one.is_by_wall or one.whole not in with_wall]


def make_candidates(
    costmap: Costmap,
    reachable: Reachable,
    frontiers: Sequence[FrontierInReach],
    most: int,
    keep: Point | None = None,
) -> list[FrontierCandidate]:
    """Search the paths to frontiers, no farther than to those with the cheapest paths.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        frontiers: From :func:`frontiers_in_reach`.
        most: So many candidates are made at most.
        keep: Where the robot is going [m]: a frontier that passes there keeps this place, so that a
            target drawn again from every map doesn't send the robot back and forth.

    Returns:
        The candidates that a path leads to, the cheapest path first.
    """
    if not frontiers:
        return []
    costs, frame = coarsen_costmap(costmap.costs, costmap.frame)
    start = _coarse_cell(divmod(int(reachable.order[0]), costmap.frame.width_px), frame)
    ends = np.array([_coarse_cell(one.place, frame) for one in frontiers], dtype=np.int64)
    lengths, parent = search_path(costs, start, -1, ends, INSCRIBED_COST, COST_FACTOR, most)
    found = []
    for index in np.argsort(lengths, kind="stable")[:most].tolist():
        frontier, place, *_ = frontiers[index]
        end = int(ends[index])
        if math.isfinite(lengths[index]):
            rows, cols = np.divmod(trace_path(parent, start, end), frame.width_px)
            path = frame.to_points(rows, cols)
            points = costmap.frame.to_points(*frontier.cells.T)
            steps = path[1:] - path[:-1]
            candidate = FrontierCandidate(
                frontier=frontier,
                points=points,
                target=_target(frontier, points, keep),
                place=place,
                path_length=float(np.hypot(*steps.T).sum()),
                path_cost=float(lengths[index]) * frame.resolution,
                path=path,
            )
            found.append(candidate)
    return found


def split_frontier(
    frontier: Frontier, frame: GridFrame, pose: Pose2D, extent: float
) -> list[Frontier]:
    """Cut a frontier in halves, across its longer side, until no part extends farther than an extent [m]."""
    parts = [frontier.cells]
    done = []
    while parts:
        cells = parts.pop()
        spread = cells.max(axis=0) - cells.min(axis=0)
        if float(spread.max()) * frame.resolution <= extent:
            done.append(cells)
            continue
        longer_side = int(np.argmax(spread))
        order = np.argsort(cells[:, longer_side], kind="stable")
        half = len(order) // 2
        parts.append(cells[order[:half]])
        parts.append(cells[order[half:]])
    if len(done) == 1:
        return [frontier]
    return [describe_frontier(cells, frame, pose) for cells in done]


class Runs(NamedTuple):
    """Cells of several frontiers, one after the other."""

    cells: Int32Array
    """(M, 2) rows and columns."""
    starts: IntArray
    """(N + 1,) where each frontier begins, with the end appended."""

    @staticmethod
    def of(frontiers: Sequence[Int32Array]) -> "Runs":
        """Those of frontiers given by their cells, shapes (size, 2)."""
        sizes = [len(cells) for cells in frontiers]
        return Runs(np.concatenate(frontiers), np.append(0, np.cumsum(sizes)))

    def spread(self, values: FloatArray) -> FloatArray:
        """How far values (M, K) of the cells lie apart within each frontier, shape (N, K)."""
        firsts = self.starts[:-1]
        highest = np.maximum.reduceat(values, firsts, axis=0)
        return highest - np.minimum.reduceat(values, firsts, axis=0)


def unknown_regions(costmap: Costmap, frontiers: Runs) -> tuple[FloatArray, float]:
    """Measure the unknown behind frontiers.

    Returns:
        What :data:`~slamgym.planning.frontier_feature_kernels.UNKNOWN_REGION` names of each, shape (N, 7), and the size
        of the cells in which it is counted [m].
    """
    cell = costmap.frame.resolution * COARSENING
    # The margin is what a costmap keeps about the known part.
    steps = (round(_NEAR / cell), round(_FAR / cell))
    margin = round(0.5 / cell)
    regions = explore_unknown_regions(
        costmap.costs, frontiers.cells, frontiers.starts, COARSENING, steps, margin
    )
    return regions, cell


def _coarse_cell(place: tuple[int, int], frame: GridFrame) -> int:
    """The coarse cell (flat index) of a cell (row, col)."""
    row, col = place
    height, width = frame.shape
    coarse_row = min(row // COARSENING, height - 1)
    coarse_col = min(col // COARSENING, width - 1)
    return coarse_row * width + coarse_col


def _target(frontier: Frontier, points: FloatArray, keep: Point | None) -> Point:
    """Where the robot would go for a frontier, given by its cells' centres, too."""
    if keep is not None:
        missing = np.abs(points - np.array(keep))
        apart = missing.max(axis=1)
        if apart.min() <= _KEPT_WITHIN:
            return keep
    is_bent = math.dist(frontier.centroid, frontier.middle) > _BEND
    return frontier.middle if is_bent else frontier.centroid
