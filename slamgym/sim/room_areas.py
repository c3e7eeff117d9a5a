"""The rooms of a plan as parts of its floor, with the walls that face each; guessed where the plan names none."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.sim.furniture import likely_category
from slamgym.sim.passages import PASSAGE_CELL, Passages

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

# A wall counts as a room's if this far before its middle lies the room [m].
_BEFORE_WALL = 0.1

# Shorter walls carry no furniture [m].
_SHORTEST_WALL = 0.3

# In a plan without rooms, what is wider than this belongs to a room and not to a door [m].
_WIDEST_DOOR = 1.3

# Categories that say nothing about what a room is for.
_NAMELESS = {"", "room", "area", "other", "unknown"}

# So much floor that belongs to no room is made into rooms [m2].
_SMALLEST_REST = 4.0

# Smaller parts of the floor are no rooms [m2].
_SMALLEST_ROOM = 0.8


@dataclass(frozen=True)
class RoomArea:
    """The part of the floor that belongs to a room and to no smaller one."""

    name: str
    """As the plan has it; ``room 3`` where it has none."""

    category: str
    """As the plan has it, or guessed."""

    area: float
    """[m2]"""

    middle: tuple[float, float]
    """Mean of its floor [m], world frame."""

    spread: tuple[float, float]
    """Standard deviation of its floor in x and y [m]."""

    walls: FloatArray
    """Shape (W, 4), each with the free space on its left [m]."""

    label: int
    """Of its cells, as :func:`room_areas` gives them."""

    @cached_property
    def longest_wall(self) -> FloatArray:
        """One of ``walls``, of which there must be some."""
        longest: FloatArray = self.walls[np.argmax(np.hypot(*(self.walls[:, 2:] - self.walls[:, :2]).T))]
        return longest


def room_areas(
    plan: "FloorPlan", passages: Passages, rng: np.random.Generator
) -> tuple[list[RoomArea], IntArray]:
    """The rooms, and for each cell of the passages' raster the room's label, 0 where there is none."""
    labels = _named(plan, passages)
    free = passages.clearance > 0.0
    labels[~free] = 0
    rest = free & (labels == 0)
    if np.count_nonzero(rest) * PASSAGE_CELL**2 > _SMALLEST_REST:
        labels[rest] = (_guessed(rest) + len(plan.rooms))[rest]
    count = int(labels.max(initial=0))
    moments = _moments(labels, *passages.origin, np.zeros((count + 1, 5)))
    walls = _oriented_walls(plan)
    sides = _labels_before(walls, labels, passages)
    found = []
    for label in range(1, count + 1):
        cells, *sums = moments[label].tolist()
        area = cells * PASSAGE_CELL**2
        if area < _SMALLEST_ROOM:
            continue
        mean_x, mean_y, square_x, square_y = (total / cells for total in sums)
        spread = max(square_x - mean_x**2, 1e-4) ** 0.5, max(square_y - mean_y**2, 1e-4) ** 0.5
        name = plan.rooms[label - 1].category if label <= len(plan.rooms) else ""
        category = name
        if name.lower() in _NAMELESS:
            category = likely_category(area, max(spread) / min(spread), rng)
        own = walls[sides == label]
        found.append(RoomArea(name or f"room {label}", category, area, (mean_x, mean_y), spread, own, label))
    return found, labels


@kernel
def _moments(labels: IntArray, origin_x: float, origin_y: float, sums: FloatArray) -> FloatArray:
    """Number of cells, and sums of x, y, x^2 and y^2 [m] for each label."""
    for row in range(labels.shape[0]):
        y = origin_y + (row + 0.5) * PASSAGE_CELL
        for col in range(labels.shape[1]):
            x = origin_x + (col + 0.5) * PASSAGE_CELL
            own = sums[labels[row, col]]
            own[0] += 1.0
            own[1] += x
            own[2] += y
            own[3] += x * x
            own[4] += y * y
    return sums


def _named(plan: "FloorPlan", passages: Passages) -> IntArray:
    """Rooms painted from the largest to the smallest: a cell of several belongs to the smallest."""
    from slamgym.cad.floorplan import fill_segments, ring_segments

    labels = np.zeros(passages.frame.shape, np.int64)
    for index in sorted(range(len(plan.rooms)), key=lambda index: -plan.rooms[index].area):
        polygon = plan.rooms[index].polygon
        x0, y0, x1, y1 = polygon.bounds
        (row0, col0), (row1, col1) = passages.cell(x0, y0), passages.cell(x1, y1)
        if abs((x1 - x0) * (y1 - y0) - plan.rooms[index].area) < 1e-6:
            labels[row0 : row1 + 1, col0 : col1 + 1] = index + 1
        else:
            inside = fill_segments(ring_segments([polygon.exterior, *polygon.interiors]), passages.frame)
            labels[inside[::-1]] = index + 1
    return labels


def _guessed(free: BoolArray) -> IntArray:
    """Labels from 1: wide places, and to each what is nearest to it."""
    import cv2

    distance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5) * PASSAGE_CELL
    _, cores = cv2.connectedComponents((distance > 0.5 * _WIDEST_DOOR).astype(np.uint8))
    _, nearest = cv2.distanceTransformWithLabels(
        (cores == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_pixel = np.zeros(int(nearest.max(initial=0)) + 1, np.int64)
    # Without any wide place all is one room.
    of_pixel[:] = 1 if not cores.any() else 0
    of_pixel[nearest[cores > 0]] = cores[cores > 0]
    labels: IntArray = of_pixel[nearest]
    return labels


def _oriented_walls(plan: "FloorPlan") -> FloatArray:
    """The plan's longer walls, shape (W, 4), each with the free space on its left."""
    from slamgym.cad.floorplan import ring_segments

    rings: list[FloatArray] = []
    for ring in (plan.free_space.exterior, *plan.free_space.interiors):
        segments = ring_segments([ring])
        keeps = ring.is_ccw == (len(rings) == 0)
        rings.append(segments if keeps else segments[:, [2, 3, 0, 1]])
    walls = np.vstack(rings)
    long_enough = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > _SHORTEST_WALL
    found: FloatArray = walls[long_enough]
    return found


def _labels_before(walls: FloatArray, labels: IntArray, passages: Passages) -> IntArray:
    """The room that each wall faces at its middle."""
    along = walls[:, 2:] - walls[:, :2]
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    x, y = (0.5 * (walls[:, :2] + walls[:, 2:]) + _BEFORE_WALL * normal).T
    height, width = labels.shape
    rows = np.clip(((y - passages.origin[1]) / PASSAGE_CELL).astype(np.int64), 0, height - 1)
    cols = np.clip(((x - passages.origin[0]) / PASSAGE_CELL).astype(np.int64), 0, width - 1)
    found: IntArray = labels[rows, cols]
    return found
