"""Drawings as HouseExpo's JSON and as GeoJSON.

HouseExpo's JSON is readable as a plan again, so that a drawing can be explored: ``verts``, ``holes``, ``doors``,
``room_category`` and ``room_polygons`` are those of :mod:`slamgym.cad.houseexpo` (y down, the largest part of the
floor); ``drawing`` holds everything else in the MAP's frame (metres, y up).

GeoJSON has one feature for each wall, door, opening, window, room and unexplored part. RFC 7946 wants degrees of
longitude and latitude; a building's map has none, so the coordinates are local metres, which the member
``coordinates`` of the collection says.
"""

import json
from collections.abc import Iterator
from typing import Any

import shapely
from shapely import Polygon

from slamgym.cad.houseexpo import MAX_ID, format_houseexpo
from slamgym.cad.polygons import largest_part
from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnRoom, DrawnWall
from slamgym.drawing.edits import map_digest


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
        "bounds": _rounded(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "area_m2": round(drawing.area, 3),
        "walls": [{**_of_wall(wall), "polygon": _rings(wall.polygon)} for wall in drawing.walls],
        "doors": [_of_door(door) for door in drawing.doors],
        "windows": [],  # which a laser doesn't know
        "rooms": [{**_of_room(room), "polygon": _rings(room.polygon)} for room in drawing.rooms],
        "unexplored": [_rings(part) for part in drawing.unexplored],
        "inferred_floor": [_rings(part) for part in drawing.inferred_floor],
        "dimensions": [
            {"start": _rounded(d.start), "end": _rounded(d.end), "length_m": round(d.length, 4), "of": d.of}
            for d in drawing.dimensions
        ],
        "doubts": list(drawing.doubts),
        "provenance": drawing.provenance,
    }


def format_geojson(drawing: Drawing) -> str:
    """The text of the file."""
    collection = {
        "type": "FeatureCollection",
        "name": drawing.name,
        "coordinates": "local metres in the frame of the map, x right, y up; not longitude and latitude",
        "bbox": _rounded(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "doubts": list(drawing.doubts),
        "provenance": drawing.provenance,
        "features": list(_features(drawing)),
    }
    return json.dumps(collection) + "\n"


def _features(drawing: Drawing) -> Iterator[dict[str, Any]]:
    for room in drawing.rooms:
        yield _area(room.polygon, {"kind": "room", **_of_room(room)})
    for wall in drawing.walls:
        yield _area(wall.polygon, {"kind": "wall", **_of_wall(wall)})
    for door in drawing.doors:
        geometry = {"type": "LineString", "coordinates": [_rounded(door.start), _rounded(door.end)]}
        yield {"type": "Feature", "geometry": geometry, "properties": _of_door(door)}
    for part in drawing.unexplored:
        yield _area(part, {"kind": "unexplored", "layer": "INFERRED"})
    for part in drawing.inferred_floor:
        yield _area(part, {"kind": "unseen_floor", "layer": "INFERRED"})


def _area(polygon: Polygon, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": _rings(polygon)}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _of_wall(wall: DrawnWall) -> dict[str, Any]:
    return {
        "start": _rounded(wall.start),
        "end": _rounded(wall.end),
        "thickness_known": wall.thickness_known,
        "length_m": round(wall.length, 4),
        "thickness_m": round(wall.thickness, 4),
        "confidence": round(wall.confidence, 3),
        "share_seen": round(wall.share_seen, 3),
        "layer": wall.layer,
    }


def _of_door(door: DrawnDoor) -> dict[str, Any]:
    return {
        "start": _rounded(door.start),
        "end": _rounded(door.end),
        "depth_m": round(door.depth, 4),
        "walls": list(door.walls),
        "kind": door.kind,
        "width_m": round(door.width, 4),
        "rooms": list(door.rooms),
        "confidence": round(door.confidence, 3),
        "layer": door.layer,
    }


def _of_room(room: DrawnRoom) -> dict[str, Any]:
    return {
        "id": room.id,
        "name": room.name,
        "area_m2": round(room.area, 3),
        "share_seen": round(room.share_seen, 3),
        "layer": room.layer,
    }


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    """Outline and holes of a polygon, each closed, to a tenth of a millimetre."""
    largest = largest_part(polygon)
    return [
        [_rounded(point) for point in shapely.get_coordinates(ring).tolist()]
        for ring in (largest.exterior, *largest.interiors)
    ]


def _rounded(values: Any) -> list[float]:
    """Numbers to a tenth of a millimetre."""
    return [round(float(value), 4) for value in values]
