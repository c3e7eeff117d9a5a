"""The far look of the preset ``compact_far``: which way out of here leads to the nearest unknown space.

On blocks of 4 x 4 cells of the map, those that the robot's body could cross learn how far it is from them to the
nearest frontier (Yamauchi 1997), round walls, by Dial's search from all frontiers at once (Dial 1969). The map as last
published is looked at; the observation reads the lengths about the believed pose. All of it is belief.
"""

import math
from typing import Any

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
)
from slamgym.envs.batch.arrays import put
from slamgym.planning.costmap import touched_cells

SECTORS = 24
"""Directions in which the robot could leave, counter-clockwise from ahead."""
FAR_SIZE = SECTORS + 3
"""Numbers of the far look."""
_ANGLES = [2.0 * math.pi * k / SECTORS for k in range(SECTORS)]
_DIRECTIONS = tuple((math.cos(angle), math.sin(angle)) for angle in _ANGLES)
"""Unit vector of each direction, ahead and left."""
BLOCK_SIDE = 4
"""Cells along a side of a block, on the map's lattice."""
_FURTHEST = 25.0
"""Longer ways are told as this one [m]."""
_DETOUR = 2.0
"""Longer detours are told as this one [m]."""
_NEAREST_STEP = 3
"""A direction counts for ways that lead to it at least so far from the robot [blocks]."""
_LAST_STEP = 12
"""A direction is followed so far from the robot [blocks]."""

_UNKNOWN_BLOCK = -1
"""Mark of a block of which nothing is known."""
_BLOCKED = -2
"""Mark of a block that holds an occupied cell, and no place for the robot's centre."""
_TIGHT = -3
"""Mark of a block that is free, but too near to something for the robot's centre: it can be seen from beside."""
_UNREACHED = 1 << 30
"""Mark of a block that can be crossed, and to which no way was found yet."""
_STRAIGHT = 2
"""Chamfer length of the way to a block beside [half blocks]."""
_DIAGONAL = 3
"""Chamfer length of the way to a block at a corner [half blocks]."""


@kernel
def draw_blocks(cells: ByteArray, touched: ByteArray, blocks: Int32Array) -> None:
    """Tell blocks that can be crossed, those that hold an occupied cell, and those of which nothing is known.

    Args:
        cells: The map, shape (4 h, 4 w).
        touched: Not 0 where the body of a robot with its centre there would touch something, shape (4 h, 4 w).
        blocks: Receives the blocks, and one more to every side, shape (h + 2, w + 2).
    """
    blocks[:] = _UNKNOWN_BLOCK
    width = cells.shape[1]
    least = np.empty(width, np.uint8)
    most = np.empty(width, np.uint8)
    for i in range(blocks.shape[0] - 2):
        # Occupied is less than unknown, and free more.
        first = BLOCK_SIDE * i
        one = cells[first]
        two = cells[first + 1]
        three = cells[first + 2]
        four = cells[first + 3]
        for c in range(width):
            least[c] = min(one[c], two[c], three[c], four[c])
            most[c] = max(one[c], two[c], three[c], four[c])
        for j in range(blocks.shape[1] - 2):
            low = UNKNOWN
            high = UNKNOWN
            has_room = False
            for c in range(BLOCK_SIDE * j, BLOCK_SIDE * (j + 1)):
                low = min(low, least[c])
                high = max(high, most[c])
                for r in range(first, first + BLOCK_SIDE):
                    has_room |= cells[r, c] == FREE and touched[r, c] == 0
            if has_room:
                blocks[i + 1, j + 1] = _UNREACHED
            elif low == OCCUPIED:
                blocks[i + 1, j + 1] = _BLOCKED
            elif high != UNKNOWN:
                blocks[i + 1, j + 1] = _TIGHT


@kernel
def measure_ways(blocks: Int32Array) -> None:
    """Replace the mark of each block that can be crossed by its way to the nearest frontier [half blocks].

    Args:
        blocks: From :func:`draw_blocks`.
    """
    cols = blocks.shape[1]
    flat = blocks.reshape(-1)
    around = (1, cols + 1, cols, cols - 1, -1, -cols - 1, -cols, 1 - cols)
    queues = np.empty((4, flat.size), dtype=np.int32)  # those of a length and of the three after it
    counts = np.zeros(4, dtype=np.int64)
    counts[0] = _find_frontiers(blocks, queues[0])
    length = 0
    while counts.any():
        for k in range(counts[length & 3]):
            cell = queues[length & 3, k]
            if flat[cell] != length:
                continue  # a shorter way was found
            for d in range(8):
                there = cell + around[d]
                is_diagonal = d & 1
                following = length + (_DIAGONAL if is_diagonal else _STRAIGHT)
                if flat[there] <= following:
                    continue
                if is_diagonal and _cuts_corner(flat, cell, around, d):
                    continue
                flat[there] = following
                queue = following & 3
                queues[queue, counts[queue]] = there
                counts[queue] += 1
        counts[length & 3] = 0
        length += 1


@kernel
def _cuts_corner(flat: Int32Array, cell: int, around: tuple[int, ...], d: int) -> bool:
    """True if a diagonal out of a block passes a block with an occupied cell."""
    before = flat[cell + around[d - 1]]
    after = flat[cell + around[(d + 1) & 7]]
    return _BLOCKED in (before, after)


@kernel
def _find_frontiers(blocks: Int32Array, found: Int32Array) -> int:
    """Mark as 0 and list the free blocks that touch an unknown one, two or more together."""
    cols = blocks.shape[1]
    flat = blocks.reshape(-1)
    straight = (1, cols, -1, -cols)
    around = (1, cols + 1, cols, cols - 1, -1, -cols - 1, -cols, 1 - cols)
    borders = np.zeros(flat.size, dtype=np.uint8)
    for cell in range(cols + 1, flat.size - cols - 1):
        if flat[cell] in (_UNREACHED, _TIGHT):
            for step in straight:
                borders[cell] |= flat[cell + step] == _UNKNOWN_BLOCK
    count = 0
    for cell in range(cols + 1, flat.size - cols - 1):
        if borders[cell]:
            neighbours = 0
            for step in around:
                neighbours += borders[cell + step]
            if neighbours > 0:
                flat[cell] = 0
                found[count] = cell
                count += 1
    return count


@kernel
def write_far(
    ways: Int32Array,
    shapes: IntArray,
    corners: IntArray,
    size: float,
    poses: FloatArray,
    ids: IntArray,
    out: Float32Array,
) -> None:
    """Write far looks.

    Args:
        ways: Of many robots, from :func:`measure_ways`, shape (N, blocks), row by row.
        shapes: Rows and columns of each, shape (N, 2).
        corners: Row and column of the lattice of blocks at which they begin, shape (N, 2).
        size: Of a block [m].
        poses: The robots in their map frames, shape (N, 3) [m, m, rad].
        ids: The robots that look.
        out: Receives in the last columns of shape (N, n) for each direction 1 less the detour by it, and the length of
            the shortest way, each as a share of the largest that is told; then where that way starts, ahead and left.
    """
    begin = out.shape[1] - FAR_SIZE
    for i in ids:
        rows, cols = shapes[i]
        blocks = ways[i, : rows * cols].reshape(rows, cols)
        row = poses[i, 1] / size - corners[i, 0]
        col = poses[i, 0] / size - corners[i, 1]
        numbers = out[i, begin:]
        sin = math.sin(poses[i, 2])
        cos = math.cos(poses[i, 2])
        for k in range(SECTORS):
            ahead, left = _DIRECTIONS[k]
            up = ahead * sin + left * cos
            right = ahead * cos - left * sin
            numbers[k] = _way_by(blocks, row, col, up, right)
        shortest = numbers[:SECTORS].min()
        for k in range(SECTORS):
            detour = (numbers[k] - shortest) * size / _DETOUR if numbers[k] < np.inf else 1.0
            numbers[k] = max(1.0 - detour, 0.0)
        numbers[SECTORS] = min(shortest * size / _FURTHEST, 1.0)
        numbers[SECTORS + 1], numbers[SECTORS + 2] = _mean_direction(numbers)


@kernel
def _mean_direction(nearness: Float32Array) -> tuple[float, float]:
    """Unit vector, ahead and left, of the directions with hardly a detour; nothing where no way leads."""
    ahead = 0.0
    left = 0.0
    for k in range(SECTORS):
        weight = float(nearness[k]) ** 8
        ahead += weight * _DIRECTIONS[k][0]
        left += weight * _DIRECTIONS[k][1]
    length = math.sqrt(ahead * ahead + left * left)
    if length > 0.0:
        return ahead / length, left / length
    return 0.0, 0.0


@kernel
def _way_by(blocks: Int32Array, row: float, col: float, up: float, right: float) -> float:
    """Length of the way to the nearest frontier that starts in a direction [blocks]; infinite if none does."""
    rows, cols = blocks.shape
    best = np.inf
    was_frontier = False
    is_leaving = True
    for step in range(_LAST_STEP + 1):
        r = math.floor(row + step * up)
        c = math.floor(col + step * right)
        way = blocks[r, c] if 0 <= r < rows and 0 <= c < cols else _UNKNOWN_BLOCK
        if way == _UNKNOWN_BLOCK:
            return min(best, float(step)) if was_frontier else best
        if way in (_BLOCKED, _TIGHT, _UNREACHED):
            # The robot may stand in a block with a wall.
            if is_leaving and step < 2:
                continue
            return best
        is_leaving = False
        was_frontier = way == 0
        if step >= _NEAREST_STEP:
            # By the block's middle, so that the way doesn't jump where the direction enters a block.
            to_middle = math.sqrt((r + 0.5 - row) ** 2 + (c + 0.5 - col) ** 2)
            best = min(best, to_middle + 0.5 * way)
    return best


class FarLook:
    """Knowledge of robots about the ways to frontiers.

    Args:
        count: Number of robots.
        robot_radius: Of each [m].
    """

    def __init__(self, count: int, robot_radius: float) -> None:
        self._radius = robot_radius
        self._ways: Any = np.zeros((count, 0), dtype=np.int32)
        self._shapes = np.zeros((count, 2), dtype=np.int64)
        self._corners = np.zeros((count, 2), dtype=np.int64)
        self._size = 1.0

    def refresh(
        self, index: int, cells: ByteArray, corner: tuple[int, int], resolution: float
    ) -> None:
        """Look at one robot's map, which was published: the fields of a :class:`~slamgym.envs.compact.MapTiles`."""
        height, width = cells.shape
        row, col = corner
        rows = height // BLOCK_SIDE + 2
        cols = width // BLOCK_SIDE + 2
        count = rows * cols
        if count > self._ways.shape[1]:
            self._ways = put(self._ways, index, np.zeros(count, dtype=np.int32))
        self._shapes[index] = rows, cols
        self._corners[index] = row // BLOCK_SIDE - 1, col // BLOCK_SIDE - 1
        self._size = resolution * BLOCK_SIDE
        blocks = self._ways[index, :count].reshape(rows, cols)
        # The face of a wall may lie anywhere in its cell.
        touched = touched_cells(cells, self._radius / resolution + 0.5)
        draw_blocks(cells, touched, blocks)
        measure_ways(blocks)

    def write(self, ids: IntArray, poses: FloatArray, out: Float32Array) -> None:
        """Write the last numbers of observations, shape (N, n), for believed poses, shape (N, 3) [m, m, rad]."""
        write_far(self._ways, self._shapes, self._corners, self._size, poses, ids, out)
