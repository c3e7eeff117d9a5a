"""Drawings as HouseExpo's JSON and as GeoJSON.

HouseExpo's JSON is readable as a plan again, so that a drawing can be explored: ``verts``, ``holes``, ``doors``,
``room_category`` and ``room_polygons`` are those of :mod:`slamgym.cad.houseexpo` (y down, the largest part of the
floor); ``drawing`` holds everything else in the MAP's frame (metres, y up).

GeoJSON has one feature for each wall, door, opening, window and room. RFC 7946 wants degrees of longitude and latitude;
a building's map has none, so the coordinates are local metres, which the member ``coordinates`` of the collection says,
and its ``crs`` by :data:`LOCAL_METRES`: GDAL, by which QGIS reads, would take metres for degrees without it.

``upright`` says how to turn either, counter-clockwise about a point, so that the main walls lie along the axes.
"""

import json
from collections.abc import Iterator
from typing import Any

import shapely
from shapely import Polygon
from shapely.geometry import mapping
from shapely.geometry.base import BaseGeometry

from slamgym.cad.houseexpo import MAX_ID, format_houseexpo
from slamgym.cad.polygons import largest_part
from slamgym.drawing.drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, Question
from slamgym.drawing.edits import map_digest
from slamgym.drawing.formats.upright import turn_facts

LOCAL_METRES = (
    'ENGCRS["frame of the map",EDATUM["origin of the map"],CS[Cartesian,2],AXIS["(X)",east,ORDER[1]],'
    'AXIS["(Y)",north,ORDER[2]],LENGTHUNIT["metre",1]]'
)
"""A local engineering coordinate system as well-known text (ISO 19162)."""


def format_json(drawing: Drawing) -> str:
    """The text of the file."""
    plan = drawing.as_plan()
    data = json.loads(format_houseexpo(plan))
    data["id"] = plan.id[:MAX_ID]
    data["drawing"] = drawing_facts(drawing)
    return json.dumps(data) + "\n"


def drawing_facts(drawing: Drawing) -> dict[str, Any]:
    """Everything that is drawn, as JSON has it."""
    return {
        "map": {"name": drawing.name, "sha256": map_digest(drawing.grid)},
        "frame": "metres in the frame of the map, x right, y up",
        "bounds": _plain(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "upright": turn_facts(drawing),
        "area_m2": round(drawing.area, 3),
        "walls": [{**_wall(wall), "polygon": _rings(wall.polygon)} for wall in drawing.walls],
        "doors": [_door(door) for door in drawing.doors],
        "rooms": [{**_room(room), "polygon": _rings(room.polygon)} for room in drawing.rooms],
        "inferred_floor": [_rings(part) for part in drawing.inferred_floor],
        "dimensions": [_dimension(line) for line in drawing.dimensions],
        "doubts": list(drawing.doubts),
        "questions": [_question(question) for question in drawing.questions],
        "provenance": drawing.provenance,
    }


def format_geojson(drawing: Drawing) -> str:
    """The text of the file."""
    collection = {
        "type": "FeatureCollection",
        "name": drawing.name,
        "crs": {"type": "name", "properties": {"name": LOCAL_METRES}},
        "coordinates": "local metres in the frame of the map, x right, y up; not longitude and latitude",
        "bbox": _plain(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "upright": turn_facts(drawing),
        "doubts": list(drawing.doubts),
        "provenance": drawing.provenance,
        "features": list(_features(drawing)),
    }
    return json.dumps(collection) + "\n"


def _features(drawing: Drawing) -> Iterator[dict[str, Any]]:
    for room in drawing.rooms:
        yield _feature(room.polygon, {"kind": "room", **_room(room)})
    for wall in drawing.walls:
        yield _feature(wall.polygon, {"kind": "wall", **_wall(wall)})
    for door in drawing.doors:
        yield _feature(door.line, _door(door))
    for part in drawing.inferred_floor:
        yield _feature(part, {"kind": "unseen_floor", "layer": "INFERRED"})


def _feature(shape: BaseGeometry, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = mapping(shapely.transform(shape, lambda points: points.round(4)))
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _wall(wall: DrawnWall) -> dict[str, Any]:
    """What is known of a wall."""
    return {
        "start": _plain(wall.start),
        "end": _plain(wall.end),
        "thickness_known": wall.thickness_known,
        "length_m": _plain(wall.length),
        "thickness_m": _plain(wall.thickness),
        "confidence": _plain(wall.confidence),
        "share_seen": _plain(wall.share_seen),
        "layer": wall.layer,
        "glass": wall.is_glass,
    }


def _door(door: DrawnDoor) -> dict[str, Any]:
    """What is known of a door or an opening."""
    return {
        "start": _plain(door.start),
        "end": _plain(door.end),
        "depth_m": _plain(door.depth),
        "walls": _plain(door.walls),
        "kind": door.kind,
        "width_m": _plain(door.width),
        "rooms": _plain(door.rooms),
        "confidence": _plain(door.confidence),
        "layer": door.layer,
    }


def _question(question: Question) -> dict[str, Any]:
    """What is asked about a line, and the corrections that the answers are."""
    return {
        "line": [_plain(question.start), _plain(question.end)],
        "drawn": question.is_drawn,
        "yes": question.confirming,
        "no": "no_door",
    }


def _room(room: DrawnRoom) -> dict[str, Any]:
    """What is known of a room."""
    return {
        "id": room.id,
        "name": room.name,
        "area_m2": _plain(room.area),
        "share_seen": _plain(room.share_seen),
        "layer": room.layer,
    }


def _dimension(line: Dimension) -> dict[str, Any]:
    """What is known of a dimension line."""
    return {
        "start": _plain(line.start),
        "end": _plain(line.end),
        "length_m": _plain(line.length),
        "of": line.of,
    }


def _rings(polygon: Polygon) -> list[Any]:
    """Outline and holes of a polygon, each closed."""
    return [_plain(tuple(ring.coords)) for ring in shapely.get_rings(largest_part(polygon))]


def _plain(value: Any) -> Any:
    """Tuples as lists, and numbers to four places: a tenth of a millimetre."""
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return round(float(value), 4) if isinstance(value, float) else value
