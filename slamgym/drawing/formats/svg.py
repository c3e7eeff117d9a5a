"""SVG to scale: user units are millimetres of the building, printed at 1:100; one group a layer."""

from collections.abc import Callable, Iterator

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from slamgym.core.text import markup
from slamgym.core.types import OCCUPIED
from slamgym.drawing.drawing import Drawing, DrawnPoint

Placed = Callable[[DrawnPoint], str]
"""Coordinates of a point [m] as the file has them."""

PRINTED = 100.0
"""Drawn 1 to this on paper."""
PAPER_MARGIN = 1.0
"""Round the drawing [m]."""
FOOTER = 1.4
"""For the scale bar and the title [m]."""
_TEXT = 180
"""Size of letters [mm of the building]."""

STYLE = """
.room{fill:#fff;stroke:none}.room.INFERRED{fill:#eef2f7}.floor-inferred{fill:url(#hatch);stroke:none}
.wall{fill:#2b2f36;stroke:none}.wall.INFERRED{fill:#b9c2ce;stroke:#7a8794;stroke-width:15;stroke-dasharray:60 40}
.door{stroke:#1971c2;stroke-width:30;fill:none}
.opening{stroke:#1971c2;stroke-width:15;stroke-dasharray:120 80;fill:none}
.unexplored{fill:#fff4d6;stroke:#c99b2e;stroke-width:15;stroke-dasharray:90 60}
.dimension{stroke:#c92a2a;stroke-width:8;fill:none}.raw{fill:#e8590c;fill-opacity:.35}
text{font-family:sans-serif;fill:#343a40;text-anchor:middle}.size{fill:#c92a2a}
"""


def format_svg(drawing: Drawing) -> str:
    """The text of the file."""
    min_x, min_y, max_x, max_y = drawing.bounds
    left, top = min_x - PAPER_MARGIN, max_y + PAPER_MARGIN
    width, height = max_x - min_x + 2 * PAPER_MARGIN, max_y - min_y + 2 * PAPER_MARGIN + FOOTER

    def place(point: DrawnPoint) -> str:
        return f"{1000 * (point[0] - left):.1f},{1000 * (top - point[1]):.1f}"

    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{1000 * width / PRINTED:.2f}mm" '
        f'height="{1000 * height / PRINTED:.2f}mm" viewBox="0 0 {1000 * width:.1f} {1000 * height:.1f}">',
        f"<title>{markup(drawing.name)}</title>",
        f"<desc>Scale 1:{PRINTED:.0f}; user units are millimetres of the building. x of the map = {left:.4f} m + "
        f"x / 1000; y of the map = {top:.4f} m - y / 1000.</desc>",
        f"<style>{STYLE}</style>",
        '<defs><pattern id="hatch" width="160" height="160" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><line y2="160" stroke="#91a7c4" stroke-width="40"/></pattern></defs>',
        '<rect width="100%" height="100%" fill="#f1f3f5"/>',
        *_layers(drawing, place),
        *_footer(drawing, 1000 * PAPER_MARGIN, 1000 * (height - 0.7)),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _layers(drawing: Drawing, place: Placed) -> Iterator[str]:
    yield '<g id="UNEXPLORED">'
    yield from (svg_path(part, place, "unexplored") for part in drawing.unexplored)
    yield '</g><g id="ROOMS">'
    yield from (svg_path(part, place, "room") for part in drawing.floor.geoms)
    for room in drawing.rooms:
        yield svg_path(room.polygon, place, f"room {room.layer}", f"{room.id}: {room.area:.2f} m2")
    yield '</g><g id="INFERRED">'
    yield from (svg_path(part, place, "floor-inferred") for part in drawing.inferred_floor)
    yield '</g><g id="WALLS">'
    for wall in drawing.walls:
        title = f"{wall.length:.3f} m, {wall.thickness:.3f} m thick, confidence {wall.confidence:.2f}"
        yield svg_path(wall.polygon, place, f"wall {wall.layer}", title)
    yield '</g><g id="DOORS">'
    for door in drawing.doors:
        yield (
            f'<path class="{door.kind}" d="M{place(door.start)} L{place(door.end)}">'
            f"<title>{door.kind}, {door.width:.3f} m</title></path>"
        )
    yield '</g><g id="RAW">'
    yield _raw(drawing, place)
    yield '</g><g id="DIMENSIONS">'
    for dimension in drawing.dimensions:
        yield f'<path class="dimension" d="M{place(dimension.start)} L{place(dimension.end)}"/>'
        share = 0.5 if dimension.of == "building" else 0.3
        at = tuple(a + share * (b - a) for a, b in zip(dimension.start, dimension.end, strict=True))
        x, y = place((at[0], at[1])).split(",")
        turn = readable_angle(dimension.start, dimension.end)
        yield (
            f'<text class="size" font-size="{_TEXT}" transform="translate({x} {y}) rotate({turn:.2f})" '
            f'dy="-40">{dimension.length:.2f}</text>'
        )
    for room in drawing.rooms:
        middle = room.polygon.representative_point()
        x, y = place((middle.x, middle.y)).split(",")
        yield f'<text font-size="{_TEXT}" x="{x}" y="{y}">{room.id} {room.area:.1f} m²</text>'
    yield "</g>"


def _raw(drawing: Drawing, place: Placed) -> str:
    """The map's occupied cells, a run of cells in a row as one bar."""
    grid = drawing.grid
    occupied = np.pad(grid.cells == OCCUPIED, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(occupied, axis=1)
    rows, firsts = np.nonzero(change == 1)
    _, stops = np.nonzero(change == -1)
    res = grid.frame.resolution
    left, _, _, top = grid.frame.bounds
    bars = []
    for row, first, stop in zip(rows.tolist(), firsts.tolist(), stops.tolist(), strict=True):
        bars.append(
            f"M{place((left + first * res, top - row * res))}h{1000 * (stop - first) * res:.1f}v{1000 * res:.1f}"
            f"h{-1000 * (stop - first) * res:.1f}z"
        )
    return f'<path class="raw" d="{"".join(bars)}"/>'


def readable_angle(start: DrawnPoint, end: DrawnPoint) -> float:
    """Angle of a line's text [deg, clockwise as SVG has it], never upside down."""
    angle = float(-np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
    return (angle + 90.0) % 180.0 - 90.0


def svg_path(shape: Polygon | MultiPolygon, place: Placed, kind: str, title: str = "") -> str:
    """Outline and holes of a shape as one path of a class, with a title that shows where the pointer rests."""
    rings = [
        ring
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    data = " ".join(
        "M" + " ".join(place((x, y)) for x, y in shapely.get_coordinates(ring)[:-1].tolist()) + "z"
        for ring in rings
    )
    name = f"<title>{markup(title)}</title>" if title else ""
    return f'<path class="{markup(kind)}" fill-rule="evenodd" d="{data}">{name}</path>'


def _footer(drawing: Drawing, left: float, bottom: float) -> list[str]:
    bar = 1000 * drawing.scale_bar
    doubts = "; ".join(drawing.doubts)
    return [
        f'<path id="SCALE" d="M{left:.0f} {bottom - 90:.0f}v90h{bar:.0f}v-90" fill="none" stroke="#343a40" '
        'stroke-width="30"/>',
        f'<text font-size="{_TEXT}" style="text-anchor:start" x="{left + bar + 120:.0f}" y="{bottom:.0f}">'
        f"{drawing.scale_bar:g} m · 1:{PRINTED:.0f} · {markup(drawing.name)} · {drawing.area:.1f} m²</text>",
        f'<text font-size="{_TEXT}" style="text-anchor:start;fill:#c92a2a" x="{left:.0f}" y="{bottom + 380:.0f}">'
        f"{markup(doubts)}</text>",
    ]
