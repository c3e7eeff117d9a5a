"""Reading a map along the lines of a grid that is turned against it: numba kernels.

Positions are in 1 / 2^32 of a cell. A line's points are its first one and the same offsets in every line, so that what
differs from line to line is whether the fractions add up to a cell more; all loops but the one that reads become vector
instructions.
"""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import UNKNOWN, ByteArray, FloatArray

_FRACTION = 32

Place = tuple[int, int]
"""Row and column, or how they change from point to point."""
Lines = tuple[Place, Place, Place]
"""A grid's first point, the way from line to line, and the way from point to point."""
CellBox = tuple[int, int, int, int]
"""First row and column, and the end of the rows and columns."""
Tiles = tuple[ByteArray, Place, float, CellBox]
"""A map: its cells, row 0 at the bottom, the row and column at which they begin, their size [m], and the box of cells
beyond which all is unknown."""


@kernel
def turned_grid(tiles: Tiles, pose: FloatArray, pitch: float, last: Place) -> Lines:
    """Where the points of a grid lie.

    Convention: the robot is in the middle of the grid, ahead is up, its left is left.

    Args:
        tiles: The map.
        pose: The robot in the map frame, shape (3,) [m, m, rad].
        pitch: Distance of the points [cells].
        last: Numbers of the last line and of its last point.
    """
    corner = tiles[1]
    resolution = tiles[2]
    one = float(1 << _FRACTION)
    cos = round(pitch * one * math.cos(pose[2]))
    sin = round(pitch * one * math.sin(pose[2]))
    # Exact to the lattice for any given part of the map.
    robot_row = round(pose[1] / resolution * one) - (corner[0] << _FRACTION)
    robot_col = round(pose[0] / resolution * one) - (corner[1] << _FRACTION)
    row = robot_row + (last[0] * sin + last[1] * cos) // 2
    col = robot_col + (last[0] * cos - last[1] * sin) // 2
    return (row, col), (-sin, -cos), (-cos, sin)


@kernel
def line_table(cols: int, right: Place, count: int, samples: int) -> np.ndarray:
    """Offsets of the points of a line, shape (4, count * samples) uint32.

    They are the fractions of rows and columns, and distances in memory; the last row is room.

    Args:
        cols: Of the map.
        right: From point to point.
        count: Groups of points; the first of each come first, then the second of each, and so on.
        samples: Points in a group.
    """
    table = np.empty((4, count * samples), np.uint32)
    for k in range(samples):
        for j in range(count):
            point = j * samples + k
            row = point * right[0]
            col = point * right[1]
            at = k * count + j
            table[0, at] = np.uint32(row)
            table[1, at] = np.uint32(col)
            table[2, at] = np.uint32((row >> _FRACTION) * cols + (col >> _FRACTION))
    return table


@kernel
def fetch_rows(
    flat: ByteArray, cols: int, known: CellBox, lines: Lines, last: Place, read: ByteArray
) -> None:
    """Fetch the rows of the map below a grid, of which lines cross many.

    Args:
        flat: The map, row by row.
        cols: Its columns.
        known: Where it may be known.
        lines: The grid.
        last: Numbers of its last line and of its last point.
        read: Its first value is changed, so that the compiler leaves the fetching in.
    """
    first, down, right = lines
    known_top, known_left, known_bottom, known_end = known
    top = known_bottom
    left = known_end
    bottom = known_top
    end = known_left
    for a, b in ((0, 0), (0, last[1]), (last[0], 0), (last[0], last[1])):
        row = (first[0] + a * down[0] + b * right[0]) >> _FRACTION
        col = (first[1] + a * down[1] + b * right[1]) >> _FRACTION
        top = min(top, row)
        bottom = max(bottom, row + 1)
        left = min(left, col)
        end = max(end, col + 1)
    seen = np.uint8(0)
    left = max(left, known_left)
    end = min(end, known_end)
    for row in range(max(top, known_top), min(bottom, known_bottom)):
        begin = row * cols
        for at in range(begin + left, begin + end, 64):
            seen |= flat[np.uint64(at)]
    read[0, 0] = seen


@kernel
def _points_between(begin: int, step: int, low: int, end: int, points: Place) -> Place:
    """Of some points, half open, those that lie between two borders [cells], half open."""
    low = (low << _FRACTION) - begin
    end = (end << _FRACTION) - begin
    if step == 0:
        return points if low <= 0 < end else (0, 0)
    if step < 0:
        low, end = 1 - end, 1 - low
        step = -step
    first = _first_point_from(low, step)
    last = _first_point_from(end, step)
    return max(points[0], first), min(points[1], last)


@kernel
def _first_point_from(border: int, step: int) -> int:
    """Number of the first of the points at multiples of a positive step that isn't below a border."""
    inverse = 1.0 / step  # a division of whole numbers would take longer than reading the line
    number = math.ceil(border * inverse)
    return number + (number * step < border) - ((number - 1) * step >= border)


@kernel
def read_turned(
    flat: ByteArray,
    cols: int,
    known: CellBox,
    lines: Lines,
    samples: int,
    table: np.ndarray,
    read: ByteArray,
) -> bool:
    """Read the points of some lines; unknown where the map is. No part of an array is taken, which would be counted.

    Args:
        flat: The map, row by row.
        cols: Its columns.
        known: Where it may be known.
        lines: The first point of the first line, from line to line, and from point to point.
        samples: Points in a group.
        table: From :func:`line_table`.
        read: Receives the values, shape (lines, points).

    Returns:
        True if one of the points is where the map may be known.
    """
    (row, col), down, right = lines
    num_points = table.shape[1]
    count = num_points // samples
    share = 1.0 / samples
    is_there = False
    for a in range(read.shape[0]):
        begin, end = _points_between(row, right[0], known[0], known[2], (0, num_points))
        begin, end = _points_between(col, right[1], known[1], known[3], (begin, end))
        if begin > 0 or end < num_points:
            for k in range(num_points):
                read[a, k] = UNKNOWN
        if begin < end:
            is_there = True
            row_rest = np.uint32(~row)
            col_rest = np.uint32(~col)
            here = (row >> _FRACTION) * cols + (col >> _FRACTION)
            corner = np.uint32(here)
            above = np.uint32(here + cols)
            for k in range(num_points):
                begins = above if table[0, k] > row_rest else corner
                beside = np.uint32(1) if table[1, k] > col_rest else np.uint32(0)
                table[3, k] = begins + beside + table[2, k]
            first = int((begin + 0.5) * share)
            last = int((end + 0.5) * share)
            before = begin - first * samples
            after = end - last * samples
            for s in range(samples):
                begin = s * count + first + (s < before)
                end = s * count + last + (s < after)
                for k in range(np.uint64(begin), np.uint64(end)):
                    read[a, k] = flat[table[3, k]]
        row += down[0]
        col += down[1]
    return is_there
