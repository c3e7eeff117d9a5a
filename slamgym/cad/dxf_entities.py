"""Entities of a DXF drawing (ezdxf): those that are read, and what each stands for before it is drawn."""

from typing import Any

CURVES = frozenset({"LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"})
"""Entities that are drawn as one line."""
POLYLINES = ("LWPOLYLINE", "POLYLINE")
"""Entities with corners, and bulges between them."""
_LEAST_POINTS = {"LINE": 2, "ARC": 2, "ELLIPSE": 9, "CIRCLE": 33}
"""Least number of points with which a curve is drawn."""
_READ = CURVES | {"INSERT", "MLINE", "HATCH"}
"""All entities that are read."""


def strip_entities(document: Any) -> None:
    """Delete what is passed over, and what is attached to the rest: every insert of a block would copy it."""
    for block in document.blocks:
        for entity in block:
            entity.xdata = None
            entity.appdata = None
            entity.extension_dict = None
            entity.reactors = None
            if entity.dxftype() == "INSERT":
                entity.delete_all_attribs()
            elif entity.dxftype() not in _READ:
                entity.destroy()
        block.purge()


def _outline_weight(outline: Any) -> int:
    """The same for one outline of a hatch, which has corners or edges."""
    edges = getattr(outline, "edges", ())
    splines = [getattr(edge, "control_points", ()) for edge in edges]
    return len(getattr(outline, "vertices", ())) + 1 + len(edges) + sum(map(len, splines))


def entity_weight(entity: Any) -> int:
    """Least number of points or lines with which an entity is drawn, as its insert copies them."""
    name = entity.dxftype()
    if name == "SPLINE":
        # Without control points a curve through n points solves n equations, at a cost that grows with the square.
        return len(entity.control_points) or 1 + len(entity.fit_points) ** 2 // 80
    if name == "MLINE":
        lines = len(entity.style.elements) if entity.style else 1
        return len(entity) * lines
    if name == "HATCH":
        return sum(_outline_weight(path) for path in entity.paths)
    if name in POLYLINES:
        return len(entity)
    return _LEAST_POINTS.get(name, 1)
