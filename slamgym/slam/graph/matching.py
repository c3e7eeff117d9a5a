"""Exhaustive search of a scan in a window about a place: the matcher that no wrong guess misleads.

The surfaces are told apart by the directions that they face, so that a wall isn't found at the back of another.
"""

import math

import numpy as np

from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, maxima, search_blocks, turned_cells
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

    def __init__(
        self, chosen: Chosen, centre: FloatArray, window: float, turn: float, reach: float
    ) -> None:
        cells, self._origin = chosen.occupied(centre, reach + window + 0.5)
        self._cells = max(1, math.ceil(window / SUBMAP_CELL))
        count = min(MOST_LEVELS, max(1, math.ceil(math.log2(self._cells + 1))) + 1)
        self._levels = score_levels(cells, count)
        self._face_width = self._levels.shape[2] // FACES
        self._centre, self._turn = centre, turn

    def search(
        self,
        points: FloatArray,
        sides: FloatArray,
        least: float,
        away_from: FloatArray | None = None,
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
        avoided, most = (0.0, 0.0, 0.0), HIT * max(len(points), 1)
        if away_from is not None:
            x, y = ((away_from - self._centre)[:2] / SUBMAP_CELL).tolist()
            avoided = x, y, ELSEWHERE / SUBMAP_CELL
        origin = self._centre[:2] - self._origin
        cells = turned_cells(points, sides, self._centre[2] + angles, origin, self._face_width)
        window = -self._cells, (self._cells, self._cells)
        places = search_blocks(
            self._levels, self._levels[:0], *cells, *window, int(least * most), 0, avoided
        )
        if not len(places):
            return self._centre.copy(), least
        col, row, turn, score = places[-1].tolist()
        away = np.array([col * SUBMAP_CELL, row * SUBMAP_CELL, angles[int(turn)]])
        return self._centre + away, score / most
