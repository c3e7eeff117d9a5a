"""How well two floors agree where both were seen: walls that lie on walls, and walls that lie in open floor."""

from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from slamgym.core.portable import inverted
from slamgym.core.types import FREE, BoolArray, Float32Array, FloatArray, IntArray
from slamgym.slam.graph.alignment import FACES, AlignmentTarget
from slamgym.slam.graph.relative import match_with, seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, Submap
from slamgym.slam.merge.floor import Floor, WallPieces, faces_of

FIELD_BORDER = 1.0
"""Width of the strip round a map in which distances to its walls are known [m]."""
OPEN_ROUND = 0.25
"""Floor that is free so far all round is open [m]: a wall in it is none that noisy lasers smear or bent maps move, and
a door is wider. In 17 right pairs with 1.6 km of wall one piece is left (ten at 0.15 m, four at 0.2 m), in each of 15
storeys five or more (at 0.35 m in some none)."""
STRAY_PIECES = 2.5
"""So few contradicting pieces within 15 cm are stray end points: a laser of 8 m leaves them along its walls."""


class WallAgreement(NamedTuple):
    """What two floors say of each other at a transform: the mean of both directions."""

    agreed: float  # wall on wall [m]
    contradicted: float  # wall in open floor [m]


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
        """Metres (2,) of surfaces on this floor's walls to within a tolerance [m], and on its open floor."""
        rows, cols = self._cells(surfaces.points)
        height, width = self._is_open.shape
        is_inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        rows, cols = rows[is_inside], cols[is_inside]
        faces = faces_of(surfaces.sides[is_inside])
        away = self._away[faces, rows, cols]
        is_agreed = away <= tolerance
        is_false = self._is_open[rows, cols] & ~is_agreed
        is_false[is_false] = self._are_together(rows[is_false], cols[is_false])
        counts = np.array([np.count_nonzero(is_agreed), np.count_nonzero(is_false)])
        return SUBMAP_CELL * counts

    def _are_together(self, rows: IntArray, cols: IntArray) -> BoolArray:
        """True (n,) for those of some cells that make a piece of wall; others are stray end points."""
        side = SUBMAP_CELL / self._cell
        height, width = self._is_open.shape
        coarse = (rows / side).astype(np.int64), (cols / side).astype(np.int64)
        counts = np.zeros((int(height / side) + 1, int(width / side) + 1), np.float32)
        np.add.at(counts, coarse, 1.0)
        around = cv2.boxFilter(counts, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(around[coarse] > STRAY_PIECES)


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
