"""Where one floor may lie on another: every view of each searched on the other, at all headings.

A view's best places are found by branch and bound (:mod:`slamgym.slam.branch_and_bound`), none is missed. Each says how
the whole floors would lie; what the whole floors say of that ranks them.
"""

import math

import numpy as np

from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.branch_and_bound import HIT
from slamgym.slam.graph.alignment import FACES
from slamgym.slam.graph.matching import score_levels, searched_part
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints
from slamgym.slam.localization.global_search import distinct_poses, search_everywhere
from slamgym.slam.merge.floor import VIEW_REACH, Floor, View

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
        self._size = np.ptp(cells, axis=0)[::-1] + 1
        low = cells.min(axis=0) - border
        cols, rows = (cells - low).T
        faces: ByteArray = np.zeros((FACES, *(self._size + 2 * border)), np.uint8)
        for face, is_seen in enumerate(floor.surfaces.seen_by_face()):
            faces[face, rows[is_seen], cols[is_seen]] = 1
        self._levels = score_levels(faces, SEARCH_LEVELS)
        self._first = low * SUBMAP_CELL + (border + 0.5) * SUBMAP_CELL  # place of offset 0 [m]
        self._origin = np.full(2, (border + 0.5) * SUBMAP_CELL)

    def find(self, surfaces: OrientedPoints) -> list[FloatArray]:
        """The best poses (3,) of a view's surfaces, the best first."""
        seen = searched_part(surfaces)
        margin = int(VIEW_MARGIN * HIT * len(seen.points))
        face_width = self._levels.shape[2] // FACES
        everywhere = self._levels[:0]
        cells, headings = search_everywhere(
            self._levels, everywhere, seen, self._origin, face_width, self._size.tolist(), margin
        )
        places = self._first + cells * SUBMAP_CELL
        return distinct_poses(np.column_stack([places, headings]), PLACES_OF_A_VIEW)


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
