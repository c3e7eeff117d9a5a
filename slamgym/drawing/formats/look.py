"""The look of a drawing in pictures and pages: colours, what they mean, and where its words stand."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, MultiLineString, Polygon

from slamgym.cad.floorplan import polygon_edges
from slamgym.core.types import IntArray
from slamgym.drawing.drawing import Dimension, Drawing, DrawnPoint, DrawnRoom
from slamgym.drawing.settings import MARGIN
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
    "glass": ((77, 171, 247), "glass, as a person says"),
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
"""Of the key, which has two columns."""
LETTER_WIDTH = 0.56
"""Width of a letter [heights of letters]."""
KEY_HEIGHT = 6.0 + 1.6 * LEGEND_ROWS
"""Height of the strip with the key [heights of letters]."""


def format_part(name: str, values: Mapping[str, str] | None = None) -> str:
    """A file beside this one, with values in the places of their names."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


DRAWING_STYLE = format_part(
    "drawing.css", {name: f"rgb{colour}" for name, (colour, _) in DRAWN_COLOURS.items()}
)
"""CSS of a drawing's shapes."""


class _Step(NamedTuple):
    """A place of a label from the middle of its line."""

    share: float
    """Along the line, in its lengths."""
    along: float
    """Along the line too, in the label's lengths."""
    left: float
    """To the left of the line, in heights of letters."""


_STEPS = {
    "name": [
        _Step(0.0, along, left)
        for left in (1.0, -1.0, 2.3, -2.3, 3.6, -3.6)
        for along in (-0.5, 0.5, 0.0)
    ],
    "size": [_Step(share, 0.0, 0.0) for share in (-0.25, 0.25, 0.0, 0.4, -0.4)],
    "number": [
        _Step(share, 0.0, left) for left in (1.0, -1.0, 1.7, -1.7) for share in (0.0, 0.25, -0.25)
    ],
}
"""Places of labels by their kind, the best first."""


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
        kind = "glass" if wall.is_glass else "wall" if wall.layer == "SEEN" else "inferred"
        layer = "GLASS" if wall.is_glass else "WALLS"
        yield DrawnShape(layer, kind, wall.polygon, f"W{number}: {sizes}")
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
        height = max_y - min_y + 2 * MARGIN
        return cls(
            left=min_x - MARGIN,
            top=max_y + MARGIN,
            width=max_x - min_x + 2 * MARGIN,
            height=height + KEY_HEIGHT * letters,
            letters=letters,
        )

    def key(
        self, words: str, doubts: Sequence[str] = ()
    ) -> tuple[list[DrawnShape], list[DrawnLabel]]:
        """What the colours mean, a bar of a round length with words, and the first doubt: shapes and labels."""
        size = self.letters
        bottom = self.top - self.height
        shapes = []
        labels = []
        for number, (kind, (_, meaning)) in enumerate(DRAWN_COLOURS.items()):
            column, row = divmod(number, LEGEND_ROWS)
            x = self.left + size * (1.0 + 17.0 * column)
            y = bottom + size * (4.1 + 1.6 * (LEGEND_ROWS - row))
            line = LineString([(x, y), (x + 1.2 * size, y)])
            shape = line if kind in LINES else line.buffer(0.45 * size, cap_style="flat")
            shapes.append(DrawnShape("KEY", kind, shape))
            labels.append(DrawnLabel(meaning, "start", (x + 1.6 * size, y)))
        x = self.left + size
        y = bottom + 2.5 * size
        bar = round_length(0.25 * self.width)
        end = x + bar
        tick = y + 0.5 * size
        ticks = LineString([(x, tick), (x, y), (end, y), (end, tick)])
        shapes.append(DrawnShape("SCALE", "bar", ticks))
        beside = (end + 0.5 * size, y + 0.35 * size)
        labels.append(DrawnLabel(f"{bar:g} m{words}", "start", beside))
        if doubts:
            more = f" (and {len(doubts) - 1} more: see the report)" if len(doubts) > 1 else ""
            labels.append(DrawnLabel(f"{doubts[0]}{more}", "doubts", (x, bottom + size)))
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
    with_ticks = [_with_ticks(line, sheet.letters) for line in lines]
    dimensions = [DrawnShape("DIMENSIONS", "dimension", shape) for shape in with_ticks]
    key, texts = sheet.key(words, doubts)
    return [*drawn_shapes(drawing), *dimensions, *key], [*labels, *texts]


def _with_ticks(line: Dimension, letters: float) -> MultiLineString:
    """A dimension line with a slanted stroke at each end."""
    start = np.array(line.start)
    end = np.array(line.end)
    x, y = (end - start) / line.length
    slant = 0.35 * letters * np.array([x - y, x + y])
    first_tick = (start - slant, start + slant)
    last_tick = (end - slant, end + slant)
    return MultiLineString([(start, end), first_tick, last_tick])


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
    lines = [line for line in drawing.dimensions if width * len(_figure(line)) <= 0.8 * line.length]
    wanted = [_name(room, width) for room in drawing.rooms]
    wanted += [_Wanted(_figure(line), "size", line) for line in lines]
    for number, door in enumerate(drawing.doors, 1):
        name = f"D{number}"
        wanted.append(_Wanted(name, "number", Dimension(door.start, door.end, name)))
    tries = [list(_tries(one, letters, turned)) for one in wanted]
    labels = list(itertools.chain(*tries))
    boxes = label_boxes(labels, letters)
    strokes = shapely.STRtree([line.line for line in lines])
    crossing = strokes.query(boxes, "dwithin", 0.1 * letters)[0]
    # 0 on clear floor, 1 across a line, 2 over a wall, 3 where another label stands.
    rank = np.full(len(boxes), 2)
    clear = _on_floor(drawing, boxes)
    rank[clear] = 0
    rank[np.intersect1d(clear, crossing)] = 1
    tree = shapely.STRtree(boxes)
    placed = list[DrawnLabel]()
    shown = list[Dimension]()
    ends = np.cumsum([len(own) for own in tries])
    for one, own in zip(wanted, np.split(np.arange(len(boxes)), ends[:-1]), strict=False):
        best = own[rank[own].argmin()]
        if rank[best] > 2:
            continue
        rank[tree.query(boxes[best], "intersects")] = 3
        placed.append(labels[best])
        if one.kind == "size":
            shown.append(one.line)
    return placed, shown


def _on_floor(drawing: Drawing, boxes: NDArray[np.object_]) -> IntArray:
    """Numbers of the rectangles that lie on floor whole: no face of a wall meets them, and a room has their middles.

    Trees of faces and of rooms: GEOS's own index of a floor is by y alone, so a row of rooms would be searched whole.
    """
    faces = shapely.STRtree(np.asarray(shapely.linestrings(polygon_edges(drawing.floor))))
    rooms = shapely.STRtree([room.polygon for room in drawing.rooms])
    inside = rooms.query(shapely.centroid(boxes), "intersects")[0]
    return np.setdiff1d(inside, faces.query(boxes, "intersects")[0])


def label_boxes(labels: Sequence[DrawnLabel], letters: float) -> NDArray[np.object_]:
    """The rectangles that labels take, with letters of a height [m]."""
    at = np.array([label.at for label in labels]).reshape(-1, 2) @ (1.0, 1j)
    turn = np.exp(1j * np.radians([label.turn for label in labels]))
    across = 0.5 * LETTER_WIDTH * letters * np.array([len(label.words) for label in labels])
    up = 0.65j * letters
    corners = np.stack([across + up, up - across, -across - up, across - up]) * turn + at
    return np.asarray(shapely.polygons(np.stack([corners.real.T, corners.imag.T], axis=2)))


class _Wanted(NamedTuple):
    """Words that belong to a line."""

    words: str
    kind: str
    """As that of :class:`DrawnLabel`."""
    line: Dimension


def _figure(line: Dimension) -> str:
    """What stands at a dimension line."""
    return f"{line.length:.2f}"


def _tries(wanted: _Wanted, letters: float, turned: bool) -> Iterator[DrawnLabel]:
    """A label of a line at its places, best first."""
    line = wanted.line
    x0, y0 = line.start
    x1, y1 = line.end
    cos = (x1 - x0) / line.length
    sin = (y1 - y0) / line.length
    turn = 0.0
    if turned and wanted.kind == "size":
        along = float(np.degrees(np.arctan2(sin, cos)))
        turn = (along + 89.9) % 180.0 - 89.9
    for step in _STEPS[wanted.kind]:
        in_letters = step.along * (len(wanted.words) + 0.5)
        far = step.share * line.length + in_letters * LETTER_WIDTH * letters
        up = step.left * letters
        x = 0.5 * (x0 + x1) + far * cos - up * sin
        y = 0.5 * (y0 + y1) + far * sin + up * cos
        yield DrawnLabel(wanted.words, wanted.kind, (x, y), turn)


def _name(room: DrawnRoom, width: float) -> _Wanted:
    """Name and area of a room, around the middle in which its dimension lines cross; the name alone in a small room."""
    radius = shapely.maximum_inscribed_circle(room.polygon, tolerance=0.1)
    (x, y), (x1, y1) = shapely.get_coordinates(radius)
    words = f"{room.name} {room.area:.1f} m²"
    diameter = 2.0 * float(np.hypot(x1 - x, y1 - y))
    fits = width * len(words) <= diameter
    line = Dimension((x - 0.5, y), (x + 0.5, y), room.id)
    return _Wanted(words if fits else room.name, "name", line)
