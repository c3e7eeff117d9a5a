"""The look of a drawing in pictures and pages: colours, what they mean, and where its words stand."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, MultiLineString, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from slamgym.drawing.drawing import Dimension, Drawing, DrawnPoint, DrawnRoom
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    TRUE_COLOUR,
    UNSEEN_TINT,
    WALL_TINT,
    Colour,
    round_length,
)

DRAWN_COLOURS: dict[str, tuple[Colour, str]] = {
    "wall": (WALL_TINT, "wall, seen"),
    "inferred": ((173, 181, 189), "wall, inferred"),
    "unseen": (UNSEEN_TINT, "floor never observed"),
    "door": (TRUE_COLOUR, "door"),
    "opening": ((112, 72, 232), "opening"),
    "dimension": (BELIEVED_COLOUR, "length [m]"),
    "echo": ((232, 89, 12), "occupied in the map"),
}
"""Colours, and what they mean."""
LINES = ("door", "opening", "dimension")
"""What is drawn as lines; the rest are areas."""
LEGEND_ROWS = (len(DRAWN_COLOURS) + 1) // 2
LETTER_WIDTH, KEY_HEIGHT = 0.56, 6.0 + 1.6 * LEGEND_ROWS
"""Width of a letter, and height of the strip with the key, in heights of letters."""
SHEET_MARGIN = 1.0
"""Round the drawing [m]."""


def format_part(name: str, /, **values: str) -> str:
    """A file beside this one, with values in the places of their names."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


DRAWING_STYLE = format_part(
    "drawing.css", **{name: f"rgb{colour}" for name, (colour, _) in DRAWN_COLOURS.items()}
)
"""CSS of a drawing's shapes."""
_STEPS = {
    "name": [
        (0.0, along, left)
        for left in (1.0, -1.0, 2.3, -2.3, 3.6, -3.6)
        for along in (-0.5, 0.5, 0.0)
    ],
    "size": [(share, 0.0, 0.0) for share in (-0.25, 0.25, 0.0, 0.4, -0.4)],
    "number": [
        (share, 0.0, left) for left in (1.0, -1.0, 1.7, -1.7) for share in (0.0, 0.25, -0.25)
    ],
}
"""Places of labels from the middle of their lines: along it in its lengths and in the label's, then to its left."""


class DrawnShape(NamedTuple):
    """A part of a drawing as pictures show it."""

    layer: str
    kind: str
    """Its CSS class, and its name in :data:`DRAWN_COLOURS`; what has none there is white."""
    shape: Polygon | LineString | MultiLineString
    title: str = ""


def drawn_shapes(drawing: Drawing) -> Iterator[DrawnShape]:
    """All that is drawn, from the lowest up."""
    yield from (DrawnShape("ROOMS", "room", part) for part in drawing.floor.geoms)
    for room in drawing.rooms:
        kind = "room" if room.layer == "SEEN" else "room INFERRED"
        yield DrawnShape("ROOMS", kind, room.polygon, f"{room.name}: {room.area:.2f} m2")
    yield from (DrawnShape("INFERRED", "unseen", part) for part in drawing.inferred_floor)
    for number, wall in enumerate(drawing.walls, 1):
        sizes = (
            f"{wall.length:.3f} m, {wall.thickness:.3f} m thick, confidence {wall.confidence:.2f}"
        )
        kind = "wall" if wall.layer == "SEEN" else "inferred"
        yield DrawnShape("WALLS", kind, wall.polygon, f"W{number}: {sizes}")
    for number, door in enumerate(drawing.doors, 1):
        title = f"D{number}: {door.kind}, {door.width:.3f} m"
        yield DrawnShape("DOORS", door.kind, door.line, title)


class DrawnLabel(NamedTuple):
    """A line of text around a point."""

    words: str
    kind: str
    """``name`` of a room, ``number`` of a door, ``size``; ``start`` and ``doubts`` begin at their point."""
    at: DrawnPoint
    turn: float = 0.0
    """Counter-clockwise [deg]."""

    def box(self, letters: float) -> BaseGeometry:
        """The rectangle that it takes, with letters of a height [m]."""
        x, y = 0.5 * LETTER_WIDTH * letters * len(self.words), 0.65 * letters
        return affinity.translate(
            affinity.rotate(shapely.box(-x, -y, x, y), self.turn, (0, 0)), *self.at
        )


class Sheet(NamedTuple):
    """The part of the map's frame that a picture of the drawing shows."""

    left: float
    top: float
    width: float
    height: float
    letters: float
    """Height of letters; all of this in metres of the building."""

    @classmethod
    def of(cls, bounds: Sequence[float], letters: float) -> "Sheet":
        """A sheet for (min x, min y, max x, max y) [m] with a margin, and a strip for its key."""
        min_x, min_y, max_x, max_y = bounds
        width, height = max_x - min_x + 2 * SHEET_MARGIN, max_y - min_y + 2 * SHEET_MARGIN
        return cls(
            min_x - SHEET_MARGIN,
            max_y + SHEET_MARGIN,
            width,
            height + KEY_HEIGHT * letters,
            letters,
        )

    def key(
        self, words: str, doubts: Sequence[str] = ()
    ) -> tuple[list[DrawnShape], list[DrawnLabel]]:
        """What the colours mean, a bar of a round length with words behind it, and the doubts: shapes and labels."""
        size, bottom = self.letters, self.top - self.height
        shapes, labels = [], []
        for number, (kind, (_, meaning)) in enumerate(DRAWN_COLOURS.items()):
            column, row = divmod(number, LEGEND_ROWS)
            x, y = (
                self.left + size * (1.0 + 17.0 * column),
                bottom + size * (4.1 + 1.6 * (LEGEND_ROWS - row)),
            )
            line = LineString([(x, y), (x + 1.2 * size, y)])
            shape = line if kind in LINES else line.buffer(0.45 * size, cap_style="flat")
            shapes.append(DrawnShape("KEY", kind, shape))
            labels.append(DrawnLabel(meaning, "start", (x + 1.6 * size, y)))
        x, y, bar = self.left + size, bottom + 2.5 * size, round_length(0.25 * self.width)
        ticks = LineString([(x, y + 0.5 * size), (x, y), (x + bar, y), (x + bar, y + 0.5 * size)])
        shapes.append(DrawnShape("SCALE", "bar", ticks))
        labels.append(
            DrawnLabel(f"{bar:g} m{words}", "start", (x + bar + 0.5 * size, y + 0.35 * size))
        )
        if doubts:
            labels.append(DrawnLabel("; ".join(doubts), "doubts", (x, bottom + size)))
        return shapes, labels


def drawn_scene(
    drawing: Drawing, sheet: Sheet, words: str, doubts: Sequence[str] = (), turned: bool = True
) -> tuple[list[DrawnShape], list[DrawnLabel]]:
    """All that a sheet shows: shapes from the lowest up, and labels.

    Args:
        drawing: The drawing.
        sheet: Where it lies.
        words: Behind the scale bar.
        doubts: Below it.
        turned: If figures lie along their lines.
    """
    labels, lines = place_labels(drawing, sheet.letters, turned)
    shapes = list(drawn_shapes(drawing))
    for line in lines:
        start, end = np.array(line.start), np.array(line.end)
        unit = (end - start) / line.length
        slant = 0.35 * sheet.letters * np.array([unit[0] - unit[1], unit[0] + unit[1]])
        strokes = [(start, end), (start - slant, start + slant), (end - slant, end + slant)]
        shapes.append(DrawnShape("DIMENSIONS", "dimension", MultiLineString(strokes)))
    key, texts = sheet.key(words, doubts)
    return [*shapes, *key], [*labels, *texts]


def place_labels(
    drawing: Drawing, letters: float, turned: bool = True
) -> tuple[list[DrawnLabel], list[Dimension]]:
    """Find places for the names of rooms, the figures of dimension lines and the numbers of doors.

    No two overlap. Each stands at the first of its places that is free, at best of walls and dimension lines, too; one
    that has none is left out, a dimension line with its figure.

    Args:
        drawing: The drawing.
        letters: Their height [m].
        turned: If figures lie along their lines.

    Returns:
        The labels, and the dimension lines that are shown.
    """
    width = LETTER_WIDTH * letters
    lines = [
        line
        for line in drawing.dimensions
        if width * len(f"{line.length:.2f}") <= 0.8 * line.length
    ]
    strokes = shapely.union_all([line.line for line in lines])
    floor, inside = drawing.floor, drawing.floor.difference(strokes.buffer(0.1 * letters))
    doors = [
        Dimension(door.start, door.end, f"D{number}")
        for number, door in enumerate(drawing.doors, 1)
    ]
    labels, shown, taken = list[DrawnLabel](), list[Dimension](), list[BaseGeometry]()
    for words, kind, line in [
        *(_name(room, width) for room in drawing.rooms),
        *((f"{line.length:.2f}", "size", line) for line in lines),
        *((line.of, "number", line) for line in doors),
    ]:
        tried = [
            (label, label.box(letters)) for label in _tries(words, kind, line, letters, turned)
        ]
        free = [place for place in tried if not shapely.intersects(taken, place[1]).any()]
        if free:
            # At best it covers neither lines nor walls, at second best no walls.
            label, box = min(
                free, key=lambda place: (not inside.covers(place[1]), not floor.covers(place[1]))
            )
            labels.append(label)
            taken.append(box)
            shown += [line] * (kind == "size")
    return labels, shown


def _tries(
    words: str, kind: str, line: Dimension, letters: float, turned: bool
) -> Iterator[DrawnLabel]:
    """A label of a line at its places, best first."""
    (x0, y0), (x1, y1) = line.start, line.end
    cos, sin = (x1 - x0) / line.length, (y1 - y0) / line.length
    turn = (float(np.degrees(np.arctan2(sin, cos))) + 89.9) % 180.0 - 89.9
    for share, along, left in _STEPS[kind]:
        far = share * line.length + along * (len(words) + 0.5) * LETTER_WIDTH * letters
        up = left * letters
        at = 0.5 * (x0 + x1) + far * cos - up * sin, 0.5 * (y0 + y1) + far * sin + up * cos
        yield DrawnLabel(words, kind, at, turn if turned and kind == "size" else 0.0)


def _name(room: DrawnRoom, width: float) -> tuple[str, str, Dimension]:
    """Name and area of a room, around the middle in which its dimension lines cross; the name alone in a small room."""
    (x, y), (x1, y1) = shapely.get_coordinates(
        shapely.maximum_inscribed_circle(room.polygon, tolerance=0.1)
    )
    words = f"{room.name} {room.area:.1f} m²"
    fits = width * len(words) <= 2.0 * float(np.hypot(x1 - x, y1 - y))
    return words if fits else room.name, "name", Dimension((x - 0.5, y), (x + 0.5, y), room.id)
