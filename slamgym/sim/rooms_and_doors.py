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

_BEFORE_WALL = 0.1
"""A wall counts as a room's if this far before its middle lies the room [m]."""

_SHORTEST_WALL = 0.3
"""Shorter walls carry no furniture [m]."""

_WIDEST_DOOR = 1.3
"""In a plan without rooms, what is wider than this belongs to a room and not to a door [m]."""

_NAMELESS = {"", "room", "area", "other", "unknown"}
"""Categories that say nothing about what a room is for."""

_SMALLEST_REST = 4.0
"""So much floor that belongs to no room is made into rooms [m2]."""

_SMALLEST_ROOM = 0.8
"""Smaller parts of the floor are no rooms [m2]."""

_DOOR_WIDTH = (0.6, 1.15)
"""Openings with a clear width between these have a leaf [m]."""

_LEAF = 0.04
"""Thickness of a leaf [m]."""
_LEAF_GAP = 0.03
"""Gap between a leaf and the jambs [m]."""

_OPEN = (75.0, 90.0)
"""Least and largest angle of a door that stands open from the closed one [deg]."""
_HALF_OPEN = (30.0, 70.0)
"""Least and largest angle of a door that stands half open from the closed one [deg]."""
_OPEN_SHARE = 0.65
"""Share of the doors that stand open among those that aren't closed."""
_AJAR = (3.0, 14.0)
"""Least and largest angle of a door that stands ajar [deg]: a gap of 5 to 20 cm, too narrow for a robot."""
_MOST_AJAR = math.sin(math.radians(_AJAR[1] + 1.0))
"""Sine of an angle that no door that stands ajar has."""


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
        return self.walls[np.argmax(_lengths(self.walls))]


def room_areas(
    plan: "FloorPlan", passages: Passages, rng: np.random.Generator
) -> tuple[list[RoomArea], IntArray]:
    """The rooms, and for each cell of the passages' raster the room's label, 0 where there is none."""
    labels = _named(plan, passages)
    free = passages.clearance > 0.0
    labels[~free] = 0
    rest = free & (labels == 0)
    if np.count_nonzero(rest) * PASSAGE_CELL**2 > _SMALLEST_REST:
        labels[rest] = _guessed(rest)[rest] + len(plan.rooms)
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
        spread_x = max(square_x - mean_x**2, 1e-4) ** 0.5
        spread_y = max(square_y - mean_y**2, 1e-4) ** 0.5
        name = plan.rooms[label - 1].category if label <= len(plan.rooms) else ""
        category = name
        if name.lower() in _NAMELESS:
            aspect = max(spread_x, spread_y) / min(spread_x, spread_y)
            category = likely_category(area, aspect, rng)
        room = RoomArea(
            name=name or f"room {label}",
            category=category,
            area=area,
            middle=(mean_x, mean_y),
            spread=(spread_x, spread_y),
            walls=walls[sides == label],
            label=label,
        )
        found.append(room)
    return found, labels


def _moments(labels: IntArray, passages: Passages) -> FloatArray:
    """Number of cells, and sums of x, y, x^2 and y^2 [m], for each label, shape (labels, 5)."""
    height, width = labels.shape
    left, bottom = passages.origin
    x = left + (np.arange(width) + 0.5) * PASSAGE_CELL
    y = bottom + (np.arange(height) + 0.5) * PASSAGE_CELL
    moments = []
    for term in (np.ones(1), x, y[:, None], x * x, (y * y)[:, None]):
        weights = np.broadcast_to(term, labels.shape).ravel()
        moments.append(np.bincount(labels.ravel(), weights=weights))
    return np.column_stack(moments)


def _named(plan: "FloorPlan", passages: Passages) -> IntArray:
    """Rooms painted from the largest to the smallest: a cell of several belongs to the smallest."""
    from slamgym.cad.floorplan import fill_segments, ring_segments

    labels = np.zeros(passages.frame.shape, np.int64)
    numbered = list(enumerate(plan.rooms, start=1))
    for label, room in sorted(numbered, key=lambda one: -one[1].area):
        polygon = room.polygon
        x0, y0, x1, y1 = polygon.bounds
        is_box = abs((x1 - x0) * (y1 - y0) - room.area) < 1e-6
        if is_box:
            (row0, row1), (col0, col1) = passages.cell([x0, x1], [y0, y1])
            labels[row0 : row1 + 1, col0 : col1 + 1] = label
        else:
            outline = ring_segments([polygon.exterior, *polygon.interiors])
            inside = fill_segments(outline, passages.frame)
            labels[inside[::-1]] = label
    return labels


def _guessed(free: BoolArray) -> IntArray:
    """Labels from 1: wide places, and to each what is nearest to it."""
    import cv2

    distance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    is_wide = distance * PASSAGE_CELL > 0.5 * _WIDEST_DOOR
    _, cores = cv2.connectedComponents(is_wide.astype(np.uint8))
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
    return walls[_lengths(walls) > _SHORTEST_WALL]


def _lengths(walls: FloatArray) -> FloatArray:
    """Lengths of walls, shape (W,) [m]."""
    along = walls[:, 2:] - walls[:, :2]
    return np.hypot(along[:, 0], along[:, 1])


def _labels_before(walls: FloatArray, labels: IntArray, passages: Passages) -> IntArray:
    """The room that each wall faces at its middle."""
    starts = walls[:, :2]
    ends = walls[:, 2:]
    along = ends - starts
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / _lengths(walls)[:, None]
    before = 0.5 * (starts + ends) + _BEFORE_WALL * normals
    rows, cols = passages.cell(before[:, 0], before[:, 1])
    return labels[rows, cols]


def doors_of(plan: "FloorPlan") -> list["Door"]:
    """The openings of a plan: its doors where it has some, else those that its walls show."""
    if plan.doors:
        return list(plan.doors)
    import shapely

    from slamgym.cad.doors import SIMPLIFY, find_openings

    simple = plan.free_space.simplify(SIMPLIFY)
    if not isinstance(simple, shapely.Polygon) or simple.is_empty:
        return []
    return find_openings(simple)


def has_leaf(door: "Door") -> bool:
    """True if an opening is as wide as one that a single leaf closes."""
    narrowest, widest = _DOOR_WIDTH
    return narrowest <= door.width <= widest


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
    start = np.array(door.start)
    end = np.array(door.end)
    if rng.random() < 0.5:
        start, end = end, start
    along = (end - start) / door.width
    side = 1.0 if rng.random() < 0.5 else -1.0
    length = door.width - 2.0 * _LEAF_GAP
    hinge = start + _LEAF_GAP * along
    boxes = []
    for closed, wide, share in rng.random((places, 3)).tolist():
        low, high = _OPEN if wide < _OPEN_SHARE else _HALF_OPEN
        if closed < closed_share[0]:
            low, high = _AJAR if wide < closed_share[1] else (0.0, 0.0)
        angle = side * math.radians(low + share * (high - low))
        cos = math.cos(angle)
        sin = math.sin(angle)
        ux = along[0] * cos - along[1] * sin
        uy = along[0] * sin + along[1] * cos
        x, y = hinge + 0.5 * length * np.array([ux, uy])
        boxes.append(np.array([x, y, ux, uy, 0.5 * length, 0.5 * _LEAF]))
    return boxes


def is_closed(door: "Door", leaf: FloatArray) -> bool:
    """True if a leaf lies in its opening, or ajar."""
    _, _, ux, uy, _, _ = leaf
    x0, y0 = door.start
    x1, y1 = door.end
    out_of_opening = abs((x1 - x0) * uy - (y1 - y0) * ux)
    return bool(out_of_opening < _MOST_AJAR * door.width)
