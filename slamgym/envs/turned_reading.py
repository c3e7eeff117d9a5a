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
Tiles = tuple[ByteArray, Place, float]
"""A map: its cells, row 0 at the bottom, the row and column at which they begin, and their size [m]."""


@kernel
def turned_grid(tiles: Tiles, pose: FloatArray, pitch: float, last: Place) -> tuple[Place, Place, Place]:
    """Where the points of a grid lie: the first one, and the ways from line to line and from point to point.

    Convention: the robot is in the middle of the grid, ahead is up, its left is left.

    Args:
        tiles: The map.
        pose: The robot in the map frame, shape (3,) [m, m, rad].
        pitch: Distance of the points [cells].
        last: Numbers of the last line and of its last point.
    """
    _, corner, resolution = tiles
    one = float(1 << _FRACTION)
    cos, sin = round(pitch * one * math.cos(pose[2])), round(pitch * one * math.sin(pose[2]))
    # Exact to the lattice for any given part of the map.
    row = round(pose[1] / resolution * one) + (last[0] * sin + last[1] * cos) // 2 - (corner[0] << _FRACTION)
    col = round(pose[0] / resolution * one) + (last[0] * cos - last[1] * sin) // 2 - (corner[1] << _FRACTION)
    return (row, col), (-sin, -cos), (-cos, sin)


@kernel
def line_table(cols: int, right: Place, count: int, samples: int) -> np.ndarray:
    """Offsets of the points of a line, shape (6, count * samples) uint32.

    They are whole rows and columns, their fractions, and distances in memory; the last row is room.

    Args:
        cols: Of the map.
        right: From point to point.
        count: Groups of points; the first of each come first, then the second of each, and so on.
        samples: Points in a group.
    """
    table = np.empty((6, count * samples), np.uint32)
    for k in range(samples):
        for j in range(count):
            row, col = (j * samples + k) * right[0], (j * samples + k) * right[1]
            at = k * count + j
            table[0, at], table[1, at] = np.uint32(row >> _FRACTION), np.uint32(col >> _FRACTION)
            table[2, at], table[3, at] = np.uint32(row), np.uint32(col)
            table[4, at] = np.uint32((row >> _FRACTION) * cols + (col >> _FRACTION))
    return table


@kernel
def is_inside(
    cells: ByteArray, first: Place, down: Place, right: Place, last: Place, read: ByteArray
) -> bool:
    """True if all points of a grid are on the map; fetches the rows between them then, of which lines cross many.

    Args:
        cells: The map, shape (H, W).
        first: The first point.
        down: From line to line.
        right: From point to point.
        last: Numbers of the last line and of its last point.
        read: Its first value is changed, so that the compiler leaves the fetching in.
    """
    rows, cols = cells.shape
    top, left, bottom, end = rows, cols, -1, -1
    for a, b in ((0, 0), (0, last[1]), (last[0], 0), (last[0], last[1])):
        row = (first[0] + a * down[0] + b * right[0]) >> _FRACTION
        col = (first[1] + a * down[1] + b * right[1]) >> _FRACTION
        top, bottom, left, end = min(top, row), max(bottom, row), min(left, col), max(end, col)
    if top < 0 or left < 0 or bottom >= rows or end >= cols:
        return False
    flat, seen = cells.reshape(-1), np.uint8(0)
    for row in range(top, bottom + 1):
        for at in range(row * cols + left, row * cols + end, 64):
            seen |= flat[np.uint64(at)]
    read[0, 0] = seen
    return True


@kernel
def read_turned(
    flat: ByteArray, shape: Place, first: Place, down: Place, inside: bool, table: np.ndarray, read: ByteArray
) -> None:
    """Read the points of some lines; unknown beyond the map. No part of an array is taken, which would be counted.

    Args:
        flat: The map, row by row.
        shape: Its rows and columns.
        first: The first point of the first line.
        down: From line to line.
        inside: True if all points are on the map.
        table: From :func:`line_table`.
        read: Receives the values, shape (lines, points).
    """
    rows, cols = np.uint32(shape[0]), np.uint32(shape[1])
    for a in range(read.shape[0]):
        begin = first[0] + a * down[0], first[1] + a * down[1]
        top, left = np.uint32(begin[0] >> _FRACTION), np.uint32(begin[1] >> _FRACTION)
        row_rest, col_rest = np.uint32(~begin[0]), np.uint32(~begin[1])
        if inside:
            corner = np.uint32(top * cols + left)
            for k in range(table.shape[1]):
                carried = np.uint32(table[3, k] > col_rest) + cols * np.uint32(table[2, k] > row_rest)
                table[5, k] = corner + table[4, k] + carried
            for k in range(table.shape[1]):
                read[a, k] = flat[table[5, k]]
            continue
        for k in range(table.shape[1]):
            row = np.uint32(top + table[0, k] + np.uint32(table[2, k] > row_rest))
            col = np.uint32(left + table[1, k] + np.uint32(table[3, k] > col_rest))
            is_there = row < rows and col < cols
            read[a, k] = flat[row * cols + col] if is_there else np.uint8(UNKNOWN)
