"""How well two floors agree where both were seen: walls that lie on walls, beside them, and on free floor."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from slamgym.core.portable import inverted
from slamgym.core.types import FREE, BoolArray, Float32Array, FloatArray, IntArray
from slamgym.slam.graph.alignment import FACES, AlignmentTarget
from slamgym.slam.graph.relative import match_with, seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, Submap
from slamgym.slam.merge.floor import Floor, Surfaces

BORDER = 1.0
"""Width of the strip round a map in which distances to its walls are known [m]."""
BESIDE = 0.3
"""A wall this near to one of the other map that faces the same way may be the same, or beside it [m]."""


class Agreement(NamedTuple):
    """What two floors say of each other at a transform: the mean of both directions."""

    agreed: float  # wall on wall [m]
    beside: float  # wall in front of or behind a wall [m]
    contradicted: float  # wall on free floor [m]

    @property
    def share(self) -> float:
        """Share of the walls seen on both maps that contradicts."""
        against = self.beside + self.contradicted
        return against / max(self.agreed + against, 1e-9)


def faces_of(sides: FloatArray) -> IntArray:
    """Numbers (n,) of the axes x, y, -x, -y that some sides (n, 2 or more) face most."""
    x, y = sides[:, 0], sides[:, 1]
    along_x = np.where(x > 0.0, 0, 2)
    along_y = np.where(y > 0.0, 1, 3)
    return np.asarray(np.where(np.abs(x) >= np.abs(y), along_x, along_y))


class FloorFields:
    """A floor, made ready for the surfaces of others."""

    def __init__(self, floor: Floor) -> None:
        frame = floor.grid.frame
        self.floor = floor
        self._cell = frame.resolution
        border = round(BORDER / self._cell)
        self._corner = np.array([frame.origin_x, frame.origin_y]) - border * self._cell
        free = np.pad(floor.grid.cells[::-1] == FREE, border)
        self._away: Float32Array = np.empty((FACES, *free.shape), np.float32)
        points, sides = floor.surfaces
        rows, cols = self._cells(points)
        to_x, to_y = sides[:, 0], sides[:, 1]
        nowhere = np.ones(free.shape, dtype=bool)
        for face, towards in enumerate((to_x, to_y, -to_x, -to_y)):
            is_empty = nowhere.copy()
            is_seen = towards > 0.0
            is_empty[rows[is_seen], cols[is_seen]] = False
            self._away[face] = distance_transform_edt(is_empty, sampling=self._cell)
        reach = float(np.hypot(points[:, 0], points[:, 1]).max()) + BORDER
        submap = Submap(0, reach)
        submap.add(np.zeros(3), points, sides)
        submap.close()
        self._target = AlignmentTarget([submap], np.zeros((1, 3)))
        self._is_free: BoolArray = free

    def align(self, surfaces: Surfaces, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
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

    def compare(self, surfaces: Surfaces, tolerance: float) -> FloatArray:
        """Metres (3,) of surfaces on this floor's walls to within a tolerance [m], beside them, and on its floor."""
        rows, cols = self._cells(surfaces.points)
        height, width = self._is_free.shape
        is_inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        rows, cols = rows[is_inside], cols[is_inside]
        faces = faces_of(surfaces.sides[is_inside])
        away = self._away[faces, rows, cols]
        is_agreed = away <= tolerance
        is_false = self._is_free[rows, cols] & ~is_agreed
        agreed = np.count_nonzero(is_agreed)
        beside = np.count_nonzero(is_false & (away <= BESIDE))
        contradicted = np.count_nonzero(is_false) - beside
        return SUBMAP_CELL * np.array([agreed, beside, contradicted], dtype=np.float64)


def agreement(
    here: FloorFields, there: FloorFields, pose: FloatArray, tolerance: float
) -> Agreement:
    """Compare two floors.

    Args:
        here: One of them.
        there: The other.
        pose: (3,) of the frame of ``there`` in that of ``here``.
        tolerance: Walls agree that are so near [m].
    """
    ahead = here.compare(there.floor.surfaces.placed(pose), tolerance)
    back = there.compare(here.floor.surfaces.placed(seen_from(pose, np.zeros(3))), tolerance)
    return Agreement(*(0.5 * (ahead + back)).tolist())
