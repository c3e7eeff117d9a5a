"""Schools and offices given as rooms with portals: one JSON object a line, also compressed (``.jsonl.xz``).

Each line is a floor of the Polimi data set of annotated plans (Luperto and Amigoni, Predicting the global
structure of indoor environments, Autonomous Robots 2019): ``name``, ``m_per_px``, and ``rooms``, each with a
``label``, a ``polygon`` in pixels (y down) and ``segments`` ``[x0, y0, x1, y1, "WALL" or "PORTAL", ...]``.
Rooms meet without walls between them and a portal is a point, so walls get a thickness and portals a width
here.
"""

import json
import lzma
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import Door, FloorPlan, Room
from slamgym.core.errors import InputFileError, PlanError
from slamgym.core.types import FloatArray

WALL_THICKNESS = 0.15
"""Between two rooms [m]."""
DOOR_WIDTH = 1.0
"""Of a portal [m]."""
_DOOR_DEPTH = 0.35
"""A door cuts this far to either side [m]: annotated rooms are drawn up to 0.3 m apart."""
MIN_CONNECTED_SHARE = 0.8
"""The largest connected part must make up this share of the floor; closets without a portal are dropped."""


class RoomLinesSource:
    """All floors of one file, read when the source is opened and built when they are asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._floors = _read_lines(path)
        self.ids: Sequence[str] = list(self._floors)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Build one plan."""
        source = f"{self._path}:{plan_id}"
        try:
            return _build(self._floors[plan_id], plan_id, source)
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            raise PlanError(source, f"its rooms are malformed ({error})") from None


def _read_lines(path: Path) -> dict[str, Mapping[str, Any]]:
    floors: dict[str, Mapping[str, Any]] = {}
    try:
        content = path.read_bytes()
        text = (lzma.decompress(content) if path.suffix == ".xz" else content).decode()
        for number, line in enumerate(text.splitlines(), start=1):
            if line.strip():
                floor = json.loads(line)
                floors[str(floor.get("name", f"line_{number}")).replace("/", "_")] = floor
    except (OSError, EOFError, lzma.LZMAError, ValueError, AttributeError) as error:
        raise InputFileError(path, f"is not a file of floors, one JSON object a line ({error})") from None
    return floors


def _build(floor: Mapping[str, Any], plan_id: str, source: str) -> FloorPlan:
    scale = float(floor["m_per_px"])
    drawn = [room for room in floor["rooms"] if len(room["polygon"]) >= 3]
    rooms = [
        Room(str(room["label"]).title().replace(" ", "_"), polygon)
        for room in drawn
        if (polygon := _interior(_metres(room["polygon"], scale))) is not None
    ]
    building = shapely.union_all([_outline(_metres(room["polygon"], scale)) for room in drawn])
    # Gaps between rooms belong to the building; its outer walls stay closed.
    building = building.buffer(_DOOR_DEPTH, join_style="mitre").buffer(
        -_DOOR_DEPTH - 0.5 * WALL_THICKNESS, join_style="mitre"
    )
    doors = [door for room in drawn for door in _doors(room, scale)]
    passages = [_passage(door).intersection(building) for door in doors]
    space = shapely.union_all([*(room.polygon for room in rooms), *passages])
    parts = [part for part in shapely.get_parts(space) if isinstance(part, Polygon)]
    largest = max(parts, key=lambda part: float(part.area), default=Polygon())
    if largest.area < MIN_CONNECTED_SHARE * space.area or largest.is_empty:
        raise PlanError(source, f"the free space falls into {len(parts)} disjoint parts; connect them")
    return FloorPlan(
        id=plan_id,
        free_space=largest,
        rooms=tuple(room for room in rooms if room.polygon.intersection(largest).area > 0.5 * room.area),
        doors=tuple(door for door in doors if largest.covers(shapely.LineString([door.start, door.end]))),
        source=source,
    )


def _metres(points: Any, scale: float) -> FloatArray:
    """Pixels, y down, to metres, y up."""
    metres = np.array(points, dtype=np.float64)[:, :2] * [scale, -scale]
    if not np.isfinite(metres).all():
        raise ValueError("a coordinate is NaN or infinite")
    return np.asarray(metres)


def _outline(points: FloatArray) -> BaseGeometry:
    return shapely.make_valid(Polygon(points))


def _interior(points: FloatArray) -> Polygon | None:
    """A room without its walls, None if nothing is left."""
    parts = shapely.get_parts(_outline(points).buffer(-0.5 * WALL_THICKNESS, join_style="mitre"))
    polygons = [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
    return max(polygons, key=lambda part: float(part.area), default=None)


def _doors(room: Mapping[str, Any], scale: float) -> list[Door]:
    """A door at every portal, along the wall that the portal is on."""
    walls = np.array([segment[:4] for segment in room["segments"]], dtype=np.float64).reshape(-1, 2, 2)
    walls = walls * [scale, -scale]
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(*along.T)
    doors = []
    for index, segment in enumerate(room["segments"]):
        if segment[4] != "PORTAL":
            continue
        place = walls[index].mean(axis=0)
        # Of the wall pieces that end here, the longer one has room for a door.
        near = np.hypot(*(walls - place).transpose(2, 0, 1)).min(axis=1) < 1.5 * scale
        best = int(np.argmax(np.where(near, length, 0.0)))
        if length[best] < 0.5:
            continue
        direction = along[best] / length[best]
        far_end = walls[best, np.argmax(np.hypot(*(walls[best] - place).T))]
        inwards = math.copysign(1.0, float(np.dot(far_end - place, direction)))
        centre = place + direction * inwards * min(0.6 * DOOR_WIDTH, 0.5 * length[best])
        start, end = (centre + sign * 0.5 * DOOR_WIDTH * direction for sign in (-1, 1))
        doors.append(Door((float(start[0]), float(start[1])), (float(end[0]), float(end[1]))))
    return doors


def _passage(door: Door) -> Polygon:
    line = shapely.LineString([door.start, door.end])
    passage = line.buffer(_DOOR_DEPTH, cap_style="flat")
    assert isinstance(passage, Polygon)
    return passage
