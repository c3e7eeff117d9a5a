"""Particle maps as tables of shared tiles: numba kernels.

A particle's map holds what GMapping's holds: per cell the number of end points that fell into it and their
mean. Maps of particles that share their past are mostly equal, so a map is a table of tile numbers into one
pool, tiles are counted references, and a tile is copied only when one of its owners writes to it. Resampling
then copies tables instead of maps, and its cost hardly depends on the size of the building.

Convention: points are in cells, ``(u, v) = (x, y) / resolution`` from the lower left corner of the table;
tile ``[row, col]`` covers cells ``[row * TILE, (row + 1) * TILE)`` in v and likewise in u, rows upwards.
A cell is four uint16, so that all that is asked of it lies in eight bytes of one cache line: the mean end
point within the cell (in 1/65536 of a cell, i.e. 0.8 um at 5 cm, in a map of any size), the count, and the
neighbours. Half of the time of a naive layout goes into waiting for memory.
"""

from typing import NamedTuple

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray

TILE_BITS = 5
"""Bits of a place within a tile."""
TILE = 1 << TILE_BITS
"""Cells along a tile's side: 1.6 m at 5 cm."""
TILE_MASK = TILE - 1
"""Mask of a place within a tile."""
EMPTY = 0
"""The tile that stands for every tile never written to; it is never written to itself."""
MAX_COUNT = 65535
"""A cell counts no more end points than this: the most that 16 bits hold."""
MEAN_U = 0
"""Index of the mean along u in a cell's four numbers."""
MEAN_V = 1
"""Index of the mean along v in a cell's four numbers."""
COUNT = 2
"""Index of the count of end points in a cell's four numbers."""
NEIGHBOURS = 3
"""Index of the neighbours with a mean in a cell's four numbers."""
MEAN_UNITS = 65536.0
"""Units of a mean per cell."""


class TilePool(NamedTuple):
    """Storage of all tiles of all particles; ``C`` is the capacity."""

    cells: np.ndarray
    """(C, TILE * TILE, 4) uint16: mean u and v [1 / MEAN_UNITS cells], end points seen (stops at MAX_COUNT),
    and the neighbours that hold a mean (bit ``3 * (dv + 1) + du + 1``)."""
    references: np.ndarray  # (C,) int32 how many tables name the tile
    free: np.ndarray  # (C,) int32 stack of unused tile numbers
    num_free: IntArray  # (1,) height of the stack

    @staticmethod
    def empty(capacity: int) -> "TilePool":
        """A pool of ``capacity`` unused tiles, the first of them the empty tile."""
        free = np.zeros(capacity, dtype=np.int32)
        free[: capacity - 1] = np.arange(capacity - 1, 0, -1)
        return TilePool(
            cells=np.zeros((capacity, TILE * TILE, 4), dtype=np.uint16),
            references=np.zeros(capacity, dtype=np.int32),
            free=free,
            num_free=np.array([capacity - 1], dtype=np.int64),
        )

    def grown(self, capacity: int) -> "TilePool":
        """A pool of larger ``capacity`` with the same contents."""
        larger = TilePool.empty(capacity)
        size = len(self.references)
        larger.cells[:size] = self.cells
        larger.references[:size] = self.references
        # The new tiles lie below those that were unused before.
        larger.free[capacity - size :] = self.free
        larger.num_free[0] = self.num_free[0] + capacity - size
        return larger


class TileMaps(NamedTuple):
    """The maps of all particles."""

    pool: TilePool
    tables: np.ndarray  # (particles, rows, cols) int32 tile numbers
    origin: FloatArray  # (2,) lower left corner of the tables [m]
    resolution: float  # [m]


@kernel
def writable_tile(pool: TilePool, table: np.ndarray, row: int, col: int) -> int:
    """The tile at ``[row, col]``, made this table's own first; the pool must have a free tile."""
    tile = table[row, col]
    if tile != EMPTY and pool.references[tile] == 1:
        return tile
    pool.num_free[0] -= 1
    fresh = pool.free[pool.num_free[0]]
    pool.references[fresh] = 1
    assign(pool.cells[tile], pool.cells[fresh])
    if tile != EMPTY:
        pool.references[tile] -= 1
    table[row, col] = fresh
    return fresh


@kernel
def _begin_cell(pool: TilePool, table: np.ndarray, cell_u: int, cell_v: int) -> None:
    """Tell the neighbours of a cell that it holds a mean from now on; its tile is this table's own."""
    at_u = cell_u & TILE_MASK
    at_v = cell_v & TILE_MASK
    inside = 0 < at_u < TILE_MASK and 0 < at_v < TILE_MASK
    tile = table[cell_v >> TILE_BITS, cell_u >> TILE_BITS]
    for dv in range(-1, 2):
        for du in range(-1, 2):
            near = tile
            if not inside:
                row = (cell_v + dv) >> TILE_BITS
                col = (cell_u + du) >> TILE_BITS
                near = writable_tile(pool, table, row, col)
            near_u = (at_u + du) & TILE_MASK
            near_v = (at_v + dv) & TILE_MASK
            near_cell = np.uint64((near_v << TILE_BITS) | near_u)
            # Seen from the neighbour, the new mean lies the other way.
            bit = np.uint16(1 << (3 * (1 - dv) + 1 - du))
            pool.cells[np.uint64(near), near_cell, np.uint64(NEIGHBOURS)] |= bit


@kernel
def register_scan(maps: TileMaps, poses: FloatArray, points: FloatArray, first: int) -> int:
    """Add a scan's end points to each particle's own map at the particle's pose.

    Args:
        maps: The particles' maps.
        poses: (particles, 3) [m, m, rad].
        points: (n, 2) end points in the robot frame [m].
        first: Particle to begin with.

    Returns:
        The particle that the pool had too few free tiles for, or the number of particles when done. The
        caller lets the pool grow and calls again from there.
    """
    parts, tables, origin, resolution = maps
    pool = TilePool(*parts)
    scale = 1.0 / resolution
    cells = pool.cells
    # An end point touches at most four tiles: its own and those of its neighbour cells.
    most = min(4 * len(points), tables.shape[1] * tables.shape[2])
    max_u = tables.shape[2] * TILE - 1.0
    max_v = tables.shape[1] * TILE - 1.0
    for p in range(first, len(poses)):
        if pool.num_free[0] < most:
            return p
        cos = np.cos(poses[p, 2]) * scale
        sin = np.sin(poses[p, 2]) * scale
        u0 = (poses[p, 0] - origin[0]) * scale
        v0 = (poses[p, 1] - origin[1]) * scale
        row = -1
        col = -1
        tile = EMPTY
        table = tables[p]
        for i in range(len(points)):
            u = u0 + cos * points[i, 0] - sin * points[i, 1]
            v = v0 + sin * points[i, 0] + cos * points[i, 1]
            if u >= 1.0 and v >= 1.0 and u < max_u and v < max_v:
                cell_u = int(u)
                cell_v = int(v)
                at_row = cell_v >> TILE_BITS
                at_col = cell_u >> TILE_BITS
                # Neighbouring beams mostly end in the same tile.
                if at_row != row or at_col != col:
                    row = at_row
                    col = at_col
                    tile = writable_tile(pool, table, row, col)
                # Indices are unsigned, so that none is asked whether it counts from the end.
                cell = np.uint64(((cell_v & TILE_MASK) << TILE_BITS) | (cell_u & TILE_MASK))
                own = np.uint64(tile)
                in_u = (u - cell_u) * MEAN_UNITS
                in_v = (v - cell_v) * MEAN_UNITS
                count = int(cells[own, cell, np.uint64(COUNT)])
                if count == 0:
                    cells[own, cell, np.uint64(MEAN_U)] = np.uint16(in_u)
                    cells[own, cell, np.uint64(MEAN_V)] = np.uint16(in_v)
                    cells[own, cell, np.uint64(COUNT)] = 1
                    _begin_cell(pool, table, cell_u, cell_v)
                    continue
                gain = 1.0 / (count + 1)
                mean_u = float(cells[own, cell, np.uint64(MEAN_U)])
                mean_v = float(cells[own, cell, np.uint64(MEAN_V)])
                # A convex combination of values below MEAN_UNITS, half a unit for rounding: never out of range.
                mean_u = min(mean_u + gain * (in_u - mean_u) + 0.5, MEAN_UNITS - 1.0)
                mean_v = min(mean_v + gain * (in_v - mean_v) + 0.5, MEAN_UNITS - 1.0)
                cells[own, cell, np.uint64(MEAN_U)] = np.uint16(mean_u)
                cells[own, cell, np.uint64(MEAN_V)] = np.uint16(mean_v)
                if count < MAX_COUNT:
                    cells[own, cell, np.uint64(COUNT)] = np.uint16(count + 1)
    return len(poses)


@kernel
def copy_maps(pool: TilePool, tables: np.ndarray, ancestors: IntArray) -> None:
    """Give each particle the map of its ancestor; a tile that no table names any more becomes free.

    Args:
        pool: The tiles.
        tables: (particles, rows, cols) int32, changed in place.
        ancestors: (particles,) sorted so that no survivor's place is given away: ``ancestors[i] == i`` for
            each place i that occurs in it.
    """
    for p in range(len(ancestors)):
        source = ancestors[p]
        if source == p:
            continue
        for row in range(tables.shape[1]):
            for col in range(tables.shape[2]):
                old = tables[p, row, col]
                new = tables[source, row, col]
                if old == new:
                    continue
                tables[p, row, col] = new
                if new != EMPTY:
                    pool.references[new] += 1
                if old != EMPTY:
                    pool.references[old] -= 1
                    if pool.references[old] == 0:
                        pool.free[pool.num_free[0]] = old
                        pool.num_free[0] += 1
