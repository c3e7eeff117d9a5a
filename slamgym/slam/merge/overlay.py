"""How well two floors agree where both were seen: walls that lie on walls, and walls that lie in open floor."""

from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from slamgym.core.portable import inverted
from slamgym.core.types import FREE, BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from slamgym.slam.graph.alignment import FACES, AlignmentTarget
from slamgym.slam.graph.relative import match_with, seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, Submap
from slamgym.slam.merge.days import ADJOINING
from slamgym.slam.merge.floor import Floor, WallPieces, faces_of

FIELD_BORDER = 1.0
"""Width of the strip round a map in which distances to its walls are known [m]."""
OPEN_ROUND = 0.25
"""Floor that is free so far all round is open [m]: a wall in it is none that noisy lasers smear or bent maps move, and
a door is wider. In 17 right pairs with 1.6 km of wall one piece is left (ten at 0.15 m, four at 0.2 m), in each of 15
storeys five or more (at 0.35 m in some none)."""
LEAST_WALL = 0.35
"""A wall that contradicts is longer than this, with what isn't in the open: a door that one storey lacks is 0.8 m, less
where its ends lie by the other's walls [m]. With 0.5 m a mirror image would be sure."""
MOST_THICK = 0.3
"""It is no thicker than this, or ..."""
MOST_WIDE = 1.0 / 3.0
"""... than this share of its length, as walls have corners: what was moved is a heap. Both were chosen with 10 of 21
buildings; the other 11 have no wrong pair, and both halves of Freiburg 079 are sure."""


class WallAgreement(NamedTuple):
    """What two floors say of each other at a transform: the mean of both directions."""

    agreed: float  # wall on wall [m]
    contradicted: float  # wall in open floor [m]
    moved: float  # what else stands in open floor [m]


class FloorFields:
    """A floor, made ready for the surfaces of others."""

    def __init__(self, floor: Floor) -> None:
        frame = floor.grid.frame
        self.floor = floor
        self._cell = frame.resolution
        border = round(FIELD_BORDER / self._cell)
        self._corner = np.array([frame.origin_x, frame.origin_y]) - border * self._cell
        free = np.pad(floor.grid.cells[::-1] == FREE, border)
        self._away: Float32Array = np.empty((FACES, *free.shape), np.float32)
        points, sides = floor.surfaces
        rows, cols = self._cells(points)
        nowhere = np.ones(free.shape, dtype=bool)
        for face, is_seen in enumerate(floor.surfaces.seen_by_face()):
            is_empty = nowhere.copy()
            is_empty[rows[is_seen], cols[is_seen]] = False
            self._away[face] = distance_transform_edt(is_empty, sampling=self._cell)
        reach = float(np.hypot(points[:, 0], points[:, 1]).max()) + FIELD_BORDER
        submap = Submap(0, reach)
        submap.add(np.zeros(3), points, sides)
        submap.close()
        self._target = AlignmentTarget([submap], np.zeros((1, 3)))
        clearance = distance_transform_edt(free, sampling=self._cell)
        self._is_free: BoolArray = free
        self._is_open: BoolArray = clearance > OPEN_ROUND - 0.5 * self._cell

    def align(self, surfaces: WallPieces, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The pose (3,) near a given one at which some surfaces in its frame lie best on this floor's walls.

        Returns:
            The pose, and its covariance (3, 3).
        """
        unknown = np.zeros((3, 3))
        placed = self._target.align(surfaces.points, surfaces.sides, pose, pose, unknown)
        sums = placed.equations.sums[0]
        match = match_with(np.zeros((1, 3)), 0, 0, placed.pose, sums, 1)
        return placed.pose, inverted(match.information + np.eye(3))

    def _cells(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        """Rows and columns of points (n, 2), the lowest row first."""
        cols, rows = np.floor((points - self._corner) / self._cell).astype(np.int64).T
        return rows, cols

    def compare(self, surfaces: WallPieces, tolerance: float) -> FloatArray:
        """Metres (3,) of surfaces as :class:`WallAgreement` has them, to within a tolerance [m]."""
        rows, cols = self._cells(surfaces.points)
        height, width = self._is_open.shape
        is_inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        rows, cols = rows[is_inside], cols[is_inside]
        faces = faces_of(surfaces.sides[is_inside])
        away = self._away[faces, rows, cols]
        is_agreed = away <= tolerance
        is_apart = self._is_free[rows, cols] & ~is_agreed
        false, moved = self._count_open(rows[is_apart], cols[is_apart])
        return SUBMAP_CELL * np.array([np.count_nonzero(is_agreed), false, moved])

    def _count_open(self, rows: IntArray, cols: IntArray) -> tuple[int, int]:
        """Numbers of some cells on free floor that lie in the open, those that are parts of walls and others."""
        apart: ByteArray = np.zeros(self._is_open.shape, np.uint8)
        apart[rows, cols] = 1
        _, pieces = cv2.connectedComponents(cv2.dilate(apart, ADJOINING))
        numbers = pieces[rows, cols]
        is_open = self._is_open[rows, cols]
        walls = 0
        for number in np.unique(numbers[is_open]).tolist():
            is_own = numbers == number
            points = np.column_stack([cols[is_own], rows[is_own]]).astype(np.float32)
            _, sides, _ = cv2.minAreaRect(points)
            length = self._cell * max(sides)
            width = self._cell * min(sides)
            if length >= LEAST_WALL and width <= max(MOST_THICK, MOST_WIDE * length):
                walls += int(np.count_nonzero(is_open & is_own))
        return walls, int(np.count_nonzero(is_open)) - walls


def agreement(
    here: FloorFields, there: FloorFields, pose: FloatArray, tolerance: float
) -> WallAgreement:
    """Compare two floors.

    Args:
        here: One of them.
        there: The other.
        pose: (3,) of the frame of ``there`` in that of ``here``.
        tolerance: Walls agree that are so near [m].
    """
    ahead = here.compare(there.floor.surfaces.placed(pose), tolerance)
    back = there.compare(here.floor.surfaces.placed(seen_from(pose, np.zeros(3))), tolerance)
    return WallAgreement(*(0.5 * (ahead + back)).tolist())
