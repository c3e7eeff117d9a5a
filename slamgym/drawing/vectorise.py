"""A map in, a drawing out."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

import slamgym
from slamgym.core.errors import InputFileError
from slamgym.core.geometry import unit_vectors
from slamgym.core.text import printable
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, FloatArray, GridFrame, OccupancyGrid
from slamgym.drawing.confidence import judged_walls
from slamgym.drawing.doubts import find_doubts
from slamgym.drawing.drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, Layer
from slamgym.drawing.edits import Corrections
from slamgym.drawing.evidence import Evidence, filled, share_known, share_seen_open, unseen_floor
from slamgym.drawing.floor import FloorModel, floor_of_rooms, load_floor_model, seen_floor
from slamgym.drawing.openings import Division, Gap, divide, likely_gaps, onto_faces
from slamgym.drawing.polygons import straightened
from slamgym.drawing.revise import revised_division, revised_floor, room_names
from slamgym.drawing.settings import (
    DEFAULT_MODEL,
    DRAWN_DOORS,
    OUTER_THICKNESS,
    SEEN_SHARE,
    SMALLEST_ROOM,
)
from slamgym.drawing.walls import find_walls
from slamgym.metrics.wall_direction import find_wall_direction

SMALLEST_DIMENSIONED = 1.5
"""Rooms below this get no dimension lines [m2]."""
BESIDE_DOORS = (0.0, 0.5, -0.5, 0.9, -0.9, 1.3, -1.3)
"""Distances of a room's dimension lines from its middle [m], in the order of trial."""
KNOWN_MARGIN = 1.0
"""Margin of unknown cells that is kept around the known part [m]."""


def make_drawing(
    grid: OccupancyGrid,
    name: str = "map",
    model: str | FloorModel = DEFAULT_MODEL,
    angle_deg: float | None = None,
    provenance: Mapping[str, Any] | None = None,
    corrections: Corrections | None = None,
) -> Drawing:
    """Draw a SLAM map: walls, doors and rooms with true dimensions.

    Args:
        grid: The map: 0 occupied, 205 unknown, 254 free.
        name: Name of the drawing.
        model: Pretrained or other weights, ``none`` for cleaning alone (no torch), or a function that finds the layers.
        angle_deg: Direction of the main walls against the x axis, counter-clockwise; None finds it.
        provenance: Anything to keep with the drawing, e.g. the source.
        corrections: A person's last word.

    Returns:
        The drawing, in the frame of the map.

    Raises:
        InputFileError: If the map holds no floor or no walls, or the corrections don't fit it.
    """
    corrections, provenance = corrections or Corrections(()), provenance or {}
    where = provenance.get("source", name)
    if not (grid.cells == FREE).any():
        raise InputFileError(where, "has no free cell; a map needs some that the robot saw free")
    if not (grid.cells == OCCUPIED).any():
        raise InputFileError(where, "has no occupied cell; a drawing needs walls")
    used = load_floor_model(model) if isinstance(model, str) else model
    grid = known_part(grid)
    corrections.require(grid)
    direction = find_wall_direction(grid.cells)
    angle = direction.angle_deg if angle_deg is None else (angle_deg + 45.0) % 90.0 - 45.0
    floor, gaps = _find_floor(grid, used, angle)
    floor = revised_floor(floor, corrections)
    if floor.is_empty:
        raise InputFileError(
            where, f"holds no floor of {SMALLEST_ROOM:g} m2 or more; check its resolution"
        )
    evidence = Evidence(grid)
    division = revised_division(floor, gaps, corrections)
    walls = judged_walls(find_walls(floor), evidence)
    rooms = _rooms(division.rooms, grid, room_names(division.rooms, corrections))
    doors = _doors(division, rooms, walls, grid)
    kept = {
        "model": model
        if isinstance(model, str)
        else getattr(model, "__name__", type(model).__name__),
        "corrections": [entry.as_dict() for entry in corrections.corrections],
        "slamgym": slamgym.__version__,
        **{
            key: printable(value) if isinstance(value, str) else value
            for key, value in provenance.items()
        },
    }
    drawing = Drawing(
        name=printable(name),
        grid=grid,
        floor=floor,
        angle_deg=float(angle),
        walls=tuple(walls),
        doors=doors,
        rooms=rooms,
        inferred_floor=tuple(unseen_floor(floor, grid)),
        dimensions=tuple(_dimensions(floor, rooms, doors, angle)),
        provenance=kept,
    )
    return replace(
        drawing, doubts=tuple(find_doubts(drawing, direction if angle_deg is None else None))
    )


def _find_floor(
    grid: OccupancyGrid, model: FloorModel, angle_deg: float
) -> tuple[MultiPolygon, list[Gap]]:
    """The floor with straight edges, and the boundaries of rooms that are likely, from face to face."""
    layers = model(grid, angle_deg)
    seen, space = seen_floor(grid, angle_deg)
    if space.is_empty:
        return space, []
    gaps = likely_gaps(space, seen, layers, grid.frame)
    division = divide(space, gaps)
    rooms = np.zeros(seen.shape, np.int64)
    for number, room in enumerate(division.rooms, 1):
        rooms[filled(room, grid.frame)] = number
    picture = floor_of_rooms(
        layers.free, seen, grid.cells == OCCUPIED, rooms, grid.frame.resolution
    )
    floor = straightened(picture, grid.frame, angle_deg)
    return floor, [] if floor.is_empty else [onto_faces(gap, floor) for gap in division.doors]


def known_part(grid: OccupancyGrid) -> OccupancyGrid:
    """The part of a map that is known, with a margin, in the same coordinates: many maps are mostly empty."""
    known = grid.cells != UNKNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    frame, cell = grid.frame, grid.frame.resolution
    margin = int(np.ceil(KNOWN_MARGIN / cell))
    top, left = max(int(rows[0]) - margin, 0), max(int(cols[0]) - margin, 0)
    cells = grid.cells[top : rows[-1] + margin + 1, left : cols[-1] + margin + 1]
    x, y = (
        frame.origin_x + left * cell,
        frame.origin_y + (frame.height_px - top - len(cells)) * cell,
    )
    return OccupancyGrid(np.ascontiguousarray(cells), GridFrame(cell, x, y, *cells.shape))


def _rooms(
    polygons: Sequence[Polygon], grid: OccupancyGrid, names: Mapping[int, str]
) -> tuple[DrawnRoom, ...]:
    rooms = []
    for number, polygon in enumerate(polygons):
        name, seen = f"R{number + 1:02d}", share_known(polygon, grid)
        layer: Layer = "SEEN" if seen >= SEEN_SHARE else "INFERRED"
        rooms.append(DrawnRoom(name, polygon, seen, layer, names.get(number, name)))
    return tuple(rooms)


def _doors(
    division: Division, rooms: tuple[DrawnRoom, ...], walls: list[DrawnWall], grid: OccupancyGrid
) -> tuple[DrawnDoor, ...]:
    bodies = shapely.STRtree([wall.polygon for wall in walls])
    doors = []
    for gap, pair in zip(division.doors, division.joins, strict=True):
        ends = [shapely.Point(point).buffer(0.05) for point in (gap.start, gap.end)]
        beside = sorted({int(k) for end in ends for k in bodies.query(end, predicate="intersects")})
        is_seen = share_seen_open(np.array([gap.start, gap.end]), grid) >= SEEN_SHARE
        sure = 1.0 / (1.0 + math.exp(-gap.log_odds))
        layer: Layer = "SEEN" if is_seen else "INFERRED"
        names = tuple(rooms[k].id for k in sorted(pair))
        kind = gap.kind or ("door" if gap.length <= DRAWN_DOORS[1] else "opening")
        depth = max(
            [walls[k].thickness for k in beside if walls[k].thickness_known],
            default=OUTER_THICKNESS,
        )
        doors.append(DrawnDoor(gap.start, gap.end, depth, names, tuple(beside), sure, layer, kind))
    return tuple(doors)


def _dimensions(
    floor: MultiPolygon,
    rooms: tuple[DrawnRoom, ...],
    doors: tuple[DrawnDoor, ...],
    angle_deg: float,
) -> list[Dimension]:
    """Clear width and depth of each room through its middle, and both lengths of the building."""
    axes = unit_vectors(np.radians([angle_deg, angle_deg + 90.0]))
    shut = shapely.union_all([door.line.buffer(0.02) for door in doors])
    found = list[tuple[LineString, str]]()
    for room in rooms:
        if room.area < SMALLEST_DIMENSIONED:
            continue
        circle = shapely.get_coordinates(
            shapely.maximum_inscribed_circle(room.polygon, tolerance=0.05)
        )
        for axis in axes:
            line = _clear_line(room.polygon, circle[0], axis, shut)
            if line is not None:
                found.append((line, room.id))
    spans = [shapely.get_coordinates(floor) @ axis for axis in axes]
    for k, axis in enumerate(axes):
        aside = (spans[1 - k].min() - 0.8) * axes[1 - k]
        ends = [place * axis + aside for place in (spans[k].min(), spans[k].max())]
        found.append((LineString(ends), "building"))
    return [
        Dimension((x0, y0), (x1, y1), of)
        for line, of in found
        for (x0, y0), (x1, y1) in [line.coords]
    ]


def _clear_line(
    room: Polygon, middle: FloatArray, axis: FloatArray, shut: BaseGeometry
) -> LineString | None:
    """A line from wall to wall near a point that avoids doors: their lines lie in the middle of walls."""
    across = np.array([-axis[1], axis[0]])
    for aside in BESIDE_DOORS:
        place = middle + aside * across
        far = LineString([place - 500.0 * axis, place + 500.0 * axis])
        for piece in shapely.get_parts(far.intersection(room)):
            is_here = piece.length > 0.3 and piece.distance(shapely.Point(place)) < 1e-6
            if is_here and not shut.intersects(piece.boundary):
                return LineString(piece)
    return None
