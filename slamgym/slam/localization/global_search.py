"""Search for points over a whole map and all headings: every place that explains them nearly as well as the best one.

Branch and bound (:mod:`slamgym.slam.branch_and_bound`) is exact. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.slam.branch_and_bound import HIT, search_blocks, turned_cells
from slamgym.slam.graph.submaps import SUBMAP_CELL
from slamgym.slam.localization.known_map import KnownMap

HEADING_STEPS = (0.015, 0.07)
"""Bounds of the step in heading [rad]."""
MOST_HYPOTHESES = 60
"""So many of the best places that differ are returned."""
SCORE_MARGIN = 0.12
"""A place is kept if its score falls so much behind the best one's at most (1: every point lies on a wall)."""
SAME, SAME_TURN = 0.3, 0.25
"""Places nearer to each other than this are one [m], [rad]."""


def is_same(poses: FloatArray, pose: FloatArray) -> np.ndarray:
    """True (n,) for those of some poses (n, 3 or more) that are the same place as another (3,)."""
    near = np.hypot(poses[:, 0] - pose[0], poses[:, 1] - pose[1]) < SAME
    return np.asarray(near & (np.abs(wrap_angle(poses[:, 2] - pose[2])) < SAME_TURN))


def find_places(known: KnownMap, points: FloatArray) -> list[FloatArray]:
    """The best poses (3,) of points (n, 2) in the robot frame [m], the best first."""
    far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
    step = min(max(SUBMAP_CELL / max(far, SUBMAP_CELL), HEADING_STEPS[0]), HEADING_STEPS[1])
    headings = np.linspace(-math.pi, math.pi, math.ceil(2.0 * math.pi / step), endpoint=False)
    # The robot stands in the middle of a cell.
    cells = turned_cells(points, np.empty((0, 3)), headings, np.full(2, 0.5 * SUBMAP_CELL), 0)
    margin = round(SCORE_MARGIN * HIT * len(points))
    last = known.levels.shape[2] - 1, known.levels.shape[1] - 1
    places = search_blocks(
        known.levels, known.floors, *cells, 0, last, 0, margin + 1, (0.0, 0.0, 0.0)
    )
    places[:, :2] = known.field.corner + (places[:, :2] + 0.5) * SUBMAP_CELL
    places[:, 2] = headings[places[:, 2].astype(np.int64)]
    places = places[places[:, 3] >= places[:, 3].max(initial=0.0) - margin]
    places = places[np.argsort(-places[:, 3], kind="stable")]
    kept: list[FloatArray] = []
    while len(places) and len(kept) < MOST_HYPOTHESES:
        kept.append(places[0, :3])
        places = places[~is_same(places, places[0])]
    return kept
