"""Path lengths between many places, on a coarser grid than the navigation stack's.

A tour over frontiers needs the distance of every place from every other. On cells of 0.15 m instead of
0.05 m such a search costs a twentieth and is as good for comparing lengths.
"""

import math

import numpy as np

from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2D
from slamgym.planning.costmap import INSCRIBED_COST, LETHAL_COST, Costmap
from slamgym.planning.frontier_kernels import nearest_open_cell
from slamgym.planning.frontiers import Point, Reachable
from slamgym.planning.grid_path_kernels import EVERYWHERE, search_path, trace_path

SHRINK = 3
"""Cells of the costmap along the side of a coarse one."""

_ANY: BoolArray = np.zeros(0, dtype=np.bool_)


class CoarsePaths:
    """Shortest path lengths over the cells that the robot's centre can be on.

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
        height, width = costmap.costs.shape
        rows, cols = np.divmod(reachable.order[: reachable.num_centre], width)
        shape = -(-height // SHRINK), -(-width // SHRINK)
        self._costs = np.full(shape, LETHAL_COST, dtype=np.uint8)
        self._costs[rows // SHRINK, cols // SHRINK] = 0
        self._crossable = np.where(self._costs == LETHAL_COST, np.uint8(INSCRIBED_COST), np.uint8(0))
        self.cell = SHRINK * costmap.frame.resolution

    def place(self, point: Point) -> int:
        """The open coarse cell (flat index) nearest to a point [m]; -1 if the point is off the map.

        Walls are crossed in the search: a place that is known to be reachable may lie in a closed cell's
        corner.
        """
        row, col = self._frame.to_cell(*point)
        row, col, size = int(row) // SHRINK, int(col) // SHRINK, self._crossable.size
        return int(nearest_open_cell(self._crossable, row, col, 1, _ANY, size))

    def lengths_from(self, place: int, wanted: IntArray = EVERYWHERE) -> Float32Array:
        """Length of the shortest path from an open cell to each coarse cell, inf where none leads.

        Args:
            place: Flat index, from :meth:`place`; from -1 none leads anywhere.
            wanted: Flat indices of the cells to which lengths must be right; by default all.

        Returns:
            Flat, shape (cells,) [m].
        """
        if place < 0:
            return np.full(self._costs.size, np.inf, dtype=np.float32)
        lengths, _ = search_path(self._costs, place, -1, wanted, INSCRIBED_COST, 0.0)
        in_metres: Float32Array = lengths * np.float32(self.cell)
        return in_metres

    def lengths_to(self, lengths: Float32Array, points: FloatArray) -> FloatArray:
        """Read :meth:`lengths_from` at points that lie in open cells.

        Args:
            lengths: Shape (cells,) [m].
            points: Shape (N, 2) [m].

        Returns:
            Shape (N,) [m]; inf where the cell isn't open or off the map.
        """
        row, col = self._frame.to_cell(points[:, 0], points[:, 1])
        row, col = row // SHRINK, col // SHRINK
        height, width = self._costs.shape
        inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        values = np.full(len(points), math.inf)
        values[inside] = lengths[row[inside] * width + col[inside]]
        return values

    def matrix(self, pose: Pose2D, places: FloatArray) -> FloatArray:
        """Path lengths between the robot and some places.

        Args:
            pose: The robot.
            places: Shape (N, 2) [m], each on or near a cell where the robot's centre can be.

        Returns:
            Shape (N + 1, N + 1) [m], symmetric, the robot first; inf between places that no path joins.
        """
        cells = np.array([self.place((pose.x, pose.y)), *(self.place((x, y)) for x, y in places.tolist())])
        lengths = np.full((len(cells), len(cells)), math.inf)
        on_map = np.flatnonzero(cells >= 0)
        for i in on_map:
            lengths[i, on_map] = self.lengths_from(int(cells[i]), cells[on_map])[cells[on_map]]
        return np.minimum(lengths, lengths.T)

    def path(self, start: Point, goal: Point) -> FloatArray:
        """Points of a shortest path, a coarse cell apart, shape (N, 2) [m]; empty where none leads."""
        first, last = self.place(start), self.place(goal)
        if first < 0 or last < 0:
            return np.zeros((0, 2))
        lengths, parent = search_path(self._costs, first, last, EVERYWHERE, INSCRIBED_COST, 0.0)
        if not math.isfinite(lengths[last]):
            return np.zeros((0, 2))
        row, col = np.divmod(trace_path(parent, first, last), self._costs.shape[1])
        half = 0.5 * (SHRINK - 1)
        return np.column_stack(self._frame.to_point(SHRINK * row + half, SHRINK * col + half))


def tour_lengths(
    costmap: Costmap, reachable: Reachable, pose: Pose2D, places: FloatArray, turn_weight: float
) -> FloatArray:
    """Path lengths between the robot and some places where turning before the first leg counts as length.

    Args:
        costmap: The costmap.
        reachable: The robot's reachable space.
        pose: The robot.
        places: Shape (N, 2) [m].
        turn_weight: What a radian of turning counts [m/rad].

    Returns:
        Shape (N + 1, N + 1) [m], as :meth:`CoarsePaths.matrix` gives them.
    """
    lengths = CoarsePaths(costmap, reachable).matrix(pose, places)
    lengths[0, 1:] += turn_weight * straight_turns(pose, places)
    return lengths


def straight_turns(pose: Pose2D, places: FloatArray) -> FloatArray:
    """How far the robot would turn to face places (N, 2), shape (N,) [rad]; 0 for those that it stands at."""
    dx, dy = (places - np.array(pose[:2])).T
    turns = np.abs(
        np.remainder(
            np.array([math.atan2(*one) for one in zip(dy, dx, strict=True)]) - pose.theta + np.pi, 2.0 * np.pi
        )
        - np.pi
    )
    return np.where(np.hypot(dx, dy) < 0.3, 0.0, turns)
