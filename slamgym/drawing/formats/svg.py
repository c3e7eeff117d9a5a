"""SVG to scale: user units are millimetres of the building, printed at 1:100; one group a layer.

The figures of the report (:mod:`slamgym.drawing.formats.html`) are drawn by the same :class:`Sheet`, to other scales.
"""

from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, MultiLineString, Polygon

from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.drawing.evidence import echo_outlines
from slamgym.drawing.formats.look import (
    DRAWING_STYLE,
    DRAWN_COLOURS,
    LEGEND_ROWS,
    LETTER_WIDTH,
    DrawnLabel,
    drawn_shapes,
    format_part,
    place_labels,
)
from slamgym.viz.canvas import round_length

PRINTED = 100
"""Drawn 1 to this on paper."""
SHEET_MARGIN = 1.0
"""Round the drawing [m]."""
LETTERS = 1.8
"""Height of letters on paper [mm]."""


class Sheet(NamedTuple):
    """Where points of the map lie on paper."""

    left: float  # x of the map at the sheet's left edge [m]
    top: float  # y of the map at its upper edge [m]
    width: float  # [m]
    height: float  # [m]
    scale: float  # on paper it is drawn 1 to this

    @classmethod
    def of(cls, bounds: tuple[float, float, float, float], scale: float) -> "Sheet":
        """A sheet for (min x, min y, max x, max y) [m] with a margin, and a strip for legend and scale bar."""
        min_x, min_y, max_x, max_y = bounds
        width, height = max_x - min_x + 2 * SHEET_MARGIN, max_y - min_y + 2 * SHEET_MARGIN
        strip = (6e-3 + 1.6e-3 * LEGEND_ROWS) * LETTERS * scale
        return cls(min_x - SHEET_MARGIN, max_y + SHEET_MARGIN, width, height + strip, scale)

    @property
    def letters(self) -> float:
        """Height of letters [mm of the building]."""
        return LETTERS * self.scale

    def place(self, point: DrawnPoint) -> str:
        """A point of the map [m] as SVG has it."""
        return f"{1000 * (point[0] - self.left):.1f},{1000 * (self.top - point[1]):.1f}"

    def text(self, label: DrawnLabel) -> str:
        """A label with a halo."""
        x, y = self.place(label.at).split(",")
        turned = f' transform="rotate({-label.turn:.1f} {x} {y})"' if label.turn else ""
        return (
            f'<text class="halo {label.kind}" x="{x}" y="{float(y) + 0.35 * self.letters:.0f}" '
            f'font-size="{self.letters:.0f}" stroke-width="{0.25 * self.letters:.0f}"{turned}>'
            f"{markup(label.words)}</text>"
        )

    def path(self, shape: Polygon | LineString | MultiLineString, kind: str, title: str = "") -> str:
        """A shape, with its holes, as one path of a class, with a title that shows where the pointer rests."""
        is_area = isinstance(shape, Polygon)
        lines = shapely.get_rings(shape).tolist() if is_area else shapely.get_parts(shape).tolist()
        data = " ".join(
            "M" + " ".join(map(self.place, line.coords[:-1] if is_area else line.coords)) + "z" * is_area
            for line in lines
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
            self.start(f"{bar / 1000:g} m · 1:{self.scale:g}{words}", x + bar + tick, y),
        ]

    def legend(self) -> list[str]:
        """Colours and what they mean, above the scale bar."""
        size, parts = self.letters, []
        for number, (colour, words) in enumerate(DRAWN_COLOURS.values()):
            column, row = divmod(number, LEGEND_ROWS)
            x = size * (1.0 + 17.0 * column)
            y = 1000.0 * self.height - size * (4.2 + 1.6 * (LEGEND_ROWS - 1 - row))
            data = f"M{x:.0f} {y - 0.8 * size:.0f}h{1.2 * size:.0f}v{0.9 * size:.0f}h{-1.2 * size:.0f}z"
            parts += [f'<path d="{data}" fill="rgb{colour}"/>', self.start(words, x + 1.6 * size, y)]
        return parts

    def start(self, words: str, x: float, y: float) -> str:
        """A line of text that begins at a place on the sheet."""
        return f'<text class="start" x="{x:.0f}" y="{y:.0f}" font-size="{self.letters:.0f}">{markup(words)}</text>'


def format_svg(drawing: Drawing) -> str:
    """The text of the file."""
    sheet = Sheet.of(drawing.bounds, PRINTED)
    width, height = 1000 * sheet.width, 1000 * sheet.height
    layers = shape_layers(drawing, sheet) | {
        "DRAWN_COLOURS": sheet.legend(),
        "RAW": [sheet.path(part, "raw") for part in echo_outlines(drawing.grid)],
        "DIMENSIONS": size_layer(drawing, sheet),
    }
    layers["SCALE"] = sheet.scale_bar(f" · {drawing.name} · {drawing.area:.1f} m²")
    return format_part(
        "drawing.svg",
        paper=f'width="{width / PRINTED:.2f}mm" height="{height / PRINTED:.2f}mm"',
        view=f"0 0 {width:.1f} {height:.1f}",
        name=markup(drawing.name),
        frame=f"x of the map = {sheet.left:.4f} m + x / 1000; y of the map = {sheet.top:.4f} m - y / 1000",
        style=DRAWING_STYLE,
        layers="\n".join(f'<g id="{name}">{"".join(parts)}</g>' for name, parts in layers.items()),
        doubts=sheet.start("; ".join(drawing.doubts), sheet.letters, height - 0.7 * sheet.letters),
    )


def shape_layers(drawing: Drawing, sheet: Sheet) -> dict[str, list[str]]:
    """The drawn shapes, by layers from the lowest up."""
    layers: dict[str, list[str]] = {}
    for layer, kind, shape, title in drawn_shapes(drawing):
        layers.setdefault(layer, []).append(sheet.path(shape, kind, title))
    return layers


def size_layer(drawing: Drawing, sheet: Sheet) -> list[str]:
    """Dimension lines, names and areas of rooms, and numbers of doors."""
    labels, lines = place_labels(drawing, 1e-3 * LETTER_WIDTH * sheet.letters, 1e-3 * sheet.letters)
    parts = []
    for line in lines:
        start, end = np.array(line.start), np.array(line.end)
        unit = (end - start) / line.length
        slant = 0.35e-3 * sheet.letters * np.array([unit[0] - unit[1], unit[0] + unit[1]])
        strokes = [(start, end), (start - slant, start + slant), (end - slant, end + slant)]
        parts.append(sheet.path(MultiLineString(strokes), "dimension"))
    return parts + [sheet.text(label) for label in labels]
