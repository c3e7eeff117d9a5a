"""Search for points over a whole map and all headings: every place that explains them nearly as well as the best one.

Branch and bound (:mod:`slamgym.slam.branch_and_bound`) is exact. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math
from collections.abc import Sequence

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, search_blocks, turned_cells
from slamgym.slam.graph.matching import heading_step
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints
from slamgym.slam.localization.known_map import KnownMap

HEADING_STEPS = (0.015, 0.07)
"""Bounds of the step in heading [rad]."""
MOST_HYPOTHESES = 60
"""So many of the best places that differ are returned."""
SCORE_MARGIN = 0.12
"""A place is kept if its score falls so much behind the best one's at most (1: every point lies on a wall)."""
SAME = 0.3
"""Places nearer to each other than this are one, if their headings are alike, too [m]."""
SAME_TURN = 0.25
"""Headings are alike if they differ by less than this [rad]."""


def is_same(poses: FloatArray, pose: FloatArray) -> np.ndarray:
    """True (n,) for those of some poses (n, 3 or more) that are the same place as another (3,)."""
    x, y, heading = pose[:3]
    distances = np.hypot(poses[:, 0] - x, poses[:, 1] - y)
    turns = np.abs(wrap_angle(poses[:, 2] - heading))
    is_near = distances < SAME
    is_alike = turns < SAME_TURN
    return is_near & is_alike


def find_places(known: KnownMap, points: FloatArray) -> list[FloatArray]:
    """The best poses (3,) of points (n, 2) in the robot frame [m], the best first."""
    seen = OrientedPoints(points, np.empty((0, 3)))  # the map doesn't tell sides
    margin = round(SCORE_MARGIN * HIT * len(points))
    # The robot stands in the middle of a cell.
    origin = np.full(2, 0.5 * SUBMAP_CELL)
    _, *size = known.levels.shape
    cells, headings = search_everywhere(known.levels, known.floors, seen, origin, 0, size, margin)
    points_on_map = known.field.corner + (cells + 0.5) * SUBMAP_CELL
    return distinct_poses(np.column_stack([points_on_map, headings]), MOST_HYPOTHESES)


def search_everywhere(
    levels: ByteArray,
    floors: ByteArray,
    seen: OrientedPoints,
    origin: FloatArray,
    width: int,
    size: Sequence[int],
    margin: int,
) -> tuple[FloatArray, FloatArray]:
    """The best places for points in the cells of a grid, at all headings.

    Args:
        levels: As for :func:`slamgym.slam.branch_and_bound.search_blocks`.
        floors: The same.
        seen: The points in the robot frame.
        origin: (2,) of the robot in the grid's frame at the first cell [m].
        width: Columns from one face's grid to the next.
        size: Rows and columns of the places.
        margin: Places are kept whose score falls so much behind that of the best.

    Returns:
        Columns and rows (m, 2) of the places and their headings (m,) [rad], the best first.
    """
    step = heading_step(seen.points, *HEADING_STEPS)
    count = math.ceil(2.0 * math.pi / step)
    headings = np.linspace(-math.pi, math.pi, count, endpoint=False)
    us, vs = turned_cells(*seen, headings, origin, width)
    rows, cols = size
    last = (cols - 1, rows - 1)
    nowhere = (0.0, 0.0, 0.0)
    found = search_blocks(levels, floors, us, vs, 0, last, 0, margin + 1, nowhere)
    ranked = found[np.argsort(-found[:, 3], kind="stable")]
    best = ranked[ranked[:, 3] >= ranked[:1, 3].max(initial=0.0) - margin]
    return best[:, :2], headings[best[:, 2].astype(np.int64)]


def distinct_poses(poses: FloatArray, most: int) -> list[FloatArray]:
    """Those of some poses (n, 3), the best first, that aren't the same as one before."""
    kept: list[FloatArray] = []
    while len(poses) and len(kept) < most:
        kept.append(poses[0])
        poses = poses[~is_same(poses, poses[0])]
    return kept
