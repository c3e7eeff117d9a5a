"""Walls, doors, windows and rooms from IFC building models (ifcopenshell; extra ``ifc``).

A model is cut where a robot's laser looks: 0.2 m above the storey's floor. What the cut meets of walls, columns and
curtain walls are bodies of walls; openings that reach down to it are doors, or windows where a window fills them.

Schema: ISO 16739-1 (IFC 4): IfcBuildingStorey, IfcWall, IfcRelVoidsElement, IfcRelFillsElement, IfcSpace.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.drawn_plan import (
    LINE_GRID,
    DrawnWalls,
    floor_of_walls,
    middle_line,
    outline_edges,
    stacked,
)
from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.cad.polygons import polygon_parts
from slamgym.core.errors import InputFileError, PlanError, needing_extra
from slamgym.core.files import require_file
from slamgym.core.limits import DRAWING_BYTES, ENTRIES, PLAN_PARTS, shown
from slamgym.core.parallel.budget import read_apart
from slamgym.core.types import FloatArray, IntArray

LASER_HEIGHT = 0.2
"""Where the model is cut above the storey's floor [m]."""
SOLIDS = ("IfcWall", "IfcColumn", "IfcCurtainWall", "IfcPlate", "IfcMember")
"""Elements of a building that a laser sees."""
MIN_LENGTH = 0.4
"""Openings narrower than this are no doors [m]."""

_DAMAGED = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    RuntimeError,
    ArithmeticError,
    OSError,
)


def storeys_of(path: Path | str) -> list[str]:
    """Names of the storeys that have walls, from the lowest up.

    Raises:
        PlanError: If the file is no IFC model.
    """
    return list(read_apart(_names, Path(path), Path(path), PlanError))


def _names(path: Path) -> list[str]:
    model = _open(path)  # kept to the end: ifcopenshell's elements are no longer there without it
    return [storey.name for storey in _storeys(model, path)]


def read_ifc(path: Path | str, storey: str | None = None) -> FloorPlan:
    """Read one storey of an IFC model.

    Args:
        path: The file.
        storey: Its name; None takes the lowest that has walls.

    Raises:
        PlanError: If it is no IFC model, has no such storey, or its walls enclose no floor.
    """
    return read_apart(_read, (Path(path), storey), Path(path), PlanError)


def open_ifc(path: Path, options: PlanOptions) -> PlanIndex:
    """The plans of an IFC model, one for each storey.

    Raises:
        PlanError: If it is no IFC model.
        InputFileError: If two storeys have one name.
    """
    del options  # nothing about the format is open
    storeys: dict[str, tuple[Path, str]] = {}
    names = storeys_of(path)
    for storey in names:
        plan_id = path.stem if len(names) == 1 else f"{path.stem}-{storey}"
        if plan_id in storeys:
            raise InputFileError(path, f"has two storeys called {shown(storey)}; rename one")
        storeys[plan_id] = (path, storey)
    return PlanIndex(storeys, read_ifc)


def _read(file: tuple[Path, str | None]) -> FloorPlan:
    path, wanted = file
    model = _open(path)  # kept to the end, as in _names
    storeys = _storeys(model, path)
    chosen = [storey for storey in storeys if wanted in (None, storey.name)]
    if not chosen:
        names = ", ".join(shown(storey.name) for storey in storeys[:8])
        raise PlanError(path, f"has no storey called {shown(wanted)}; it has {names}")
    storey = chosen[0]
    with _undamaged(path, "has geometry that can't be computed"):
        drawn = _cut(storey.elements, storey.elevation + LASER_HEIGHT, str(path))
    if len(storeys) == 1:
        return floor_of_walls(drawn, path.stem, str(path))
    source = f"{path}, storey {shown(storey.name)}"
    return floor_of_walls(drawn, f"{path.stem}-{storey.name}", source)


def _open(path: Path) -> Any:
    with needing_extra("reading IFC", "ifc"):
        import ifcopenshell
    require_file(path, DRAWING_BYTES)
    with path.open("rb") as file:
        if b"ISO-10303-21" not in file.read(1024):
            raise PlanError(path, "is no IFC model in STEP form (it must begin with ISO-10303-21)")
    with _undamaged(path, "is no readable IFC model", (ifcopenshell.Error, *_DAMAGED)):
        return ifcopenshell.open(str(path))


@contextlib.contextmanager
def _undamaged(path: Path, fault: str, errors: Any = _DAMAGED) -> Iterator[None]:
    """Say what is wrong with a file over which the library stumbles in the block."""
    try:
        yield
    except errors as error:
        raise PlanError(path, f"{fault} ({shown(str(error))}); export it again") from None


class _Storey(NamedTuple):
    """A storey of a model."""

    name: str
    elevation: float  # [m]
    elements: list[Any]


def _storeys(model: Any, path: Path) -> list[_Storey]:
    """The storeys with walls, from the lowest up."""
    from ifcopenshell.util.element import get_decomposition
    from ifcopenshell.util.placement import get_storey_elevation
    from ifcopenshell.util.unit import calculate_unit_scale

    with _undamaged(path, "has storeys that can't be read"):
        scale = float(calculate_unit_scale(model))
        found = []
        count = 0
        for number, storey in enumerate(model.by_type("IfcBuildingStorey"), start=1):
            elements = list(get_decomposition(storey))
            count += len(elements)
            ENTRIES.check(path, count, PlanError)
            if any(element.is_a("IfcWall") for element in elements):
                name = str(storey.Name or f"storey {number}")
                elevation = scale * float(get_storey_elevation(storey))
                found.append(_Storey(name, elevation, elements))
    if not found:
        raise PlanError(path, "has no storey with walls (IfcBuildingStorey with IfcWall)")
    return sorted(found, key=lambda storey: storey.elevation)


def _cut(elements: list[Any], height: float, source: str) -> DrawnWalls:
    """Cut elements by the plane at a height."""
    walls: list[FloatArray] = []
    doors: list[FloatArray] = []
    windows: list[FloatArray] = []
    rooms: list[Room] = []
    openings = sum(len(getattr(element, "HasOpenings", ()) or ()) for element in elements)
    PLAN_PARTS.check(source, len(elements) + openings, PlanError)
    for element in elements:
        if any(element.is_a(kind) for kind in SOLIDS):
            section = _section(element, height)
            walls += outline_edges(section)
            for opening, is_window in _openings(element):
                line = _across(_section(opening, height), section)
                if line is not None:
                    closures = windows if is_window else doors
                    closures.append(line[None])
        elif element.is_a("IfcSpace"):
            name = str(element.LongName or element.Name or "Room")[:100]
            rooms += [Room(name, part) for part in _section(element, height)]
    return DrawnWalls(stacked(walls), stacked(doors), stacked(windows), tuple(rooms))


def _openings(wall: Any) -> Iterator[tuple[Any, bool]]:
    """The openings of a wall, and whether a window fills them."""
    for relation in getattr(wall, "HasOpenings", ()) or ():
        opening = relation.RelatedOpeningElement
        fillings = getattr(opening, "HasFillings", ()) or ()
        elements = [filling.RelatedBuildingElement for filling in fillings]
        yield opening, any(element.is_a("IfcWindow") for element in elements)


def _across(openings: list[Polygon], wall: list[Polygon]) -> FloatArray | None:
    """The line from jamb to jamb through an opening, along the middle of the wall."""
    if not openings:
        return None
    opening = max(openings, key=lambda part: float(part.area))
    box = shapely.oriented_envelope(shapely.union_all(wall))
    if isinstance(box, Polygon) and not box.is_empty:
        body = middle_line(box)
        line = middle_line(opening, body[2:] - body[:2])
        if not box.intersects(shapely.LineString(line.reshape(2, 2))):  # it sticks out of the wall
            line = _moved_to(line, 0.5 * (body[:2] + body[2:]))
    else:
        line = middle_line(opening)
    return line if float(np.hypot(*(line[2:] - line[:2]))) >= MIN_LENGTH else None


def _moved_to(line: FloatArray, point: FloatArray) -> FloatArray:
    """A line (4,) moved across itself until it runs through a point (2,), or would if it were longer."""
    length = np.hypot(*(line[2:] - line[:2]))
    across = np.array([line[1] - line[3], line[2] - line[0]]) / length
    offset = (point - line[:2]) @ across * across
    return np.asarray(line + np.tile(offset, 2), dtype=np.float64)


def _section(element: Any, height: float) -> list[Polygon]:
    """The polygons in which a horizontal plane [m] cuts an element."""
    import ifcopenshell.geom

    if getattr(element, "Representation", None) is None:
        return []
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    try:
        mesh = ifcopenshell.geom.create_shape(settings, element).geometry
    except RuntimeError:  # an element without a body
        return []
    points = np.array(mesh.verts, np.float64).reshape(-1, 3)
    faces = np.array(mesh.faces, np.int64).reshape(-1, 3)
    # Half a grid's step off, so that no triangle lies in the plane.
    lines = _crossings(points, faces, height + 0.5 * LINE_GRID)
    if not len(lines):
        return []
    outlines = shapely.union_all(shapely.linestrings(lines), grid_size=LINE_GRID)
    areas = shapely.build_area(shapely.line_merge(outlines))
    return [part for part in polygon_parts(areas) if part.area > LINE_GRID]


def _crossings(points: FloatArray, faces: IntArray, height: float) -> FloatArray:
    """Where triangles cross a horizontal plane, shape (N, 2, 2)."""
    is_above = points[:, 2] > height
    count = is_above[faces].sum(axis=1)
    is_crossed = (count == 1) | (count == 2)
    crossed = faces[is_crossed]
    if not len(crossed):
        return np.empty((0, 2, 2))
    ends = []
    # The corner that is alone on its side of the plane.
    is_lone_above = count[is_crossed] == 1
    first = np.argmax(is_above[crossed] == is_lone_above[:, None], axis=1)
    rows = np.arange(len(crossed))
    tip = points[crossed[rows, first]]
    for step in (1, 2):
        other = points[crossed[rows, (first + step) % 3]]
        share = (height - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        place = tip + share[:, None] * (other - tip)
        ends.append(place[:, :2])
    return np.stack(ends, axis=1)
