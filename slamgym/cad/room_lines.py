"""Schools and offices given as rooms with portals: one JSON object a line, also compressed (``.jsonl.xz``).

Each line is a floor of the Polimi data set of annotated plans (Luperto and Amigoni, Predicting the global
structure of indoor environments, Autonomous Robots 2019): ``name``, ``m_per_px``, and ``rooms``, each with a
``label``, a ``polygon`` in pixels (y down) and ``segments`` ``[x0, y0, x1, y1, "WALL" or "PORTAL", ...]``.
Rooms meet without walls between them and a portal is a point, so walls get a thickness and portals a width
here.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import Door, FloorPlan, Room
from slamgym.cad.houseexpo import MAX_ID, MAX_PLAN_COORDINATE
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.cad.polygons import connected_part, largest_part, make_valid, refuse_crowded
from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError, PlanError
from slamgym.core.limits import ENTRIES, MAX_SHOWN, PLAN_PARTS, VERTICES, shown
from slamgym.core.streams import DAMAGED, open_expanded
from slamgym.core.types import FloatArray

WALL_THICKNESS = 0.15
"""Between two rooms [m]."""
DOOR_WIDTH = 1.0
"""Width of a portal [m]."""
_DOOR_DEPTH = 0.35
"""A door cuts this far to either side [m]: annotated rooms are drawn up to 0.3 m apart."""
MIN_SCALE = 1e-4
"""Smaller pixels are taken for a fault [m]."""
MAX_SCALE = 10.0
"""Larger pixels are taken for a fault [m]."""
MIN_CONNECTED_SHARE = 0.8
"""The largest connected part must make up this share of the floor; closets without a portal are dropped."""


_MALFORMED = (
    TypeError,
    ValueError,
    LookupError,
    AttributeError,
    OverflowError,
    shapely.GEOSException,
)
"""Errors that rooms raise whose values are of other kinds than they should be."""


def build_floor(floor: Mapping[str, Any], plan_id: str, source: str) -> FloorPlan:
    """Build the plan of a line of a file.

    Raises:
        PlanError: If its rooms are malformed, or too little of the floor is connected.
    """
    try:
        with np.errstate(invalid="ignore"):  # of rooms without any width; the area tells
            return _build(floor, plan_id, source)
    except _MALFORMED as error:
        raise PlanError(source, f"its rooms are malformed ({str(error)[:MAX_SHOWN]})") from None


def open_room_lines(path: Path, options: PlanOptions) -> PlanIndex:
    """The floors of a file."""
    del options  # nothing about the format is open
    return PlanIndex(read_lines(path), build_floor)


def read_lines(path: Path) -> dict[str, tuple[Any, str, str]]:
    """The arguments of :func:`build_floor` for all floors of a file, by their names.

    Raises:
        InputFileError: If it is no such file, or holds two floors of one name.
    """
    floors: dict[str, tuple[Any, str, str]] = {}
    try:
        with open_expanded(path) as file:
            lines = file.read().decode().split("\n")
    except (OSError, UnicodeDecodeError, *DAMAGED) as error:
        raise InputFileError(
            path, f"is not a file of floors, one JSON object a line ({error})"
        ) from None
    ENTRIES.check(path, len(lines))
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        floor = parse_json(line, f"{path}:{number}")
        name = floor.get("name", f"line_{number}") if isinstance(floor, dict) else None
        if not isinstance(name, str | int) or len(str(name)) > MAX_ID:
            raise InputFileError(
                f"{path}:{number}", "is not a floor: a JSON object with a 'name' and 'rooms'"
            )
        plan_id = str(name).replace("/", "_")
        if plan_id in floors:
            raise InputFileError(
                f"{path}:{number}", f"holds a second floor called {shown(plan_id)}; rename it"
            )
        floors[plan_id] = floor, plan_id, f"{path}:{plan_id}"
    return floors


def _build(floor: Mapping[str, Any], plan_id: str, source: str) -> FloorPlan:
    scale = float(floor["m_per_px"])
    drawn = [room for room in floor["rooms"] if len(room["polygon"]) >= 3]
    _check_size(drawn, scale, source)
    rooms: list[Room] = []
    outlines = []
    doors: list[Door] = []
    for room in drawn:
        outline = make_valid(Polygon(_metres(room["polygon"], scale)), source)
        outlines.append(outline)
        interior = _interior(outline)
        if interior is not None:
            label = str(room["label"]).title().replace(" ", "_")
            rooms.append(Room(label, interior))
        doors += _doors(room, scale)
    # Gaps between rooms belong to the building; its outer walls stay closed.
    closed = shapely.union_all(outlines).buffer(_DOOR_DEPTH, join_style="mitre")
    building = closed.buffer(-_DOOR_DEPTH - 0.5 * WALL_THICKNESS, join_style="mitre")
    passages = [_passage(door).intersection(building) for door in doors]
    space = shapely.union_all([*(room.polygon for room in rooms), *passages])
    largest = connected_part(space, MIN_CONNECTED_SHARE, source)
    return FloorPlan(
        id=plan_id,
        free_space=largest,
        rooms=tuple(room for room in rooms if _is_part(room, largest)),
        doors=tuple(door for door in doors if largest.covers(_line(door))),
        source=source,
    )


def _is_part(room: Room, floor: Polygon) -> bool:
    """True if more than half of a room is floor."""
    return bool(room.polygon.intersection(floor).area > 0.5 * room.area)


def _line(door: Door) -> shapely.LineString:
    return shapely.LineString([door.start, door.end])


def _metres(points: Any, scale: float) -> FloatArray:
    """Pixels, y down, to metres, y up."""
    metres = np.array(points, dtype=np.float64)[:, :2] * [scale, -scale]
    if not np.isfinite(metres).all():
        raise ValueError("a coordinate is NaN or infinite")
    if np.abs(metres).max(initial=0.0) > MAX_PLAN_COORDINATE:
        raise ValueError(f"a coordinate is beyond {MAX_PLAN_COORDINATE:.0f} m")
    return np.asarray(metres)


def _check_size(rooms: Sequence[Mapping[str, Any]], scale: float, source: str) -> None:
    """Refuse a floor that would take too long to build."""
    if not MIN_SCALE <= scale < MAX_SCALE:
        raise ValueError(f"m_per_px is {scale}")
    PLAN_PARTS.check(source, len(rooms), PlanError)
    corners = sum(len(room["polygon"]) + len(room["segments"]) for room in rooms)
    VERTICES.check(source, corners, PlanError)
    for room in rooms:
        # Distances of all portals to all walls are computed at once.
        portals = sum(segment[4] == "PORTAL" for segment in room["segments"])
        PLAN_PARTS.check(source, portals, PlanError)
    rings = [_metres(room["polygon"], scale) for room in rooms]
    walls = [np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in rings]
    if walls:
        refuse_crowded(np.vstack(walls), 2.0 * _DOOR_DEPTH, source)


def _interior(outline: BaseGeometry) -> Polygon | None:
    """A room without its walls, None if nothing is left."""
    interior = largest_part(outline.buffer(-0.5 * WALL_THICKNESS, join_style="mitre"))
    return None if interior.is_empty else interior


def _doors(room: Mapping[str, Any], scale: float) -> list[Door]:
    """A door at every portal, along the wall that the portal is on."""
    ends = np.array([segment[:4] for segment in room["segments"]], dtype=np.float64)
    walls = ends.reshape(-1, 2, 2) * [scale, -scale]
    along = walls[:, 1] - walls[:, 0]
    length = np.hypot(*along.T)
    doors = []
    for index, segment in enumerate(room["segments"]):
        if segment[4] != "PORTAL":
            continue
        place = walls[index].mean(axis=0)
        # Of the wall pieces that end here, the longer one has room for a door.
        apart = np.hypot(*(walls - place).transpose(2, 0, 1)).min(axis=1)
        near = apart < 1.5 * scale
        best = int(np.argmax(np.where(near, length, 0.0)))
        if length[best] < 0.5:
            continue
        direction = along[best] / length[best]
        far_end = walls[best, np.argmax(np.hypot(*(walls[best] - place).T))]
        inwards = math.copysign(1.0, float(np.dot(far_end - place, direction)))
        centre = place + direction * inwards * min(0.6 * DOOR_WIDTH, 0.5 * length[best])
        half = 0.5 * DOOR_WIDTH * direction
        x0, y0 = (centre - half).tolist()
        x1, y1 = (centre + half).tolist()
        doors.append(Door((x0, y0), (x1, y1)))
    return doors


def _passage(door: Door) -> BaseGeometry:
    return _line(door).buffer(_DOOR_DEPTH, cap_style="flat")
