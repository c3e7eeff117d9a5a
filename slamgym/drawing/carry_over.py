"""Corrections and ids of rooms carry over, by place, to the drawing of another map of the same building.

A file of corrections holds the rooms that they were made on. Where these lie in the other map is found as for a
comparison with a plan (:mod:`slamgym.drawing.comparison.registration`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import Polygon

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.polygons import largest_part
from slamgym.core.errors import InputFileError
from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D
from slamgym.drawing.comparison.faces import map_evidence, plan_walls
from slamgym.drawing.edits import THICKEST_ADDED_WALL, Correction, Corrections, map_digest
from slamgym.drawing.settings import MAJORITY, SAME_PLACE, USUAL_CELL


def carried_over(corrections: Corrections, grid: OccupancyGrid) -> Corrections:
    """Corrections in the frame of a map, be it the one that they were made on or another of that building.

    Raises:
        InputFileError: If they are of another building, it seems.
    """
    digest = map_digest(grid)
    if not corrections.corrections or corrections.map.get("sha256") == digest:
        return corrections
    if not corrections.rooms:
        said = "the corrections are of another map and hold no rooms: they are taken to be in this map's frame"
        return replace(corrections, faults=(*corrections.faults, said))
    from slamgym.drawing.comparison.registration import register

    floors = [room.shape.buffer(SAME_PLACE, join_style="mitre") for room in corrections.rooms]
    floor = shapely.union_all(floors).buffer(-SAME_PLACE, join_style="mitre")
    plan = FloorPlan("former", largest_part(floor))
    found = register(plan, plan_walls(plan), map_evidence(grid))
    if not found.is_same_building:
        raise InputFileError(
            corrections.where,
            f"is of another building, it seems: {found.explained:.0%} of the walls around its rooms are in this map",
        )
    doubts = [f"the corrections were moved to another map: {doubt}" for doubt in found.doubts]
    return _moved(corrections, inverse(found.plan_from_map), tuple(doubts))


def _moved(corrections: Corrections, by: Pose2D, doubts: tuple[str, ...]) -> Corrections:
    """Corrections and their rooms in another frame."""

    def moved(points: ArrayLike) -> FloatArray:
        return transform_points(by, np.asarray(points, np.float64)).round(4)

    entries = []
    for entry in corrections.corrections:
        line = tuple(map(tuple, moved(entry.line).tolist())) if entry.line else ()
        at = tuple(moved(entry.at).tolist()) if entry.at else ()
        entries.append(replace(entry, line=line, at=at, thickness=_thickness(entry)))
    rooms = []
    for room in corrections.rooms:
        rings = [tuple(map(tuple, moved(ring).tolist())) for ring in room.polygon]
        rooms.append(replace(room, polygon=tuple(rings)))
    return replace(
        corrections,
        corrections=tuple(entries),
        rooms=tuple(rooms),
        faults=(*corrections.faults, *doubts),
    )


def _thickness(entry: Correction) -> float:
    """Of the wall of a correction, on another map [m]."""
    # Another map draws a wall a cell beside its place.
    stray = 2.0 * USUAL_CELL if entry.kind == "remove_wall" else 0.0
    return min(entry.thickness + stray, THICKEST_ADDED_WALL)


def room_ids(rooms: Sequence[Polygon], corrections: Corrections) -> list[str]:
    """The ids of rooms: those that the former rooms had there, new ones for others."""
    former = {room.id: room.shape for room in corrections.rooms}
    shared = [
        (float(room.intersection(shape).area), number, own)
        for own, shape in former.items()
        for number, room in enumerate(rooms)
        if room.intersects(shape)
    ]
    ids: dict[int, str] = {}
    for area, number, own in sorted(shared, reverse=True):
        is_same = area >= MAJORITY * min(rooms[number].area, former[own].area)
        if is_same and number not in ids and own not in ids.values():
            ids[number] = own
    fresh = (f"R{number:02d}" for number in range(1, len(rooms) + len(former) + 1))
    unused = (own for own in fresh if own not in former)
    return [ids.get(number) or next(unused) for number in range(len(rooms))]
