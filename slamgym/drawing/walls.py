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

from slamgym.core.types import FloatArray, IntArray
from slamgym.drawing.free_space import FreeSpace
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
        shares = np.array([-self.before, self.length + self.after]) / self.length
        face, other = self.places(shares, 0.0), self.places(shares, self.thickness)
        return Polygon([face[0], *other, face[1]])


class _Stretch(NamedTuple):
    """A part of a face, and what is behind it."""

    low: float  # along the face [m]
    high: float
    thickness: float
    known: bool  # False if there is no other face

    def continues(self, other: "_Stretch") -> bool:
        """True if both are of one wall."""
        return self.known == other.known and abs(self.thickness - other.thickness) <= SAME_THICKNESS


def find_walls(floor: BaseGeometry, whole: bool = True) -> list[WallPiece]:
    """The walls round a floor and between its parts.

    Args:
        floor: With straight edges [m].
        whole: Whether walls continue where others meet them, and jambs are none; without it they are cut there.

    Returns:
        Every stretch of every face belongs to one wall; the longest faces come first. Jambs of doors belong to the
        walls that end there.
    """
    space = FreeSpace(floor)
    start, direction = space.start @ (1.0, 1j), space.direction @ (1.0, 1j)
    lengths, is_convex = space.length.tolist(), space.turn > 0.0
    taken: list[list[tuple[float, float]]] = [[] for _ in lengths]
    near = space.edges_near_edges(THICKEST_WALL)
    found = []
    for face in sorted(range(len(lengths)), key=lambda index: (-round(lengths[index], 4), index)):
        length, convex = lengths[face], (is_convex[face], is_convex[space.after[face]])
        if length < SHORTEST:
            continue
        behind = list(_behind(face, near[face], start, direction, space.length))
        for part in _stretches(length, [stretch for _, stretch in behind], taken[face], whole):
            at_ends = part.low < 1e-6, part.high > length - 1e-6
            # A short face between two corners that reach into the floor is the end of a wall.
            is_jamb = (
                whole
                and all(at_ends)
                and length <= THICKEST_WALL
                and not (any(convex) or part.known)
            )
            if part.high - part.low < SHORTEST or is_jamb:
                continue
            first, last = (
                complex(start[face] + place * direction[face]) for place in (part.low, part.high)
            )
            # Longer at the corners of its room, so that bodies meet.
            corner = max(part.thickness, OUTER_THICKNESS)
            before, after = (corner if at_ends[k] and convex[k] else 0.0 for k in (0, 1))
            found.append(WallPiece(first, last, part.thickness, part.known, before, after))
            for other, _ in behind:
                places = (np.array([last, first]) - start[other]) * direction[other].conjugate()
                low, high = np.clip(places.real, 0.0, lengths[other]).tolist()
                if high - low > 1e-6:
                    taken[other].append((low, high))
    return found


def _behind(
    face: int, near: IntArray, start: np.ndarray, direction: np.ndarray, length: FloatArray
) -> Iterator[tuple[int, _Stretch]]:
    """Faces that stand back to back with one, the nearest first.

    Args:
        face: Its number.
        near: Numbers of the faces that are near enough.
        start: Start points of all faces, (N,).
        direction: Their directions, (N,).
        length: (N,) [m].
    """
    ends = np.stack([start[near], start[near] + length[near] * direction[near]])
    places = (ends - start[face]) * direction[face].conjugate()
    low, high = (
        np.maximum(places.real.min(axis=0), 0.0),
        np.minimum(places.real.max(axis=0), length[face]),
    )
    depth = -places.imag.mean(axis=0)
    good = (direction[near] * direction[face].conjugate()).real < -ANTIPARALLEL
    good &= (high - low > SHORTEST) & (depth > 0.005) & (depth <= THICKEST_WALL)
    for k in sorted(np.flatnonzero(good).tolist(), key=depth.__getitem__):
        yield int(near[k]), _Stretch(float(low[k]), float(high[k]), float(depth[k]), True)


def _stretches(
    length: float, behind: Sequence[_Stretch], taken: Sequence[tuple[float, float]], whole: bool
) -> list[_Stretch]:
    """Parts of a face that aren't part of a wall yet, cut where the face behind changes."""
    marks = {0.0, length, *(mark for part in behind for mark in part[:2]), *itertools.chain(*taken)}
    cells = []
    for low, high in itertools.pairwise(sorted(marks)):
        middle = 0.5 * (low + high)
        if high - low >= 1e-6 and not any(a <= middle <= b for a, b in taken):
            over = (
                part._replace(low=low, high=high)
                for part in behind
                if part.low <= middle <= part.high
            )
            cells.append(next(over, _Stretch(low, high, OUTER_THICKNESS, known=False)))
    merged: list[_Stretch] = []
    for cell, following in itertools.zip_longest(cells, cells[1:]):
        last = merged[-1] if merged and abs(merged[-1].high - cell.low) < 1e-6 else None
        # Where a wall meets from behind, the two walls next to it continue as one.
        is_bridge = whole and not cell.known and cell.high - cell.low <= THICKEST_WALL and following
        if last and (last.continues(cell) or (is_bridge and last.continues(following))):
            merged[-1] = last._replace(high=cell.high)
        else:
            merged.append(cell)
    return merged
