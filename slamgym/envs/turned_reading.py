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
    corner, resolution = tiles[1], tiles[2]
    one = float(1 << _FRACTION)
    cos, sin = round(pitch * one * math.cos(pose[2])), round(pitch * one * math.sin(pose[2]))
    # Exact to the lattice for any given part of the map.
    row = (
        round(pose[1] / resolution * one)
        + (last[0] * sin + last[1] * cos) // 2
        - (corner[0] << _FRACTION)
    )
    col = (
        round(pose[0] / resolution * one)
        + (last[0] * cos - last[1] * sin) // 2
        - (corner[1] << _FRACTION)
    )
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
            row, col = (j * samples + k) * right[0], (j * samples + k) * right[1]
            at = k * count + j
            table[0, at], table[1, at] = np.uint32(row), np.uint32(col)
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
    top, left, bottom, end = known[2], known[3], known[0], known[1]
    for a, b in ((0, 0), (0, last[1]), (last[0], 0), (last[0], last[1])):
        row = (first[0] + a * down[0] + b * right[0]) >> _FRACTION
        col = (first[1] + a * down[1] + b * right[1]) >> _FRACTION
        top, bottom, left, end = (
            min(top, row),
            max(bottom, row + 1),
            min(left, col),
            max(end, col + 1),
        )
    seen = np.uint8(0)
    left, end = max(left, known[1]), min(end, known[3])
    for row in range(max(top, known[0]), min(bottom, known[2])):
        for at in range(row * cols + left, row * cols + end, 64):
            seen |= flat[np.uint64(at)]
    read[0, 0] = seen


@kernel
def _points_between(begin: int, step: int, low: int, end: int, points: Place) -> Place:
    """Of some points, half open, those that lie between two borders [cells], half open."""
    low, end = (low << _FRACTION) - begin, (end << _FRACTION) - begin
    if step == 0:
        return points if low <= 0 < end else (0, 0)
    if step < 0:
        low, end, step = 1 - end, 1 - low, -step
    inverse = 1.0 / step  # a division of whole numbers would take longer than reading the line
    first, last = math.ceil(low * inverse), math.ceil(end * inverse)
    first += (first * step < low) - ((first - 1) * step >= low)
    last += (last * step < end) - ((last - 1) * step >= end)
    return max(points[0], first), min(points[1], last)


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
    num_points, is_there = table.shape[1], False
    count, share = num_points // samples, 1.0 / samples
    for a in range(read.shape[0]):
        begin, end = _points_between(row, right[0], known[0], known[2], (0, num_points))
        begin, end = _points_between(col, right[1], known[1], known[3], (begin, end))
        if begin > 0 or end < num_points:
            for k in range(num_points):
                read[a, k] = UNKNOWN
        if begin < end:
            is_there = True
            row_rest, col_rest = np.uint32(~row), np.uint32(~col)
            here = (row >> _FRACTION) * cols + (col >> _FRACTION)
            corner, above = np.uint32(here), np.uint32(here + cols)
            for k in range(num_points):
                begins = above if table[0, k] > row_rest else corner
                beside = np.uint32(1) if table[1, k] > col_rest else np.uint32(0)
                table[3, k] = begins + beside + table[2, k]
            first, last = int((begin + 0.5) * share), int((end + 0.5) * share)
            before, after = begin - first * samples, end - last * samples
            for s in range(samples):
                begin, end = s * count + first + (s < before), s * count + last + (s < after)
                for k in range(np.uint64(begin), np.uint64(end)):
                    read[a, k] = flat[table[3, k]]
        row, col = row + down[0], col + down[1]
    return is_there
