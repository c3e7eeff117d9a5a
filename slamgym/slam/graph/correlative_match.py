"""Exhaustive search for a scan's pose in a window of a local map: numba kernels.

The correlative matcher of Olson (2009), made fast by branch and bound over grids of maxima (Hess et al. 2016,
section V-B): a block of offsets is expanded only while its bound beats the best pose found, so the result is
the best of all poses in the window, which no local search can promise.
"""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.slam.graph.surface_map import VACANT

HIT, NEAR_HIT = 255, 120
"""What a point scores in an occupied cell and beside one."""


@kernel
def paint_levels(index: np.ndarray, levels: np.ndarray) -> None:
    """Make the grids of maxima.

    Args:
        index: (rows, cols) of the local map.
        levels: (levels, rows, cols) uint8; ``[h, r, c]`` receives the maximum of the scores in the
            2^h x 2^h cells whose lower left one is ``[r, c]``.
    """
    rows, cols = index.shape
    levels[0] = 0
    for row in range(rows):
        for col in range(cols):
            if index[row, col] == VACANT:
                continue
            for near_row in range(max(row - 1, 0), min(row + 2, rows)):
                for near_col in range(max(col - 1, 0), min(col + 2, cols)):
                    levels[0, near_row, near_col] = max(levels[0, near_row, near_col], NEAR_HIT)
    for row in range(rows):
        for col in range(cols):
            if index[row, col] != VACANT:
                levels[0, row, col] = HIT
    for h in range(1, len(levels)):
        step = 1 << (h - 1)
        below, level = levels[h - 1], levels[h]
        for row in range(rows):
            up = min(row + step, rows - 1)
            # Without a branch inside, the compiler turns these loops into vector instructions.
            for col in range(cols):
                level[row, col] = max(below[row, col], below[up, col])
            for col in range(cols - step):
                level[row, col] = max(level[row, col], level[row, col + step])


@kernel
def block_score(
    level: np.ndarray, low: int, us: np.ndarray, vs: np.ndarray, du: int, dv: int
) -> int:  # fmt: skip
    """Sum of a level's values at the points moved by an offset.

    Cells left of or below the grid still see its border: their block of maxima may reach into it.
    """
    rows, cols = level.shape
    total = 0
    for i in range(len(us)):
        row, col = vs[i] + dv, us[i] + du
        if row >= rows or col >= cols or row <= -low or col <= -low:
            continue
        total += level[max(row, 0), max(col, 0)]
    return total


@kernel
def search_window(
    levels: np.ndarray, origin_x: float, origin_y: float, cell: float, points: FloatArray, centre: FloatArray,
    window: int, angles: FloatArray, least: float, pose: FloatArray,
) -> float:  # fmt: skip
    """Find the best pose in a window.

    Args:
        levels: From :func:`paint_levels`.
        origin_x: Lower left corner of the grid [m].
        origin_y: Lower left corner of the grid [m].
        cell: Cell size [m].
        points: (n, 2) end points in the robot frame [m].
        centre: (3,) middle of the window.
        window: Largest offset in x and in y [cells].
        angles: (a,) turns to try, added to the centre's heading [rad].
        least: Score below which nothing is of interest, 0 to 1.
        pose: (3,) receives the best pose.

    Returns:
        Its score, 0 to 1: 1 if every point falls into an occupied cell; ``least`` if none is better.
    """
    num, top = len(points), len(levels) - 1
    us = np.empty((len(angles), num), dtype=np.int32)
    vs = np.empty((len(angles), num), dtype=np.int32)
    block = 1 << top
    per_side = (2 * window) // block + 1
    bounds = np.empty(len(angles) * per_side * per_side, dtype=np.int64)
    for a in range(len(angles)):
        cos, sin = math.cos(centre[2] + angles[a]), math.sin(centre[2] + angles[a])
        for i in range(num):
            us[a, i] = math.floor((centre[0] + cos * points[i, 0] - sin * points[i, 1] - origin_x) / cell)
            vs[a, i] = math.floor((centre[1] + sin * points[i, 0] + cos * points[i, 1] - origin_y) / cell)
        for i in range(per_side):
            for j in range(per_side):
                bounds[(a * per_side + i) * per_side + j] = block_score(
                    levels[top], block, us[a], vs[a], i * block - window, j * block - window
                )
    best = int(least * HIT * num)
    stack = np.empty((4 * top + 4, 4), dtype=np.int64)
    pose[:] = centre
    for place in np.argsort(-bounds):
        if bounds[place] <= best:
            break
        a, rest = place // (per_side * per_side), place % (per_side * per_side)
        stack[0, 0], stack[0, 1], stack[0, 2] = (
            top,
            (rest // per_side) * block - window,
            (rest % per_side) * block - window,
        )
        stack[0, 3] = bounds[place]
        height = 1
        while height > 0:
            height -= 1
            h, du, dv, bound = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
            if bound <= best:
                continue
            if h == 0:
                best = bound
                pose[0], pose[1], pose[2] = (
                    centre[0] + du * cell,
                    centre[1] + dv * cell,
                    centre[2] + angles[a],
                )
                continue
            half = 1 << (h - 1)
            first = height
            for child in range(4):
                child_u, child_v = du + (child & 1) * half, dv + (child >> 1) * half
                if child_u > window or child_v > window:
                    continue
                value = block_score(levels[h - 1], half, us[a], vs[a], child_u, child_v)
                if value <= best:
                    continue
                # Insertion keeps the best child on top of the stack.
                at = height
                while at > first and stack[at - 1, 3] > value:
                    stack[at] = stack[at - 1]
                    at -= 1
                stack[at, 0], stack[at, 1], stack[at, 2], stack[at, 3] = h - 1, child_u, child_v, value
                height += 1
    return best / (HIT * max(num, 1))
