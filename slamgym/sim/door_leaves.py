"""Doors' leaves."""

import math
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.types import FloatArray

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

# Doors that stand ajar [deg]: a gap of 5 to 20 cm, too narrow for a robot.
_AJAR = (3.0, 14.0)
_MOST_AJAR = math.sin(math.radians(_AJAR[1] + 1.0))


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
    """Whether a leaf lies in its opening, or ajar."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    return bool(abs(dx * leaf[3] - dy * leaf[2]) < _MOST_AJAR * door.width)
