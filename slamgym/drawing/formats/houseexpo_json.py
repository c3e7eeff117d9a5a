"""HouseExpo's JSON with the drawing beside it: readable as a plan again, so that a drawing can be explored.

``verts``, ``holes``, ``doors``, ``room_category`` and ``room_polygons`` are those of
:mod:`slamgym.cad.houseexpo` (y down, the largest part of the floor); ``drawing`` holds everything else in the MAP's
frame (metres, y up).
"""

import json
from typing import Any

import shapely
from shapely import Polygon

from slamgym.cad.houseexpo import MAX_ID, format_houseexpo
from slamgym.cad.polygons import largest_part
from slamgym.drawing.drawing import Drawing


def format_json(drawing: Drawing) -> str:
    """The text of the file."""
    plan = drawing.as_plan()
    data = json.loads(format_houseexpo(plan))
    data["id"] = plan.id[:MAX_ID]
    data["drawing"] = {
        "frame": "metres in the frame of the map, x right, y up",
        "bounds": rounded(drawing.bounds),
        "angle_deg": round(drawing.angle_deg, 3),
        "area_m2": round(drawing.area, 3),
        "walls": [
            {
                "start": rounded(wall.start),
                "end": rounded(wall.end),
                "length_m": round(wall.length, 4),
                "thickness_m": round(wall.thickness, 4),
                "thickness_known": wall.thickness_known,
                "confidence": round(wall.confidence, 3),
                "share_seen": round(wall.share_seen, 3),
                "layer": wall.layer,
                "polygon": polygon_rings(wall.polygon),
            }
            for wall in drawing.walls
        ],
        "doors": [
            {
                "start": rounded(door.start),
                "end": rounded(door.end),
                "kind": door.kind,
                "width_m": round(door.width, 4),
                "depth_m": round(door.depth, 4),
                "rooms": list(door.rooms),
                "walls": list(door.walls),
                "confidence": round(door.confidence, 3),
                "layer": door.layer,
            }
            for door in drawing.doors
        ],
        "windows": [{"start": rounded(w.start), "end": rounded(w.end)} for w in drawing.windows],
        "rooms": [
            {
                "id": room.id,
                "area_m2": round(room.area, 3),
                "share_seen": round(room.share_seen, 3),
                "layer": room.layer,
                "polygon": polygon_rings(room.polygon),
            }
            for room in drawing.rooms
        ],
        "unexplored": [polygon_rings(part) for part in drawing.unexplored],
        "inferred_floor": [polygon_rings(part) for part in drawing.inferred_floor],
        "dimensions": [
            {"start": rounded(d.start), "end": rounded(d.end), "length_m": round(d.length, 4), "of": d.of}
            for d in drawing.dimensions
        ],
        "doubts": list(drawing.doubts),
        "provenance": drawing.provenance,
    }
    return json.dumps(data) + "\n"


def polygon_rings(polygon: Polygon) -> list[list[list[float]]]:
    """Outline and holes of a polygon, each closed, to a tenth of a millimetre."""
    largest = largest_part(polygon)
    return [
        [rounded(point) for point in shapely.get_coordinates(ring).tolist()]
        for ring in (largest.exterior, *largest.interiors)
    ]


def rounded(values: Any) -> list[float]:
    """Numbers to a tenth of a millimetre."""
    return [round(float(value), 4) for value in values]
