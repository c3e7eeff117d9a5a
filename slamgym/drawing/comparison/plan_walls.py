"""The straight walls of a plan, as a drawing finds them, with points on their faces."""

from dataclasses import dataclass

import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import FloatArray, IntArray
from slamgym.drawing.walls import find_walls

FACE_STEP = 0.05
"""Distance of the points on a face [m]."""
_SIMPLIFY = 0.002
"""Corners that stray less than this from a straight face are none [m]."""


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
    walls = find_walls(plan.free_space.simplify(_SIMPLIFY), whole=False)
    lines, points, wall, side = [], [], [], []
    for number, piece in enumerate(walls):
        depth = piece.thickness if piece.known else 0.0
        count = max(round(piece.length / FACE_STEP), 1)
        lines.append(piece.places(np.array([0.0, 1.0]), 0.5 * depth).ravel())
        for face, behind in ((1.0, 0.0), (-1.0, depth))[: 1 + piece.known]:
            points.append(piece.places((np.arange(count) + 0.5) / count, behind))
            wall.extend([number] * count)
            side.extend([face] * count)
    ends = np.array(lines)
    x, y = (ends[:, 2:] - ends[:, :2]).T
    lengths = np.hypot(x, y)
    normals = np.column_stack([-y, x]) / lengths[:, None]
    return PlanWalls(ends, normals, lengths, np.vstack(points), np.array(wall), np.array(side))
