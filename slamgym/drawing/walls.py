"""Walls from the faces that bound the floor: two faces that stand back to back are one wall.

Points are complex numbers, x + iy, in metres.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.core.types import FloatArray
from slamgym.drawing.free_space import FreeSpace
from slamgym.drawing.settings import (
    OUTER_THICKNESS,
    SAME_DIRECTION,
    SAME_PLACE,
    THICKEST_WALL,
    THINNEST_WALL,
    USUAL_CELL,
)


@dataclass(frozen=True)
class WallPiece:
    """A straight wall: a stretch of one face, and how far behind it the other lies."""

    start: complex
    end: complex
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
        return abs(self.end - self.start)

    def places(self, shares: FloatArray, depth: float) -> FloatArray:
        """Points (N, 2) at shares (N,) of its length, so far behind its face [m]."""
        along = self.end - self.start
        points = self.start + along * (shares - 1j * depth / self.length)
        return np.column_stack([points.real, points.imag])

    @property
    def centre_line(self) -> FloatArray:
        """Its ends, corners left out, (2, 2) [m]."""
        return self.places(np.array([0.0, 1.0]), 0.5 * self.thickness)

    @property
    def body(self) -> Polygon:
        """A rectangle, corners included."""
        ends = np.array([-self.before, self.length + self.after])
        shares = ends / self.length
        face = self.places(shares, 0.0)
        other = self.places(shares, self.thickness)
        return Polygon([face[0], *other, face[1]])


class _Stretch(NamedTuple):
    """A part of a face, and what is behind it."""

    low: float  # along the face [m]
    high: float
    thickness: float
    known: bool  # False if there is no other face

    def continues(self, other: "_Stretch") -> bool:
        """True if both are of one wall, across what meets it on the other side."""
        return self.known == other.known and abs(self.thickness - other.thickness) <= USUAL_CELL


def find_walls(floor: BaseGeometry, whole: bool = True) -> list[WallPiece]:
    """The walls round a floor and between its parts.

    Args:
        floor: With straight edges [m].
        whole: Whether walls continue where others meet them, and jambs are none; without it they are cut there.

    Returns:
        Every stretch of every face belongs to one wall; the longest faces come first. Jambs of doors belong to the
        walls that end there.
    """
    faces = _Faces(FreeSpace(floor))
    taken: list[list[tuple[float, float]]] = [[] for _ in faces.lengths]
    found = []
    for face in faces.longest_first():
        length = faces.lengths[face]
        if length < SAME_PLACE:
            continue
        behind = list(faces.behind(face))
        stretches = [stretch for _, stretch in behind]
        for part in _stretches(length, stretches, taken[face], whole):
            is_jamb = whole and not part.known and faces.is_end_of_wall(face, part)
            if part.high - part.low < SAME_PLACE or is_jamb:
                continue
            piece = faces.wall(face, part)
            found.append(piece)
            for other, _ in behind:
                low, high = faces.covered(other, piece)
                if high - low > 1e-6:
                    taken[other].append((low, high))
    return found


class _Faces:
    """The faces of all walls of a floor."""

    def __init__(self, space: FreeSpace) -> None:
        self.lengths: list[float] = space.length.tolist()
        self._length = space.length
        self._start = space.start @ (1.0, 1j)
        self._direction = space.direction @ (1.0, 1j)
        self._is_convex = space.turn > 0.0
        self._after = space.after
        self._near = space.edges_near_edges(THICKEST_WALL)

    def longest_first(self) -> list[int]:
        """The numbers of all faces."""
        numbers = range(len(self.lengths))
        return sorted(numbers, key=lambda number: -round(self.lengths[number], 4))

    def behind(self, face: int) -> Iterator[tuple[int, _Stretch]]:
        """Faces that stand back to back with one, the nearest first."""
        near = self._near[face]
        start = self._start[near]
        direction = self._direction[near]
        end = start + self._length[near] * direction
        ends = np.stack([start, end])
        turn = self._direction[face].conjugate()
        places = (ends - self._start[face]) * turn
        along = places.real
        low = np.maximum(along.min(axis=0), 0.0)
        high = np.minimum(along.max(axis=0), self._length[face])
        depth = -places.imag.mean(axis=0)
        is_opposite = (direction * turn).real < -math.cos(SAME_DIRECTION)
        is_wall = (depth > 0.5 * THINNEST_WALL) & (depth <= THICKEST_WALL)
        good = is_opposite & is_wall & (high - low > SAME_PLACE)
        for k in sorted(np.flatnonzero(good).tolist(), key=depth.__getitem__):
            stretch = _Stretch(float(low[k]), float(high[k]), float(depth[k]), known=True)
            yield int(near[k]), stretch

    def is_end_of_wall(self, face: int, part: _Stretch) -> bool:
        """True if a stretch is a short face between two corners that reach into the floor."""
        length = self.lengths[face]
        is_all_of_it = part.low < 1e-6 and part.high > length - 1e-6
        any_convex = self._is_convex[face] or self._is_convex[self._after[face]]
        return is_all_of_it and length <= THICKEST_WALL and not any_convex

    def wall(self, face: int, part: _Stretch) -> WallPiece:
        """A stretch of a face as a wall."""
        start = self._start[face]
        direction = self._direction[face]
        first = complex(start + part.low * direction)
        last = complex(start + part.high * direction)
        # Longer at the corners of its room, so that bodies meet.
        corner = max(part.thickness, OUTER_THICKNESS)
        is_at_start = part.low < 1e-6
        is_at_end = part.high > self.lengths[face] - 1e-6
        from_corner = is_at_start and self._is_convex[face]
        to_corner = is_at_end and self._is_convex[self._after[face]]
        before = corner if from_corner else 0.0
        after = corner if to_corner else 0.0
        return WallPiece(first, last, part.thickness, part.known, before, after)

    def covered(self, face: int, piece: WallPiece) -> tuple[float, float]:
        """From where to where a wall lies along a face behind it [m]."""
        ends = np.array([piece.end, piece.start])
        turn = self._direction[face].conjugate()
        places = (ends - self._start[face]) * turn
        along = np.clip(places.real, 0.0, self.lengths[face])
        low, high = along.tolist()
        return low, high


def _stretches(
    length: float, behind: Sequence[_Stretch], taken: Sequence[tuple[float, float]], whole: bool
) -> list[_Stretch]:
    """Parts of a face that aren't part of a wall yet, cut where the face behind changes."""
    marks = {0.0, length, *itertools.chain(*taken)}
    for part in behind:
        marks |= {part.low, part.high}
    cells = []
    for low, high in itertools.pairwise(sorted(marks)):
        middle = 0.5 * (low + high)
        is_taken = any(first <= middle <= last for first, last in taken)
        if high - low >= 1e-6 and not is_taken:
            cells.append(_nearest_behind(behind, low, high))
    merged: list[_Stretch] = []
    for cell, following in itertools.zip_longest(cells, cells[1:]):
        if merged and _is_one_wall(merged[-1], cell, following, whole):
            merged[-1] = merged[-1]._replace(high=cell.high)
        else:
            merged.append(cell)
    return merged


def _nearest_behind(behind: Sequence[_Stretch], low: float, high: float) -> _Stretch:
    """The first stretch that lies behind a part of a face, cut to it; one of no known thickness if there is none."""
    middle = 0.5 * (low + high)
    for part in behind:
        if part.low <= middle <= part.high:
            return part._replace(low=low, high=high)
    return _Stretch(low, high, OUTER_THICKNESS, known=False)


def _is_one_wall(last: _Stretch, cell: _Stretch, following: _Stretch | None, whole: bool) -> bool:
    """True if a stretch continues the one before it, or only bridges the place where a wall meets from behind."""
    if abs(last.high - cell.low) >= 1e-6:
        return False
    if last.continues(cell):
        return True
    may_bridge = whole and not cell.known and cell.high - cell.low <= THICKEST_WALL
    return may_bridge and following is not None and last.continues(following)
