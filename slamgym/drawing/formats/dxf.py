"""DXF by ezdxf: model space in metres, the map's echoes as underlay, and a sheet to scale in paper space.

Layers are named as the US National CAD Standard has them: A-WALL (outlines of walls; A-WALL-INFR of those without
evidence; A-WALL-PATT, their filling), A-DOOR and A-DOOR-OPNG (a block for each door and opening), A-AREA (outlines of
rooms; A-AREA-IDEN, their names and areas), A-FLOR-INFR (floor never observed), A-ANNO-DIMS
(dimension lines that measure themselves), A-ANNO-TTLB (the sheet), V-SURV (the map's echoes).
"""

import io
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from slamgym.cad.polygons import polygon_parts
from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnPoint
from slamgym.drawing.evidence import echo_outlines
from slamgym.drawing.formats.dxf_sheet import add_sheet, add_text, fitting_paper
from slamgym.drawing.formats.look import place_labels
from slamgym.drawing.polygons import CORNER_GRID

LAYER_LOOKS = {
    "V-SURV": (30, 9), "A-AREA": (8, 9), "A-AREA-IDEN": (7, 18), "A-FLOR-INFR": (151, 9),
    "A-WALL": (7, 35), "A-WALL-INFR": (8, 25), "A-WALL-PATT": (9, 9), "A-DOOR": (5, 25), "A-DOOR-OPNG": (150, 18),
    "A-ANNO-DIMS": (1, 13), "A-ANNO-TTLB": (7, 25),
}  # fmt: skip
"""AutoCAD's number of the colour, and the width of lines [0.01 mm]."""


def format_dxf(drawing: Drawing) -> str:
    """The text of the file (R2018)."""
    import ezdxf
    from ezdxf import units

    document = ezdxf.new("R2018", units=units.M)
    document.header["$PSLTSCALE"] = 0  # dashes are in metres, on paper too
    low, high = np.reshape(drawing.bounds, (2, 2))
    paper = fitting_paper(*(high - low).tolist())
    _add_tables(document, paper.letters)
    space = document.modelspace()
    space.units = units.M
    _draw(space, drawing, paper.letters)
    space.reset_extents((*low, 0.0), (*high, 0.0))
    space.reset_limits(low, high)
    document.set_modelspace_vport(high[1] - low[1], 0.5 * (low + high))
    add_sheet(document, drawing, paper, 0.5 * (low + high))
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def _add_tables(document: Any, letters: float) -> None:
    """Layers, styles for letters of a height [m], and a block each for doors and openings 1 m wide."""
    document.linetypes.add("DASHED", [0.3, 0.2, -0.1])
    for name, (colour, weight) in LAYER_LOOKS.items():
        linetype = "DASHED" if name.endswith(("-INFR", "-OPNG")) else "CONTINUOUS"
        document.layers.add(name, color=colour, lineweight=weight, linetype=linetype)
    document.styles.add("PLAN", font="arial.ttf")
    look = {
        "dimtxt": letters, "dimtsz": 0.4 * letters, "dimasz": 0.4 * letters, "dimgap": 0.3 * letters, "dimexe": 0.0,
        "dimlunit": 2, "dimdec": 2, "dimzin": 0, "dimlfac": 1.0, "dimscale": 1.0, "dimpost": "<> m", "dimtxsty": "PLAN",
        "dimtad": 1, "dimjust": 1, "dimtih": 0, "dimtoh": 0, "dimexo": 0.0, "dimdsep": 46, "dimclrd": 1, "dimclre": 1,
    }  # fmt: skip
    document.dimstyles.new("METRES", dxfattribs=look).copy_to_header(document)
    document.blocks.new("OPENING").add_line((0.0, 0.0), (1.0, 0.0))
    door = document.blocks.new("DOOR")
    door.add_line((0.0, 0.0), (0.0, 1.0))
    door.add_arc((0.0, 0.0), 1.0, 0.0, 90.0)


def _draw(space: Any, drawing: Drawing, letters: float) -> None:
    """Everything in metres, what lies on top last."""
    bodies = [
        [w.polygon for w in drawing.walls if w.layer == layer] for layer in ("SEEN", "INFERRED")
    ]
    seen, inferred = (shapely.union_all(some, grid_size=CORNER_GRID) for some in bodies)
    inferred = shapely.difference(inferred, seen, grid_size=CORNER_GRID)
    _add_hatch(space, drawing.inferred_floor, "A-FLOR-INFR", "ANSI31")
    _add_hatch(space, polygon_parts(seen), "A-WALL-PATT", "SOLID")
    _add_outlines(space, echo_outlines(drawing.grid), "V-SURV")
    _add_outlines(space, [room.polygon for room in drawing.rooms], "A-AREA")
    _add_outlines(space, polygon_parts(inferred), "A-WALL-INFR")
    _add_outlines(space, polygon_parts(seen), "A-WALL")
    for door in drawing.doors:
        _add_door(space, door, drawing.floor)
    for line in drawing.dimensions:
        look = {"dimstyle": "METRES", "dxfattribs": {"layer": "A-ANNO-DIMS"}}
        space.add_aligned_dim(line.start, line.end, 0.0, **look).render()
    for label in place_labels(drawing, letters)[0]:
        if label.kind == "name":
            add_text(space, label.words, label.at, letters, "A-AREA-IDEN", "MIDDLE_CENTER")


def _rings(shape: Polygon) -> list[list[list[float]]]:
    """Outline and holes, the first point not repeated [m]."""
    return [
        np.round(shapely.get_coordinates(ring)[:-1], 4).tolist()
        for ring in shapely.get_rings(shape)
    ]


def _add_outlines(space: Any, shapes: Iterable[Polygon], layer: str) -> None:
    """Closed LWPOLYLINEs."""
    for points in (ring for shape in shapes for ring in _rings(shape)):
        space.add_lwpolyline(points, close=True, dxfattribs={"layer": layer})


def _add_hatch(space: Any, shapes: Iterable[Polygon], layer: str, pattern: str) -> None:
    """Filled areas."""
    for shape in shapes:
        hatch = space.add_hatch(color=256, dxfattribs={"layer": layer})
        if pattern != "SOLID":
            hatch.set_pattern_fill(pattern, color=256, scale=0.05)
        for number, points in enumerate(_rings(shape)):
            hatch.paths.add_polyline_path(points, is_closed=True, flags=16 if number else 1)


def _add_door(space: Any, door: DrawnDoor, floor: MultiPolygon) -> None:
    """A door's block. A map doesn't say how it is hung: the leaf swings over as much floor as it can."""
    hinge, jamb, side = max(
        (
            (a, b, side)
            for a, b in ((door.start, door.end), (door.end, door.start))
            for side in (1.0, -1.0)
        ),
        key=lambda hung: round(_swept(*hung).intersection(floor).area, 2),
    )
    scale = {"xscale": door.width, "yscale": side * door.width, "zscale": door.width}
    turn = float(np.degrees(np.arctan2(jamb[1] - hinge[1], jamb[0] - hinge[0])))
    layer = "A-DOOR" if door.kind == "door" else "A-DOOR-OPNG"
    space.add_blockref(door.kind.upper(), hinge, {**scale, "rotation": turn, "layer": layer})


def _swept(hinge: DrawnPoint, jamb: DrawnPoint, side: float) -> Polygon:
    """The triangle between a door that is shut and one that is open."""
    across = side * (hinge[1] - jamb[1]), side * (jamb[0] - hinge[0])
    return Polygon([hinge, jamb, (hinge[0] + across[0], hinge[1] + across[1])])
