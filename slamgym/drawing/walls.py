"""Walls from the faces that bound the floor: two faces that stand back to back are one wall."""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import FloatArray
from slamgym.drawing.settings import OUTER_THICKNESS, THICKEST_WALL

ANTIPARALLEL = math.cos(math.radians(8.0))
"""Two faces belong to one wall if their directions differ by no more."""
SHORTEST = 0.02
"""Pieces shorter than this are no walls [m]."""
SAME_THICKNESS = 0.04
"""Pieces of one face whose walls differ by no more are one wall, across what meets it on the other side [m]."""


@dataclass(frozen=True)
class WallPiece:
    """A straight wall: a stretch of one face, and how far behind it the other lies."""

    start: tuple[float, float]
    end: tuple[float, float]
    """Ends of the face, the floor on the left [m]."""
    thickness: float
    known: bool
    """True if there is another face."""
    before: float = 0.0
    after: float = 0.0
    """By how much its body is longer than the face at either end: corners [m]."""

    @property
    def length(self) -> float:
        """[m]."""
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])

    def _vectors(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        start, end = np.array(self.start), np.array(self.end)
        direction = (end - start) / self.length
        behind = np.array([direction[1], -direction[0]])
        return start, end, direction, behind

    @property
    def centre_line(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Its ends, corners left out [m]."""
        start, end, _, behind = self._vectors()
        first, last = start + 0.5 * self.thickness * behind, end + 0.5 * self.thickness * behind
        return (float(first[0]), float(first[1])), (float(last[0]), float(last[1]))

    @property
    def body(self) -> Polygon:
        """A rectangle, corners included."""
        start, end, direction, behind = self._vectors()
        start, end = start - self.before * direction, end + self.after * direction
        return Polygon([start, start + self.thickness * behind, end + self.thickness * behind, end])


@dataclass(frozen=True)
class Face:
    """A straight edge of the floor."""

    start: FloatArray
    end: FloatArray
    convex: tuple[bool, bool]
    """For each end, True if the room has a corner there, seen from inside."""

    @property
    def length(self) -> float:
        """[m]."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def is_wall_end(self) -> bool:
        """True for a short face between two corners that reach into the floor."""
        return SHORTEST <= self.length <= THICKEST_WALL and not any(self.convex)


def find_walls(floor: MultiPolygon) -> list[WallPiece]:
    """The walls round a floor and between its parts.

    Args:
        floor: With straight edges [m].

    Returns:
        Every stretch of every face belongs to one wall; the longest faces come first. Jambs of doors belong to the
        walls that end there.
    """
    faces = faces_of(floor)
    order = sorted(range(len(faces)), key=lambda index: (-round(faces[index].length, 4), index))
    taken: list[list[tuple[float, float]]] = [[] for _ in faces]
    starts = np.array([face.start for face in faces]).reshape(-1, 2)
    ends = np.array([face.end for face in faces]).reshape(-1, 2)
    lines: Any = shapely.linestrings(np.stack([starts, ends], axis=1))
    pairs = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=THICKEST_WALL)
    near = np.split(pairs[1], np.searchsorted(pairs[0], np.arange(1, len(faces))))
    found: list[tuple[int, WallPiece]] = []
    for index in order:
        face = faces[index]
        if face.length < SHORTEST:
            continue
        pieces = _behind(index, np.sort(near[index]), starts, ends)
        direction = (face.end - face.start) / face.length
        for low, high, other, thickness in _free_stretches(face, pieces, taken[index]):
            if high - low < SHORTEST:
                continue
            if other < 0 and _is_jamb(face, low, high):
                continue
            first, last = face.start + low * direction, face.start + high * direction
            piece = WallPiece(_pair(first), _pair(last), thickness, other >= 0)
            found.append((index, _with_corners(piece, face, low, high)))
            for opposite, a, b in _on_opposite(starts, ends, pieces, first, last):
                taken[opposite].append((a, b))
    return [piece for _, piece in found]


def _pair(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def faces_of(floor: MultiPolygon) -> list[Face]:
    """All edges of a floor, the floor on their left."""
    faces = []
    for ring in oriented_rings(floor):
        points = shapely.get_coordinates(ring)[:-1]
        after = np.roll(points, -1, axis=0)
        outgoing = after - points
        incoming = np.roll(outgoing, 1, axis=0)
        convex = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0] > 0.0
        following = np.roll(convex, -1)
        turns = zip(convex.tolist(), following.tolist(), strict=True)
        faces += [Face(a, b, turn) for a, b, turn in zip(points, after, turns, strict=True)]
    return faces


def _behind(
    index: int, near: np.ndarray, starts: FloatArray, ends: FloatArray
) -> list[tuple[float, float, int, float]]:
    """Faces that stand back to back with one: from where to where along it, which, and how far behind [m].

    Args:
        index: The face.
        near: Numbers of the faces that are near enough.
        starts: Start points of all faces, (N, 2).
        ends: The same.
    """
    start, vector = starts[index], ends[index] - starts[index]
    length = float(np.hypot(*vector))
    direction = vector / length
    behind = np.array([direction[1], -direction[0]])
    others = ends[near] - starts[near]
    lengths = np.maximum(np.hypot(*others.T), 1e-12)
    first, second = starts[near] - start, ends[near] - start
    along = np.stack([first @ direction, second @ direction])
    low, high = np.maximum(along.min(axis=0), 0.0), np.minimum(along.max(axis=0), length)
    depth = 0.5 * (first @ behind + second @ behind)
    good = (
        ((others @ direction) / lengths < -ANTIPARALLEL)
        & (high - low > SHORTEST)
        & (depth > 0.005)
        & (depth <= THICKEST_WALL)
    )
    chosen = np.flatnonzero(good)
    chosen = chosen[np.argsort(depth[chosen], kind="stable")]
    return [(float(low[k]), float(high[k]), int(near[k]), float(depth[k])) for k in chosen]


def _free_stretches(
    face: Face,
    pieces: list[tuple[float, float, int, float]],
    taken: list[tuple[float, float]],
) -> list[tuple[float, float, int, float]]:
    """Parts of a face that aren't part of a wall yet, cut where the face behind changes; -1 where there is none."""
    marks = sorted(
        {0.0, face.length, *(x for a, b, _, _ in pieces for x in (a, b)), *(x for ab in taken for x in ab)}
    )
    cells = []
    for low, high in itertools.pairwise(marks):
        middle = 0.5 * (low + high)
        if high - low < 1e-6 or any(a <= middle <= b for a, b in taken):
            continue
        behind = next(((k, depth) for a, b, k, depth in pieces if a <= middle <= b), (-1, OUTER_THICKNESS))
        cells.append((low, high, behind[0], behind[1]))
    merged: list[tuple[float, float, int, float]] = []
    for index, (low, high, other, thickness) in enumerate(cells):
        if merged and abs(merged[-1][1] - low) < 1e-6:
            a, _, k, depth = merged[-1]
            alike = (k < 0) == (other < 0) and abs(depth - thickness) <= SAME_THICKNESS
            # Where a wall meets from behind, the two walls next to it continue as one.
            bridge = (
                other < 0 <= k
                and high - low <= THICKEST_WALL
                and index + 1 < len(cells)
                and cells[index + 1][2] >= 0
                and abs(cells[index + 1][3] - depth) <= SAME_THICKNESS
            )
            if alike or bridge:
                merged[-1] = (a, high, k, depth)
                continue
        merged.append((low, high, other, thickness))
    return merged


def _is_jamb(face: Face, low: float, high: float) -> bool:
    """True if a stretch is the end of a wall: a whole short face between two corners that reach into the floor."""
    return low < 1e-6 and high > face.length - 1e-6 and face.is_wall_end


def _with_corners(piece: WallPiece, face: Face, low: float, high: float) -> WallPiece:
    """Lengthen a wall's body at the corners of its room, so that bodies meet."""
    most = OUTER_THICKNESS if not piece.known else max(piece.thickness, OUTER_THICKNESS)
    before = most if low < 1e-6 and face.convex[0] else 0.0
    after = most if high > face.length - 1e-6 and face.convex[1] else 0.0
    return replace(piece, before=before, after=after)


def _on_opposite(
    starts: FloatArray,
    ends: FloatArray,
    pieces: list[tuple[float, float, int, float]],
    first: FloatArray,
    last: FloatArray,
) -> list[tuple[int, float, float]]:
    """Which stretches of the faces behind a wall belong to it."""
    found = []
    for _, _, k, _ in pieces:
        vector = ends[k] - starts[k]
        length = float(np.hypot(*vector))
        direction = vector / length
        a, b = float((last - starts[k]) @ direction), float((first - starts[k]) @ direction)
        a, b = max(0.0, min(a, b)), min(length, max(a, b))
        if b - a > 1e-6:
            found.append((k, a, b))
    return found
