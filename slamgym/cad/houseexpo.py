"""The HouseExpo file format: one JSON object per plan, metres, y down.

Keys of the data set (Li et al., HouseExpo, IROS 2020): ``id``, ``room_num``, ``bbox`` (``min`` and ``max``
corner), ``verts`` (one closed outline without its last vertex repeated) and ``room_category`` (category to
boxes ``[min x, min y, max x, max y]``). Plans written here may carry three keys more, each left out where it
says nothing new, so that programs for HouseExpo read them too: ``holes`` (a list of rings: pillars, islands,
cores), ``doors`` (a list of ``[[x, y], [x, y]]`` from jamb to jamb) and ``room_polygons`` (category to rooms,
each a list of its outline and its holes, where a room is more than a box).

Convention: y is down in the file and up in a :class:`FloorPlan`; reader and writer mirror a plan about the
horizontal middle line of its outline, so its bounding box stays where it is.

Of the 23,647 training outlines 883 touch, retrace or cross themselves. 806 are repaired, where the result is
beyond doubt, and 77 are refused; see :func:`repair_outline`.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.floorplan import Door, FloorPlan, Room
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.cad.polygons import connected_part, make_valid, polygon_parts
from slamgym.core.documents import parse_json
from slamgym.core.errors import PlanError, as_plan_error
from slamgym.core.files import read_bytes, write_text
from slamgym.core.limits import DOCUMENT_BYTES, PLAN_PARTS, VERTICES, shown
from slamgym.core.provenance import check_origin
from slamgym.core.types import FloatArray

MAX_PLAN_COORDINATE = 10_000.0
"""Coordinates beyond this [m] are taken for another unit than metres."""
MAX_ID = 255
"""Characters of a plan's name: so many fit into the name of a file."""
MIN_AREA = 0.01
"""Less floor than this [m2] is none."""
MAX_REPAIRED_SHARE = 0.005
"""Repairing may change the area, and cut off crumbs, by at most this share of it."""

_DECIMALS = 6
"""A micrometre: below the files' resolution, above the noise of mirroring."""


@as_plan_error()
def read_houseexpo(path: Path | str) -> FloorPlan:
    """Read one plan; its id is the name of the file.

    Raises:
        PlanError: If the file can't be read or isn't a plan; the sentence names the file.
    """
    path = Path(path)
    check_origin(path)
    return parse_houseexpo(read_bytes(path, DOCUMENT_BYTES), str(path), path.stem)


def open_houseexpo(path: Path, options: PlanOptions) -> PlanIndex:
    """The plan of a file of HouseExpo."""
    del options  # nothing about the format is open
    return PlanIndex({path.stem: (path,)}, read_houseexpo)


def parse_houseexpo(text: str | bytes, source: str, plan_id: str | None = None) -> FloorPlan:
    """Read a plan from the content of its file.

    Args:
        text: The JSON text.
        source: Where it came from; errors name it.
        plan_id: Name of the plan; by default the file's own ``id``.

    Raises:
        PlanError: If it isn't JSON, lacks vertices, has coordinates that aren't numbers, encloses no area or
            crosses itself.
    """
    data = _parse_json(text, source)
    outline = _points(data["verts"], source, "'verts'", at_least=3)
    rings = _list(data, "holes", source)
    holes = [_points(ring, source, "'holes'", at_least=3) for ring in rings]
    VERTICES.check(source, len(outline) + sum(map(len, holes)), PlanError)
    # Before mirroring, so that errors give places as they stand in the file.
    space = repair_outline(outline, holes, source)
    mirror = float(outline[:, 1].min() + outline[:, 1].max())
    return FloorPlan(
        id=_id(data, source) if plan_id is None else plan_id,
        free_space=_mirrored(space, mirror),
        rooms=_rooms(data, source, mirror),
        doors=_doors(data, source, mirror),
        source=source,
    )


def write_houseexpo(path: Path | str, plan: FloorPlan) -> None:
    """Write a plan so that :func:`read_houseexpo` gives it back, whole or not at all.

    Raises:
        InputFileError: If the file can't be written.
    """
    write_text(path, format_houseexpo(plan))


def format_houseexpo(plan: FloorPlan) -> str:
    """The text of a plan's file."""
    min_x, min_y, max_x, max_y = plan.bounds
    mirror = min_y + max_y
    data: dict[str, Any] = {
        "verts": _ring(plan.free_space.exterior, mirror),
        "id": plan.id,
        "room_category": {},
        "room_num": len(plan.rooms),
        "bbox": {"min": _rounded([min_x, min_y]), "max": _rounded([max_x, max_y])},
    }
    for room in plan.rooms:
        x0, y0, x1, y1 = room.polygon.bounds
        box = _rounded([x0, mirror - y1, x1, mirror - y0])
        data["room_category"].setdefault(room.category, []).append(box)
    if not all(_is_box(room.polygon) for room in plan.rooms):
        data["room_polygons"] = {}
        for room in plan.rooms:
            rings = (room.polygon.exterior, *room.polygon.interiors)
            mirrored = [_ring(ring, mirror) for ring in rings]
            data["room_polygons"].setdefault(room.category, []).append(mirrored)
    if plan.free_space.interiors:
        data["holes"] = [_ring(hole, mirror) for hole in plan.free_space.interiors]
    if plan.doors:
        data["doors"] = []
        for door in plan.doors:
            ends = [_rounded([x, mirror - y]) for x, y in (door.start, door.end)]
            data["doors"].append(ends)
    return json.dumps(data) + "\n"


def _is_box(polygon: Polygon) -> bool:
    """True if an axis-parallel box says all of a room."""
    return polygon.equals(shapely.box(*polygon.bounds))


def repair_outline(outline: FloatArray, holes: list[FloatArray], source: str) -> Polygon:
    """Make a valid polygon of an outline, if there is only one way to read it.

    An outline that touches or retraces itself encloses one area however it is read. An outline that crosses
    itself, like a figure of eight or a loop that overlaps itself, encloses different areas by the even-odd
    rule and by the sum of its signed parts; it is refused. Crumbs and dangling spikes of up to 0.5 % of the
    area that repairing cuts off are dropped; larger separate parts make the free space disjoint, an error.

    Args:
        outline: Shape (N, 2) [m].
        holes: Rings within it, each (M, 2).
        source: Named in errors.

    Raises:
        PlanError: If the area is none, ambiguous or disjoint.
    """
    polygon = Polygon(outline, holes)
    if polygon.is_valid and polygon.area >= MIN_AREA:
        return polygon
    x, y = outline.T
    doubled = np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)
    signed_area = abs(float(doubled)) / 2.0
    repaired = make_valid(polygon, source)
    area = sum(part.area for part in polygon_parts(repaired))
    if area < MIN_AREA:
        raise PlanError(
            source, "the outline encloses no area; give at least a closed room in metres"
        )
    if holes or abs(area - signed_area) > MAX_REPAIRED_SHARE * area:
        reason = shapely.is_valid_reason(polygon)
        raise PlanError(source, f"the outline crosses itself ({reason}); make it a simple polygon")
    return connected_part(repaired, 1.0 - MAX_REPAIRED_SHARE, source)


def _parse_json(text: str | bytes, source: str) -> Mapping[str, Any]:
    data = parse_json(text, source, PlanError)
    if not isinstance(data, dict) or "verts" not in data:
        raise PlanError(
            source, "has no 'verts'; a HouseExpo plan is an object with id, verts, room_category"
        )
    return data


def _list(data: Mapping[str, Any], key: str, source: str) -> list[Any]:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise PlanError(source, f"'{key}' is not a list")
    PLAN_PARTS.check(source, len(value), PlanError)
    return value


def _id(data: Mapping[str, Any], source: str) -> str:
    """The plan's own name, by default where it came from."""
    plan_id = data.get("id", source)
    if not isinstance(plan_id, str | int) or len(str(plan_id)) > MAX_ID:
        raise PlanError(
            source, f"'id' is {shown(plan_id)}; it must be a name of up to {MAX_ID} characters"
        )
    return str(plan_id)


def _points(
    value: Any, source: str, what: str, at_least: int = 1, form: str = "[x, y]"
) -> FloatArray:
    """A list of groups of coordinates as an array, shape (N, 2), or as many as the form has."""
    size = form.count(",") + 1
    try:
        points = np.asarray(value if len(value) else np.empty((0, size)))
    except (TypeError, ValueError, OverflowError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != size or points.dtype.kind not in "iuf":
        raise PlanError(source, f"{what} is not a list of {form} of numbers")
    if len(points) < at_least:
        raise PlanError(
            source, f"{what} has {len(points)} vertices; an outline needs at least {at_least}"
        )
    if not np.isfinite(points).all():
        raise PlanError(
            source, f"{what} has a coordinate that is NaN or infinite; give numbers in metres"
        )
    if np.abs(points).max(initial=0.0) > MAX_PLAN_COORDINATE:
        raise PlanError(
            source, f"{what} has a coordinate beyond {MAX_PLAN_COORDINATE:.0f} m; give metres"
        )
    return points.astype(np.float64)


def _rooms(data: Mapping[str, Any], source: str, mirror: float) -> tuple[Room, ...]:
    """Rooms from polygons where there are any, else from boxes; those without area are left out."""
    key = "room_polygons" if "room_polygons" in data else "room_category"
    categories = data.get(key, {})
    if not isinstance(categories, dict):
        raise PlanError(source, f"'{key}' is not an object from category to rooms")
    rooms = []
    for category, entries in categories.items():
        for entry in _list(categories, category, source) if entries else []:
            read = _rings if key == "room_polygons" else _box
            polygon = read(entry, source)
            if polygon.is_valid and polygon.area > 0.0:
                rooms.append(Room(category, _mirrored(polygon, mirror)))
        PLAN_PARTS.check(source, len(rooms), PlanError)
    corners = shapely.get_coordinates([room.polygon for room in rooms])
    VERTICES.check(source, len(corners), PlanError)
    return tuple(rooms)


def _rings(entry: Any, source: str) -> Polygon:
    if not isinstance(entry, list) or not entry:
        raise PlanError(source, "'room_polygons' has a room that is not a list of rings")
    outline, *holes = (_points(ring, source, "'room_polygons'", at_least=3) for ring in entry)
    return Polygon(outline, holes)


def _box(entry: Any, source: str) -> Polygon:
    form = "[min x, min y, max x, max y]"
    corners = _points([entry], source, "'room_category'", form=form)
    ((x0, y0, x1, y1),) = corners.tolist()
    return shapely.box(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))


def _doors(data: Mapping[str, Any], source: str, mirror: float) -> tuple[Door, ...]:
    doors = []
    for entry in _list(data, "doors", source):
        ends = _points(entry, source, "'doors'", at_least=2)
        (x0, y0), (x1, y1) = _flipped(ends, mirror)[:2].tolist()
        doors.append(Door((x0, y0), (x1, y1)))
    return tuple(doors)


def _mirrored(polygon: Polygon, mirror: float) -> Polygon:
    """Turn y from down to up or back, about the line y = mirror / 2."""
    return shapely.transform(polygon, lambda points: _flipped(points, mirror))


def _flipped(points: FloatArray, mirror: float) -> FloatArray:
    """The same of points (N, 2)."""
    return np.round(points * [1.0, -1.0] + [0.0, mirror], _DECIMALS)


def _ring(ring: Any, mirror: float) -> list[list[float]]:
    points = shapely.get_coordinates(ring)[:-1]
    return _flipped(points, mirror).tolist()


def _rounded(values: list[float]) -> list[float]:
    return [round(float(value), _DECIMALS) for value in values]
