"""DXF by ezdxf: metres, one layer a kind, dimension lines that measure themselves, the map's echoes as underlay.

Layers: WALLS (closed LWPOLYLINEs of wall bodies), DOORS, OPENINGS and WINDOWS (LINEs), ROOMS (closed LWPOLYLINEs, a
TEXT with id and area), UNEXPLORED, INFERRED (bodies of walls without evidence as on WALLS; unseen floor as
HATCH), RAW (one closed LWPOLYLINE for each run of occupied cells), DIMENSIONS.
"""

import io
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from slamgym.drawing.drawing import Drawing

LAYER_COLOURS = {
    "RAW": 30, "ROOMS": 8, "WALLS": 7, "DOORS": 5, "OPENINGS": 150, "WINDOWS": 4, "INFERRED": 9, "UNEXPLORED": 2,
    "DIMENSIONS": 1,
}  # fmt: skip
"""AutoCAD's colour numbers."""
_TEXT = 0.18
"""Height of letters [m]."""
_APP = "SLAMGYM"
"""Name under which walls carry thickness, confidence and share seen (extended data)."""


def format_dxf(drawing: Drawing) -> str:
    """The text of the file (R2018)."""
    import ezdxf
    from ezdxf import units

    document = ezdxf.new("R2018", setup=["linetypes", "dimstyles"], units=units.M)
    for name, colour in LAYER_COLOURS.items():
        document.layers.add(name, color=colour)
    for name in ("INFERRED", "OPENINGS", "UNEXPLORED"):
        document.layers.get(name).dxf.linetype = "DASHED"
    document.appids.add(_APP)
    space = document.modelspace()
    space.units = units.M
    for x0, y0, x1, y1 in np.round(drawing.echo_runs(), 4).tolist():
        outline = [(x0, y1), (x1, y1), (x1, y0), (x0, y0)]
        space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "RAW"})
    for room in drawing.rooms:
        _add_polygons(space, [room.polygon], "ROOMS")
        place = room.polygon.representative_point()
        text = space.add_text(f"{room.id} {room.area:.2f} m2", height=_TEXT, dxfattribs={"layer": "ROOMS"})
        text.set_placement((place.x, place.y))
    for wall in drawing.walls:
        layer = "WALLS" if wall.layer == "SEEN" else "INFERRED"
        for line in _add_polygons(space, [wall.polygon], layer):
            line.set_xdata(_APP, [(1040, wall.thickness), (1040, wall.confidence), (1040, wall.share_seen)])
    for door in drawing.doors:
        space.add_line(door.start, door.end, dxfattribs={"layer": f"{door.kind.upper()}S"})
    for part in drawing.inferred_floor:
        _add_hatch(space, part, "INFERRED")
    _add_polygons(space, drawing.unexplored, "UNEXPLORED")
    _add_dimensions(space, drawing)
    min_x, min_y, max_x, max_y = drawing.bounds
    document.set_modelspace_vport(
        height=max_y - min_y + 2.0, center=(0.5 * (min_x + max_x), 0.5 * (min_y + max_y))
    )
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def _add_polygons(space: Any, shapes: Iterable[Polygon], layer: str) -> list[Any]:
    """Outlines and holes as closed LWPOLYLINEs."""
    outlines = [shapely.get_coordinates(ring)[:-1].tolist() for ring in shapely.get_rings(list(shapes))]
    return [space.add_lwpolyline(points, close=True, dxfattribs={"layer": layer}) for points in outlines]


def _add_hatch(space: Any, shape: Polygon, layer: str) -> None:
    """A hatched area: floor, which is no wall's body."""
    hatch = space.add_hatch(dxfattribs={"layer": layer})
    hatch.set_pattern_fill("ANSI31", scale=0.05)
    for number, ring in enumerate((shape.exterior, *shape.interiors)):
        points = shapely.get_coordinates(ring)[:-1].tolist()
        hatch.paths.add_polyline_path(points, is_closed=True, flags=1 if number == 0 else 16)


def _add_dimensions(space: Any, drawing: Drawing) -> None:
    """Aligned dimension lines; their text is what they measure."""
    override = {
        "dimtxt": _TEXT, "dimasz": 0.12, "dimexe": 0.05, "dimexo": 0.05, "dimgap": 0.05, "dimdec": 2, "dimlfac": 1.0,
        "dimscale": 1.0, "dimtad": 1, "dimpost": "<>", "dimzin": 0,
    }  # fmt: skip
    for dimension in drawing.dimensions:
        line = {"p1": dimension.start, "p2": dimension.end, "distance": 0.0}
        look = {"dimstyle": "EZDXF", "override": override, "dxfattribs": {"layer": "DIMENSIONS"}}
        space.add_aligned_dim(**line, **look).render()
