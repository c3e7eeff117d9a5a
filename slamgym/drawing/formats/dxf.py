"""DXF by ezdxf: model space in millimetres of the building, so that 1:100 is 1:100, and a sheet on paper.

The model lies in the frame of the map; the sheet and the first view show it upright, along the axes of the UCS UPRIGHT.

Layers are named as the US National CAD Standard has them: A-WALL (outlines of walls; A-WALL-INFR of those without
evidence; A-WALL-PATT, their filling), A-GLAZ (outlines of walls of glass), A-DOOR and A-DOOR-OPNG (a block for each
door and opening), A-AREA (outlines of rooms; A-AREA-IDEN, their names and areas), A-FLOR-INFR (floor never observed),
A-ANNO-DIMS (dimension lines that measure themselves), A-ANNO-TTLB (the sheet), V-SURV (the map's echoes). How doors
swing is on A-DOOR-SWING-ASSUMED: a map doesn't say it.
"""

import io
import itertools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from slamgym.cad.polygons import polygon_parts
from slamgym.core.geometry import unit_vectors
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnPoint, DrawnWall
from slamgym.drawing.formats.chains import CHAIN_OFFSET, dimension_chains
from slamgym.drawing.formats.dxf_sheet import MM, add_sheet, add_text, fitting_paper
from slamgym.drawing.formats.look import place_labels
from slamgym.drawing.formats.upright import turn_deg
from slamgym.drawing.polygons import CORNER_GRID

LAYER_LOOKS = {
    "V-SURV": (30, 9),
    "A-AREA": (8, 9),
    "A-AREA-IDEN": (7, 18),
    "A-FLOR-INFR": (151, 9),
    "A-WALL": (7, 35),
    "A-WALL-INFR": (8, 25),
    "A-WALL-PATT": (9, 9),
    "A-GLAZ": (4, 25),
    "A-DOOR": (5, 25),
    "A-DOOR-OPNG": (150, 18),
    "A-DOOR-SWING-ASSUMED": (9, 13),
    "A-ANNO-DIMS": (1, 13),
    "A-ANNO-TTLB": (7, 25),
}
"""AutoCAD's number of the colour, and the width of lines [0.01 mm]."""
SWING = "A-DOOR-SWING-ASSUMED"
"""Layer of the leaves and arcs of doors."""


def format_dxf(drawing: Drawing) -> str:
    """The text of the file (R2018)."""
    import ezdxf
    from ezdxf import units

    document = ezdxf.new("R2018", units=units.MM)
    low, high = MM * np.reshape(drawing.bounds, (2, 2))
    middle, width, height = _upright(drawing)
    paper = fitting_paper(width + 2.0 * CHAIN_OFFSET, height + 2.0 * CHAIN_OFFSET)
    document.header["$PSLTSCALE"] = 0  # dashes are as long on paper as in the building
    _add_tables(document, MM * paper.letters)
    space = document.modelspace()
    space.units = units.MM
    _draw(space, drawing, paper.letters)
    space.reset_extents((*low, 0.0), (*high, 0.0))
    space.reset_limits(low, high)
    _show_upright(document, drawing, MM * middle, MM * height)
    add_sheet(document, drawing, paper, MM * middle)
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def _upright(drawing: Drawing) -> tuple[FloatArray, float, float]:
    """The middle (2,) of a drawing, and its width and height along its main walls [m]."""
    walls = [wall.polygon for wall in drawing.walls]
    lines = [dimension.line for dimension in drawing.dimensions]
    points = shapely.get_coordinates([drawing.floor, *walls, *lines])
    axes = unit_vectors(np.radians([drawing.angle_deg, drawing.angle_deg + 90.0]))
    places = points @ axes.T
    low, high = places.min(axis=0), places.max(axis=0)
    width, height = (high - low).tolist()
    return 0.5 * (low + high) @ axes, width, height


def _show_upright(document: Any, drawing: Drawing, middle: FloatArray, height: float) -> None:
    """Turn the view in which the model opens about a middle (2,), so high [mm], and name its axes."""
    angle = -turn_deg(drawing)
    view = document.set_modelspace_vport(height, (0.0, 0.0))
    view.dxf.target = (*middle, 0.0)
    view.dxf.view_twist = -angle
    (x, y), (across_x, across_y) = unit_vectors(np.radians([angle, angle + 90.0])).tolist()
    axes = {"origin": (0.0, 0.0, 0.0), "xaxis": (x, y, 0.0), "yaxis": (across_x, across_y, 0.0)}
    document.ucs.add("UPRIGHT", dxfattribs=axes)


def _add_tables(document: Any, letters: float) -> None:
    """Layers, styles for letters of a height [mm], and a block each for doors and openings 1 m wide."""
    document.linetypes.add("DASHED", [300.0, 200.0, -100.0])
    for name, (colour, weight) in LAYER_LOOKS.items():
        linetype = "DASHED" if name.endswith(("-INFR", "-OPNG")) else "CONTINUOUS"
        document.layers.add(name, color=colour, lineweight=weight, linetype=linetype)
    document.styles.add("PLAN", font="arial.ttf")
    _add_dimension_style(document, letters)
    for name in ("OPENING", "DOOR"):
        document.blocks.new(name).add_line((0.0, 0.0), (1.0, 0.0))
    door = document.blocks.get("DOOR")
    door.add_line((0.0, 0.0), (0.0, 1.0), dxfattribs={"layer": SWING})
    door.add_arc((0.0, 0.0), 1.0, 0.0, 90.0, dxfattribs={"layer": SWING})


def _add_dimension_style(document: Any, letters: float) -> None:
    """The style of lines that measure themselves, in metres with two places."""
    entry = document.dimstyles.new("METRES")
    style = entry.dxf
    style.dimtxt = letters
    style.dimtsz = 0.4 * letters
    style.dimasz = 0.4 * letters
    style.dimgap = 0.3 * letters
    style.dimexe = 0.3 * letters
    style.dimlunit = 2
    style.dimdec = 2
    style.dimzin = 0
    style.dimlfac = 1.0 / MM
    style.dimscale = 1.0
    style.dimpost = "<> m"
    style.dimtxsty = "PLAN"
    style.dimtad = 1
    style.dimjust = 1
    style.dimtih = 0
    style.dimtoh = 0
    style.dimexo = 0.5 * letters
    style.dimdsep = 46
    style.dimclrd = 1
    style.dimclre = 1
    entry.copy_to_header(document)


def _draw(space: Any, drawing: Drawing, letters: float) -> None:
    """Everything, what lies on top last; letters of a height [m]."""
    solid = [wall for wall in drawing.walls if not wall.is_glass]
    seen = _union_of([wall for wall in solid if wall.layer == "SEEN"])
    inferred = _union_of([wall for wall in solid if wall.layer == "INFERRED"])
    inferred = shapely.difference(inferred, seen, grid_size=CORNER_GRID)
    glass = _union_of([wall for wall in drawing.walls if wall.is_glass])
    _add_hatch(space, drawing.inferred_floor, "A-FLOR-INFR", "ANSI31")
    _add_hatch(space, polygon_parts(seen), "A-WALL-PATT", "SOLID")
    _add_outlines(space, drawing.echoes, "V-SURV")
    _add_outlines(space, [room.polygon for room in drawing.rooms], "A-AREA")
    _add_outlines(space, polygon_parts(inferred), "A-WALL-INFR")
    _add_outlines(space, polygon_parts(seen), "A-WALL")
    _add_outlines(space, polygon_parts(glass), "A-GLAZ")
    for door in drawing.doors:
        _add_door(space, door, drawing.floor)
    for line in drawing.dimensions:
        _add_dimension(space, line.start, line.end, 0.0)
    for chain in dimension_chains(drawing):
        for start, end in itertools.pairwise(chain.marks):
            _add_dimension(space, start, end, chain.aside)
    for label in place_labels(drawing, letters)[0]:
        if label.kind == "name":
            at = MM * np.array(label.at)
            text = add_text(space, label.words, at, MM * letters, "A-AREA-IDEN", "MIDDLE_CENTER")
            text.dxf.rotation = drawing.angle_deg


def _add_dimension(space: Any, start: DrawnPoint, end: DrawnPoint, aside: float) -> None:
    """A dimension between two places [m], its line so far to the left of the way from one to the other."""
    places = MM * np.array([start, end])
    dimension = space.add_aligned_dim(
        *places, MM * aside, dimstyle="METRES", dxfattribs={"layer": "A-ANNO-DIMS"}
    )
    dimension.render()


def _union_of(walls: Sequence[DrawnWall]) -> Any:
    """The bodies of walls as one shape."""
    return shapely.union_all([wall.polygon for wall in walls], grid_size=CORNER_GRID)


def _rings(shape: Polygon) -> list[list[list[float]]]:
    """Outline and holes, the first point not repeated [mm]."""
    rings = []
    for ring in shapely.get_rings(shape):
        points = shapely.get_coordinates(ring)[:-1]
        rings.append(np.round(MM * points, 1).tolist())
    return rings


def _add_outlines(space: Any, shapes: Iterable[Polygon], layer: str) -> None:
    """Closed LWPOLYLINEs."""
    for shape in shapes:
        for points in _rings(shape):
            space.add_lwpolyline(points, close=True, dxfattribs={"layer": layer})


def _add_hatch(space: Any, shapes: Iterable[Polygon], layer: str, pattern: str) -> None:
    """Filled areas."""
    for shape in shapes:
        hatch = space.add_hatch(color=256, dxfattribs={"layer": layer})
        if pattern != "SOLID":
            hatch.set_pattern_fill(pattern, color=256, scale=50.0)
        for number, points in enumerate(_rings(shape)):
            hatch.paths.add_polyline_path(points, is_closed=True, flags=16 if number else 1)


def _add_door(space: Any, door: DrawnDoor, floor: MultiPolygon) -> None:
    """A door's block. A map doesn't say how it is hung: the leaf is assumed to swing over as much floor as it can."""
    shut_from_either_end = [(door.start, door.end), (door.end, door.start)]
    hung = [
        _Hung(hinge, jamb, side) for hinge, jamb in shut_from_either_end for side in (1.0, -1.0)
    ]
    best = max(hung, key=lambda way: round(way.swept.intersection(floor).area, 2))
    attributes = {
        "xscale": MM * door.width,
        "yscale": MM * best.side * door.width,
        "zscale": MM * door.width,
        "rotation": best.turn_deg,
        "layer": "A-DOOR" if door.kind == "door" else "A-DOOR-OPNG",
    }
    space.add_blockref(door.kind.upper(), MM * np.array(best.hinge), attributes)


class _Hung(NamedTuple):
    """A way in which a door may be hung."""

    hinge: DrawnPoint
    jamb: DrawnPoint
    """The other end of its gap."""
    side: float
    """1 if it opens to the left, seen from the hinge, else -1."""

    @property
    def turn_deg(self) -> float:
        """Direction from the hinge to the jamb [deg]."""
        hinge_x, hinge_y = self.hinge
        jamb_x, jamb_y = self.jamb
        turn = np.arctan2(jamb_y - hinge_y, jamb_x - hinge_x)
        return float(np.degrees(turn))

    @property
    def swept(self) -> Polygon:
        """The triangle between the door when it is shut and when it is open."""
        hinge_x, hinge_y = self.hinge
        jamb_x, jamb_y = self.jamb
        across_x = self.side * (hinge_y - jamb_y)
        across_y = self.side * (jamb_x - hinge_x)
        opened = (hinge_x + across_x, hinge_y + across_y)
        return Polygon([self.hinge, self.jamb, opened])
