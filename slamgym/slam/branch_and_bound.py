"""The best places for a scan in a grid, by branch and bound over grids of maxima: numba kernels.

The correlative matcher of Olson (2009), made fast by the bounds of Hess et al. (2016, section V-B): a block of offsets
is expanded only while its bound beats the best place found, so the result is the best of all, which no local
search can promise.
"""

import math

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import ByteArray, FloatArray, Int32Array
from slamgym.slam.graph.submaps import SUBMAP_CELL

HIT = 255
"""The most that a point scores."""
MOST_PLACES = 20_000
"""A search finds no more places than this."""


@kernel
def maxima(grid: ByteArray, count: int) -> ByteArray:
    """Grids of maxima (count, rows, cols) of a grid (rows, cols) of scores.

    ``[h, r, c]`` is the maximum of the scores in the 2^h x 2^h cells whose lower left one is ``[r, c]``.
    """
    rows, cols = grid.shape
    levels = np.empty((count, rows, cols), dtype=np.uint8)
    assign(grid, levels[0])
    for h in range(1, count):
        step = 1 << (h - 1)
        below = levels[h - 1]
        level = levels[h]
        for row in range(rows):
            up = min(row + step, rows - 1)
            # Without a branch inside, the compiler turns these loops into vector instructions.
            for col in range(cols):
                level[row, col] = max(below[row, col], below[up, col])
            for col in range(cols - step):
                level[row, col] = max(level[row, col], level[row, col + step])
    return levels


@kernel
def block_score(
    level: np.ndarray, low: int, us: np.ndarray, vs: np.ndarray, du: int, dv: int
) -> int:
    """Sum of a level's values at the points moved by an offset.

    Cells left of or below the grid still see its border: their block of maxima may reach into it.
    """
    rows, cols = level.shape
    total = 0
    for i in range(len(us)):
        row = vs[i] + dv
        col = us[i] + du
        if row >= rows or col >= cols or row <= -low or col <= -low:
            continue
        total += level[max(row, 0), max(col, 0)]
    return total


@kernel
def best_in_block(
    levels: ByteArray,
    floors: ByteArray,
    us: np.ndarray,
    vs: np.ndarray,
    block: tuple[int, int, int],
    most: tuple[int, int],
    least: int,
    avoided: tuple[float, float, float],
) -> tuple[int, int, int]:
    """Find the best place of a block of the top level.

    Args:
        levels: From :func:`maxima`.
        floors: The same of a mask of places that count; empty if all do.
        us: (n,) int32 columns of the points with the robot at offset 0.
        vs: (n,) rows.
        block: First column and row of the block, and its bound.
        most: Largest column and row of a place.
        least: A place that counts scores more than this.
        avoided: Column, row and radius of a disc whose places don't count.

    Returns:
        Score, column and row of the place; ``least`` and the block's own if there is none.
    """
    top = len(levels) - 1
    stack = np.empty((4 * top + 4, 4), dtype=np.int64)
    stack[0, 0] = top
    stack[0, 1] = block[0]
    stack[0, 2] = block[1]
    stack[0, 3] = block[2]
    best = least
    best_u = block[0]
    best_v = block[1]
    height = 1
    while height > 0:
        height -= 1
        h = stack[height, 0]
        u = stack[height, 1]
        v = stack[height, 2]
        bound = stack[height, 3]
        if bound <= best:
            continue
        if h == 0:
            if (u - avoided[0]) ** 2 + (v - avoided[1]) ** 2 >= avoided[2] ** 2:
                best = bound
                best_u = u
                best_v = v
            continue
        half = 1 << (h - 1)
        first = height
        for child in range(4):
            child_u = u + (child & 1) * half
            child_v = v + (child >> 1) * half
            if child_u > most[0] or child_v > most[1]:
                continue
            if len(floors) > 0 and floors[h - 1, child_v, child_u] == 0:
                continue
            value = block_score(levels[h - 1], half, us, vs, child_u, child_v)
            if value <= best:
                continue
            # Insertion keeps the best child on top of the stack.
            at = height
            while at > first and stack[at - 1, 3] > value:
                assign(stack[at - 1], stack[at])
                at -= 1
            stack[at, 0] = h - 1
            stack[at, 1] = child_u
            stack[at, 2] = child_v
            stack[at, 3] = value
            height += 1
    return best, best_u, best_v


@kernel
def face_of(x: float, y: float) -> int:
    """Number of the axis x, y, -x or -y that a direction is nearest to."""
    if abs(x) >= abs(y):
        return 0 if x > 0.0 else 2
    return 1 if y > 0.0 else 3


@kernel
def turned_cells(
    points: FloatArray, sides: FloatArray, headings: FloatArray, origin: FloatArray, width: int
) -> tuple[Int32Array, Int32Array]:
    """Columns and rows of points at each heading, both (a, n).

    Args:
        points: (n, 2) end points in the robot frame [m].
        sides: (n, 3) their sides in the robot frame; (0, 3) if all face the same grid.
        headings: (a,) [rad].
        origin: (2,) of the robot in the grid's frame [m].
        width: Columns from one face's grid to the next.
    """
    us = np.empty((len(headings), len(points)), dtype=np.int32)
    vs = np.empty((len(headings), len(points)), dtype=np.int32)
    for a in range(len(headings)):
        cos = math.cos(headings[a])
        sin = math.sin(headings[a])
        for i in range(len(points)):
            x = origin[0] + cos * points[i, 0] - sin * points[i, 1]
            y = origin[1] + sin * points[i, 0] + cos * points[i, 1]
            us[a, i] = math.floor(x / SUBMAP_CELL)
            vs[a, i] = math.floor(y / SUBMAP_CELL)
        for i in range(len(sides)):
            x = cos * sides[i, 0] - sin * sides[i, 1]
            y = sin * sides[i, 0] + cos * sides[i, 1]
            us[a, i] += width * face_of(x, y)
    return us, vs


@kernel
def search_blocks(
    levels: ByteArray,
    floors: ByteArray,
    us: Int32Array,
    vs: Int32Array,
    first: int,
    last: tuple[int, int],
    least: int,
    margin: int,
    avoided: tuple[float, float, float],
) -> FloatArray:
    """Find the best place of every block at every heading, if it is nearly as good as the best of all.

    Args:
        levels: As for :func:`best_in_block`.
        floors: As for :func:`best_in_block`, empty (0, rows, cols) if all places count.
        us: (headings, n) columns of the points, from :func:`turned_cells`.
        vs: (headings, n) rows.
        first: Smallest column and row of a place.
        last: Largest column and row of a place.
        least: A place that counts scores more than this ...
        margin: ... and more than the best one until then less this: with 0 the last is the best of all.
        avoided: As for :func:`best_in_block`.

    Returns:
        (places, 4) column, row, number of the heading, and score; ``MOST_PLACES`` at most.
    """
    top = len(levels) - 1
    cols = ((last[0] - first) >> top) + 1
    rows = ((last[1] - first) >> top) + 1
    bounds = np.zeros(len(us) * cols * rows, dtype=np.int64)
    for a in range(len(us)):
        for i in range(cols):
            for j in range(rows):
                u = first + (i << top)
                v = first + (j << top)
                if len(floors) == 0 or floors[top, v, u]:
                    place = (a * cols + i) * rows + j
                    bounds[place] = block_score(levels[top], 1 << top, us[a], vs[a], u, v)
    places = np.empty((min(len(bounds), MOST_PLACES), 4))
    best = least
    count = 0
    for place in np.argsort(-bounds):
        wanted = max(best - margin, least)
        if bounds[place] <= wanted or count == len(places):
            break
        a = place // (cols * rows)
        i = place // rows % cols
        j = place % rows
        block = (first + (i << top), first + (j << top), bounds[place])
        score, u, v = best_in_block(levels, floors, us[a], vs[a], block, last, wanted, avoided)
        if score > wanted:
            places[count, 0] = u
            places[count, 1] = v
            places[count, 2] = a
            places[count, 3] = score
            count += 1
            best = max(best, score)
    return places[:count]
