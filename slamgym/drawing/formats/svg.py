"""SVG to scale, upright: user units are millimetres of the building, printed at 1:100; one group a layer.

The figures of the report (:mod:`slamgym.drawing.formats.html`) are drawn in the same way, to other scales.
"""

from collections.abc import Iterable

import shapely
from shapely import Polygon

from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.drawing.formats.look import (
    DRAWING_STYLE,
    DrawnLabel,
    DrawnShape,
    Sheet,
    drawn_scene,
    format_part,
)
from slamgym.drawing.formats.upright import said_turn, turn_deg, turned_shape, upright

PRINTED = 100
"""Drawn 1 to this on paper."""
LETTERS = 1.8
"""Height of letters on paper [mm]."""


def format_svg(drawing: Drawing) -> str:
    """The text of the file."""
    shown = upright(drawing)
    sheet = Sheet.of(shown.bounds, 1e-3 * LETTERS * PRINTED)
    words = f" · 1:{PRINTED} · {drawing.name} · {drawing.area:.1f} m²"
    shapes, labels = drawn_scene(shown, sheet, words, drawing.doubts)
    angle = turn_deg(drawing)
    shapes += [DrawnShape("RAW", "echo", turned_shape(part, angle)) for part in drawing.echoes]
    layers = drawn_layers(shapes, labels, sheet)
    groups = [f'<g id="{name}">{"".join(parts)}</g>' for name, parts in layers.items()]
    width = 1000 * sheet.width
    height = 1000 * sheet.height
    values = {
        "paper": f'width="{width / PRINTED:.2f}mm" height="{height / PRINTED:.2f}mm"',
        "view": f"0 0 {width:.1f} {height:.1f}",
        "name": markup(drawing.name),
        "frame": f"x of the map = {sheet.left:.4f} m + x / 1000; y of the map = {sheet.top:.4f} m - y / 1000"
        f"{said_turn(drawing)}",
        "style": DRAWING_STYLE,
        "layers": "\n".join(groups),
    }
    return format_part("drawing.svg", values)


def drawn_layers(
    shapes: Iterable[DrawnShape], labels: Iterable[DrawnLabel], sheet: Sheet
) -> dict[str, list[str]]:
    """Shapes and labels on a sheet as SVG's elements, by layers from the lowest up."""
    layers: dict[str, list[str]] = {}
    for shape in shapes:
        layers.setdefault(shape.layer, []).append(_path(shape, sheet))
    return layers | {"LABELS": [_text(label, sheet) for label in labels]}


def svg_point(point: DrawnPoint, sheet: Sheet) -> str:
    """A point of the map [m] as SVG has it."""
    return f"{1000 * (point[0] - sheet.left):.1f},{1000 * (sheet.top - point[1]):.1f}"


def _text(label: DrawnLabel, sheet: Sheet) -> str:
    """A label with a halo."""
    x, y = svg_point(label.at, sheet).split(",")
    size = 1000 * sheet.letters
    turned = f' transform="rotate({-label.turn:.1f} {x} {y})"' if label.turn else ""
    return (
        f'<text class="halo {label.kind}" x="{x}" y="{float(y) + 0.35 * size:.0f}" '
        f'font-size="{size:.0f}" stroke-width="{0.25 * size:.0f}"{turned}>{markup(label.words)}</text>'
    )


def _path(drawn: DrawnShape, sheet: Sheet) -> str:
    """A shape, with its holes, as one path of a class, with a title that shows where the pointer rests."""
    if isinstance(drawn.shape, Polygon):
        rings = shapely.get_rings(drawn.shape).tolist()
        pieces = [_polyline(ring.coords[:-1], sheet) + "z" for ring in rings]
    else:
        pieces = [_polyline(line.coords, sheet) for line in shapely.get_parts(drawn.shape).tolist()]
    data = " ".join(pieces)
    name = f"<title>{markup(drawn.title)}</title>" if drawn.title else ""
    return f'<path class="{markup(drawn.kind)}" fill-rule="evenodd" d="{data}">{name}</path>'


def _polyline(points: Iterable[DrawnPoint], sheet: Sheet) -> str:
    """Points of a path, from the first to the last."""
    return "M" + " ".join(svg_point(point, sheet) for point in points)
