"""The straight walls of a plan, with points on their faces."""

from dataclasses import dataclass

import numpy as np
import shapely

from slamgym.cad.floorplan import FloorPlan, ring_segments
from slamgym.core.types import BoolArray, FloatArray, IntArray

FACE_STEP = 0.05
"""Distance of the points on a face [m]."""
_SIMPLIFY = 0.01
"""Corners that stray less than this from a straight face are none [m]."""
THICKNESS = (0.01, 0.6)
"""Two faces that look away from each other at such a distance belong to one wall [m]."""
SHORTEST_PIECE = 0.2
"""Walls are not cut into shorter pieces than this [m]."""
NEXT_PIECE = 1.5
"""Walls on one line with a gap of less than this, a door's, are one [m]: else the two parts of a wall that has moved
vouch for each other, and in a flat of two rooms the outer walls are reported instead."""
PARALLEL = 0.996
"""Cosine of the angle up to which faces count as parallel: 5 degrees."""


@dataclass(frozen=True)
class PlanWalls:
    """Straight walls W, cut where another one joins, and points S on their faces.

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

    def in_line(self, wall: int) -> BoolArray:
        """The walls on one line with a wall, also beyond doors, as a mask (W,)."""
        normal, away = self.normals[wall], self.middles - self.middles[wall]
        gap = np.abs(away @ [normal[1], -normal[0]]) - 0.5 * (self.lengths + self.lengths[wall])
        parallel = np.abs(self.normals @ normal) > PARALLEL
        return parallel & (np.abs(away @ normal) < THICKNESS[1]) & (gap < NEXT_PIECE)


def plan_walls(plan: FloorPlan) -> PlanWalls:
    """All walls of a plan."""
    simple = plan.free_space.simplify(_SIMPLIFY)
    space = shapely.orient_polygons(simple if simple.geom_type == "Polygon" else plan.free_space)
    faces = _cut(ring_segments(shapely.get_rings(space)))
    normals, lengths = _normals(faces)
    behind, depth = _faces_behind(faces, normals, lengths)
    first = np.flatnonzero((behind < 0) | (np.arange(len(faces)) < behind))
    number = np.full(len(faces), -1)
    number[first] = np.arange(len(first))
    side = np.where(number >= 0, 1.0, -1.0)
    number = np.where(number >= 0, number, number[behind])
    count = np.maximum(np.round(lengths / FACE_STEP).astype(np.int64), 1)
    face = np.repeat(np.arange(len(faces)), count)
    share = (np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[face]
    points = faces[face, :2] + share[:, None] * (faces[face, 2:] - faces[face, :2])
    lines = faces[first] - np.tile(0.5 * depth[first, None] * normals[first], 2)
    return PlanWalls(lines, normals[first], lengths[first], points, number[face], side[face])


def _normals(faces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normals to the left of faces (F, 4), (F, 2), and their lengths, (F,) [m]."""
    x, y = (faces[:, 2:] - faces[:, :2]).T
    lengths = np.hypot(x, y)
    return np.column_stack([-y, x]) / lengths[:, None], lengths


def _cut(whole: FloatArray) -> FloatArray:
    """Faces cut where one behind them ends, (F, 4)."""
    normals, lengths = _normals(whole)
    pieces = []
    for face, normal, length in zip(whole, normals, lengths.tolist(), strict=True):
        unit = np.array([normal[1], -normal[0]])
        depth = (0.5 * (whole[:, :2] + whole[:, 2:]) - face[:2]) @ -normal
        behind = (normals @ normal < -PARALLEL) & (depth > THICKNESS[0]) & (depth < THICKNESS[1])
        ends = [0.0]
        for cut in np.sort((whole[behind].reshape(-1, 2) - face[:2]) @ unit):
            if cut - ends[-1] > SHORTEST_PIECE and length - cut > SHORTEST_PIECE:
                ends.append(cut)
        corners = face[:2] + np.array([*ends, length])[:, None] * unit
        pieces.append(np.hstack([corners[:-1], corners[1:]]))
    return np.vstack(pieces)


def _faces_behind(faces: FloatArray, normals: FloatArray, lengths: FloatArray) -> tuple[IntArray, FloatArray]:
    """For each face the other one of its wall, (F,), -1 where there is none, and how far it is behind it, (F,) [m]."""
    middles = 0.5 * (faces[:, :2] + faces[:, 2:])
    nearest, depths = np.full(len(faces), -1), np.zeros(len(faces))
    for i, normal in enumerate(normals):
        away = middles - middles[i]
        depth, beside = away @ -normal, np.abs(away @ [normal[1], -normal[0]])
        fits = (normals @ normal < -PARALLEL) & (depth > THICKNESS[0]) & (depth < THICKNESS[1])
        fits &= beside < 0.5 * np.minimum(lengths, lengths[i])
        if fits.any():
            nearest[i] = np.where(fits, depth + beside, np.inf).argmin()
            depths[i] = depth[nearest[i]]
    mutual = (nearest >= 0) & (nearest[nearest] == np.arange(len(faces)))
    return np.where(mutual, nearest, -1), np.where(mutual, depths, 0.0)
