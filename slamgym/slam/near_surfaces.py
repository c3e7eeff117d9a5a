"""The surfaces near a block of end points, looked up together: numba kernels.

What an end point pulls towards is the average of the cell means in the 3 x 3 cells round it. Point by point that is a
chain of look-ups and divisions with a branch for each neighbour; here the cells of a block of points are copied first,
all nine, and then the arithmetic runs over many points at once. An empty cell counts nothing and so adds nothing.

Convention: see :mod:`slamgym.slam.tiles` for points in cells.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.tiles import COUNT, MEAN_U, MEAN_UNITS, MEAN_V, NEIGHBOURS, TILE_BITS, TILE_MASK

BLOCK = 64
"""Points looked up together: what is kept of them fits into the nearest cache."""
SQUARE_WIDTH = 0.15
"""Closeness by which means are averaged is 1 / (this + d^2)^2 [cells^2]; 2 cm at 5 cm cells."""
NOTHING = 1e9
"""Squared distance where the neighbourhood is empty [cells^2]."""
FARTHEST = 8.0
"""Squared distance that a mean in the 3 x 3 cells round a point can't exceed [cells^2]."""
_SIDE = 1 << TILE_BITS
_BITS, _MASK = np.uint64(16), np.uint64(0xFFFF)  # of one of the four numbers of a cell
_U, _V, _N = np.uint64(16 * MEAN_U), np.uint64(16 * MEAN_V), np.uint64(16 * COUNT)


class Surfaces(NamedTuple):
    """Room for what is found near a block of points. Each row of a table is BLOCK long, so that rows lie in one array."""

    words: np.ndarray
    """(9 * BLOCK,) uint64: the cells round each point as one number each, by neighbour."""
    rows: FloatArray  # (len(Row) * BLOCK,) by the rows below


X, Y, NORMAL_U, NORMAL_V, IN_U, IN_V, SQUARE, TO_U, TO_V, WEIGHT = (BLOCK * row for row in range(10))
"""Rows of a block: end point from the robot [cells], surface normal, the cell's corner from the end point [cells], squared
distance to the nearest mean [cells^2], offset to the middle of the surface [cells], weight."""
UU, UV, VV, UT, VT, TT, PULL_U, PULL_V, PULL_T = (BLOCK * row for row in range(10, 19))
NUM_ROWS = 19


@kernel
def room_for_surfaces() -> Surfaces:
    """Room for one block."""
    return Surfaces(np.empty(9 * BLOCK, dtype=np.uint64), np.empty(NUM_ROWS * BLOCK))


@kernel
def copy_cells(
    cells: np.ndarray, table: np.ndarray, u: float, v: float, room: Surfaces, count: int
) -> None:
    """Copy the 3 x 3 cells round each of a block's first points, which lie at (u, v) plus their X and Y."""
    words, rows = room.words, room.rows
    for at in range(np.uint64(count)):
        point_u, point_v = u + rows[np.uint64(X) + at], v + rows[np.uint64(Y) + at]
        cell_u, cell_v = int(point_u), int(point_v)
        rows[np.uint64(IN_U) + at] = cell_u - point_u
        rows[np.uint64(IN_V) + at] = cell_v - point_v
        row, col = cell_v >> TILE_BITS, cell_u >> TILE_BITS
        if cell_u < 1 or cell_v < 1 or row >= table.shape[0] or col >= table.shape[1]:
            for k in range(9):
                words[np.uint64(k * BLOCK) + at] = np.uint64(0)
            continue
        tile = np.uint64(table[np.uint64(row), np.uint64(col)])
        in_u, in_v = cell_u & TILE_MASK, cell_v & TILE_MASK
        if 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK:
            first = np.uint64(((in_v - 1) << TILE_BITS) + in_u - 1)
            for k in range(9):
                words[np.uint64(k * BLOCK) + at] = cells[tile, first + np.uint64(k // 3 * _SIDE + k % 3)]
            continue
        bits = cells[tile, np.uint64((in_v << TILE_BITS) | in_u)] >> np.uint64(16 * NEIGHBOURS)
        for k in range(9):
            word = np.uint64(0)
            if bits & np.uint64(1 << k):
                near_v, near_u = cell_v + k // 3 - 1, cell_u + k % 3 - 1
                tile = np.uint64(table[np.uint64(near_v >> TILE_BITS), np.uint64(near_u >> TILE_BITS)])
                word = cells[tile, np.uint64(((near_v & TILE_MASK) << TILE_BITS) | (near_u & TILE_MASK))]
            words[np.uint64(k * BLOCK) + at] = word


@kernel
def average_means(words: np.ndarray, rows: FloatArray, count: int) -> None:
    """Squared distance to the nearest mean and offset to the middle of the surface, for a block's first points.

    The middle is the average of the means by their counts and closeness. A wall seen from slightly wrong poses is smeared
    over two cells; the nearest of its means would hold a point anywhere within it.
    """
    for j in range(np.uint64(count)):
        in_u, in_v = rows[np.uint64(IN_U) + j], rows[np.uint64(IN_V) + j]
        nearest, sum_u, sum_v, weight = NOTHING, 0.0, 0.0, 0.0
        for k in range(9):
            word = words[np.uint64(k * BLOCK) + j]
            seen = np.int64((word >> _N) & _MASK)
            offset_u = in_u + (k % 3 - 1) + np.int64((word >> _U) & _MASK) * (1.0 / MEAN_UNITS)
            offset_v = in_v + (k // 3 - 1) + np.int64((word >> _V) & _MASK) * (1.0 / MEAN_UNITS)
            d2 = offset_u * offset_u + offset_v * offset_v
            w = seen / ((SQUARE_WIDTH + d2) * (SQUARE_WIDTH + d2))
            sum_u += w * offset_u
            sum_v += w * offset_v
            weight += w
            d2 = d2 if seen > 0 else NOTHING
            nearest = d2 if d2 < nearest else nearest
        rows[np.uint64(SQUARE) + j] = nearest
        rows[np.uint64(TO_U) + j] = sum_u / weight
        rows[np.uint64(TO_V) + j] = sum_v / weight
