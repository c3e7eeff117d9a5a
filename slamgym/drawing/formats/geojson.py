"""GeoJSON: one feature for each wall, door, opening, window, room and unexplored part.

RFC 7946 wants degrees of longitude and latitude; a building's map has none, so the coordinates are local metres, which
the member ``coordinates`` of the collection says.
"""

import json
from collections.abc import Iterator
from typing import Any

from shapely import Polygon

from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.drawing.formats.houseexpo_json import polygon_rings, rounded


def format_geojson(drawing: Drawing) -> str:
    """The text of the file."""
    collection = {
        "type": "FeatureCollection",
        "name": drawing.name,
        "coordinates": "local metres in the frame of the map, x right, y up; not longitude and latitude",
        "bbox": rounded(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "doubts": list(drawing.doubts),
        "provenance": drawing.provenance,
        "features": list(_features(drawing)),
    }
    return json.dumps(collection) + "\n"


def _features(drawing: Drawing) -> Iterator[dict[str, Any]]:
    for room in drawing.rooms:
        yield _area(
            room.polygon,
            {
                "kind": "room",
                "id": room.id,
                "area_m2": round(room.area, 3),
                "share_seen": round(room.share_seen, 3),
            },
            room.layer,
        )
    for wall in drawing.walls:
        yield _area(
            wall.polygon,
            {
                "kind": "wall",
                "thickness_m": round(wall.thickness, 4),
                "length_m": round(wall.length, 4),
                "confidence": round(wall.confidence, 3),
                "share_seen": round(wall.share_seen, 3),
                "centre_line": [rounded(wall.start), rounded(wall.end)],
            },
            wall.layer,
        )
    for door in drawing.doors:
        yield _line(
            door.start,
            door.end,
            {
                "kind": door.kind,
                "width_m": round(door.width, 4),
                "thickness_m": round(door.depth, 4),
                "rooms": list(door.rooms),
                "confidence": round(door.confidence, 3),
                "layer": door.layer,
            },
        )
    for window in drawing.windows:
        yield _line(window.start, window.end, {"kind": "window", "layer": "SEEN"})
    for part in drawing.unexplored:
        yield _area(part, {"kind": "unexplored"}, "INFERRED")
    for part in drawing.inferred_floor:
        yield _area(part, {"kind": "unseen_floor"}, "INFERRED")


def _area(polygon: Polygon, properties: dict[str, Any], layer: str) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": polygon_rings(polygon)}
    return {"type": "Feature", "geometry": geometry, "properties": {**properties, "layer": layer}}


def _line(start: DrawnPoint, end: DrawnPoint, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": [rounded(start), rounded(end)]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
