"""The cell means near each cell that a climb looks at, gathered once: numba kernels.

A climb scores some 80 poses a few centimetres apart, so that a beam's end point falls into the same few cells
again and again. The means of the 3 x 3 cells are kept as a short list; the next look at the cell spares the
walk through tiles, rows and neighbours.

Convention: see :mod:`slamgym.slam.tiles` for points in cells.
"""

from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.tiles import EMPTY, MEAN_U, MEAN_UNITS, MEAN_V, NEIGHBOURS, TILE_BITS, TILE_MASK

SLOT_BITS = 7
SLOTS_ACROSS = 1 << SLOT_BITS
SLOT_MASK = SLOTS_ACROSS - 1
"""Cells this many apart share a slot: 6.4 m at 5 cm, twice what a TurtleBot3 sees, so that few compete."""
MAX_MEANS = 1 << 13
"""When so many means are kept all are forgotten."""
END_SHIFT = 32
END_MASK = (1 << END_SHIFT) - 1
COORDINATE_BITS = 20


class NearMeans(NamedTuple):
    """What one climb after the other remembers of the map that it looks at."""

    slots: IntArray
    """(SLOTS_ACROSS * SLOTS_ACROSS, 2): number of a cell (map, v and u, COORDINATE_BITS each), and where its
    means begin and end (``begin | end << END_SHIFT``)."""
    means: FloatArray  # (MAX_MEANS, 2) from the corner of their cell [cells]
    state: IntArray  # (2,) number of the map, means kept


@kernel
def empty_means() -> NearMeans:
    """A memory that holds nothing."""
    return NearMeans(
        np.zeros((SLOTS_ACROSS * SLOTS_ACROSS, 2), dtype=np.int64),
        np.empty((MAX_MEANS, 2)),
        np.zeros(2, dtype=np.int64),
    )


@kernel
def forget(near: NearMeans) -> None:
    """Begin with another map."""
    near.state[0] += 1
    near.state[1] = 0


@kernel
def gather(
    cells: np.ndarray, table: np.ndarray, cell_u: int, cell_v: int, means: FloatArray, first: int
) -> int:
    """Write the means of the 3 x 3 cells round a cell to ``means[first:]``.

    Args:
        cells: The pool's cells.
        table: (rows, cols) int32, the map.
        cell_u: The cell; 1 or more.
        cell_v: The same upwards.
        means: Receives the means, from the corner of the cell [cells].
        first: Where to begin.

    Returns:
        Where they end.
    """
    row, col = cell_v >> TILE_BITS, cell_u >> TILE_BITS
    if row >= table.shape[0] or col >= table.shape[1] or table[row, col] == EMPTY:
        return first
    tile = np.uint64(table[row, col])
    in_u, in_v = cell_u & TILE_MASK, cell_v & TILE_MASK
    left = np.uint64(cells[tile, np.uint64((in_v << TILE_BITS) | in_u), np.uint64(NEIGHBOURS)])
    inside = 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK
    end = np.uint64(first)
    for dv in range(-1, 2):
        for du in range(-1, 2):
            if left & np.uint64(1):
                if not inside:
                    tile = np.uint64(table[(cell_v + dv) >> TILE_BITS, (cell_u + du) >> TILE_BITS])
                cell = np.uint64((((in_v + dv) & TILE_MASK) << TILE_BITS) | ((in_u + du) & TILE_MASK))
                means[end, np.uint64(0)] = du + cells[tile, cell, np.uint64(MEAN_U)] * (1.0 / MEAN_UNITS)
                means[end, np.uint64(1)] = dv + cells[tile, cell, np.uint64(MEAN_V)] * (1.0 / MEAN_UNITS)
                end += np.uint64(1)
            left >>= np.uint64(1)
    return int(np.int64(end))
