"""The look of a drawing in pictures and pages: colours, what they mean, and where its words stand."""

from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from slamgym.drawing.drawing import Dimension, Drawing, DrawnPoint, DrawnRoom
from slamgym.viz.canvas import BELIEVED_COLOUR, TRUE_COLOUR, UNSEEN_TINT, WALL_TINT, Colour

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
LEGEND_ROWS = (len(DRAWN_COLOURS) + 1) // 2
LETTER_WIDTH = 0.56
"""Width of a letter in heights."""


def format_part(name: str, /, **values: str) -> str:
    """A file beside this one, with values in the places of their names."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


DRAWING_STYLE = format_part(
    "drawing.css", **{name: f"rgb{colour}" for name, (colour, _) in DRAWN_COLOURS.items()}
)
"""CSS of a drawing's shapes."""
_STEPS = {
    "name": [(0.0, along, left) for left in (1.0, -1.0, 2.3, -2.3, 3.6, -3.6) for along in (-0.5, 0.5, 0.0)],
    "size": [(share, 0.0, 0.0) for share in (-0.25, 0.25, 0.0, 0.4, -0.4)],
    "number": [(share, 0.0, left) for left in (1.0, -1.0, 1.7, -1.7) for share in (0.0, 0.25, -0.25)],
}
"""Places of labels from the middle of their lines: along it in its lengths and in the label's, then to its left."""


class DrawnShape(NamedTuple):
    """A part of a drawing as pictures show it."""

    layer: str
    kind: str
    """Its CSS class, and its name in :data:`DRAWN_COLOURS`; what has none there is white."""
    shape: Polygon | LineString
    title: str = ""


def drawn_shapes(drawing: Drawing) -> Iterator[DrawnShape]:
    """All that is drawn, from the lowest up."""
    yield from (DrawnShape("ROOMS", "room", part) for part in drawing.floor.geoms)
    for room in drawing.rooms:
        kind = "room" if room.layer == "SEEN" else "room INFERRED"
        yield DrawnShape("ROOMS", kind, room.polygon, f"{room.name}: {room.area:.2f} m2")
    yield from (DrawnShape("INFERRED", "unseen", part) for part in drawing.inferred_floor)
    for number, wall in enumerate(drawing.walls, 1):
        sizes = f"{wall.length:.3f} m, {wall.thickness:.3f} m thick, confidence {wall.confidence:.2f}"
        kind = "wall" if wall.layer == "SEEN" else "inferred"
        yield DrawnShape("WALLS", kind, wall.polygon, f"W{number}: {sizes}")
    for number, door in enumerate(drawing.doors, 1):
        title = f"D{number}: {door.kind}, {door.width:.3f} m"
        yield DrawnShape("DOORS", door.kind, LineString([door.start, door.end]), title)


class DrawnLabel(NamedTuple):
    """A line of text around a point."""

    words: str
    kind: str
    """``name`` of a room, ``number`` of a door or ``size``."""
    line: Dimension
    """That it belongs to."""
    at: DrawnPoint = (0.0, 0.0)
    turn: float = 0.0
    """Counter-clockwise [deg]."""

    def tries(self, width: float, height: float, turned: bool) -> Iterator["DrawnLabel"]:
        """The label at its places, best first."""
        (x0, y0), (x1, y1) = self.line.start, self.line.end
        cos, sin = (x1 - x0) / self.line.length, (y1 - y0) / self.line.length
        turn = (float(np.degrees(np.arctan2(sin, cos))) + 89.9) % 180.0 - 89.9
        for share, along, left in _STEPS[self.kind]:
            far, up = share * self.line.length + along * (len(self.words) + 0.5) * width, left * height
            at = 0.5 * (x0 + x1) + far * cos - up * sin, 0.5 * (y0 + y1) + far * sin + up * cos
            yield self._replace(at=at, turn=turn if turned and self.kind == "size" else 0.0)

    def box(self, width: float, height: float) -> BaseGeometry:
        """The rectangle that it takes, with letters of a width and height [m]."""
        x, y = 0.5 * width * len(self.words), 0.65 * height
        return affinity.translate(affinity.rotate(shapely.box(-x, -y, x, y), self.turn, (0, 0)), *self.at)


def place_labels(
    drawing: Drawing, width: float, height: float, turned: bool = True
) -> tuple[list[DrawnLabel], list[Dimension]]:
    """Find places for the names of rooms, the figures of dimension lines and the numbers of doors.

    No two overlap. Each stands at the first of its places that is free, at best of walls and dimension lines, too; one
    that has none is left out, a dimension line with its figure.

    Args:
        drawing: The drawing.
        width: Of a letter [m].
        height: The same.
        turned: If figures lie along their lines.

    Returns:
        The labels, and the dimension lines that are shown.
    """
    lines = [line for line in drawing.dimensions if width * len(f"{line.length:.2f}") <= 0.8 * line.length]
    strokes = shapely.union_all([LineString([line.start, line.end]) for line in lines])
    inside = drawing.floor.difference(strokes.buffer(0.1 * height))
    doors = [Dimension(door.start, door.end, f"D{number}") for number, door in enumerate(drawing.doors, 1)]
    labels: list[DrawnLabel] = []
    taken: list[BaseGeometry] = []
    for label in [
        *(_name(room, width) for room in drawing.rooms),
        *(DrawnLabel(f"{line.length:.2f}", "size", line) for line in lines),
        *(DrawnLabel(line.of, "number", line) for line in doors),
    ]:
        places = [(one, one.box(width, height)) for one in label.tries(width, height, turned)]
        free = [(one, box) for one, box in places if not shapely.intersects(taken, box).any()]
        if free:
            best = min(
                free, key=lambda place: (not inside.covers(place[1]), not drawing.floor.covers(place[1]))
            )
            labels.append(best[0])
            taken.append(best[1])
    return labels, [label.line for label in labels if label.kind == "size"]


def _name(room: DrawnRoom, width: float) -> DrawnLabel:
    """Name and area of a room, around the middle in which its dimension lines cross; the name alone in a small room."""
    (x, y), (x1, y1) = shapely.get_coordinates(shapely.maximum_inscribed_circle(room.polygon, tolerance=0.1))
    words = f"{room.name} {room.area:.1f} m²"
    fits = width * len(words) <= 2.0 * float(np.hypot(x1 - x, y1 - y))
    return DrawnLabel(words if fits else room.name, "name", Dimension((x - 0.5, y), (x + 0.5, y), room.id))
