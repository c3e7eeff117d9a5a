"""Exhaustive search of a scan in a window about a place: the matcher that no wrong guess misleads.

The surfaces are told apart by the directions that they face, so that a wall isn't found at the back of another.
"""

import math

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, best_in_block, block_score, maxima
from slamgym.slam.graph.alignment import FACES, Chosen
from slamgym.slam.graph.submaps import SUBMAP_CELL

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
    corner: FloatArray,
    points: FloatArray,
    sides: FloatArray,
    face_width: int,
    centre: FloatArray,
    window: int,
    angles: FloatArray,
    least: float,
    away_from: FloatArray,
    pose: FloatArray,
) -> float:
    """Find the best pose in a window.

    Args:
        levels: Grids of maxima of the score of a point in each cell, one beside the other for each face.
        corner: (2,) lower left corner of the grids [m].
        points: (n, 2) end points in the robot frame [m].
        sides: (n, 3) their sides in the robot frame.
        face_width: Columns from one face's grid to the next.
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
            side_x, side_y = cos * sides[i, 0] - sin * sides[i, 1], sin * sides[i, 0] + cos * sides[i, 1]
            face = (0 if side_x > 0.0 else 2) if abs(side_x) >= abs(side_y) else (1 if side_y > 0.0 else 3)
            us[a, i], vs[a, i] = face * face_width + math.floor(x / SUBMAP_CELL), math.floor(y / SUBMAP_CELL)
        for i in range(per_side):
            for j in range(per_side):
                bounds[(a * per_side + i) * per_side + j] = block_score(
                    levels[top], block, us[a], vs[a], i * block - window, j * block - window
                )
    best = int(least * HIT * num)
    everywhere = np.empty((0, 0, 0), dtype=np.uint8)
    avoided = (
        (away_from[0] - centre[0]) / SUBMAP_CELL, (away_from[1] - centre[1]) / SUBMAP_CELL, away_from[2] / SUBMAP_CELL,
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
            pose[0], pose[1] = centre[0] + u * SUBMAP_CELL, centre[1] + v * SUBMAP_CELL
            pose[2] = centre[2] + angles[a]
    return best / (HIT * max(num, 1))


def score_levels(cells: ByteArray, count: int) -> ByteArray:
    """Grids of maxima (count, rows, width) of the score in cells, the faces' beside each other.

    Args:
        cells: (FACES, rows, cols) 1 where there is a surface.
        count: Number of grids.
    """
    import cv2

    # No block of maxima reaches from one face into the next.
    gap, ring = 1 << (count - 1), np.ones((3, 3), np.uint8)
    scores = [np.where(face > 0, HIT, NEAR_HIT * cv2.dilate(face, ring)) for face in cells]
    beside = np.concatenate([np.pad(face, ((0, 0), (0, gap))) for face in scores], axis=1)
    return maxima(beside.astype(np.uint8), count)


class SearchWindow:
    """A window in which scans are searched.

    Args:
        chosen: Submaps whose surfaces are looked at.
        centre: (3,) middle of the window in the map frame.
        window: Largest offset in x and in y [m].
        turn: Largest turn [rad].
        reach: Points lie no further than this from the robot [m].
    """

    def __init__(self, chosen: Chosen, centre: FloatArray, window: float, turn: float, reach: float) -> None:
        cells, self._origin = chosen.occupied(centre, reach + window + 0.5)
        self._cells = max(1, math.ceil(window / SUBMAP_CELL))
        count = min(MOST_LEVELS, max(1, math.ceil(math.log2(self._cells + 1))) + 1)
        self._levels = score_levels(cells, count)
        self._face_width = self._levels.shape[2] // FACES
        self._centre, self._turn = centre, turn

    def search(
        self, points: FloatArray, sides: FloatArray, least: float, away_from: FloatArray | None = None
    ) -> tuple[FloatArray, float]:
        """Find the best pose for a scan; only what lies away from a pose (3,) counts.

        Args:
            points: (n, 2) end points in the robot frame [m].
            sides: (n, 3) their sides in the robot frame.
            least: Score below which nothing is of interest, 0 to 1.
            away_from: Poses as near as ``ELSEWHERE`` to this one (3,) don't count.

        Returns:
            The pose (3,) to the precision of a cell, and its score, ``least`` if no pose is better.
        """
        stride = max(1, len(points) // SEARCH_POINTS)
        points, sides = points[::stride], sides[::stride]
        # One step turns the far points by about a cell: further points would only be blurred by a finer one.
        far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
        step = min(max(SUBMAP_CELL / max(far, SUBMAP_CELL), ANGULAR_STEPS[0]), ANGULAR_STEPS[1])
        count = math.ceil(self._turn / step)
        angles = step * np.arange(-count, count + 1, dtype=np.float64)
        pose, avoided = np.empty(3), np.zeros(3)
        if away_from is not None:
            avoided[:2], avoided[2] = away_from[:2], ELSEWHERE
        scan = points, sides, self._face_width
        score = search_window(
            self._levels, self._origin, *scan, self._centre, self._cells, angles, least, avoided, pose
        )
        return pose, float(score)
