"""The rooms of a plan with the walls that face each, and its doors with their leaves; guessed where it names none."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.sim.furniture import likely_category
from slamgym.sim.passages import PASSAGE_CELL, Passages

if TYPE_CHECKING:
    from slamgym.cad.floorplan import Door, FloorPlan

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

# Openings of these clear widths have a leaf [m].
_DOOR_WIDTH = (0.6, 1.15)

# Thickness of a leaf, and the gap between it and the jambs [m].
_LEAF = 0.04
_LEAF_GAP = 0.03

# Doors that stand open, and half open, by their angle from the closed one [deg]; and the share of the first
# among those that aren't closed.
_OPEN = (75.0, 90.0)
_HALF_OPEN = (30.0, 70.0)
_OPEN_SHARE = 0.65

# Doors that stand ajar [deg]: a gap of 5 to 20 cm, too narrow for a robot.
_AJAR = (3.0, 14.0)
_MOST_AJAR = math.sin(math.radians(_AJAR[1] + 1.0))


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
    """Label of its cells, as :func:`room_areas` gives them."""

    @cached_property
    def longest_wall(self) -> FloatArray:
        """One of ``walls``, of which there must be some."""
        return self.walls[np.argmax(np.hypot(*(self.walls[:, 2:] - self.walls[:, :2]).T))]


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
    moments = _moments(labels, passages)
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
        found.append(
            RoomArea(name or f"room {label}", category, area, (mean_x, mean_y), spread, own, label)
        )
    return found, labels


def _moments(labels: IntArray, passages: Passages) -> FloatArray:
    """Number of cells, and sums of x, y, x^2 and y^2 [m], for each label, shape (labels, 5)."""
    x, y = (
        origin + (np.arange(count) + 0.5) * PASSAGE_CELL
        for origin, count in zip(passages.origin, labels.shape[::-1], strict=True)
    )
    terms = np.broadcast_arrays(1.0, x, y[:, None], x * x, (y * y)[:, None], labels)[:-1]
    return np.column_stack([np.bincount(labels.ravel(), weights=term.ravel()) for term in terms])


def _named(plan: "FloorPlan", passages: Passages) -> IntArray:
    """Rooms painted from the largest to the smallest: a cell of several belongs to the smallest."""
    from slamgym.cad.floorplan import fill_segments, ring_segments

    labels = np.zeros(passages.frame.shape, np.int64)
    for index in sorted(range(len(plan.rooms)), key=lambda index: -plan.rooms[index].area):
        polygon = plan.rooms[index].polygon
        x0, y0, x1, y1 = polygon.bounds
        (row0, row1), (col0, col1) = passages.cell([x0, x1], [y0, y1])
        if abs((x1 - x0) * (y1 - y0) - plan.rooms[index].area) < 1e-6:
            labels[row0 : row1 + 1, col0 : col1 + 1] = index + 1
        else:
            inside = fill_segments(
                ring_segments([polygon.exterior, *polygon.interiors]), passages.frame
            )
            labels[inside[::-1]] = index + 1
    return labels


def _guessed(free: BoolArray) -> IntArray:
    """Labels from 1: wide places, and to each what is nearest to it."""
    import cv2

    distance = (
        cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5) * PASSAGE_CELL
    )
    _, cores = cv2.connectedComponents((distance > 0.5 * _WIDEST_DOOR).astype(np.uint8))
    _, nearest = cv2.distanceTransformWithLabels(
        (cores == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_pixel = np.zeros(int(nearest.max(initial=0)) + 1, np.int64)
    # Without any wide place all is one room.
    of_pixel[:] = 1 if not cores.any() else 0
    of_pixel[nearest[cores > 0]] = cores[cores > 0]
    return of_pixel[nearest]


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
    return walls[long_enough]


def _labels_before(walls: FloatArray, labels: IntArray, passages: Passages) -> IntArray:
    """The room that each wall faces at its middle."""
    along = walls[:, 2:] - walls[:, :2]
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    x, y = (0.5 * (walls[:, :2] + walls[:, 2:]) + _BEFORE_WALL * normal).T
    return labels[passages.cell(x, y)]


def doors_of(plan: "FloorPlan") -> list["Door"]:
    """The openings of a plan: its doors where it has some, else those that its walls show."""
    if plan.doors:
        return list(plan.doors)
    import shapely

    from slamgym.cad.doors import SIMPLIFY, find_openings

    simple = plan.free_space.simplify(SIMPLIFY)
    return (
        find_openings(simple) if isinstance(simple, shapely.Polygon) and not simple.is_empty else []
    )


def has_leaf(door: "Door") -> bool:
    """True if an opening is as wide as one that a single leaf closes."""
    return _DOOR_WIDTH[0] <= door.width <= _DOOR_WIDTH[1]


def leaf_boxes(
    door: "Door", closed_share: tuple[float, float], rng: np.random.Generator, places: int
) -> list[FloatArray]:
    """Where a door's leaf may stand, each with the same hinge: the places to try, the first the likeliest.

    Args:
        door: The opening.
        closed_share: Probability of each to be closed, and of a closed one to be ajar.
        rng: Draws hinge, side and angles.
        places: How many.

    Returns:
        Boxes as :mod:`slamgym.sim.passages` has them.
    """
    start, end = np.array(door.start), np.array(door.end)
    if rng.random() < 0.5:
        start, end = end, start
    along = (end - start) / door.width
    side = 1.0 if rng.random() < 0.5 else -1.0
    length = door.width - 2.0 * _LEAF_GAP
    boxes = []
    for closed, wide, share in rng.random((places, 3)).tolist():
        low, high = _OPEN if wide < _OPEN_SHARE else _HALF_OPEN
        if closed < closed_share[0]:
            low, high = _AJAR if wide < closed_share[1] else (0.0, 0.0)
        angle = side * math.radians(low + share * (high - low))
        cos, sin = math.cos(angle), math.sin(angle)
        ux, uy = along[0] * cos - along[1] * sin, along[0] * sin + along[1] * cos
        x, y = start + _LEAF_GAP * along + 0.5 * length * np.array([ux, uy])
        boxes.append(np.array([x, y, ux, uy, 0.5 * length, 0.5 * _LEAF]))
    return boxes


def is_closed(door: "Door", leaf: FloatArray) -> bool:
    """True if a leaf lies in its opening, or ajar."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    return bool(abs(dx * leaf[3] - dy * leaf[2]) < _MOST_AJAR * door.width)
