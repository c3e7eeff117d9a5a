"""Rooms of a map by its shape alone: parts of the free space that only a doorway joins.

The distance from the nearest wall is a landscape: rooms are its hills, doorways its passes. Flooding it from
the top (a watershed, as in the distance-transform segmentation of Bormann et al., *Room Segmentation: Survey,
Implementation, and Analysis*, ICRA 2016), two hills stay two rooms if the pass between them is as narrow as a
doorway and clearly narrower than both; else they are one room. The same rule applies to a map and the truth, so
what it gets wrong about unusual rooms is wrong in both.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.metrics.maps import check_same_shape

WIDEST_DOORWAY = 1.6
"""Wider openings join two parts to one room [m]. It lies in the gap of the widths in HouseExpo plans: doors end at
1.35 m, and open passages begin at 1.85 m."""
MAX_NARROWING = 0.75
"""A doorway is at most this share of the smaller room's width."""
NARROWEST_ROOM = 0.7
"""Narrower parts are no rooms: niches, and slits between furniture and a wall [m]."""
SMALLEST_ROOM_AREA = 1.0
"""Smaller parts are no rooms [m2]."""


@dataclass(frozen=True)
class RoomScore:
    """Agreement of the rooms of two maps."""

    count: int
    true_count: int
    f1: float
    """F1 of rooms that have a counterpart with an intersection over union above 0.5 (Structured3D's room F1)."""


def label_rooms(
    free: BoolArray,
    metres_per_px: float,
    widest_doorway: float = WIDEST_DOORWAY,
    max_narrowing: float = MAX_NARROWING,
    narrowest_room: float = NARROWEST_ROOM,
) -> IntArray:
    """Number the rooms of a map.

    Args:
        free: Free cells, shape (rows, cols).
        metres_per_px: Scale [m].
        widest_doorway: Wider openings join two parts to one room [m].
        max_narrowing: A doorway is at most this share of the smaller room's width. With 1, and a doorway as wide as the
            narrowest room, this is the plain watershed: rooms are what lies farther than half that width from walls.
        narrowest_room: Narrower parts are no rooms [m].

    Returns:
        Shape (rows, cols): 0 where there is no room, else 1 to the number of rooms.
    """
    landscape = Landscape.of(free, metres_per_px)
    return landscape.rooms(widest_doorway, max_narrowing, narrowest_room)


@dataclass(frozen=True)
class Landscape:
    """The free cells of a map by their distance from walls, in which rooms are found by one rule or several."""

    free: BoolArray
    metres_per_px: float
    clearance: FloatArray
    """Distance of each cell from the nearest wall's face, which lies half a cell before its first cell [m]."""
    order: IntArray
    """Flat indices of the free cells, from the highest on, in the picture with a border of one cell."""

    @staticmethod
    def of(free: BoolArray, metres_per_px: float) -> "Landscape":
        """Prepare a map of a scale [m]."""
        is_free = np.pad(free, 1)
        image = is_free.astype(np.uint8)
        distance = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        exact = distance[1:-1, 1:-1].astype(np.float64)
        clearance = np.where(free, (exact - 0.5) * metres_per_px, 0.0)
        from_top = np.argsort(-clearance[free], kind="stable")
        return Landscape(free, metres_per_px, clearance, np.flatnonzero(is_free)[from_top])

    def rooms(self, widest_doorway: float, max_narrowing: float, narrowest_room: float) -> IntArray:
        """The rooms, as those of :func:`label_rooms`."""
        cell = self.metres_per_px**2
        parts = _flood(
            np.pad(self.clearance, 1),
            self.order,
            widest_doorway / 2.0,
            max_narrowing,
            narrowest_room / 2.0,
            SMALLEST_ROOM_AREA / cell,
        )
        root_of_cell = parts[1:-1, 1:-1][self.free]
        roots = np.flatnonzero(np.bincount(root_of_cell, minlength=1))
        label_of_root = np.zeros(parts.size, np.int64)
        label_of_root[roots] = np.arange(1, len(roots) + 1)  # 0: outside
        label_of_cell = label_of_root[root_of_cell]
        sizes = np.bincount(label_of_cell, minlength=1) * cell
        widest = np.zeros(len(sizes))
        np.maximum.at(widest, label_of_cell, self.clearance[self.free])
        is_room = (sizes >= SMALLEST_ROOM_AREA) & (widest >= narrowest_room / 2.0)
        is_room[0] = False  # outside
        numbers = np.where(is_room, np.cumsum(is_room), 0)
        numbered = np.zeros(self.free.shape, np.int64)
        numbered[self.free] = numbers[label_of_cell]
        return numbered


def room_score(free: BoolArray, true_free: BoolArray, metres_per_px: float) -> RoomScore:
    """Compare the rooms of a map with those of the CAD map.

    Args:
        free: Free cells of the map, shape (rows, cols).
        true_free: Free cells of the CAD map, same shape and frame.
        metres_per_px: Scale of both [m].

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(free, true_free)
    found = label_rooms(free, metres_per_px)
    truth = label_rooms(true_free, metres_per_px)
    count = int(found.max(initial=0))
    true_count = int(truth.max(initial=0))
    overlap = np.zeros((count + 1, true_count + 1))
    np.add.at(overlap, (found, truth), 1.0)
    sizes = overlap.sum(axis=1, keepdims=True)
    true_sizes = overlap.sum(axis=0, keepdims=True)
    intersection = overlap[1:, 1:]
    both_sizes = sizes[1:] + true_sizes[:, 1:]
    union = both_sizes - intersection
    iou = intersection / np.maximum(union, 1.0)
    # Above one half, no room can have two counterparts.
    matched = np.count_nonzero(iou > 0.5)
    total = count + true_count
    f1 = 2.0 * matched / total if total else 1.0
    return RoomScore(count, true_count, f1)


@kernel
def _flood(
    radius: FloatArray,
    order: IntArray,
    max_pass: float,
    max_narrowing: float,
    min_peak: float,
    min_cells: float,
) -> IntArray:
    """Flood a landscape from the top; 0 outside, else the number of the part that a cell belongs to.

    ``order`` lists the flat indices of the cells from the highest on; the border of the landscape is 0.
    """
    rows, cols = radius.shape
    height = radius.ravel()
    parent = np.zeros(rows * cols, np.int64)  # 0: not flooded; a root is its own parent
    size = np.zeros(rows * cols, np.int64)
    peak = np.zeros(rows * cols, np.float64)
    for at in order:
        own: Any = np.int64(0)
        for k in range(8):
            step = (-1, 1, -cols, cols, -cols - 1, -cols + 1, cols - 1, cols + 1)[k]
            if parent[at + step] == 0:
                continue
            other = _root(parent, at + step)
            if own == 0:
                own = other
                parent[at] = own
                size[own] += 1
            elif other != own:
                lower = min(peak[own], peak[other])
                doorway = height[at] <= max_pass and height[at] <= max_narrowing * lower
                if doorway and lower >= min_peak and min(size[own], size[other]) >= min_cells:
                    continue  # two rooms: the cell stays with the first
                if peak[other] > peak[own]:
                    own, other = other, own
                parent[other] = own
                size[own] += size[other]
        if own == 0:
            parent[at] = at
            size[at] = 1
            peak[at] = height[at]
    for at in order:
        parent[at] = _root(parent, at)
    return parent.reshape(rows, cols)


@kernel
def _root(parent: IntArray, at: Any) -> Any:
    """The root of a cell's tree; paths are halved on the way."""
    while parent[at] != at:
        parent[at] = parent[parent[at]]
        at = parent[at]
    return at
