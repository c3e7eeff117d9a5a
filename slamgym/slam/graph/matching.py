"""Exhaustive search of a scan in a window about a place: the matcher that no wrong guess misleads.

The surfaces are told apart by the directions that they face, so that a wall isn't found at the back of another.
"""

import math

import numpy as np

from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, maxima, search_blocks, turned_cells
from slamgym.slam.graph.alignment import FACES, AlignmentTarget
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints

NEAR_HIT = 120
"""Score of a point in a cell next to an occupied one."""
MOST_LEVELS = 6
"""Grids of maxima at most: the largest blocks of a search have sides of 32 cells."""
FAR_PERCENTILE = 80.0
"""This percentile of the points' distances is how far the far points are."""
SEARCH_POINTS = 120
"""The search takes about this many of a scan's points."""
ELSEWHERE = 0.35
"""A place so far from another is another [m]."""
ANGULAR_STEPS = (0.008, 0.06)
"""Bounds of the search's step in heading [rad]."""


def score_levels(cells: ByteArray, count: int) -> ByteArray:
    """Grids of maxima (count, rows, width) of the score in cells, the faces' beside each other.

    Args:
        cells: (FACES, rows, cols) 1 where there is a surface.
        count: Number of grids.
    """
    import cv2

    # No block of maxima reaches from one face into the next.
    gap = 1 << (count - 1)
    ring = np.ones((3, 3), np.uint8)
    scores = []
    for face in cells:
        near = NEAR_HIT * cv2.dilate(face, ring)
        score = np.where(face > 0, HIT, near)
        scores.append(np.pad(score, ((0, 0), (0, gap))))
    beside = np.concatenate(scores, axis=1)
    return maxima(beside.astype(np.uint8), count)


def searched_part(seen: OrientedPoints) -> OrientedPoints:
    """As many of some points as a search takes."""
    stride = max(1, len(seen.points) // SEARCH_POINTS)
    return seen.every(stride)


def heading_step(points: FloatArray, least: float, most: float) -> float:
    """Step in heading that turns the far ones of points (n, 2) by about a cell, within bounds [rad]."""
    distances = np.hypot(points[:, 0], points[:, 1])
    far = float(np.percentile(distances, FAR_PERCENTILE))
    step = SUBMAP_CELL / max(far, SUBMAP_CELL)
    return min(max(step, least), most)


class SearchWindow:
    """A window in which scans are searched.

    Args:
        target: Submaps whose surfaces are looked at.
        centre: (3,) middle of the window in the map frame.
        window: (2,) largest offset in x and in y [m], and largest turn [rad].
        reach: Points lie no further than this from the robot [m].
    """

    def __init__(
        self, target: AlignmentTarget, centre: FloatArray, window: FloatArray, reach: float
    ) -> None:
        metres, self._turn = window.tolist()
        cells, self._origin = target.occupied(centre, reach + metres + 0.5)
        self._cells = max(1, math.ceil(metres / SUBMAP_CELL))
        needed = max(1, math.ceil(math.log2(self._cells + 1))) + 1
        self._levels = score_levels(cells, min(MOST_LEVELS, needed))
        self._face_width = self._levels.shape[2] // FACES
        self._centre = centre

    def search(
        self, seen: OrientedPoints, least: float, away_from: FloatArray | None = None
    ) -> tuple[FloatArray, float]:
        """Find the best pose for a scan; only what lies away from a pose (3,) counts.

        Args:
            seen: The scan.
            least: Score below which nothing is of interest, 0 to 1.
            away_from: Poses as near as ``ELSEWHERE`` to this one (3,) don't count.

        Returns:
            The pose (3,) to the precision of a cell, and its score, ``least`` if no pose is better.
        """
        taken = searched_part(seen)
        # Further points would only be blurred by a finer step.
        step = heading_step(taken.points, *ANGULAR_STEPS)
        count = math.ceil(self._turn / step)
        angles = step * np.arange(-count, count + 1, dtype=np.float64)
        headings = self._centre[2] + angles
        origin = self._centre[:2] - self._origin
        us, vs = turned_cells(*taken, headings, origin, self._face_width)
        avoided = (0.0, 0.0, 0.0)
        if away_from is not None:
            x, y, _ = ((away_from - self._centre) / SUBMAP_CELL).tolist()
            avoided = (x, y, ELSEWHERE / SUBMAP_CELL)
        most = HIT * max(len(taken.points), 1)
        every_floor = self._levels[:0]
        last = (self._cells, self._cells)
        least_score = int(least * most)
        places = search_blocks(
            self._levels, every_floor, us, vs, -self._cells, last, least_score, 0, avoided
        )
        if not len(places):
            return self._centre.copy(), least
        col, row, number, score = places[-1].tolist()
        away = np.array([col * SUBMAP_CELL, row * SUBMAP_CELL, angles[int(number)]])
        return self._centre + away, score / most
