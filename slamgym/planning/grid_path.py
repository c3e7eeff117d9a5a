"""Paths over a costmap: the one to a goal, and the lengths of those between many places."""

import math

import numpy as np

from slamgym.core.types import Float32Array, FloatArray, IntArray, Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, LETHAL_COST, Costmap, cells_inside
from slamgym.planning.frontier_kernels import nearest_open_cell, nearest_open_cells
from slamgym.planning.frontiers import Point, Reachable, reachable_space
from slamgym.planning.grid_path_kernels import search_lengths, search_path, shortcut, trace_path

COST_FACTOR = 0.8 / 50.0
"""Weight of a cell's cost relative to its length: navfn's COST_FACTOR 0.8 over COST_NEUTRAL 50."""

SHRINK = 3
"""Cells of the costmap along the side of a coarse one."""

NEAR_PLACES = 16
"""From so many places about the robot, and from new ones, paths are searched anew on every map. Searched only from new
ones, ``rl`` took 1.05 [1.01, 1.09] times as long in 91 furnished homes."""

_STANDS_AT = 0.3
"""A robot need not turn to face a place that is nearer than this [m]: it stands there."""


def plan_path(
    costmap: Costmap,
    start: Pose2D,
    goal: Point,
    tolerance: float = 0.5,
    reachable: Reachable | None = None,
) -> FloatArray | None:
    """The cheapest path to a goal, or to the place nearest to it where the robot's centre can be.

    Args:
        costmap: The costmap.
        start: The robot, in the frame of the costmap. If it stands too near to an obstacle the path leads
            out first.
        goal: Where to go, in the same frame [m]; may lie in unknown or inflated space.
        tolerance: A place within this distance of the goal will do, if no wall lies between [m].
        reachable: The reachable space, where the caller has it already.

    Returns:
        Points, shape (N, 2) [m], about one cell apart, the first where the robot stands; None if nothing within the
        tolerance can be reached.
    """
    space = reachable or reachable_space(costmap, start)
    if space is None:
        return None
    frame = costmap.frame
    place = place_near(costmap, goal, tolerance, space)
    if place is None:
        return None
    row, col = place
    first = int(space.order[0])
    last = row * frame.width_px + col
    length, parent = search_path(
        costmap.costs, first, last, np.array([last]), INSCRIBED_COST, COST_FACTOR
    )
    if not math.isfinite(length[0]):
        return None
    rows, cols = np.divmod(trace_path(parent, first, last), frame.width_px)
    cells = np.column_stack([rows, cols])
    return _path_through(costmap, start, cells.astype(np.float64))


def _path_through(costmap: Costmap, start: Pose2D, cells: FloatArray) -> FloatArray:
    """Straighten a path of cells and sample it about once per cell."""
    frame = costmap.frame
    kept = shortcut(costmap.costs, cells, INSCRIBED_COST, COST_FACTOR)
    corner_rows, corner_cols = cells[kept].T
    corners_x, corners_y = frame.to_point(corner_rows, corner_cols)
    x = np.append(start.x, corners_x)
    y = np.append(start.y, corners_y)
    steps = np.hypot(np.diff(x), np.diff(y))
    along = np.append(0.0, np.cumsum(steps))
    length = along[-1]
    pieces = math.ceil(length / frame.resolution)
    number = max(2, pieces + 1)
    samples = np.linspace(0.0, length, number)
    sampled_x = np.interp(samples, along, x)
    sampled_y = np.interp(samples, along, y)
    return np.column_stack([sampled_x, sampled_y])


def path_is_free(costmap: Costmap, points: FloatArray) -> bool:
    """True if a path, shape (N, 2) [m], stays where the robot's centre can be.

    Its first cells may be too near to an obstacle: there the robot stands already.
    """
    row, col, inside = cells_inside(costmap.frame, points)
    free = costmap.costs[row, col] < INSCRIBED_COST
    if not inside.all() or not free.any():
        return False
    first_free = np.argmax(free)
    return bool(free[first_free:].all())


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
    cell = nearest_open_cell(
        costmap.costs, int(row), int(col), INSCRIBED_COST, reachable.mask, steps
    )
    return None if cell < 0 else divmod(int(cell), costmap.frame.width_px)


class CoarsePaths:
    """Shortest path lengths over the cells that the robot's centre can be on, on a grid of larger cells.

    A tour over frontiers needs the distance of every place from every other. On cells of 0.15 m instead of
    0.05 m such a search costs a twentieth and is as good for comparing lengths.

    A coarse cell is open if any of its cells is, so no doorway is lost. Walls stay closed, because the ring
    round them where no centre can be is wider than a coarse cell.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.

    Attributes:
        cell: Size of a coarse cell [m].
    """

    def __init__(self, costmap: Costmap, reachable: Reachable) -> None:
        self._frame = costmap.frame
        open_cells = reachable.order[: reachable.num_centre]
        rows, cols = np.divmod(open_cells, costmap.frame.width_px)
        shape = [math.ceil(size / SHRINK) for size in costmap.costs.shape]
        costs = np.full(shape, LETHAL_COST, dtype=np.uint8)
        costs[rows // SHRINK, cols // SHRINK] = 0
        self._costs = costs
        is_closed = costs == LETHAL_COST
        closed = np.uint8(INSCRIBED_COST)
        self._crossable = np.where(is_closed, closed, np.uint8(0))
        self.cell = SHRINK * costmap.frame.resolution

    def place(self, point: Point) -> int:
        """The open coarse cell (flat index) nearest to a point [m]; -1 if the point is off the map.

        Walls are crossed in the search: a place that is known to be reachable may lie in a closed cell's
        corner.
        """
        return int(self.places(np.array([point]))[0])

    def places(self, points: FloatArray) -> IntArray:
        """:meth:`place` of points (N, 2) [m], shape (N,)."""
        rows, cols = self._frame.to_cell(*points.T)
        return nearest_open_cells(self._crossable, rows // SHRINK, cols // SHRINK, 1)

    def search_anew(self, lengths: FloatArray, cells: IntArray, anew: IntArray) -> None:
        """Search the paths from some of N places, and shorten those between others that lead by way of them.

        Args:
            lengths: Between all, shape (N, N) [m]; written to.
            cells: Flat indices of coarse cells, from :meth:`places`, shape (N,).
            anew: From which the paths are searched, in this order, shape (M,).
        """
        search_lengths(self._costs, cells, anew, INSCRIBED_COST, np.float32(self.cell), lengths)

    def lengths_from(self, place: int, wanted: IntArray) -> Float32Array:
        """Length of the shortest path from an open cell to others, inf where none leads.

        Args:
            place: Flat index, from :meth:`place`; from -1 none leads anywhere.
            wanted: Flat indices of coarse cells, shape (N,).

        Returns:
            Shape (N,) [m].
        """
        if place < 0:
            return np.full(len(wanted), np.inf, dtype=np.float32)
        lengths, _ = search_path(self._costs, place, -1, wanted, INSCRIBED_COST, 0.0)
        return lengths * np.float32(self.cell)

    def path(self, start: Point, goal: Point) -> FloatArray:
        """Points of a shortest path, a coarse cell apart, shape (N, 2) [m]; empty where none leads."""
        first = self.place(start)
        last = self.place(goal)
        if first < 0 or last < 0:
            return np.zeros((0, 2))
        wanted = np.array([last])
        length, parent = search_path(self._costs, first, last, wanted, INSCRIBED_COST, 0.0)
        if not math.isfinite(length[0]):
            return np.zeros((0, 2))
        width = self._costs.shape[1]
        cells = trace_path(parent, first, last)
        row, col = np.divmod(cells, width)
        half = 0.5 * (SHRINK - 1)
        x, y = self._frame.to_point(SHRINK * row + half, SHRINK * col + half)
        return np.column_stack([x, y])


class PathLengths:
    """Lengths of the paths between places: those between old places that are far away are kept from map to map.

    A map that grows opens shorter ways. So each path that is kept is held against those by way of all other places.
    """

    def __init__(self) -> None:
        self._places = np.zeros((0, 2))
        self._lengths = np.zeros((0, 0))

    def matrix(
        self, paths: CoarsePaths, pose: Pose2D, places: FloatArray, per_turn: float
    ) -> FloatArray:
        """Path lengths between the robot and some places.

        Args:
            paths: Over the newest map.
            pose: The robot.
            places: Shape (N, 2) [m], each on or near a cell where the robot's centre can be.
            per_turn: What a radian of the robot's first turn counts [m/rad].

        Returns:
            Shape (N + 1, N + 1) [m], the robot first; inf between places that no path joins.
        """
        points = np.vstack([pose[:2], places])
        cells = paths.places(points)
        if len(points) <= 1 + NEAR_PLACES:  # all are searched anew
            lengths = np.full((len(points), len(points)), math.inf)
            paths.search_anew(lengths, cells, np.arange(len(points)))
            self._places = places
        else:
            lengths = self._search_some(paths, points, cells)
        self._lengths = lengths[1:, 1:]
        lengths[0, 1:] += per_turn * straight_turns(pose, places)
        return lengths

    def _search_some(self, paths: CoarsePaths, points: FloatArray, cells: IntArray) -> FloatArray:
        """Lengths between points, shape (N, N) [m], of which those far from the first are kept."""
        num_old = len(self._places)
        known = np.vstack([self._places, points])
        apart = points[:, None] - known[None]
        distances = np.hypot(*apart.T).T
        # A place that has moved by less than a cell is the old one.
        same = np.argmax(distances < paths.cell, axis=1)
        num_new = len(points)
        padded = np.pad(self._lengths, (0, num_new), constant_values=math.inf)
        lengths = padded[np.ix_(same, same)]
        from_robot = paths.lengths_from(int(cells[0]), cells)
        nearest_first = np.argsort(from_robot, kind="stable")
        new = np.flatnonzero(same >= num_old)
        anew = np.union1d(nearest_first[: 1 + NEAR_PLACES], new)
        paths.search_anew(lengths, cells, anew)
        self._places = known[same[1:]]
        return lengths


def straight_turns(pose: Pose2D, places: FloatArray) -> FloatArray:
    """Turns of the robot to face places (N, 2), shape (N,) [rad]; 0 for those that it stands at."""
    x, y = places.T
    dx = x - pose.x
    dy = y - pose.y
    bearings = [math.atan2(up, right) for right, up in zip(dx, dy, strict=True)]
    beyond_back = np.array(bearings) - pose.theta + np.pi
    turns = np.remainder(beyond_back, 2.0 * np.pi) - np.pi
    turns = np.abs(turns)
    stands_at = np.hypot(dx, dy) < _STANDS_AT
    turns[stands_at] = 0.0
    return turns
