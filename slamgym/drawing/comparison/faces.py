"""The straight faces of a plan's walls with points on them, and the faces that a map shows.

A map's points lie on the faces of what is occupied, with normals to the side from which they were seen.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    IntArray,
    OccupancyGrid,
    Pose2D,
)
from slamgym.drawing.evidence import values_at

FACE_STEP = 0.05
"""Distance of the points on a face [m]."""
_SIMPLIFY = 0.01
"""Corners that stray less than this from a straight face are none [m]."""
THICKNESS = (0.01, 0.6)
"""Two faces that look away from each other at such a distance belong to one wall [m]."""
SHORTEST_PIECE = 0.2
"""Faces are not cut into shorter pieces than this [m]."""
NEXT_PIECE = 1.5
"""Faces on one line with a gap of less than this, a door's, are one wall [m]: else the two parts of a wall that has
moved vouch for each other, and in a flat of two rooms the outer walls are reported instead."""
PARALLEL = 0.996
"""Cosine of the angle up to which faces count as parallel: 5 degrees."""
NORMAL_BLUR = 1.5
"""Blur of the free space whose gradient gives a map's normals [cells]."""
IN_VIEW = np.array([0.1, 0.2, 0.3])
"""A face is in view where the map is free so far before it [m]."""


@dataclass(frozen=True)
class PlanFaces:
    """Faces F, cut where another wall joins from behind, and their points S."""

    segments: FloatArray  # (F, 4) x0, y0, x1, y1 [m]; the floor is on the left
    normals: FloatArray  # (F, 2) towards the floor
    lengths: FloatArray  # (F,) [m]
    points: FloatArray  # (S, 2) every 5 cm
    face: IntArray  # (S,) which face a point is on
    along: FloatArray  # (S,) from the face's first end [m]
    opposite: IntArray  # (F,) the other face of the same wall; -1 where there is none

    @property
    def point_normals(self) -> FloatArray:
        """The normals of the points' faces, (S, 2)."""
        return self.normals[self.face]

    def same_wall(self, face: int) -> BoolArray:
        """The faces of the same straight wall, on both of its sides and beyond its doors, as a mask (F,)."""
        normal = self.normals[face]
        middle = 0.5 * (self.segments[:, :2] + self.segments[:, 2:])
        away = middle - middle[face]
        beside = np.abs(away @ normal) < THICKNESS[1]
        gap = np.abs(away @ [normal[1], -normal[0]]) - 0.5 * (self.lengths + self.lengths[face])
        return (np.abs(self.normals @ normal) > PARALLEL) & beside & (gap < NEXT_PIECE)


def plan_faces(plan: FloorPlan) -> PlanFaces:
    """The faces of all walls of a plan."""
    simple = plan.free_space.simplify(_SIMPLIFY)
    space: Any = shapely.orient_polygons(simple if simple.geom_type == "Polygon" else plan.free_space)
    edges = []
    for ring in (space.exterior, *space.interiors):
        corners = shapely.get_coordinates(ring)
        edges.append(np.hstack([corners[:-1], corners[1:]]))
    whole = np.vstack(edges)
    whole = whole[np.hypot(*(whole[:, 2:] - whole[:, :2]).T) > 1e-6]
    return _with_points(*_pieces(whole))


def _with_points(segments: FloatArray, opposite: IntArray) -> PlanFaces:
    direction = segments[:, 2:] - segments[:, :2]
    lengths = np.hypot(*direction.T)
    unit = direction / lengths[:, None]
    count = np.maximum(np.round(lengths / FACE_STEP).astype(np.int64), 1)
    face = np.repeat(np.arange(len(segments)), count)
    place = (np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[face]
    points = segments[face, :2] + place[:, None] * direction[face]
    normals = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    return PlanFaces(segments, normals, lengths, points, face, place * lengths[face], opposite)


def _pieces(whole: FloatArray) -> tuple[FloatArray, IntArray]:
    """Faces cut at the ends of those behind them, and for each piece the one behind it."""
    lengths = np.hypot(*(whole[:, 2:] - whole[:, :2]).T)
    unit = (whole[:, 2:] - whole[:, :2]) / lengths[:, None]
    pieces: list[FloatArray] = []
    behind: list[tuple[int, FloatArray]] = []  # the face behind a piece, and the piece's middle moved onto it
    of_face: list[list[int]] = [[] for _ in whole]
    for i, segment in enumerate(whole):
        spans = _spans_behind(whole, unit, i, lengths[i])
        cuts = {
            0.0,
            float(lengths[i]),
            *(float(np.clip(end, 0.0, lengths[i])) for span in spans for end in span[:2]),
        }
        ends = _far_apart(sorted(cuts))
        for start, stop in itertools.pairwise(ends):
            middle = 0.5 * (start + stop)
            covering = [span for span in spans if span[0] <= middle <= span[1]]
            nearest = min(covering, key=lambda span: span[2], default=None)
            of_face[i].append(len(pieces))
            pieces.append(np.concatenate([segment[:2] + start * unit[i], segment[:2] + stop * unit[i]]))
            inward = np.array([unit[i, 1], -unit[i, 0]])
            place = segment[:2] + middle * unit[i] + (nearest[2] if nearest else 0.0) * inward
            behind.append((nearest[3] if nearest else -1, place))
    segments = np.array(pieces)
    opposite = np.full(len(pieces), -1)
    for piece, (face, place) in enumerate(behind):
        if face >= 0:
            middles = 0.5 * (segments[of_face[face], :2] + segments[of_face[face], 2:])
            opposite[piece] = of_face[face][int(np.hypot(*(middles - place).T).argmin())]
    return segments, opposite


def _spans_behind(
    whole: FloatArray, unit: FloatArray, i: int, length: float
) -> list[tuple[float, float, float, int]]:
    """Parts of a face with another behind it: start and end along it [m], thickness [m], the other face."""
    inward = np.array([unit[i, 1], -unit[i, 0]])
    depth = (0.5 * (whole[:, :2] + whole[:, 2:]) - whole[i, :2]) @ inward
    found = []
    for j in np.flatnonzero((unit @ unit[i] < -PARALLEL) & (depth > THICKNESS[0]) & (depth < THICKNESS[1])):
        ends = sorted(float((whole[j, k : k + 2] - whole[i, :2]) @ unit[i]) for k in (0, 2))
        if min(ends[1], length) - max(ends[0], 0.0) > SHORTEST_PIECE:
            found.append((ends[0], ends[1], float(depth[j]), int(j)))
    return found


def _far_apart(cuts: list[float]) -> list[float]:
    """Cuts that are not too near each other; the first and last stay."""
    kept = [cuts[0]]
    for cut in cuts[1:-1]:
        if cut - kept[-1] > SHORTEST_PIECE and cuts[-1] - cut > SHORTEST_PIECE:
            kept.append(cut)
    return [*kept, cuts[-1]]


@dataclass(frozen=True)
class MapEvidence:
    """A map in the frame of a plan."""

    points: FloatArray  # (N, 2) [m] on the faces of walls, plan frame
    normals: FloatArray  # (N, 2) towards the free space
    cells: ByteArray
    frame: GridFrame
    plan_from_map: Pose2D
    scale: float = 1.0

    def values(self, points: FloatArray) -> ByteArray:
        """The map's cells at points of the plan's frame, any shape (..., 2); unknown beyond the map."""
        flat = transform_points(inverse(self.plan_from_map), points.reshape(-1, 2)) / self.scale
        return values_at(self.cells, self.frame, flat, UNKNOWN).reshape(points.shape[:-1])

    def moved(self, plan_from_map: Pose2D, scale: float = 1.0) -> "MapEvidence":
        """The same map laid over the plan in another way."""
        back = transform_points(inverse(self.plan_from_map), self.points) / self.scale
        turn = plan_from_map.theta - self.plan_from_map.theta
        return MapEvidence(
            transform_points(plan_from_map, scale * back),
            transform_points(Pose2D(0.0, 0.0, turn), self.normals),
            self.cells,
            self.frame,
            plan_from_map,
            scale,
        )


def map_evidence(grid: OccupancyGrid) -> MapEvidence:
    """The faces of a map's walls, in its own frame.

    A cell of a thin wall is a point for each side from which it was seen.
    """
    free = grid.cells == FREE
    occupied = grid.cells == OCCUPIED
    blurred = cv2.GaussianBlur(free.astype(np.float32), (0, 0), NORMAL_BLUR)
    down, right = np.gradient(blurred)
    padded, found = np.pad(free, 1), []
    for row_step, col_step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = np.roll(padded, (-row_step, -col_step), (0, 1))[1:-1, 1:-1]
        row, col = np.nonzero(occupied & beside)
        normal = np.stack(
            [right[row + row_step, col + col_step], -down[row + row_step, col + col_step]], axis=1
        )
        # Pointing away from the free cell: the blur of a thin wall's other side.
        wrong = normal @ [col_step, -row_step] <= 0.0
        normal[wrong] = [col_step, -row_step]
        x, y = grid.frame.to_point(row, col)
        found.append(np.column_stack([x, y, normal / np.maximum(np.hypot(*normal.T), 1e-6)[:, None]]))
    points = np.vstack(found)
    return MapEvidence(points[:, :2], points[:, 2:], grid.cells, grid.frame, Pose2D(0.0, 0.0, 0.0))
