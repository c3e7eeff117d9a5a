"""A drawing turned so that its main walls lie along the sheet: a robot's map often lies askew in its frame."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import shapely
from shapely import affinity

from slamgym.drawing.drawing import Drawing, Segment

_Shape = TypeVar("_Shape", bound=shapely.Geometry)
_TURNED = ("walls", "doors", "rooms", "dimensions", "questions")
"""Fields of a drawing that hold records."""


def turn_deg(drawing: Drawing) -> float:
    """By how much a drawing is turned counter-clockwise, about the origin of its map, to be upright."""
    return -drawing.angle_deg


def turn_facts(drawing: Drawing) -> dict[str, Any]:
    """The same as files of data say it."""
    return {"turn_deg": round(turn_deg(drawing), 3), "about": [0.0, 0.0]}


def turned_shape(shape: _Shape, angle_deg: float) -> _Shape:
    """A shape turned counter-clockwise about the origin of the map."""
    return affinity.rotate(shape, angle_deg, origin=(0.0, 0.0)) if angle_deg else shape


def upright(drawing: Drawing) -> Drawing:
    """The same drawing upright; its ``grid``, ``echoes`` and the places that its doubts name stay where they are."""
    angle = turn_deg(drawing)
    if not angle:
        return drawing
    changes: dict[str, Any] = {"floor": turned_shape(drawing.floor, angle)}
    for name in _TURNED:
        changes[name] = tuple(_turned_record(record, angle) for record in getattr(drawing, name))
    changes["inferred_floor"] = _all(drawing.inferred_floor, angle)
    changes["left_out"] = _all(drawing.left_out, angle)
    return dataclasses.replace(drawing, angle_deg=0.0, **changes)


def said_turn(drawing: Drawing) -> str:
    """How a place on the upright sheet becomes one of the map, as a part of a sentence; empty if they are the same."""
    angle = turn_deg(drawing)
    return f", then turned by {-angle:.3f} degrees about the origin" if angle else ""


def _all(shapes: Sequence[_Shape], angle_deg: float) -> tuple[_Shape, ...]:
    return tuple(turned_shape(shape, angle_deg) for shape in shapes)


def _turned_record(record: Any, angle_deg: float) -> Any:
    """A wall, a door, a room or a line, turned."""
    changes: dict[str, Any] = {}
    if isinstance(record, Segment):
        changes["start"], changes["end"] = turned_shape(record.line, angle_deg).coords
    if hasattr(record, "polygon"):
        changes["polygon"] = turned_shape(record.polygon, angle_deg)
    return dataclasses.replace(record, **changes)
