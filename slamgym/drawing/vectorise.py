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
from slamgym.core.limits import RUNS
from slamgym.core.text import printable
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, FloatArray, GridFrame, OccupancyGrid
from slamgym.drawing.boundaries import BoundaryModels
from slamgym.drawing.candidates import Candidates
from slamgym.drawing.carry_over import carried_over, room_ids
from slamgym.drawing.confidence import judged_walls
from slamgym.drawing.doubts import find_doubts
from slamgym.drawing.drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, Layer
from slamgym.drawing.edits import Corrections
from slamgym.drawing.evidence import (
    Evidence,
    left_out_floor,
    share_known,
    share_seen_open,
    undrawn_cells,
    unseen_floor,
)
from slamgym.drawing.floor import FloorModel, load_floor_model
from slamgym.drawing.glass import cut_at_glass, with_glass
from slamgym.drawing.openings import Division, Gap
from slamgym.drawing.questions import doubtful_boundaries
from slamgym.drawing.revise import revise
from slamgym.drawing.settings import (
    DEFAULT_MODEL,
    DRAWN_DOORS,
    MAJORITY,
    MARGIN,
    OUTER_THICKNESS,
    SMALLEST_ROOM,
)
from slamgym.drawing.walls import find_walls
from slamgym.metrics.wall_direction import find_wall_direction

BESIDE_DOORS = (0.0, 0.5, -0.5, 0.9, -0.9, 1.3, -1.3)
"""Distances of a room's dimension lines from its middle [m], in the order of trial. With the middle alone 221 of 864
lines on 57 real maps would be missing."""


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
        model: Pretrained or other weights, ``none`` for cleaning alone, or a function that finds the layers.
        angle_deg: Direction of the main walls against the x axis, counter-clockwise; None finds it.
        provenance: Anything to keep with the drawing, e.g. the source.
        corrections: A person's last word. One that can't be carried out is left out, which is a doubt of the drawing.

    Returns:
        The drawing, in the frame of the map.

    Raises:
        InputFileError: If the map holds no floor or no walls, or the corrections are of another building.
    """
    corrections = corrections or Corrections(())
    provenance = provenance or {}
    where = provenance.get("source", name)
    if not (grid.cells == FREE).any():
        raise InputFileError(where, "has no free cell; a map needs some that the robot saw free")
    if not (grid.cells == OCCUPIED).any():
        raise InputFileError(where, "has no occupied cell; a drawing needs walls")
    changes = int(np.count_nonzero(np.diff(grid.cells, axis=1)))
    RUNS.check(where, changes // 2)
    used = load_floor_model(model) if isinstance(model, str) else model
    grid = known_part(grid)
    no_floor = InputFileError(
        where, f"holds no floor of {SMALLEST_ROOM:g} m2 or more; check its resolution"
    )
    if grid.cells.size * grid.frame.resolution**2 < SMALLEST_ROOM:
        raise no_floor  # cleaning would take long over its many cells in a decimetre
    direction = find_wall_direction(grid.cells)
    angle = direction.angle_deg if angle_deg is None else (angle_deg + 45.0) % 90.0 - 45.0
    found = Candidates.of(grid, used, angle)
    likely = found.floor(found.log_odds(BoundaryModels.pretrained()))
    made = carried_over(corrections, grid)
    usable = made.on_map(grid)
    floor, division, names, faults = revise(likely.floor, likely.gaps, usable)
    if floor.is_empty:
        raise no_floor
    lost = undrawn_cells(likely.floor, found.seen, grid.frame)
    cell = grid.frame.resolution**2
    evidence = Evidence(grid)
    pieces = cut_at_glass(find_walls(floor), usable)
    walls, no_glass = with_glass(judged_walls(pieces, evidence), usable)
    rooms = _rooms(division.rooms, room_ids(division.rooms, made), grid, names)
    doors = _doors(division, rooms, walls, grid)
    drawing = Drawing(
        name=printable(name),
        grid=grid,
        floor=floor,
        angle_deg=float(angle),
        walls=tuple(walls),
        doors=doors,
        rooms=rooms,
        inferred_floor=tuple(unseen_floor(floor, grid)),
        left_out=tuple(left_out_floor(lost, grid.frame)),
        left_out_area=float(lost.sum()) * cell,
        seen_area=float(found.seen.sum()) * cell,
        dimensions=tuple(_dimensions(floor, rooms, doors, angle)),
        questions=doubtful_boundaries(division, likely.others, made.corrections),
        provenance=_provenance(model, made, provenance),
    )
    doubts = find_doubts(drawing, direction if angle_deg is None else None)
    return replace(drawing, doubts=(*faults, *no_glass, *doubts))


def _provenance(
    model: str | FloorModel, corrections: Corrections, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Model, corrections and version, and what the caller keeps with the drawing."""
    if not isinstance(model, str):
        model = getattr(model, "__name__", type(model).__name__)
    kept = {
        "model": model,
        "corrections": [entry.as_dict() for entry in corrections.corrections],
        "slamgym": slamgym.__version__,
    }
    for key, value in given.items():
        kept[key] = printable(value) if isinstance(value, str) else value
    return kept


def known_part(grid: OccupancyGrid) -> OccupancyGrid:
    """The part of a map that is known, with a margin, in the same coordinates: many maps are mostly empty."""
    known = grid.cells != UNKNOWN
    rows = np.flatnonzero(known.any(axis=1))
    cols = np.flatnonzero(known.any(axis=0))
    frame = grid.frame
    cell = frame.resolution
    margin = int(np.ceil(MARGIN / cell))
    top = max(int(rows[0]) - margin, 0)
    left = max(int(cols[0]) - margin, 0)
    bottom = rows[-1] + margin + 1
    right = cols[-1] + margin + 1
    cells = np.ascontiguousarray(grid.cells[top:bottom, left:right])
    rows_below = frame.height_px - top - len(cells)
    x = frame.origin_x + left * cell
    y = frame.origin_y + rows_below * cell
    return OccupancyGrid(cells, GridFrame(cell, x, y, *cells.shape))


def _rooms(
    polygons: Sequence[Polygon], ids: Sequence[str], grid: OccupancyGrid, names: Mapping[int, str]
) -> tuple[DrawnRoom, ...]:
    rooms = []
    for number, (polygon, name) in enumerate(zip(polygons, ids, strict=True)):
        seen = share_known(polygon, grid)
        layer: Layer = "SEEN" if seen >= MAJORITY else "INFERRED"
        rooms.append(DrawnRoom(name, polygon, seen, layer, names.get(number, name)))
    return tuple(rooms)


def _doors(
    division: Division, rooms: tuple[DrawnRoom, ...], walls: list[DrawnWall], grid: OccupancyGrid
) -> tuple[DrawnDoor, ...]:
    bodies = shapely.STRtree([wall.polygon for wall in walls])
    doors = []
    for gap, pair in zip(division.doors, division.joins, strict=True):
        beside = _walls_beside(gap, bodies)
        share_open = share_seen_open(np.array([gap.start, gap.end]), grid)
        layer: Layer = "SEEN" if share_open >= MAJORITY else "INFERRED"
        thicknesses = [walls[k].thickness for k in beside if walls[k].thickness_known]
        door = DrawnDoor(
            start=gap.start,
            end=gap.end,
            depth=max(thicknesses, default=OUTER_THICKNESS),
            rooms=tuple(rooms[k].id for k in sorted(pair)),
            walls=tuple(beside),
            confidence=1.0 / (1.0 + math.exp(-gap.log_odds)),
            layer=layer,
            kind=gap.kind or ("door" if gap.length <= DRAWN_DOORS[1] else "opening"),
        )
        doors.append(door)
    return tuple(doors)


def _walls_beside(gap: Gap, bodies: shapely.STRtree) -> list[int]:
    """Numbers of the walls at the ends of a gap."""
    found = set[int]()
    for point in (gap.start, gap.end):
        end = shapely.Point(point).buffer(0.05)
        found.update(bodies.query(end, predicate="intersects").tolist())
    return sorted(found)


def _dimensions(
    floor: MultiPolygon,
    rooms: tuple[DrawnRoom, ...],
    doors: tuple[DrawnDoor, ...],
    angle_deg: float,
) -> list[Dimension]:
    """Clear width and depth of each room through its middle, and both lengths of the building."""
    axes = unit_vectors(np.radians([angle_deg, angle_deg + 90.0]))
    shut = shapely.union_all([door.line.buffer(0.02) for door in doors])
    shapely.prepare(shut)
    found = list[tuple[LineString, str]]()
    for room in rooms:
        radius = shapely.maximum_inscribed_circle(room.polygon, tolerance=0.05)
        middle = shapely.get_coordinates(radius)[0]
        for axis in axes:
            line = _clear_line(room.polygon, middle, axis, shut)
            if line is not None:
                found.append((line, room.id))
    spans = [shapely.get_coordinates(floor) @ axis for axis in axes]
    for k, axis in enumerate(axes):
        beside = 1 - k
        aside = (spans[beside].min() - 0.8) * axes[beside]
        first = spans[k].min() * axis + aside
        last = spans[k].max() * axis + aside
        found.append((LineString([first, last]), "building"))
    dimensions = []
    for line, of in found:
        (x0, y0), (x1, y1) = line.coords
        dimensions.append(Dimension((x0, y0), (x1, y1), of))
    return dimensions


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
