"""The figures of a report as SVG within the page, each to a round scale on paper.

User units are millimetres of the building, as in :mod:`slamgym.drawing.formats.svg`; text has a size on paper.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
import shapely

from slamgym.core.text import markup
from slamgym.core.types import ByteArray
from slamgym.drawing.drawing import Dimension, Drawing, DrawnPoint, DrawnRoom
from slamgym.drawing.formats.svg import readable_angle, svg_path
from slamgym.viz.canvas import round_length
from slamgym.viz.pages import inline_picture

Paper = tuple[float, float]
"""Width and height that a figure may take of a page [mm]."""
BESIDE_TEXT: Paper = (180.0, 160.0)
LEFT_HALF, UPPER_HALF = (88.0, 190.0), (180.0, 92.0)
"""Of A4: below some text, and of two figures beside or below each other."""
PLACES = (0.25, 0.75, 0.5, 0.14, 0.86)
"""Along a dimension line, where its length may stand; where most room is, the first first."""
PAPER_SCALES = (
    20,
    50,
    75,
    100,
    125,
    150,
    200,
    250,
    300,
    400,
    500,
    600,
    750,
    1000,
    1500,
    2000,
    5000,
    10_000,
    50_000,
)
"""Drawn 1 to one of these."""
LETTERS = 2.4
"""Height of letters on paper [mm]."""
LETTER_WIDTH = 0.56
"""Of a letter in heights."""
SHEET_MARGIN = 1.2
"""Round what is drawn [m]."""
SURE = 0.7
"""Walls below this confidence are drawn apart."""

FIGURE_STYLE = """
figure { margin: .5rem 0; break-inside: avoid } figcaption { color: #495057; font-size: .9em; max-width: 60rem }
figure svg { display: block; width: 100%; height: auto; max-height: 92vh; background: #f1f3f5 }
figure svg { border: 1px solid #dee2e6 }
@media print { figure svg { width: var(--paper); max-height: none } }
.floor { fill: #fff } .floor-inferred { fill: #ffd8a8 } .unexplored { fill: #e9d8fd; stroke: #9775fa }
.wall { fill: #2b2f36 } .wall.INFERRED { fill: #fd7e14 } .wall.unsure { fill: #adb5bd; stroke: #2b2f36 }
.see-through .floor { fill: none } .see-through .floor-inferred, .see-through .unexplored { fill-opacity: .55 }
.see-through .wall { fill-opacity: .8 }
.door, .opening { stroke: #1971c2; fill: none } .door.INFERRED, .opening.INFERRED { stroke: #fd7e14 }
.opening { stroke-dasharray: 120 80 }
.dimension { stroke: #c92a2a; fill: none } .size { fill: #c92a2a } .bar { stroke: #343a40; fill: none }
svg text { font-family: system-ui, sans-serif; fill: #343a40; text-anchor: middle }
svg .halo { paint-order: stroke; stroke: #fff; stroke-linejoin: round } svg .start { text-anchor: start }
svg text.blue { fill: #1971c2 } svg image { image-rendering: pixelated }
"""


class Sheet(NamedTuple):
    """Where a figure's points lie on its sheet."""

    left: float  # x of the map at the sheet's left edge [m]
    top: float  # y of the map at its upper edge [m]
    width: float  # [m]
    height: float  # [m]
    scale: int  # on paper it is drawn 1 to this

    @classmethod
    def of(cls, bounds: tuple[float, float, float, float], paper: Paper = BESIDE_TEXT) -> "Sheet":
        """A sheet for (min x, min y, max x, max y) [m] with a margin, and a strip for the scale bar."""
        min_x, min_y, max_x, max_y = bounds
        width, height = max_x - min_x + 2 * SHEET_MARGIN, max_y - min_y + 2 * SHEET_MARGIN
        least = 1000.0 * max(width / paper[0], height / (paper[1] - 2.5 * LETTERS))
        scale = next((scale for scale in PAPER_SCALES if scale >= least), PAPER_SCALES[-1])
        return cls(
            min_x - SHEET_MARGIN, max_y + SHEET_MARGIN, width, height + 2.5e-3 * LETTERS * scale, scale
        )

    @property
    def letters(self) -> float:
        """Height of letters [mm of the building]."""
        return LETTERS * self.scale

    def place(self, point: DrawnPoint) -> str:
        """A point of the map [m] as SVG has it."""
        return f"{1000 * (point[0] - self.left):.0f},{1000 * (self.top - point[1]):.0f}"

    def text(self, at: DrawnPoint, words: str, kind: str, size: float = 1.0, turn: float = 0.0) -> str:
        """A line of text around a point; ``turn`` in degrees, clockwise."""
        x, y = self.place(at).split(",")
        turned = f' transform="rotate({turn:.1f} {x} {y})"' if turn else ""
        height = size * self.letters
        return (
            f'<text class="{kind}" x="{x}" y="{float(y) + 0.35 * height:.0f}" font-size="{height:.0f}" '
            f'stroke-width="{0.25 * height:.0f}"{turned}>{markup(words)}</text>'
        )

    def fits(self, words: str, room: float, size: float = 1.0) -> bool:
        """Whether a line of text is no longer than this [m]."""
        return len(words) * LETTER_WIDTH * size * self.letters <= 1000.0 * room

    def svg(self, parts: Sequence[str], label: str, kind: str = "") -> str:
        """The figure, with a scale bar and what scale it has on paper."""
        paper = 1000.0 * self.width / self.scale
        bar = 1000.0 * round_length(0.25 * self.width)
        x, y = 0.6 * self.letters, 1000.0 * self.height - 0.8 * self.letters
        tick = 0.5 * self.letters
        words = f"{bar / 1000:g} m; 1:{self.scale} on A4"
        return "\n".join(
            [
                f'<svg role="img" aria-label="{markup(label)}" class="{kind}" style="--paper: {paper:.1f}mm" '
                f'viewBox="0 0 {1000 * self.width:.0f} {1000 * self.height:.0f}">',
                *parts,
                f'<path class="bar" stroke-width="{0.25 * tick:.0f}" '
                f'd="M{x:.0f} {y - tick:.0f}v{tick:.0f}h{bar:.0f}v{-tick:.0f}"/>',
                f'<text class="start" x="{x + bar + tick:.0f}" y="{y:.0f}" '
                f'font-size="{self.letters:.0f}">{markup(words)}</text>',
                "</svg>",
            ]
        )


def map_image(drawing: Drawing, sheet: Sheet) -> str:
    """The map's cells in greys: black occupied, white free."""
    left, bottom, right, top = drawing.grid.frame.bounds
    x, y = sheet.place((left, top)).split(",")
    cells: ByteArray = drawing.grid.cells
    return (
        f'<image x="{x}" y="{y}" width="{1000 * (right - left):.0f}" height="{1000 * (top - bottom):.0f}" '
        f'preserveAspectRatio="none" href="{inline_picture(cells)}"/>'
    )


class FigurePair(NamedTuple):
    """Two figures of the same place."""

    first: str
    second: str
    are_beside: bool
    """Whether they are larger beside each other than one below the other."""


def input_and_overlay(drawing: Drawing) -> FigurePair:
    """The map as it came, cut to what is known; and the drawing over it, by what was seen and what is inferred."""
    bounds = _box(drawing.grid.frame.bounds, drawing.bounds)
    sheet, below = Sheet.of(bounds, LEFT_HALF), Sheet.of(bounds, UPPER_HALF)
    are_beside = sheet.scale <= below.scale
    sheet = sheet if are_beside else below
    ground = map_image(drawing, sheet)
    words = "the drawing over its map, seen and inferred"
    drawn = sheet.svg([ground, *_shapes(drawing, sheet)], words, "see-through")
    return FigurePair(sheet.svg([ground], f"the map {drawing.name}"), drawn, are_beside)


def dimensioned_figure(drawing: Drawing) -> str:
    """Rooms, walls, doors and dimension lines."""
    ends = np.array([end for line in drawing.dimensions for end in (line.start, line.end)]).reshape(-1, 2)
    sheet = Sheet.of(_box(drawing.bounds, (*ends.min(axis=0), *ends.max(axis=0))))
    middles = [_middle(room) for room in drawing.rooms]
    parts = [*_shapes(drawing, sheet)]
    labels = [at for at, _ in middles]
    for dimension in drawing.dimensions:
        parts += _dimension(dimension, sheet, labels)
    for room, (at, across) in zip(drawing.rooms, middles, strict=True):
        parts += _room_label(room, at, across, sheet)
    return sheet.svg(parts, "the drawing with dimensions")


def numbered_figure(drawing: Drawing, walls: Sequence[int]) -> str:
    """Walls and doors with their numbers in the tables.

    Args:
        drawing: What is drawn.
        walls: Which walls have a row, by index.
    """
    sheet = Sheet.of(drawing.bounds)
    parts = [*_shapes(drawing, sheet, "confidence")]
    for index in walls:
        wall = drawing.walls[index]
        if sheet.fits(f"W{index + 1}", wall.length, 0.75):
            turn = readable_angle(wall.start, wall.end)
            parts.append(sheet.text(_between(wall.start, wall.end), f"W{index + 1}", "halo", 0.75, turn))
    for number, door in enumerate(drawing.doors, 1):
        parts.append(sheet.text(_between(door.start, door.end), f"D{number}", "halo blue", 0.75))
    return sheet.svg(parts, "numbers of walls and doors")


def _shapes(drawing: Drawing, sheet: Sheet, tint: Literal["layer", "confidence"] = "layer") -> Iterator[str]:
    """Floor, walls and doors, tinted by layer, or walls by whether they are sure."""
    line = 0.12 * sheet.letters
    yield from (svg_path(part, sheet.place, "unexplored") for part in drawing.unexplored)
    yield from (svg_path(part, sheet.place, "floor") for part in drawing.floor.geoms)
    if tint == "layer":
        yield from (svg_path(part, sheet.place, "floor-inferred") for part in drawing.inferred_floor)
    yield f'<g stroke-width="{0.5 * line:.0f}">'
    for number, wall in enumerate(drawing.walls, 1):
        kind = wall.layer if tint == "layer" else "" if wall.confidence >= SURE else "unsure"
        title = (
            f"W{number}: {wall.length:.2f} m, {100 * wall.thickness:.0f} cm thick, {wall.confidence:.0%} sure"
        )
        yield svg_path(wall.polygon, sheet.place, f"wall {kind}".strip(), title)
    yield f'</g><g stroke-width="{1.5 * line:.0f}">'
    for number, door in enumerate(drawing.doors, 1):
        kind = door.layer if tint == "layer" else ""
        title = f"D{number}: {door.kind}, {door.width:.2f} m"
        yield (
            f'<path class="{door.kind} {kind}" d="M{sheet.place(door.start)} L{sheet.place(door.end)}">'
            f"<title>{title}</title></path>"
        )
    yield "</g>"


def _dimension(dimension: Dimension, sheet: Sheet, labels: list[DrawnPoint]) -> Iterator[str]:
    """A line with a stroke across either end and its length, if that fits, away from other labels."""
    words = f"{dimension.length:.2f}"
    if not sheet.fits(words, 0.8 * dimension.length):
        return
    start, end = np.array(dimension.start), np.array(dimension.end)
    unit = (end - start) / dimension.length
    slant = 0.35e-3 * sheet.letters * np.array([unit[0] - unit[1], unit[0] + unit[1]])
    strokes = [(start, end), (start - slant, start + slant), (end - slant, end + slant)]
    data = " ".join(f"M{sheet.place(_point(a))} L{sheet.place(_point(b))}" for a, b in strokes)
    yield f'<path class="dimension" stroke-width="{0.08 * sheet.letters:.0f}" d="{data}"/>'
    shares = sorted(PLACES, key=lambda share: abs(share - 0.5)) if dimension.of == "building" else PLACES
    places = [start + share * (end - start) for share in shares]
    others = np.array(labels).reshape(-1, 2)
    clear = [float(np.hypot(*(others - place).T).min(initial=np.inf)) for place in places]
    enough = 3.0e-3 * sheet.letters
    best = next((k for k, distance in enumerate(clear) if distance >= enough), int(np.argmax(clear)))
    at = _point(places[best])
    labels.append(at)
    yield sheet.text(at, words, "halo size", 1.0, readable_angle(dimension.start, dimension.end))


def _middle(room: DrawnRoom) -> tuple[DrawnPoint, float]:
    """Middle and diameter of the largest circle in a room [m]."""
    circle = shapely.get_coordinates(shapely.maximum_inscribed_circle(room.polygon, tolerance=0.1))
    return _point(circle[0]), 2.0 * float(np.hypot(*(circle[1] - circle[0])))


def _room_label(room: DrawnRoom, at: DrawnPoint, across: float, sheet: Sheet) -> Iterator[str]:
    """Id and area where they fit, else the id alone; it must be found from the table."""
    line, area = 1.1e-3 * sheet.letters, f"{room.area:.1f} m²"
    if sheet.fits(area, across) and 2.2 * line <= across:
        yield sheet.text((at[0], at[1] + 0.5 * line), room.id, "halo")
        yield sheet.text((at[0], at[1] - 0.5 * line), area, "halo")
    else:
        yield sheet.text(at, room.id, "halo", 1.0 if sheet.fits(room.id, across) else 0.7)


def _box(first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, float, float, float]:
    """What holds two boxes (min x, min y, max x, max y)."""
    low = np.minimum(first[:2], second[:2]).tolist()
    high = np.maximum(first[2:], second[2:]).tolist()
    return low[0], low[1], high[0], high[1]


def _between(start: DrawnPoint, end: DrawnPoint) -> DrawnPoint:
    return 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])


def _point(place: np.ndarray) -> DrawnPoint:
    return float(place[0]), float(place[1])
