"""Where one floor may lie on another: every view of each searched on the other, at all headings.

A view's best places are found by branch and bound (:mod:`slamgym.slam.branch_and_bound`), none is missed. Each says how
the whole floors would lie; what the whole floors say of that ranks them.
"""

import math

import numpy as np

from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT, search_blocks, turned_cells
from slamgym.slam.graph.alignment import FACES
from slamgym.slam.graph.matching import SEARCH_POINTS, heading_step, score_levels
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL
from slamgym.slam.localization.global_search import HEADING_STEPS, is_same
from slamgym.slam.merge.floor import VIEW_REACH, Floor, View, WallPieces

SEARCH_LEVELS = 6
"""The largest blocks of a search have sides of 32 cells."""
VIEW_MARGIN = 0.15
"""A place is kept if its score falls so much behind that of the view's best (1: every surface lies on a wall)."""
PLACES_OF_A_VIEW = 25
"""So many places of a view are kept."""

MOST_VIEWS = 40
"""So many views of a floor are sought, spread over it: enough of those of a large floor."""


class SearchedFloor:
    """A floor on which views are searched."""

    def __init__(self, floor: Floor) -> None:
        border = math.ceil(VIEW_REACH / SUBMAP_CELL) + 2
        cells = np.floor(floor.surfaces.points / SUBMAP_CELL).astype(np.int64)
        low = cells.min(axis=0) - border
        cols, rows = (cells - low).T
        self._size = cells.max(axis=0) - cells.min(axis=0) + 1
        width, height = self._size + 2 * border
        faces: ByteArray = np.zeros((FACES, height, width), np.uint8)
        for face, is_seen in enumerate(floor.surfaces.seen_by_face()):
            faces[face, rows[is_seen], cols[is_seen]] = 1
        self._levels = score_levels(faces, SEARCH_LEVELS)
        self._first = low * SUBMAP_CELL + (border + 0.5) * SUBMAP_CELL  # place of offset 0 [m]
        self._origin = np.full(2, (border + 0.5) * SUBMAP_CELL)

    def find(self, surfaces: WallPieces) -> list[FloatArray]:
        """The best poses (3,) of a view's surfaces, the best first."""
        stride = max(1, len(surfaces.points) // SEARCH_POINTS)
        points = np.ascontiguousarray(surfaces.points[::stride])
        sides = np.ascontiguousarray(surfaces.sides[::stride])
        step = heading_step(points, *HEADING_STEPS)
        count = math.ceil(2.0 * math.pi / step)
        headings = np.linspace(-math.pi, math.pi, count, endpoint=False)
        face_width = self._levels.shape[2] // FACES
        us, vs = turned_cells(points, sides, headings, self._origin, face_width)
        everywhere = self._levels[:0]
        width, height = self._size.tolist()
        margin = int(VIEW_MARGIN * HIT * len(points))
        nowhere = (0.0, 0.0, 0.0)
        last = (width - 1, height - 1)
        found = search_blocks(self._levels, everywhere, us, vs, 0, last, 0, margin + 1, nowhere)
        ranked = found[np.argsort(-found[:, 3], kind="stable")]
        best = ranked[ranked[:, 3] >= ranked[:1, 3].max(initial=0.0) - margin]
        places = self._first + best[:, :2] * SUBMAP_CELL
        numbers = best[:, 2].astype(np.int64)
        return distinct_poses(np.column_stack([places, headings[numbers]]), PLACES_OF_A_VIEW)


def distinct_poses(poses: FloatArray, most: int) -> list[FloatArray]:
    """Those of some poses (n, 3), the best first, that aren't the same as one before."""
    kept: list[FloatArray] = []
    while len(poses) and len(kept) < most:
        kept.append(poses[0])
        poses = poses[~is_same(poses, poses[0])]
    return kept


def find_transforms(first: Floor, second: Floor) -> list[FloatArray]:
    """Poses (3,) of the second floor's frame in the first's that any view of either speaks for."""
    on_first = SearchedFloor(first)
    on_second = SearchedFloor(second)
    found = []
    for view in _sought(second):
        found += [_placed_by(view, place) for place in on_first.find(view.surfaces)]
    for view in _sought(first):
        places = on_second.find(view.surfaces)
        found += [seen_from(_placed_by(view, place), np.zeros(3)) for place in places]
    return found


def _sought(floor: Floor) -> list[View]:
    count = len(floor.views)
    numbers = np.linspace(0.0, count - 1.0, min(count, MOST_VIEWS)).round().astype(np.int64)
    return [floor.views[number] for number in numbers.tolist()]


def _placed_by(view: View, place: FloatArray) -> FloatArray:
    """Pose (3,) of the frame of a view's floor if the view lies at a place (3,)."""
    return moved_by(place, seen_from(view.pose, np.zeros(3)))
