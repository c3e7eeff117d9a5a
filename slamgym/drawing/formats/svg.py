"""SVG to scale: user units are millimetres of the building, printed at 1:100; one group a layer.

The figures of the report (:mod:`slamgym.drawing.formats.html`) are drawn by the same :class:`Sheet`, to other scales.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.viz.canvas import round_length

PRINTED = 100
"""Drawn 1 to this on paper."""
SHEET_MARGIN = 1.0
"""Round the drawing [m]."""
LETTERS = 1.8
"""Height of letters on paper [mm]."""
LETTER_WIDTH = 0.56
"""Width of a letter in heights."""
STYLE = """
.room{fill:#fff;stroke:none}.room.INFERRED{fill:#eef2f7}.floor-inferred{fill:#cbdaf0;stroke:none}
.wall{fill:#2b2f36;stroke:none}.wall.INFERRED{fill:#b9c2ce;stroke:#7a8794;stroke-width:15;stroke-dasharray:60 40}
.door,.opening{stroke:#1971c2;stroke-width:30;fill:none}.opening{stroke-width:15;stroke-dasharray:120 80}
.unexplored{fill:#fff4d6;stroke:#c99b2e;stroke-width:15;stroke-dasharray:90 60}
.dimension{stroke:#c92a2a;stroke-width:8;fill:none}.raw{fill:#e8590c;fill-opacity:.35}
text{font-family:sans-serif;fill:#343a40;text-anchor:middle}text.size{fill:#c92a2a}text.blue{fill:#1971c2}
text.start{text-anchor:start}text.halo{paint-order:stroke;stroke:#fff;stroke-linejoin:round}
"""


class Sheet(NamedTuple):
    """Where points of the map lie on paper."""

    left: float  # x of the map at the sheet's left edge [m]
    top: float  # y of the map at its upper edge [m]
    width: float  # [m]
    height: float  # [m]
    scale: float  # on paper it is drawn 1 to this

    @classmethod
    def of(cls, bounds: tuple[float, float, float, float], scale: float) -> "Sheet":
        """A sheet for (min x, min y, max x, max y) [m] with a margin, and a strip for the scale bar."""
        min_x, min_y, max_x, max_y = bounds
        width, height = max_x - min_x + 2 * SHEET_MARGIN, max_y - min_y + 2 * SHEET_MARGIN
        strip = 6e-3 * LETTERS * scale
        return cls(min_x - SHEET_MARGIN, max_y + SHEET_MARGIN, width, height + strip, scale)

    @property
    def letters(self) -> float:
        """Height of letters [mm of the building]."""
        return LETTERS * self.scale

    def place(self, point: DrawnPoint) -> str:
        """A point of the map [m] as SVG has it."""
        return f"{1000 * (point[0] - self.left):.1f},{1000 * (self.top - point[1]):.1f}"

    def text(self, at: DrawnPoint, words: str, kind: str = "", turn: float = 0.0) -> str:
        """A line of text around a point; ``turn`` in degrees, clockwise."""
        x, y = self.place(at).split(",")
        turned = f' transform="rotate({turn:.1f} {x} {y})"' if turn else ""
        return (
            f'<text class="halo {kind}" x="{x}" y="{float(y) + 0.35 * self.letters:.0f}" '
            f'font-size="{self.letters:.0f}" stroke-width="{0.25 * self.letters:.0f}"{turned}>{markup(words)}</text>'
        )

    def fits(self, words: str, room: float) -> bool:
        """True if a line of text is no longer than this [m]."""
        return len(words) * LETTER_WIDTH * self.letters <= 1000.0 * room

    def path(self, shape: Polygon, kind: str, title: str = "") -> str:
        """Outline and holes of a shape as one path of a class, with a title that shows where the pointer rests."""
        data = " ".join(
            "M" + " ".join(self.place((x, y)) for x, y in shapely.get_coordinates(ring)[:-1].tolist()) + "z"
            for ring in shapely.get_rings(shape)
        )
        name = f"<title>{markup(title)}</title>" if title else ""
        return f'<path class="{markup(kind)}" fill-rule="evenodd" d="{data}">{name}</path>'

    def scale_bar(self, words: str) -> list[str]:
        """A bar of a round length in the lower left corner, and what it is."""
        bar, tick = 1000.0 * round_length(0.25 * self.width), 0.5 * self.letters
        x, y = self.letters, 1000.0 * self.height - 2.5 * self.letters
        return [
            f'<path class="bar" d="M{x:.0f} {y - tick:.0f}v{tick:.0f}h{bar:.0f}v{-tick:.0f}" fill="none" '
            f'stroke="#343a40" stroke-width="{0.3 * tick:.0f}"/>',
            f'<text class="start" x="{x + bar + tick:.0f}" y="{y:.0f}" font-size="{self.letters:.0f}">'
            f"{bar / 1000:g} m · 1:{self.scale:g}{markup(words)}</text>",
        ]


def format_svg(drawing: Drawing) -> str:
    """The text of the file."""
    sheet = Sheet.of(drawing.bounds, PRINTED)
    width, height = 1000 * sheet.width, 1000 * sheet.height
    layers = shape_layers(drawing, sheet) | {
        "RAW": [_raw(drawing, sheet)],
        "DIMENSIONS": size_layer(drawing, sheet),
    }
    bar = sheet.scale_bar(f" · {drawing.name} · {drawing.area:.1f} m²")
    doubts = markup("; ".join(drawing.doubts))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width / PRINTED:.2f}mm" '
        f'height="{height / PRINTED:.2f}mm" viewBox="0 0 {width:.1f} {height:.1f}">',
        f"<title>{markup(drawing.name)}</title>",
        f"<desc>Scale 1:{PRINTED}; user units are millimetres of the building. x of the map = {sheet.left:.4f} m + "
        f"x / 1000; y of the map = {sheet.top:.4f} m - y / 1000.</desc>",
        f"<style>{STYLE}</style>",
        '<rect width="100%" height="100%" fill="#f1f3f5"/>',
        *(f'<g id="{name}">{"".join(parts)}</g>' for name, parts in layers.items()),
        f'<g id="SCALE">{"".join(bar)}</g>',
        f'<text class="start" style="fill:#c92a2a" x="{sheet.letters:.0f}" y="{height - 0.7 * sheet.letters:.0f}" '
        f'font-size="{sheet.letters:.0f}">{doubts}</text>',
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def shape_layers(drawing: Drawing, sheet: Sheet) -> dict[str, Sequence[str]]:
    """The drawn shapes, by layers from the lowest up."""
    walls = [
        sheet.path(
            wall.polygon,
            f"wall {wall.layer}",
            f"W{number}: {wall.length:.3f} m, {wall.thickness:.3f} m thick, confidence {wall.confidence:.2f}",
        )
        for number, wall in enumerate(drawing.walls, 1)
    ]
    doors = [
        f'<path class="{door.kind}" d="M{sheet.place(door.start)} L{sheet.place(door.end)}">'
        f"<title>D{number}: {door.kind}, {door.width:.3f} m</title></path>"
        for number, door in enumerate(drawing.doors, 1)
    ]
    rooms = [
        sheet.path(room.polygon, f"room {room.layer}", f"{room.id}: {room.area:.2f} m2")
        for room in drawing.rooms
    ]
    return {
        "UNEXPLORED": [sheet.path(part, "unexplored") for part in drawing.unexplored],
        "ROOMS": [*(sheet.path(part, "room") for part in drawing.floor.geoms), *rooms],
        "INFERRED": [sheet.path(part, "floor-inferred") for part in drawing.inferred_floor],
        "WALLS": walls,
        "DOORS": doors,
    }


def size_layer(drawing: Drawing, sheet: Sheet) -> list[str]:
    """Dimension lines with their lengths where these fit, and names and areas of rooms."""
    parts = []
    for line in drawing.dimensions:
        words = f"{line.length:.2f}"
        if not sheet.fits(words, 0.8 * line.length):
            continue
        start, end = np.array(line.start), np.array(line.end)
        unit = (end - start) / line.length
        slant = 0.35e-3 * sheet.letters * np.array([unit[0] - unit[1], unit[0] + unit[1]])
        strokes = [(start, end), (start - slant, start + slant), (end - slant, end + slant)]
        data = " ".join(f"M{sheet.place(tuple(a))} L{sheet.place(tuple(b))}" for a, b in strokes)
        parts.append(f'<path class="dimension" d="{data}"/>')
        share = 0.5 if line.of == "building" else 0.25
        turn = readable_angle(line.start, line.end)
        parts.append(sheet.text(tuple(start + share * (end - start)), words, "size", turn))
    for room in drawing.rooms:
        circle = shapely.get_coordinates(shapely.maximum_inscribed_circle(room.polygon, tolerance=0.1))
        words = f"{room.id} {room.area:.1f} m²"
        is_wide = sheet.fits(words, 2.0 * float(np.hypot(*(circle[1] - circle[0]))))
        parts.append(sheet.text(tuple(circle[0]), words if is_wide else room.id))
    return parts


def _raw(drawing: Drawing, sheet: Sheet) -> str:
    """The map's occupied cells, a run of cells in a row as one bar."""
    bars = [
        f"M{sheet.place((x0, y0))}h{1000 * (x1 - x0):.1f}v{1000 * (y0 - y1):.1f}h{-1000 * (x1 - x0):.1f}z"
        for x0, y0, x1, y1 in drawing.echo_runs().tolist()
    ]
    return f'<path class="raw" d="{"".join(bars)}"/>'


def readable_angle(start: DrawnPoint, end: DrawnPoint) -> float:
    """Angle of a line's text [deg, clockwise as SVG has it], never upside down."""
    angle = float(-np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
    return (angle + 90.0) % 180.0 - 90.0
