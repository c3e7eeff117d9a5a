"""Global paths over a costmap."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.types import FloatArray, Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, Costmap
from slamgym.planning.frontier_kernels import nearest_open_cell
from slamgym.planning.frontiers import Point, Reachable, reachable_space
from slamgym.planning.grid_path_kernels import EVERYWHERE, line_cost, search_path, shortcut, trace_path

COST_FACTOR = 0.8 / 50.0
"""Weight of a cell's cost relative to its length: navfn's COST_FACTOR 0.8 over COST_NEUTRAL 50."""


@dataclass(frozen=True)
class GridPath:
    """A path in the map frame."""

    points: FloatArray  # (N, 2) x, y [m], about one cell apart; the first is where the robot stood
    cost: float  # length weighted by the costs along it [m]

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


def plan_path(
    costmap: Costmap,
    start: Pose2D,
    goal: Point,
    tolerance: float = 0.5,
    reachable: Reachable | None = None,
) -> GridPath | None:
    """The cheapest path to a goal, or to the place nearest to it where the robot's centre can be.

    Args:
        costmap: The costmap.
        start: The robot, in the frame of the costmap. If it stands too near to an obstacle the path leads
            out first.
        goal: Where to go, in the same frame [m]; may lie in unknown or inflated space.
        tolerance: A place within this distance of the goal will do, if no wall lies between [m].
        reachable: The reachable space, where the caller has it already.

    Returns:
        None if nothing within the tolerance can be reached.
    """
    space = reachable or reachable_space(costmap, start)
    if space is None:
        return None
    frame = costmap.frame
    place = place_near(costmap, goal, tolerance, space)
    if place is None:
        return None
    first, last = int(space.order[0]), place[0] * frame.width_px + place[1]
    distance, parent = search_path(costmap.costs, first, last, EVERYWHERE, INSCRIBED_COST, COST_FACTOR)
    if not math.isfinite(distance[last]):
        return None
    cells = np.column_stack(np.divmod(trace_path(parent, first, last), frame.width_px))
    return _path_through(costmap, start, cells.astype(np.float64))


def _path_through(costmap: Costmap, start: Pose2D, cells: FloatArray) -> GridPath:
    """Straighten a path of cells and sample it about once per cell."""
    frame = costmap.frame
    corners = cells[shortcut(costmap.costs, cells, INSCRIBED_COST, COST_FACTOR)]
    cost = 0.0
    for (row0, col0), (row1, col1) in itertools.pairwise(corners):
        cost += line_cost(costmap.costs, row0, col0, row1, col1, 256, COST_FACTOR)
    x, y = frame.to_point(corners[:, 0], corners[:, 1])
    x, y = np.append(start.x, x), np.append(start.y, y)
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    samples = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / frame.resolution) + 1))
    return GridPath(
        points=np.column_stack([np.interp(samples, along, x), np.interp(samples, along, y)]),
        cost=cost * frame.resolution,
    )


def path_is_free(costmap: Costmap, points: FloatArray) -> bool:
    """Whether a path, shape (N, 2) [m], stays where the robot's centre can be.

    Cells that the path leaves at its begin may be too near to an obstacle: there the robot stands already.
    """
    row, col = costmap.frame.to_cell(points[:, 0], points[:, 1])
    inside = (row >= 0) & (row < costmap.frame.height_px) & (col >= 0) & (col < costmap.frame.width_px)
    if not inside.all():
        return False
    free = costmap.costs[row, col] < INSCRIBED_COST
    return bool(free[np.argmax(free) :].all()) and bool(free.any())


def place_near(
    costmap: Costmap, goal: Point, tolerance: float, reachable: Reachable
) -> tuple[int, int] | None:
    """The cell (row, col) nearest to a goal where the robot's centre can get to.

    Args:
        costmap: The costmap.
        goal: A point that may lie in unknown or inflated space [m].
        tolerance: Largest distance from the goal, along cells that are not walls [m].
        reachable: The robot's reachable space.
    """
    row, col = costmap.frame.to_cell(*goal)
    steps = math.ceil(tolerance / costmap.frame.resolution)
    cell = nearest_open_cell(costmap.costs, int(row), int(col), INSCRIBED_COST, reachable.mask, steps)
    return None if cell < 0 else divmod(int(cell), costmap.frame.width_px)
