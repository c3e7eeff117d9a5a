"""Search for points over a whole map and all headings: every place that explains them nearly as well as the best one.

Branch and bound (:mod:`slamgym.slam.branch_and_bound`) is exact. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, best_in_block, block_score
from slamgym.slam.graph.submaps import SUBMAP_CELL
from slamgym.slam.localization.known_map import KnownMap

HEADING_STEPS = (0.015, 0.07)
"""Bounds of the step in heading [rad]."""
MOST_PLACES, MOST_HYPOTHESES = 20_000, 60
"""So many places are compared, and the best ones that differ returned."""
SCORE_MARGIN = 0.12
"""A place is kept if its score falls so much behind the best one's at most (1: every point lies on a wall)."""
SAME, SAME_TURN = 0.3, 0.25
"""Places nearer to each other than this are one [m], [rad]."""


def is_same(poses: FloatArray, pose: FloatArray) -> np.ndarray:
    """True (n,) for those of some poses (n, 3 or more) that are the same place as another (3,)."""
    near = np.hypot(poses[:, 0] - pose[0], poses[:, 1] - pose[1]) < SAME
    return np.asarray(near & (np.abs(wrap_angle(poses[:, 2] - pose[2])) < SAME_TURN))


@kernel
def search_map(
    levels: ByteArray,
    floors: ByteArray,
    points: FloatArray,
    headings: FloatArray,
    margin: int,
    places: FloatArray,
) -> int:
    """Find the best place of every block at every heading, if it is nearly as good as the best of all.

    Args:
        levels: (levels, rows, cols) grids of maxima of the score.
        floors: (levels, rows, cols) the same of the floor, where alone places count.
        points: (n, 2) in the robot frame [m].
        headings: (a,) [rad].
        margin: A place is of interest if its score falls so much behind at most.
        places: (most, 4) receives column, row, heading and score.

    Returns:
        How many were found.
    """
    top = len(levels) - 1
    us = np.empty((len(headings), len(points)), dtype=np.int32)
    vs = np.empty((len(headings), len(points)), dtype=np.int32)
    rows, cols = ((floors.shape[1] - 1) >> top) + 1, ((floors.shape[2] - 1) >> top) + 1
    bounds = np.zeros(len(headings) * rows * cols, dtype=np.int32)
    for a in range(len(headings)):
        cos, sin = math.cos(headings[a]), math.sin(headings[a])
        for i in range(len(points)):
            # The robot stands in the middle of a cell.
            us[a, i] = math.floor((cos * points[i, 0] - sin * points[i, 1]) / SUBMAP_CELL + 0.5)
            vs[a, i] = math.floor((sin * points[i, 0] + cos * points[i, 1]) / SUBMAP_CELL + 0.5)
        for row in range(rows):
            for col in range(cols):
                if floors[top, row << top, col << top]:
                    bound = block_score(levels[top], 1 << top, us[a], vs[a], col << top, row << top)
                    bounds[(a * rows + row) * cols + col] = bound
    best, count, most = 0, 0, (floors.shape[2] - 1, floors.shape[1] - 1)
    for place in np.argsort(-bounds):
        least = max(best - margin, 1)
        if bounds[place] < least or count == len(places):
            break
        a, row, col = place // (rows * cols), place // cols % rows, place % cols
        block = col << top, row << top, bounds[place]
        score, u, v = best_in_block(levels, floors, us[a], vs[a], block, most, least - 1, (0.0, 0.0, 0.0))
        if score >= least:
            places[count, 0], places[count, 1], places[count, 2], places[count, 3] = u, v, headings[a], score
            best, count = max(best, score), count + 1
    return count


def find_places(known: KnownMap, points: FloatArray) -> list[FloatArray]:
    """The best poses (3,) of points (n, 2) in the robot frame [m], the best first."""
    far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
    step = min(max(SUBMAP_CELL / max(far, SUBMAP_CELL), HEADING_STEPS[0]), HEADING_STEPS[1])
    headings = np.linspace(-math.pi, math.pi, math.ceil(2.0 * math.pi / step), endpoint=False)
    places = np.empty((MOST_PLACES, 4))
    margin = round(SCORE_MARGIN * HIT * len(points))
    places = places[: search_map(known.levels, known.floors, points, headings, margin, places)]
    places[:, :2] = known.field.corner + (places[:, :2] + 0.5) * SUBMAP_CELL
    places = places[places[:, 3] >= places[:, 3].max(initial=0.0) - margin]
    places = places[np.argsort(-places[:, 3], kind="stable")]
    kept: list[FloatArray] = []
    while len(places) and len(kept) < MOST_HYPOTHESES:
        kept.append(places[0, :3])
        places = places[~is_same(places, places[0])]
    return kept
