"""Matching a scan with a local map: exhaustive search in a window, then alignment."""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, best_in_block, block_score, maxima
from slamgym.slam.graph.surface_map import MATCH_CELL, VACANT, LocalMap, align_scan

NEAR_HIT = 120
"""Score of a point in a cell next to an occupied one."""
MOST_LEVELS = 6
SEARCH_POINTS = 120
"""The search takes about this many of a scan's points."""
ELSEWHERE = 0.35
"""A place so far from another is another [m]."""
ANGULAR_STEPS = (0.008, 0.06)
"""Bounds of the search's step in heading [rad]."""


@kernel
def search_window(
    levels: ByteArray,
    corner: tuple[float, float],
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
        levels: Grids of maxima of the score of a point in each cell.
        corner: Lower left corner of the grids [m].
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
    num, top = len(points), len(levels) - 1
    us = np.empty((len(angles), num), dtype=np.int32)
    vs = np.empty((len(angles), num), dtype=np.int32)
    block = 1 << top
    per_side = (2 * window) // block + 1
    bounds = np.empty(len(angles) * per_side * per_side, dtype=np.int64)
    for a in range(len(angles)):
        cos, sin = math.cos(centre[2] + angles[a]), math.sin(centre[2] + angles[a])
        for i in range(num):
            x = centre[0] + cos * points[i, 0] - sin * points[i, 1] - corner[0]
            y = centre[1] + sin * points[i, 0] + cos * points[i, 1] - corner[1]
            us[a, i], vs[a, i] = math.floor(x / MATCH_CELL), math.floor(y / MATCH_CELL)
        for i in range(per_side):
            for j in range(per_side):
                bounds[(a * per_side + i) * per_side + j] = block_score(
                    levels[top], block, us[a], vs[a], i * block - window, j * block - window
                )
    best = int(least * HIT * num)
    everywhere = np.empty((0, 0, 0), dtype=np.uint8)
    avoided = (
        (away_from[0] - centre[0]) / MATCH_CELL, (away_from[1] - centre[1]) / MATCH_CELL, away_from[2] / MATCH_CELL,
    )  # fmt: skip
    assign(centre, pose)
    for place in np.argsort(-bounds):
        if bounds[place] <= best:
            break
        a, rest = place // (per_side * per_side), place % (per_side * per_side)
        start = rest // per_side * block - window, rest % per_side * block - window, bounds[place]
        found, u, v = best_in_block(levels, everywhere, us[a], vs[a], start, (window, window), best, avoided)
        if found > best:
            best = found
            pose[0], pose[1] = centre[0] + u * MATCH_CELL, centre[1] + v * MATCH_CELL
            pose[2] = centre[2] + angles[a]
    return best / (HIT * max(num, 1))


class NodeMatch(NamedTuple):
    """Where a scan fits into a local map."""

    pose: FloatArray  # (3,) in the local map's frame
    information: FloatArray  # (3, 3)
    fit: float  # share of the points that fit, 0 to 1


def align_node(
    local: LocalMap, points: FloatArray, start: FloatArray, prior: FloatArray, prior_info: FloatArray
) -> NodeMatch:
    """Refine a pose near its final place; see :func:`slamgym.slam.graph.surface_map.align_scan`."""
    pose, information = np.empty(3), np.empty((3, 3))
    fit = align_scan(local, points, start, prior, prior_info, pose, information)
    return NodeMatch(pose, information, float(fit))


def score_levels(numbers: np.ndarray, count: int) -> ByteArray:
    """Grids of maxima (count, rows, cols) of the score in the cells of a local map, by their numbers (rows, cols)."""
    import cv2

    occupied = (numbers != VACANT).view(np.uint8)
    return maxima(np.where(occupied, HIT, NEAR_HIT * cv2.dilate(occupied, np.ones((3, 3), np.uint8))), count)


def search(
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
    cells = max(1, math.ceil(window / MATCH_CELL))
    levels = score_levels(local.numbers, min(MOST_LEVELS, max(1, math.ceil(math.log2(cells + 1))) + 1))
    points = points[:: max(1, len(points) // SEARCH_POINTS)]
    # One step turns the far points by about a cell: further points would only be blurred by a finer one.
    far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
    step = min(max(MATCH_CELL / max(far, MATCH_CELL), ANGULAR_STEPS[0]), ANGULAR_STEPS[1])
    count = math.ceil(turn / step)
    angles = step * np.arange(-count, count + 1, dtype=np.float64)
    pose, avoided = np.empty(3), np.zeros(3)
    if away_from is not None:
        avoided[:2], avoided[2] = away_from[:2], ELSEWHERE
    corner = local.origin_x, local.origin_y
    score = search_window(levels, corner, points, centre, cells, angles, least, avoided, pose)
    return pose, float(score)
