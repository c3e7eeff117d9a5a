"""What stands in the robot's way and its map doesn't show: for some seconds, or for the rest of the exploration."""

import math

import numpy as np

from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D
from slamgym.planning.costmap import LETHAL_COST, Costmap, mark_obstacles, unmapped_points
from slamgym.planning.frontiers import Point

_NEAR = 0.4  # what stands so near to the body of a robot that gave up is what stopped it [m]


class Hindrances:
    """Obstacles beyond those of the map. Points are in the frame of the map [m].

    Args:
        memory: What only the scan showed is kept for so long [s].
        half_width: A barrier reaches so far to either side [m].
        spacing: Distance between points of a barrier [m].
    """

    def __init__(self, memory: float, half_width: float, spacing: float) -> None:
        self._memory, self._half_width, self._spacing = memory, half_width, spacing
        self._seen: list[tuple[float, Pose2D, FloatArray]] = []  # when, from where, points (N, 2)
        self._barriers: list[
            tuple[Point, FloatArray]
        ] = []  # where it didn't get through, points that close it
        self._kept = np.zeros((0, 2))  # points

    def note_seen(self, points: FloatArray, pose: Pose2D, time: float) -> None:
        """Keep what the scan shows, points (N, 2), for a while."""
        if len(points):
            self._seen.append((time, pose, points))

    def note_impassable(self, centre: FloatArray, along: FloatArray) -> bool:
        """Note that the robot didn't get through a place (2,) in a direction (2,), and whether it is closed now.

        It is from the second time on; narrow doors get another try.
        """
        half, across = self._half_width, np.array([-along[1], along[0]])
        again = any(math.dist(centre, place) < 2.0 * half for place, _ in self._barriers)
        offsets = np.arange(-half, half if again else -half, self._spacing)
        self._barriers.append(((float(centre[0]), float(centre[1])), centre + offsets[:, None] * across))
        return again

    def keep_around(self, pose: Pose2D, radius: float, costmap: Costmap, grid: OccupancyGrid) -> None:
        """Keep the obstacles near the robot for good, whatever map and scan show later.

        For where it gave a goal up. A pane of glass returns only the beams that meet it at right angles. So it comes
        and goes in the map, and reaches farther across the line of sight than the scan shows.

        Args:
            pose: The robot.
            radius: The robot's [m].
            costmap: Map and obstacles as they are now.
            grid: The map alone.
        """
        found = [np.column_stack(costmap.frame.to_point(*np.nonzero(costmap.costs == LETHAL_COST)))]
        offsets = np.arange(-self._half_width, self._half_width, self._spacing)[:, None, None]
        for _, seen_from, seen in self._seen:
            points = unmapped_points(grid, seen)
            sight = points - np.array(seen_from[:2])
            across = sight[:, ::-1] * (-1.0, 1.0) / np.maximum(np.hypot(*sight.T), 1e-3)[:, None]
            found.append((points + offsets * across).reshape(-1, 2))
        points = np.vstack(found)
        near = points[np.hypot(*(points - np.array(pose[:2])).T) < radius + _NEAR]
        # One point for each cell, its centre, so that coming again adds next to nothing.
        row, col = costmap.frame.to_cell(near[:, 0], near[:, 1])
        rows, cols = np.unique(np.column_stack([row, col]), axis=0).T
        self._kept = np.unique(
            np.vstack([self._kept, np.column_stack(costmap.frame.to_point(rows, cols))]), axis=0
        )

    def mark(self, grid: OccupancyGrid, time: float) -> OccupancyGrid:
        """Copy a map with all of them entered; forgets what was seen too long ago."""
        self._seen = [seen for seen in self._seen if time - seen[0] < self._memory]
        if self._seen:
            grid = mark_obstacles(grid, np.vstack([points for _, _, points in self._seen]))
        if self._barriers:
            grid = mark_obstacles(grid, np.vstack([points for _, points in self._barriers]))
        return mark_obstacles(grid, self._kept, apart=0.0) if len(self._kept) else grid
