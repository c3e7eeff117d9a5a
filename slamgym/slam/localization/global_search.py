"""Search for points over a whole map and all headings: every place that explains them nearly as well as the best one.

Branch and bound (:mod:`slamgym.slam.branch_and_bound`) is exact. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.slam.branch_and_bound import HIT, search_blocks, turned_cells
from slamgym.slam.graph.matching import heading_step
from slamgym.slam.graph.submaps import SUBMAP_CELL
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
    return np.asarray(is_near & is_alike)


def find_places(known: KnownMap, points: FloatArray) -> list[FloatArray]:
    """The best poses (3,) of points (n, 2) in the robot frame [m], the best first."""
    step = heading_step(points, *HEADING_STEPS)
    count = math.ceil(2.0 * math.pi / step)
    headings = np.linspace(-math.pi, math.pi, count, endpoint=False)
    # The robot stands in the middle of a cell.
    origin = np.full(2, 0.5 * SUBMAP_CELL)
    no_sides = np.empty((0, 3))
    us, vs = turned_cells(points, no_sides, headings, origin, 0)
    margin = round(SCORE_MARGIN * HIT * len(points))
    _, rows, cols = known.levels.shape
    last = (cols - 1, rows - 1)
    nowhere = (0.0, 0.0, 0.0)
    found = search_blocks(known.levels, known.floors, us, vs, 0, last, 0, margin + 1, nowhere)
    middles = found[:, :2] + 0.5
    numbers = found[:, 2].astype(np.int64)
    scores = found[:, 3]
    points_on_map = known.field.corner + middles * SUBMAP_CELL
    places = np.column_stack([points_on_map, headings[numbers]])
    least = scores.max(initial=0.0) - margin
    ranking = np.argsort(-scores, kind="stable")
    is_good = scores[ranking] >= least
    return _different(places[ranking[is_good]])


def _different(places: FloatArray) -> list[FloatArray]:
    """Those of some poses (n, 3) that aren't the same place as one before."""
    kept: list[FloatArray] = []
    while len(places) and len(kept) < MOST_HYPOTHESES:
        kept.append(places[0])
        places = places[~is_same(places, places[0])]
    return kept
