"""The surfaces near the end points of a scan, looked up block by block: numba kernels.

What an end point is drawn to is the average of the cell means in the 3 x 3 cells round it. Point by point that is a
chain of look-ups with a branch and a division for each neighbour. Here all nine cells of each point of a block are
copied first, and the arithmetic then runs over many points at once; a cell without a mean counts nothing, so it adds
nothing. Loops over points stand inside the kernels: to hand a call so many arrays costs more than the look at a point.

Convention: see :mod:`slamgym.slam.tiles` for points in cells.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.hill_climbing import exp_of_minus
from slamgym.slam.tiles import COUNT, MEAN_U, MEAN_UNITS, MEAN_V, NEIGHBOURS, TILE, TILE_BITS, TILE_MASK

BLOCK_POINTS = 64
"""Points looked up together: what is kept of them fits into the nearest cache."""
NUM_ROWS = 19
X, Y, NORMAL_U, NORMAL_V, IN_U, IN_V, SQUARE, TO_U, TO_V = (np.uint64(BLOCK_POINTS * row) for row in range(9))
WEIGHT, UU, UV, VV, UT, VT, TT, PULL_U, PULL_V, PULL_T = (
    np.uint64(BLOCK_POINTS * row) for row in range(9, 19)
)
"""Where the rows of a block begin: end point seen from the pose [cells], unit normal of the surface there, corner of
the point's cell seen from the point [cells], squared distance to the nearest mean [cells^2], offset to the middle of
the surface [cells], weight, information, and pull. Unsigned, for such an index isn't asked whether it counts from the
end."""
TOGETHER = 8
"""Processors take up to so many points at once, and those left over one by one: places up to the next multiple are
computed, too, with any content."""
NOTHING = 1e9
"""Squared distance where the neighbourhood is empty [cells^2]."""
SQUARE_WIDTH = 0.15
"""Closeness by which means are averaged is 1 / (this + d^2)^2 [cells^2]; 2 cm at 5 cm cells."""
TANGENT = 0.1
"""Weight of a distance along the surface against one across it. Along a wall the nearest mean says little,
but not nothing: without it, a scan that sees two parallel walls slides."""
_FARTHEST = 8.0  # no mean in the 3 x 3 cells is farther, squared [cells^2]
_MASK = np.uint64(0xFFFF)  # one of the four numbers of a cell
_U, _V, _COUNT = np.uint64(16 * MEAN_U), np.uint64(16 * MEAN_V), np.uint64(16 * COUNT)


class Block(NamedTuple):
    """Room for what is found near a block of points, and for the sums over a scan.

    At constant distances within one array the compiler sees that rows don't overlap; else it takes one point at a time.
    """

    cells: np.ndarray
    """(9 * BLOCK_POINTS,) uint64: the cells round each point, each as one number, by neighbour."""
    rows: FloatArray  # (NUM_ROWS * BLOCK_POINTS,)
    sums: FloatArray  # (11,) log-likelihood, then the sums of the rows WEIGHT to PULL_T


@kernel
def empty_block() -> Block:
    """Room for a block."""
    return Block(np.zeros(9 * BLOCK_POINTS, dtype=np.uint64), np.zeros(NUM_ROWS * BLOCK_POINTS), np.zeros(11))


@kernel
def _filled_up(count: int) -> Any:
    """The next multiple of TOGETHER, unsigned."""
    return np.uint64((count + TOGETHER - 1) // TOGETHER * TOGETHER)


@kernel
def see_points(
    points: FloatArray, normals: FloatArray, begin: int, stride: int, theta: float, block: Block, count: int
) -> None:
    """Turn ``count`` end points (n, 2) [cells] and normals (n, 2), each ``stride``-th from ``begin``: X to NORMAL_V."""
    cos, sin, rows = math.cos(theta), math.sin(theta), block.rows
    for j in range(np.uint64(count)):
        i = np.uint64(begin) + j * np.uint64(stride)
        rows[X + j] = cos * points[i, 0] - sin * points[i, 1]
        rows[Y + j] = sin * points[i, 0] + cos * points[i, 1]
        rows[NORMAL_U + j] = cos * normals[i, 0] - sin * normals[i, 1]
        rows[NORMAL_V + j] = sin * normals[i, 0] + cos * normals[i, 1]


@kernel
def copy_cells(cells: np.ndarray, table: np.ndarray, u: float, v: float, block: Block, count: int) -> None:
    """Copy the 3 x 3 cells round each of the first points of a block.

    Args:
        cells: (C, TILE * TILE) uint64, the pool's cells, each as one number.
        table: (rows, cols) int32, the map.
        u: Position that the points are seen from [cells].
        v: The same upwards.
        block: Holds X and Y; receives the cells, and IN_U and IN_V.
        count: How many points.
    """
    near, rows = block.cells, block.rows
    for j in range(np.uint64(count)):
        point_u, point_v = u + rows[X + j], v + rows[Y + j]
        cell_u, cell_v = int(point_u), int(point_v)
        rows[IN_U + j], rows[IN_V + j] = cell_u - point_u, cell_v - point_v
        row, col = cell_v >> TILE_BITS, cell_u >> TILE_BITS
        if cell_u < 1 or cell_v < 1 or row >= table.shape[0] or col >= table.shape[1]:
            for k in range(9):
                near[np.uint64(k * BLOCK_POINTS) + j] = np.uint64(0)
            continue
        tile = np.uint64(table[np.uint64(row), np.uint64(col)])
        in_u, in_v = cell_u & TILE_MASK, cell_v & TILE_MASK
        if 0 < in_u < TILE_MASK and 0 < in_v < TILE_MASK:
            first = np.uint64(((in_v - 1) << TILE_BITS) + in_u - 1)
            for k in range(9):
                near[np.uint64(k * BLOCK_POINTS) + j] = cells[tile, first + np.uint64(k // 3 * TILE + k % 3)]
            continue
        bits = cells[tile, np.uint64((in_v << TILE_BITS) | in_u)] >> np.uint64(16 * NEIGHBOURS)
        for k in range(9):
            cell = np.uint64(0)
            if bits & np.uint64(1 << k):
                at_v, at_u = cell_v + k // 3 - 1, cell_u + k % 3 - 1
                tile = np.uint64(table[np.uint64(at_v >> TILE_BITS), np.uint64(at_u >> TILE_BITS)])
                cell = cells[tile, np.uint64(((at_v & TILE_MASK) << TILE_BITS) | (at_u & TILE_MASK))]
            near[np.uint64(k * BLOCK_POINTS) + j] = cell


@kernel
def average_means(block: Block, count: int) -> None:
    """Where the surface lies: SQUARE, TO_U and TO_V of the first points of a block.

    The middle of the surface is the average of the means by their counts and closeness. A wall seen from slightly wrong
    poses is smeared over two cells; the nearest of its means would hold a point anywhere within it.
    """
    near, rows = block.cells, block.rows
    for j in range(_filled_up(count)):
        in_u, in_v = rows[IN_U + j], rows[IN_V + j]
        nearest, sum_u, sum_v, weight = NOTHING, 0.0, 0.0, 0.0
        for k in range(9):
            cell = near[np.uint64(k * BLOCK_POINTS) + j]
            seen = np.int64((cell >> _COUNT) & _MASK)
            offset_u = in_u + (k % 3 - 1) + np.int64((cell >> _U) & _MASK) * (1.0 / MEAN_UNITS)
            offset_v = in_v + (k // 3 - 1) + np.int64((cell >> _V) & _MASK) * (1.0 / MEAN_UNITS)
            d2 = offset_u * offset_u + offset_v * offset_v
            w = seen / ((SQUARE_WIDTH + d2) * (SQUARE_WIDTH + d2))
            sum_u += w * offset_u
            sum_v += w * offset_v
            weight += w
            d2 = d2 if seen > 0 else NOTHING
            nearest = d2 if d2 < nearest else nearest
        rows[SQUARE + j], rows[TO_U + j], rows[TO_V + j] = nearest, sum_u / weight, sum_v / weight


@kernel
def weigh(block: Block, count: int, gain: float) -> None:
    """Compute what the first points of a block bind and where they pull: WEIGHT to PULL_T; ``gain`` in 1/cells^2."""
    rows = block.rows
    for j in range(_filled_up(count)):
        # Where the series is meant, all points may take it at once, also those that nothing is near.
        g = gain * rows[SQUARE + j]
        rows[WEIGHT + j] = 1.0 - g * (1.0 - g * (0.5 - g * (1.0 / 6.0 - g * (1.0 / 24.0))))
    if gain * _FARTHEST >= 0.5:
        for j in range(_filled_up(count)):
            rows[WEIGHT + j] = exp_of_minus(gain * rows[SQUARE + j])
    for j in range(_filled_up(count)):
        x, y, w = rows[X + j], rows[Y + j], rows[WEIGHT + j]
        n_u, n_v, du, dv = rows[NORMAL_U + j], rows[NORMAL_V + j], rows[TO_U + j], rows[TO_V + j]
        # Information of this pair: full across the surface, TANGENT along it; both without a normal.
        along = TANGENT if n_u != 0.0 or n_v != 0.0 else 1.0
        i_uu = w * (n_u * n_u * (1.0 - along) + along)
        i_uv = w * (n_u * n_v * (1.0 - along))
        i_vv = w * (n_v * n_v * (1.0 - along) + along)
        # A turn moves the point by (-y, x).
        i_ut, i_vt = i_uv * x - i_uu * y, i_vv * x - i_uv * y
        rows[UU + j], rows[UV + j], rows[VV + j] = i_uu, i_uv, i_vv
        rows[UT + j], rows[VT + j], rows[TT + j] = i_ut, i_vt, i_vt * x - i_ut * y
        f_u, f_v = i_uu * du + i_uv * dv, i_uv * du + i_vv * dv
        rows[PULL_U + j], rows[PULL_V + j], rows[PULL_T + j] = f_u, f_v, x * f_v - y * f_u


@kernel
def add_up(block: Block, count: int, miss: float, likelihood_gain: float) -> None:
    """Add the first points of a block to its sums, in their order.

    Args:
        block: The block.
        count: How many points.
        miss: Log-likelihood of a point with nothing near.
        likelihood_gain: 1 / likelihood sigma [1/cells^2].
    """
    rows, sums = block.rows, block.sums
    likelihood, total, uu, uv, vv, ut = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    vt, tt, r_u, r_v, r_t = sums[6], sums[7], sums[8], sums[9], sums[10]
    for j in range(np.uint64(count)):
        if rows[SQUARE + j] == NOTHING:
            likelihood += miss
            continue
        likelihood -= likelihood_gain * rows[SQUARE + j]
        total += rows[WEIGHT + j]
        uu += rows[UU + j]
        uv += rows[UV + j]
        vv += rows[VV + j]
        ut += rows[UT + j]
        vt += rows[VT + j]
        tt += rows[TT + j]
        r_u += rows[PULL_U + j]
        r_v += rows[PULL_V + j]
        r_t += rows[PULL_T + j]
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5] = likelihood, total, uu, uv, vv, ut
    sums[6], sums[7], sums[8], sums[9], sums[10] = vt, tt, r_u, r_v, r_t
