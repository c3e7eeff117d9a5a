"""Exhaustive search for a scan's pose in a window of a local map: numba kernels.

The correlative matcher of Olson (2009), made fast by branch and bound over grids of maxima (Hess et al. 2016,
section V-B): a block of offsets is expanded only while its bound beats the best pose found, so the result is
the best of all poses in the window, which no local search can promise.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.graph.config import PoseGraphConfig
from slamgym.slam.graph.surface_map import (
    VACANT,
    CellIndex,
    LocalMap,
    align_scan,
    bind_cells,
    collect_cells,
)

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
def block_score(level: np.ndarray, low: int, us: np.ndarray, vs: np.ndarray, du: int, dv: int) -> int:
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
def search_window(  # noqa: C901 - a branch and bound is one loop
    levels: np.ndarray,
    index: CellIndex,
    points: FloatArray,
    centre: FloatArray,
    window: int,
    angles: FloatArray,
    least: float,
    away_from: FloatArray,
    pose: FloatArray,
) -> float:
    """Find the best pose in a window.

    Args:
        levels: From :func:`paint_levels`.
        index: The grid that they were made of.
        points: (n, 2) end points in the robot frame [m].
        centre: (3,) middle of the window.
        window: Largest offset in x and in y [cells].
        angles: (a,) turns to try, added to the centre's heading [rad].
        least: Score below which nothing is of interest, 0 to 1.
        away_from: (3,) x, y [m] and a distance: poses nearer to that place don't count.
        pose: (3,) receives the best pose.

    Returns:
        Its score, 0 to 1: 1 if every point falls into an occupied cell; ``least`` if none is better.
    """
    _, origin_x, origin_y, cell = index
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
    assign(centre, pose)
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
                x, y = centre[0] + du * cell - away_from[0], centre[1] + dv * cell - away_from[1]
                if x * x + y * y < away_from[2] ** 2:
                    continue
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
                    assign(stack[at - 1], stack[at])
                    at -= 1
                stack[at, 0], stack[at, 1], stack[at, 2], stack[at, 3] = h - 1, child_u, child_v, value
                height += 1
    return best / (HIT * max(num, 1))


MARGIN_CELLS = 3
MOST_LEVELS = 6
SEARCH_POINTS = 120
"""The search takes about this many of a scan's points."""
ELSEWHERE = 0.35
"""A place so far from another is another [m]."""
ANGULAR_STEPS = (0.008, 0.06)
"""Bounds of the search's step in heading [rad]."""


class NodeMatch(NamedTuple):
    """Where a scan fits into a local map."""

    pose: FloatArray  # (3,) in the local map's frame
    information: FloatArray  # (3, 3)
    fit: float  # share of the points that fit, 0 to 1


class NodeMatcher:
    """Builds local maps and matches scans with them."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config

    def local_map(
        self, points: FloatArray, counts: IntArray, members: IntArray, poses: FloatArray, centre: FloatArray,
        radius: float,
    ) -> LocalMap:  # fmt: skip
        """Make a local map.

        Args:
            points: (nodes, most points, 2) end points in each node's own frame [m].
            counts: (nodes,) how many of them are set.
            members: (members,) which nodes the map is made of.
            poses: (members, 3) their poses in the frame of the map.
            centre: (3,) what the map is centred on.
            radius: The map extends so far from there [m].
        """
        cell = self._config.cell
        half = math.ceil(radius / cell) + MARGIN_CELLS
        index = CellIndex(
            numbers=np.empty((2 * half, 2 * half), dtype=np.int32),
            origin_x=(math.floor(centre[0] / cell) - half) * cell,
            origin_y=(math.floor(centre[1] / cell) - half) * cell,
            cell=cell,
        )
        moments = np.empty((min(int(counts[members].sum()) + 1, index.numbers.size), 8))
        places = np.empty((len(moments), 2), dtype=np.int32)
        used = collect_cells(points, counts, poses, members, index, places, moments)
        means, infos = np.empty((used, 4)), np.empty((used, 3))
        bind_cells(index.numbers, places, moments[:used], self._config.surface_sigma, means, infos)
        return LocalMap(index, means, infos)

    def align(
        self,
        local: LocalMap,
        points: FloatArray,
        start: FloatArray,
        prior: FloatArray,
        prior_info: FloatArray,
    ) -> NodeMatch:
        """Refine a pose near its final place; see :func:`slamgym.slam.graph.surface_map.align_scan`."""
        pose, information = np.empty(3), np.empty((3, 3))
        share = self._config.point_share
        fit = align_scan(local, points, start, prior, prior_info, share, pose, information)
        return NodeMatch(pose, information, float(fit))

    def search(
        self,
        local: LocalMap,
        points: FloatArray,
        centre: FloatArray,
        window: float,
        turn: float,
        least: float,
        away_from: FloatArray | None = None,
    ) -> tuple[FloatArray, float]:
        """Find the best pose in a window of ``window`` [m] and ``turn`` [rad] round ``centre``.

        With ``away_from``, a pose (3,), only what lies elsewhere counts.

        Returns:
            The pose (3,) to the precision of a cell, and its score, ``least`` if no pose is better.
        """
        cell = self._config.cell
        cells = max(1, math.ceil(window / cell))
        num_levels = min(MOST_LEVELS, max(1, math.ceil(math.log2(cells + 1))) + 1)
        numbers = local.grid.numbers
        levels = np.empty((num_levels, *numbers.shape), dtype=np.uint8)
        paint_levels(numbers, levels)
        points = points[:: max(1, len(points) // SEARCH_POINTS)]
        # One step turns the far points by about a cell: further points would only be blurred by a finer one.
        far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
        step = min(max(cell / max(far, cell), ANGULAR_STEPS[0]), ANGULAR_STEPS[1])
        count = math.ceil(turn / step)
        angles = step * np.arange(-count, count + 1, dtype=np.float64)
        pose = np.empty(3)
        avoided = np.zeros(3)
        if away_from is not None:
            avoided[:2], avoided[2] = away_from[:2], ELSEWHERE
        score = search_window(levels, local.grid, points, centre, cells, angles, least, avoided, pose)
        return pose, float(score)
