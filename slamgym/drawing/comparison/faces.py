"""The faces of walls, as points with normals to the free side: those of a plan, and those that a map shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.geometry import compose, inverse, transform_points
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    IntArray,
    OccupancyGrid,
    Pose2D,
)
from slamgym.drawing.evidence import values_at
from slamgym.drawing.settings import SAME_PLACE, USUAL_CELL
from slamgym.drawing.walls import find_walls

NORMAL_BLUR = 1.5
"""Blur of the free space whose gradient gives a map's normals [cells]."""
ACROSS = np.linspace(-0.1, 0.1, 9)
"""A wall is open where the map is free so far to both sides of it [m]."""
BEFORE = np.array([0.1, 0.2, 0.3])
"""A face is in view where the map is free so far before it [m]."""


@dataclass(frozen=True)
class PlanWalls:
    """Straight walls W, and points S on their faces.

    A wall has two faces, or one where it is thick or bounds the building.
    """

    lines: FloatArray  # (W, 4) x0, y0, x1, y1 of the middle lines [m]; the first face's floor is on the left
    normals: FloatArray  # (W, 2) towards the first face's floor
    lengths: FloatArray  # (W,) [m]
    points: FloatArray  # (S, 2) every 5 cm
    wall: IntArray  # (S,) which wall a point is on
    side: FloatArray  # (S,) 1 on a wall's first face, -1 on its second

    @property
    def point_normals(self) -> FloatArray:
        """Normals towards the floor before each point, (S, 2)."""
        return self.side[:, None] * self.normals[self.wall]

    @property
    def middles(self) -> FloatArray:
        """The middles of the walls, (W, 2) [m]."""
        return 0.5 * (self.lines[:, :2] + self.lines[:, 2:])


def plan_walls(plan: FloorPlan) -> PlanWalls:
    """All walls of a plan."""
    walls = find_walls(plan.free_space.simplify(SAME_PLACE), whole=False)
    lines = []
    points = []
    wall = []
    side = []
    for number, piece in enumerate(walls):
        depth = piece.thickness if piece.known else 0.0
        count = max(round(piece.length / USUAL_CELL), 1)
        shares = (np.arange(count) + 0.5) / count
        middle_line = piece.places(np.array([0.0, 1.0]), 0.5 * depth)
        lines.append(middle_line.ravel())
        points.append(piece.places(shares, 0.0))
        wall += [number] * count
        side += [1.0] * count
        if piece.known:
            points.append(piece.places(shares, depth))
            wall += [number] * count
            side += [-1.0] * count
    ends = np.array(lines)
    x, y = (ends[:, 2:] - ends[:, :2]).T
    lengths = np.hypot(x, y)
    return PlanWalls(
        lines=ends,
        normals=np.column_stack([-y, x]) / lengths[:, None],
        lengths=lengths,
        points=np.vstack(points),
        wall=np.array(wall),
        side=np.array(side),
    )


@dataclass(frozen=True)
class MapEvidence:
    """A map, laid over a plan, and points on the faces of its walls."""

    grid: OccupancyGrid
    points: FloatArray  # (N, 2) in the plan's frame [m]
    normals: FloatArray  # (N, 2) towards the free space
    plan_from_map: Pose2D = Pose2D(0.0, 0.0, 0.0)

    def moved(self, by: Pose2D) -> "MapEvidence":
        """The same map, moved over the plan."""
        turn = Pose2D(0.0, 0.0, by.theta)
        return MapEvidence(
            grid=self.grid,
            points=transform_points(by, self.points),
            normals=transform_points(turn, self.normals),
            plan_from_map=compose(by, self.plan_from_map),
        )

    def on_map(self, points: FloatArray) -> FloatArray:
        """Points of the plan's frame in the map's own, any shape (..., 2) [m]."""
        return transform_points(inverse(self.plan_from_map), points)

    def values(self, points: FloatArray) -> ByteArray:
        """The map's cells at points of the plan's frame, any shape (..., 2); unknown beyond the map."""
        return values_at(self.grid.cells, self.grid.frame, self.on_map(points), UNKNOWN)

    def is_free_before(self, points: FloatArray, normals: FloatArray) -> np.ndarray:
        """True for points (N, 2) [m] of faces with normals (N, 2) that the robot could see."""
        places = points[:, None] + BEFORE[:, None] * normals[:, None]
        is_free = self.values(places) == FREE
        return is_free.any(axis=1)

    def across(self, points: FloatArray, normals: FloatArray) -> IntArray:
        """At points (N, 2) [m] of walls with normals (N, 2) or (2,): 1 open, -1 closed, 0 unknown."""
        along = np.atleast_2d(normals)[:, None]
        steps = ACROSS[:, None] * along
        cells = self.values(points[:, None] + steps)
        is_closed = (cells == OCCUPIED).any(axis=1)
        is_open = (cells == FREE).mean(axis=1) > 0.8
        states = np.where(is_open, 1, 0)
        states[is_closed] = -1
        return states


def map_evidence(grid: OccupancyGrid) -> MapEvidence:
    """The faces of a map's walls.

    A cell of a thin wall is a point for each side from which it was seen.
    """
    free = grid.cells == FREE
    blurred = cv2.GaussianBlur(free.astype(np.float32), (0, 0), NORMAL_BLUR)
    down, right = np.gradient(blurred)
    padded = np.pad(free, 1)
    points = []
    normals = []
    for row_step, col_step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = np.roll(padded, (-row_step, -col_step), (0, 1))[1:-1, 1:-1]
        row, col = np.nonzero((grid.cells == OCCUPIED) & beside)
        free_cell = (row + row_step, col + col_step)
        normal = np.column_stack([right[free_cell], -down[free_cell]])
        # Pointing away from the free cell: the blur of a thin wall's other side.
        to_free_cell = [col_step, -row_step]
        wrong = normal @ to_free_cell <= 0.0
        normal[wrong] = to_free_cell
        x, y = normal.T
        length = np.maximum(np.hypot(x, y), 1e-6)
        normal /= length[:, None]
        points.append(grid.frame.to_points(row, col))
        normals.append(normal.astype(np.float64))
    return MapEvidence(grid, np.vstack(points), np.vstack(normals))
