"""Submaps: the surfaces that a few successive scans saw.

A submap is a grid of square cells in the frame of its first scan. Each cell holds up to two pieces of surface, one for
each side that it was seen from, so that the two faces of a thin wall stay apart. A piece is the straight line through
the end points of its 3 x 3 cells (5 x 5 where there are few), as in the normal-distributions transform (Biber and
Strasser, IROS 2003). Where no line fits, nothing is claimed.

Conventions: poses are (x, y, theta) [m, m, rad]. Grids have row 0 at the bottom.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.geometry import transform_points
from slamgym.core.jit import kernel, plain
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    BoolArray,
    Float32Array,
    FloatArray,
    OccupancyGrid,
    Pose2D,
)
from slamgym.slam.end_points import (
    NORMAL_GAP,
    OBLIQUE_GAP,
    surface_normals,
    surfaces_going_on,
    usable_end_points,
)
from slamgym.slam.graph.relative import seen_from
from slamgym.slam.hit_count_kernels import BeamTable

SUBMAP_CELL = 0.1
"""Size of a cell [m]: of furniture's scale, and few of an indoor scanner's beams fall between."""
SUBMAP_BORDER = 5
"""Cells round the surfaces of a submap to which no more scans are added."""
VACANT = -1
"""Number of a piece that a cell of the grid doesn't have."""
ENOUGH = 4.0
"""Points that a line needs."""
FLATNESS = 0.35**2
"""A line's variance across is below this share of that along. Two walls that meet have 0.5^2."""
LEAST_LENGTH = 0.02
"""A line is at least so long (standard deviation) [m]."""
STALE = -1.0
"""State of a piece whose line must be fitted again."""
NO_LINE = 0.0
"""State of a piece through which no line fits."""
LINE = 1.0
"""State of a piece with a line."""
HAS_NORMAL = 1.0
"""A point has a normal: its surface is straight."""
JOINED = 2.0
"""A point has a normal, and its surface goes on to the next beam's point."""
POINT_SUMS = ("count", "x", "y", "xx", "xy", "yy", "side_x", "side_y")
"""Sums over a piece's points, in the submap's frame, and over their sides."""
LINE_FIELDS = ("own_x", "own_y", "mean_x", "mean_y", "normal_x", "normal_y", "variance", "state")
"""The piece's own mean, the mean of the line through it and its surroundings, the line's normal, the variance of its
points across it, and what is known of the line."""
PIECE = np.dtype([(name, np.float64) for name in (*POINT_SUMS, *LINE_FIELDS)])
"""A piece of surface."""


class OrientedPoints(NamedTuple):
    """End points of a scan, or pieces of a map's surfaces, and the sides that they were seen from."""

    points: FloatArray  # (n, 2) [m]
    sides: FloatArray
    """(n, 3) unit vectors to the side that they were seen from, and :data:`HAS_NORMAL` where that is the surface's
    normal, or :data:`JOINED`; 0 where the scan shows no straight surface and it is the direction to the laser."""

    @staticmethod
    def joined(parts: Sequence["OrientedPoints"]) -> "OrientedPoints":
        """Those of one or more together."""
        return OrientedPoints(*map(np.concatenate, zip(*parts, strict=True)))

    def at(self, which: Any) -> "OrientedPoints":
        """Those that an index (a slice, numbers or a mask) chooses."""
        return OrientedPoints(*(np.ascontiguousarray(column[which]) for column in self))

    def every(self, stride: int) -> "OrientedPoints":
        """Every so many of them."""
        return self.at(slice(None, None, stride))

    def placed(self, pose: FloatArray) -> "OrientedPoints":
        """The same, given in the frame of a pose (3,), in the frame that the pose is given in."""
        frame = Pose2D(*pose.tolist())
        turned = transform_points(Pose2D(0.0, 0.0, frame.theta), self.sides[:, :2])
        sides = np.column_stack([turned, self.sides[:, 2]])
        return OrientedPoints(transform_points(frame, self.points), sides)

    def seen_by_face(self) -> BoolArray:
        """Which of them one sees who looks against x, y, -x and -y, shape (4, n)."""
        to_x, to_y, _ = self.sides.T
        return np.stack([to_x, to_y, -to_x, -to_y]) > 0.0

    @property
    def reach(self) -> float:
        """How far the furthest is from the origin [m]; 0 without any."""
        return float(np.hypot(*self.points.T).max(initial=0.0))


class Submap:
    """Surfaces in the frame of a node.

    Args:
        first: The node, the first of those whose scans make the submap.
        reach: Points lie no further than this from the node [m].
    """

    def __init__(self, first: int, reach: float) -> None:
        half = math.ceil(reach / SUBMAP_CELL) + 3
        self.first = first
        self.size = 0.0
        self.corner = np.array([-half * SUBMAP_CELL, -half * SUBMAP_CELL])
        self.grid = np.full((2 * half, 2 * half, 2), VACANT, dtype=np.int32)
        self.pieces = np.zeros(256, dtype=PIECE)
        self.poses: list[FloatArray] = []
        """Poses (3,) of the scans in the submap's frame, as they were drawn."""
        self.centre = np.zeros(2)
        """Mean of the surfaces in the submap's frame, once it is closed [m]."""
        self.checked = 0
        """Number of optimisations of the graph after which it was last compared with the path."""
        self._used = 0
        self._lines: OrientedPoints | None = None

    def add(self, pose: FloatArray, seen: OrientedPoints) -> None:
        """Draw a scan, in the frame of a robot at a pose (3,) in the submap's."""
        points, sides = between_beams(*seen)
        capacity = len(self.pieces)
        count = len(points)
        if self._used + count > capacity:
            more = np.zeros(capacity + count, dtype=PIECE)
            self.pieces = np.concatenate([self.pieces, more])
        self.poses.append(pose)
        self._lines = None
        self._used = add_scan(self.grid, self.pieces, self._used, self.corner, pose, points, sides)

    def clear(self) -> None:
        """Forget the scans."""
        self.grid[:] = VACANT
        self.poses = []
        self._used = 0

    def close(self) -> None:
        """Free the memory round the surfaces: no more scans will be added."""
        is_used = self.grid[..., 0] != VACANT
        if not is_used.any():
            return
        rows = np.flatnonzero(is_used.any(axis=1))
        cols = np.flatnonzero(is_used.any(axis=0))
        # A border lets the scans move a little when the path is corrected.
        top = max(rows[0] - SUBMAP_BORDER, 0)
        left = max(cols[0] - SUBMAP_BORDER, 0)
        end_row = rows[-1] + 1 + SUBMAP_BORDER
        end_col = cols[-1] + 1 + SUBMAP_BORDER
        self.grid = self.grid[top:end_row, left:end_col].copy()
        self.corner = self.corner + np.array([left, top]) * SUBMAP_CELL
        self.pieces = self.pieces[: self._used].copy()
        x, y, count = (self.pieces[name].sum() for name in ("x", "y", "count"))
        self.centre = np.array([x, y]) / count

    @property
    def means(self) -> OrientedPoints:
        """The means of all pieces in the submap's frame; the vectors to their sides have any length."""
        pieces = self.pieces[: self._used]
        means = np.column_stack([pieces["own_x"], pieces["own_y"]])
        sides = np.column_stack([pieces["side_x"], pieces["side_y"], np.zeros(self._used)])
        return OrientedPoints(means, sides)

    def lines(self) -> OrientedPoints:
        """The means of the pieces with a line, in the submap's frame."""
        if self._lines is None:
            pieces = self.pieces[: self._used]
            has_line = pieces["state"] == LINE
            lines = pieces[has_line]
            means, sides = self.means
            straight = np.ones(len(lines))
            normals = np.column_stack([lines["normal_x"], lines["normal_y"], straight])
            facing = (normals * sides[has_line]).sum(axis=1)
            normals[facing < 0.0, :2] *= -1.0
            self._lines = OrientedPoints(means[has_line], normals)
        return self._lines


@kernel
def between_beams(points: FloatArray, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A scan's points and sides, and more where beams are further apart than cells on a straight surface.

    A laser of few beams leaves most cells of a wall empty: with a quarter of its beams and a millimetre of noise the
    path through ACES is 4.2 m off without these points, through CSAIL 0.74, the lab 0.71 (one noise); with them 0.24,
    0.20, 0.25 (medians of three). With all beams, and in homes, they change nothing.
    """
    count = len(points)
    more = np.zeros(count, dtype=np.int64)
    for i in range(count - 1):
        if sides[i, 2] == JOINED:
            gap = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
            more[i] = math.floor(gap / SUBMAP_CELL)
    if not more.any():
        return points, sides
    all_points = np.empty((count + more.sum(), 2))
    all_sides = np.empty((count + more.sum(), 3))
    k = 0
    for i in range(count):
        for j in range(more[i] + 1):
            share = j / (more[i] + 1)
            all_points[k] = points[i]
            if j > 0:
                all_points[k] += share * (points[i + 1] - points[i])
            all_sides[k] = sides[i]
            k += 1
    return all_points, all_sides


@kernel
def add_scan(
    grid: np.ndarray,
    pieces: np.ndarray,
    used: int,
    corner: FloatArray,
    pose: FloatArray,
    points: FloatArray,
    sides: FloatArray,
) -> int:
    """Put a scan's end points into cells and fit the lines round them again; see :class:`Submap`.

    Returns:
        The number of pieces, ``used`` before.
    """
    rows = grid.shape[0]
    cols = grid.shape[1]
    cos = math.cos(pose[2])
    sin = math.sin(pose[2])
    touched = np.empty(len(points), dtype=np.int32)
    count = 0
    for i in range(len(points)):
        x = pose[0] + cos * points[i, 0] - sin * points[i, 1]
        y = pose[1] + sin * points[i, 0] + cos * points[i, 1]
        col = math.floor((x - corner[0]) / SUBMAP_CELL)
        row = math.floor((y - corner[1]) / SUBMAP_CELL)
        if row < 0 or col < 0 or row >= rows or col >= cols:
            continue
        side_x = cos * sides[i, 0] - sin * sides[i, 1]
        side_y = sin * sides[i, 0] + cos * sides[i, 1]
        face = 0
        number = grid[row, col, 0]
        if number != VACANT:
            p = pieces[number]
            if p.side_x * side_x + p.side_y * side_y < 0.0:
                face = 1
                number = grid[row, col, 1]
        if number == VACANT:
            number = used
            used += 1
            grid[row, col, face] = number
            p = pieces[number]
            p.count = p.x = p.y = p.xx = p.xy = p.yy = p.side_x = p.side_y = 0.0
        p = pieces[number]
        p.count += 1.0
        p.x += x
        p.y += y
        p.xx += x * x
        p.xy += x * y
        p.yy += y * y
        p.side_x += side_x
        p.side_y += side_y
        touched[count] = row * cols + col
        count += 1
    for is_marking in (True, False):
        for k in range(count):
            row = touched[k] // cols
            col = touched[k] % cols
            for near_row in range(max(row - 1, 0), min(row + 2, rows)):
                for near_col in range(max(col - 1, 0), min(col + 2, cols)):
                    for face in range(2):
                        number = grid[near_row, near_col, face]
                        if number == VACANT:
                            continue
                        if is_marking:
                            pieces[number].state = STALE
                        elif pieces[number].state == STALE:
                            _fit_line(grid, pieces, number, near_row, near_col)
    return used


@kernel
def _fit_line(grid: np.ndarray, pieces: np.ndarray, number: int, row: int, col: int) -> None:
    """Fit a line to the points round a piece that were seen from the same side."""
    own = pieces[number]
    own.own_x = own.x / own.count
    own.own_y = own.y / own.count
    own.state = NO_LINE
    for ring in range(1, 3):
        n = sx = sy = sxx = sxy = syy = 0.0
        for near_row in range(max(row - ring, 0), min(row + ring + 1, grid.shape[0])):
            for near_col in range(max(col - ring, 0), min(col + ring + 1, grid.shape[1])):
                for face in range(2):
                    near = grid[near_row, near_col, face]
                    if near == VACANT:
                        continue
                    p = pieces[near]
                    if p.side_x * own.side_x + p.side_y * own.side_y < 0.0:
                        continue
                    n += p.count
                    sx += p.x
                    sy += p.y
                    sxx += p.xx
                    sxy += p.xy
                    syy += p.yy
        if n < ENOUGH:
            continue
        mean_x = sx / n
        mean_y = sy / n
        var_x = sxx / n - mean_x * mean_x
        var_y = syy / n - mean_y * mean_y
        cov = sxy / n - mean_x * mean_y
        middle = 0.5 * (var_x + var_y)
        half = 0.5 * (var_x - var_y)
        root = math.sqrt(half * half + cov * cov)
        wide = middle + root
        narrow = max(middle - root, 0.0)
        if wide >= LEAST_LENGTH * LEAST_LENGTH and narrow < FLATNESS * wide:
            along = 0.5 * math.atan2(2.0 * cov, var_x - var_y)
            own.mean_x = mean_x
            own.mean_y = mean_y
            own.normal_x = -math.sin(along)
            own.normal_y = math.cos(along)
            # A line takes two of the points' freedoms: few points lie near theirs by chance.
            own.variance = narrow * n / (n - 2.0)
            own.state = LINE
            return


def oriented_scan(ranges: Float32Array, beams: BeamTable, longest: float) -> OrientedPoints:
    """End points of the beams of a scan (num_beams,) [m] that can be matched, and are no longer [m]."""
    points = usable_end_points(ranges, plain(beams), longest)
    return oriented(points, beams.mount, beams.spacing)


def oriented(points: FloatArray, mount: FloatArray, spacing: float = 0.0) -> OrientedPoints:
    """End points with their sides.

    Args:
        points: (n, 2) in the order of the beams [m].
        mount: (2,) the laser that saw them [m].
        spacing: How far its beams are apart at a distance of 1 m [m].
    """
    points = np.ascontiguousarray(points)
    sides = np.zeros((len(points), 3))
    to_laser = sides[:, :2]
    to_laser[:] = mount - points
    distances = np.hypot(sides[:, 0], sides[:, 1])
    to_laser /= distances[:, None] + 1e-9
    spacings = spacing * distances
    normals = surface_normals(points, np.maximum(NORMAL_GAP, OBLIQUE_GAP * spacings))
    is_joined = surfaces_going_on(points, normals, to_laser, spacings, spacing)
    # The side of a surface is told by its normal: past a thin wall's end both faces are seen from the same direction.
    is_away = (to_laser * normals).sum(axis=1) < 0.0
    normals[is_away] *= -1.0
    shown = normals.any(axis=1)
    sides[shown, :2] = normals[shown]
    sides[shown, 2] = HAS_NORMAL
    sides[is_joined, 2] = JOINED
    return OrientedPoints(points, sides)


def known_surfaces(grid: OccupancyGrid) -> OrientedPoints:
    """Occupied cells next to free ones, once for each side that is free."""
    cells = grid.cells[::-1]
    frame = grid.frame
    origin = (frame.origin_x, frame.origin_y)
    occupied = cells == OCCUPIED
    free = np.pad(cells == FREE, 1)
    rows, cols = occupied.shape
    points = []
    sides = []
    for row, col in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        top = 1 + row
        left = 1 + col
        beside = free[top : top + rows, left : left + cols]
        indices = np.argwhere(occupied & beside)[:, ::-1]
        points.append((indices + 0.5) * frame.resolution + origin)
        side = np.array([col, row, 1.0])
        sides.append(np.tile(side, (len(indices), 1)))
    return OrientedPoints(np.concatenate(points), np.concatenate(sides))


def known_submap(surfaces: OrientedPoints, start: FloatArray) -> Submap:
    """A submap of an older map's surfaces, in the frame of the first node, whose pose (3,) in that map is given."""
    away = OrientedPoints(surfaces.points - start[:2], surfaces.sides).reach
    submap = Submap(0, away + 1.0)
    submap.add(seen_from(start, np.zeros(3)), surfaces)
    submap.close()
    return submap
