"""How well two floors agree where both were seen: walls that lie on walls, and walls that lie in open floor."""

import math
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slamgym.core.jit import kernel
from slamgym.core.portable import inverted
from slamgym.core.types import FREE, ByteArray, Float32Array, FloatArray, IntArray
from slamgym.slam.branch_and_bound import face_of
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.relative import WEAK, is_within, moved_by, seen_from, weigh_match
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints, known_submap
from slamgym.slam.merge.floor import Floor
from slamgym.slam.merge.joint import MOST_MOVED

FIELD_BORDER = 1.0
"""Width of the strip round a map in which distances to its walls are known [m]."""
TOLERANCES = (0.2, 0.1)
"""Walls agree that are so near, before two maps are aligned and once they are [m]; the second is a cell of a submap."""
COARSE, FINE = 0, 1
"""Their numbers."""
LEAST_AWAY = 1e-3
"""Distances that differ by less are the same [m]."""
OPEN, AGREES = 2, 3
"""States of surfaces on free floor in the open, and on walls; on other free floor they have 1, elsewhere 0."""
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
STEPS_AHEAD = 5
"""A wall is in line with another if so many cells of submaps ahead of an end, and one behind it, ..."""
LEAST_STEPS = 4
"""... show so many steps of that. With 5, 17 of 105 wrong pairs would be sure where 3 and 4 leave 10."""
FACES_ACROSS = 0.7
"""Sine of the angle between a wall and the sides of its surfaces, at least. Without, a day and a home are refused."""


class WallAgreement(NamedTuple):
    """What two floors say of each other at a transform: the mean of both directions."""

    agreed: float  # wall on wall [m]
    contradicted: float  # wall in open floor [m]
    moved: float  # what else stands in open floor [m]
    in_line: float = 0.0  # of what is contradicted, in line with a wall that both show [m]


class FloorFields:
    """A floor, made ready for the surfaces of others."""

    def __init__(self, floor: Floor) -> None:
        frame = floor.grid.frame
        self.floor = floor
        self._cell = frame.resolution
        border = round(FIELD_BORDER / self._cell)
        self._corner = np.array([frame.origin_x, frame.origin_y]) - border * self._cell
        free: ByteArray = np.pad((floor.grid.cells[::-1] == FREE).astype(np.uint8), border)
        points = floor.surfaces.points
        cols, rows = np.floor((points - self._corner) / self._cell).astype(np.int64).T
        self._near: ByteArray = np.zeros((len(TOLERANCES), *free.shape), np.uint8)
        for face, is_seen in enumerate(floor.surfaces.seen_by_face()):
            is_empty = np.ones(free.shape, np.uint8)
            is_empty[rows[is_seen], cols[is_seen]] = 0
            away = self._away_from_zeros(is_empty)
            for near, tolerance in zip(self._near, TOLERANCES, strict=True):
                near[away < tolerance + LEAST_AWAY] |= 1 << face
        is_open = self._away_from_zeros(free) > OPEN_ROUND - 0.5 * self._cell
        self._ground: ByteArray = free + is_open

    def _away_from_zeros(self, image: ByteArray) -> Float32Array:
        """Distance of each cell from the next one that is 0 [m]."""
        away = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(away, np.float32) * np.float32(self._cell)

    @cached_property
    def _target(self) -> AlignmentTarget:
        submap = known_submap(self.floor.surfaces, np.zeros(3))
        return AlignmentTarget([submap], np.zeros((1, 3)))

    def align(self, surfaces: OrientedPoints, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The pose (3,) near a given one at which some surfaces in its frame lie best on this floor's walls.

        Returns:
            The pose, and its covariance (3, 3).
        """
        placed = self._target.align_freely(surfaces, pose)
        _, information = weigh_match(placed.total, 0.0, 1, WEAK)
        return placed.pose, inverted(information + np.eye(3))

    def bent(self, other: Floor, pose: FloatArray) -> OrientedPoints:
        """The surfaces of another floor about where a pose (3,) lays it: those nearest to a view are moved with it."""
        if not other.views:
            return other.surfaces.placed(pose)
        middles = np.array([view.pose[:2] for view in other.views])
        _, nearest = cKDTree(middles).query(other.surfaces.points)
        parts = []
        for number, view in enumerate(other.views):
            expected = moved_by(pose, view.pose)
            place, _ = self.align(view.surfaces, expected)
            if not is_within(place, expected, MOST_MOVED):
                place = expected
            own = other.surfaces.at(nearest == number)
            parts.append(own.placed(moved_by(place, seen_from(view.pose, np.zeros(3)))))
        # All pieces are kept: as many metres count as in a rigid picture.
        return OrientedPoints.joined(parts)

    def compare(self, surfaces: OrientedPoints, tolerance: int, tells_walls: bool) -> FloatArray:
        """Metres (4,) of surfaces as for :func:`agreement`."""
        near = self._near[tolerance]
        states = lay_surfaces(*surfaces, near, self._ground, self._corner, self._cell)
        agreed = np.count_nonzero(states == AGREES)
        stands = np.count_nonzero(states == OPEN)
        walls, in_line = self._count_walls(surfaces, states) if tells_walls and stands else (0, 0)
        return SUBMAP_CELL * np.array([agreed, walls, stands - walls, in_line])

    def _count_walls(self, surfaces: OrientedPoints, states: ByteArray) -> tuple[int, int]:
        """Number of surfaces in the open that are parts of walls, and of those in line with walls that agree."""
        cells = np.floor((surfaces.points - self._corner) / self._cell)
        agreed = OrientedPoints(self._cell * cells, surfaces.sides).at(states == AGREES)
        is_free = (states > 0) & (states < AGREES)
        free = cells[is_free]
        is_open = states[is_free] == OPEN
        numbers = piece_numbers(free)
        order = np.argsort(numbers, kind="stable")
        walls = in_line = 0
        for own in np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1):
            in_open = int(np.count_nonzero(is_open[own]))
            if not in_open:
                continue
            middle, sides, angle = cv2.minAreaRect(free[own].astype(np.float32))
            length = self._cell * max(sides)
            width = self._cell * min(sides)
            if length < LEAST_WALL or width > max(MOST_THICK, MOST_WIDE * length):
                continue
            walls += in_open
            heading = math.radians(angle if sides[0] >= sides[1] else angle + 90.0)
            place = (self._cell * middle[0], self._cell * middle[1])
            if goes_on(*agreed, place, heading, 0.5 * length):
                in_line += in_open
        return walls, in_line


@kernel
def goes_on(
    points: FloatArray, sides: FloatArray, middle: tuple[float, float], heading: float, end: float
) -> bool:
    """Whether surfaces go on in line with a wall.

    Args:
        points: (n, 2) surfaces [m].
        sides: (n, 3) their sides.
        middle: Of the wall [m].
        heading: Of the wall [rad].
        end: Half of its length [m].
    """
    cos = math.cos(heading)
    sin = math.sin(heading)
    is_seen = np.zeros((2, STEPS_AHEAD + 1), dtype=np.bool_)
    for i in range(len(points)):
        x = points[i, 0] - middle[0]
        y = points[i, 1] - middle[1]
        along = cos * x + sin * y
        step = math.floor((abs(along) - end) / SUBMAP_CELL) + 1
        is_beside = abs(cos * y - sin * x) < TOLERANCES[FINE]
        is_across = abs(cos * sides[i, 1] - sin * sides[i, 0]) > FACES_ACROSS
        if is_beside and is_across and 0 <= step <= STEPS_AHEAD:
            is_seen[int(along > 0.0), step] = True
    return max(is_seen[0].sum(), is_seen[1].sum()) >= LEAST_STEPS


@kernel
def lay_surfaces(
    points: FloatArray,
    sides: FloatArray,
    near: ByteArray,
    ground: ByteArray,
    corner: FloatArray,
    cell: float,
) -> ByteArray:
    """Tell surfaces near walls that face the same way, and those on free floor elsewhere.

    Args:
        points: (n, 2) surfaces [m].
        sides: (n, 3) their sides.
        near: (rows, cols) with a bit for each face that a wall nearby has.
        ground: (rows, cols) 0 where floor isn't free.
        corner: (2,) of the cells [m].
        cell: Their size [m].

    Returns:
        Their states (n,).
    """
    rows, cols = ground.shape
    states = np.zeros(len(points), dtype=np.uint8)
    for i in range(len(points)):
        col = math.floor((points[i, 0] - corner[0]) / cell)
        row = math.floor((points[i, 1] - corner[1]) / cell)
        if row < 0 or col < 0 or row >= rows or col >= cols:
            continue
        if near[row, col] >> face_of(sides[i, 0], sides[i, 1]) & 1:
            states[i] = AGREES
        else:
            states[i] = ground[row, col]
    return states


def piece_numbers(cells: FloatArray | IntArray) -> IntArray:
    """Number the pieces (n,) of some cells (n, 2) of a grid; two are in one piece if fewer than three lie between."""
    first, second = cKDTree(cells).query_pairs(3.0, p=np.inf, output_type="ndarray").T
    beside = coo_array((np.ones(len(first)), (first, second)), shape=(len(cells), len(cells)))
    return np.asarray(connected_components(beside, directed=False)[1])


def agreement(
    here: FloorFields,
    there: FloorFields,
    pose: FloatArray,
    tolerance: int,
    tells_walls: bool = True,
    is_bent: bool = False,
) -> WallAgreement:
    """Compare two floors.

    Args:
        here: One of them.
        there: The other.
        pose: (3,) of the frame of ``there`` in that of ``here``.
        tolerance: ``COARSE`` or ``FINE``.
        tells_walls: Tell walls from what was moved; else all counts as moved, which is quicker.
        is_bent: Lay each part of a floor where the other's walls near it are.
    """
    said = np.zeros(len(WallAgreement._fields))
    for one, other, place in ((here, there, pose), (there, here, seen_from(pose, np.zeros(3)))):
        laid = one.bent(other.floor, place) if is_bent else other.floor.surfaces.placed(place)
        said += 0.5 * one.compare(laid, tolerance, tells_walls)
    return WallAgreement(*said.tolist())
