"""A drawing turned so that its main walls lie along the sheet: a robot's map often lies askew in its frame."""

import dataclasses
from typing import Any, TypeVar

import shapely
from shapely import affinity

from slamgym.drawing.drawing import Drawing, Segment

_Shape = TypeVar("_Shape", bound=shapely.Geometry)
_TURNED = ("walls", "doors", "rooms", "dimensions", "questions", "inferred_floor", "left_out")
"""Fields of a drawing that hold records or shapes."""


def turn_deg(drawing: Drawing) -> float:
    """By how much a drawing is turned counter-clockwise, about the origin of its map, to be upright."""
    return -drawing.angle_deg


def turn_facts(drawing: Drawing) -> dict[str, Any]:
    """The same as files of data say it."""
    return {"turn_deg": round(turn_deg(drawing), 3), "about": [0.0, 0.0]}


def turned_shape(shape: _Shape, angle_deg: float) -> _Shape:
    """A shape turned counter-clockwise about the origin of the map."""
    return affinity.rotate(shape, angle_deg, origin=(0.0, 0.0))


def upright(drawing: Drawing) -> Drawing:
    """The same drawing upright; its ``grid``, ``echoes`` and the places that its doubts name stay where they are."""
    angle = turn_deg(drawing)
    if not angle:
        return drawing
    changes: dict[str, Any] = {
        name: tuple(_turned(part, angle) for part in getattr(drawing, name)) for name in _TURNED
    }
    floor = turned_shape(drawing.floor, angle)
    return dataclasses.replace(drawing, angle_deg=0.0, floor=floor, **changes)


def said_turn(drawing: Drawing) -> str:
    """How a place on the upright sheet becomes one of the map, as a part of a sentence; empty if they are the same."""
    angle = turn_deg(drawing)
    return f", then turned by {-angle:.3f} degrees about the origin" if angle else ""


def _turned(record: Any, angle_deg: float) -> Any:
    """A wall, a door, a room, a line or a shape, turned."""
    if isinstance(record, shapely.Geometry):
        return turned_shape(record, angle_deg)
    changes: dict[str, Any] = {}
    if isinstance(record, Segment):
        changes["start"], changes["end"] = turned_shape(record.line, angle_deg).coords
    if hasattr(record, "polygon"):
        changes["polygon"] = turned_shape(record.polygon, angle_deg)
    return dataclasses.replace(record, **changes)
