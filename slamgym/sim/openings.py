"""Doors' leaves, and the windows and glass doors that reach the floor."""

import math
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.sim.passages import Passages
from slamgym.sim.room_areas import RoomArea

if TYPE_CHECKING:
    from slamgym.cad.floorplan import Door, FloorPlan

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

# Windows and glass doors: clear width, and what is left of the wall at their sides [m].
_GLASS_WIDTH = (0.8, 2.4)
_GLASS_NIB = 0.15

# Behind an outer wall there is no floor at these distances [m].
_BEHIND = (0.3, 0.6, 1.0, 1.5, 2.5)


def doors_of(plan: "FloorPlan") -> list["Door"]:
    """The openings of a plan: its doors where it has some, else those that its walls show."""
    if plan.doors:
        return list(plan.doors)
    import shapely

    from slamgym.cad.plan_statistics import SIMPLIFY, find_openings

    simple = plan.free_space.simplify(SIMPLIFY)
    return find_openings(simple) if isinstance(simple, shapely.Polygon) and not simple.is_empty else []


def has_leaf(door: "Door") -> bool:
    """Whether an opening is as wide as one that a single leaf closes."""
    return _DOOR_WIDTH[0] <= door.width <= _DOOR_WIDTH[1]


def leaf_boxes(door: "Door", closed_share: float, rng: np.random.Generator, places: int) -> list[FloatArray]:
    """Where a door's leaf may stand, each with the same hinge: the places to try, the first the likeliest.

    Args:
        door: The opening.
        closed_share: Probability of each to be closed.
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
        angle = 0.0 if closed < closed_share else side * math.radians(low + share * (high - low))
        cos, sin = math.cos(angle), math.sin(angle)
        ux, uy = along[0] * cos - along[1] * sin, along[0] * sin + along[1] * cos
        x, y = start + _LEAF_GAP * along + 0.5 * length * np.array([ux, uy])
        boxes.append(np.array([x, y, ux, uy, 0.5 * length, 0.5 * _LEAF]))
    return boxes


def is_closed(door: "Door", leaf: FloatArray) -> bool:
    """Whether a leaf lies in its opening."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    return bool(abs(dx * leaf[3] - dy * leaf[2]) < 1e-9 * door.width)


def draw_windows(
    rooms: list[RoomArea], passages: Passages, share: float, rng: np.random.Generator
) -> FloatArray:
    """Windows down to the floor and glass doors in the outer walls of some rooms.

    Args:
        rooms: The rooms.
        passages: The building.
        share: Probability that a room with an outer wall has one.
        rng: Draws which rooms, walls and places.

    Returns:
        Parts of the plan's walls, shape (N, 4) as x0, y0, x1, y1 [m], each with the room on its left.
    """
    found = []
    for room in rooms:
        has_one, which, width, at = rng.random(4).tolist()
        if has_one >= share:
            continue
        length = np.hypot(room.walls[:, 2] - room.walls[:, 0], room.walls[:, 3] - room.walls[:, 1])
        walls = [
            wall
            for wall, long in zip(room.walls, length, strict=True)
            if long > _GLASS_WIDTH[0] + 2.0 * _GLASS_NIB and _is_outer(wall, long, passages)
        ]
        if not walls:
            continue
        x0, y0, x1, y1 = walls[int(which * len(walls))].tolist()
        long = math.hypot(x1 - x0, y1 - y0)
        room_for_it = long - 2.0 * _GLASS_NIB
        wide = min(room_for_it, _GLASS_WIDTH[0] + width * (_GLASS_WIDTH[1] - _GLASS_WIDTH[0]))
        first = _GLASS_NIB + at * (room_for_it - wide)
        ux, uy = (x1 - x0) / long, (y1 - y0) / long
        last = first + wide
        found.append((x0 + first * ux, y0 + first * uy, x0 + last * ux, y0 + last * uy))
    return np.array(found).reshape(-1, 4)


def _is_outer(wall: FloatArray, length: float, passages: Passages) -> bool:
    """Whether there is no floor behind a wall."""
    x, y = 0.5 * (wall[:2] + wall[2:])
    nx, ny = -(wall[3] - wall[1]) / length, (wall[2] - wall[0]) / length
    places = [passages.cell(x - back * nx, y - back * ny) for back in _BEHIND]
    return all(passages.clearance[place] <= 0.0 for place in places)
