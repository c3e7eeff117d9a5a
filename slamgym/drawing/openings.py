"""Doors and rooms: which of the likely boundaries part the floor.

All candidates (:mod:`slamgym.drawing.boundaries`) that don't cross surer ones cut the free space into parts. Parts are
then joined as long as that lowers the energy, the sum of the log odds of the boundaries that are kept: greedy additive
edge contraction for the multicut of a graph (Keuper et al., *Efficient decomposition of image and mesh graphs by lifted
multicuts*, 2015). All boundaries between two rooms count together, so two rooms that three doubtful lines part are
joined, and loops are closed or open as a whole.

Rooms that were only partly seen, by rays through a door, a window or a pane, end where the rays end, not at walls. They
are neither rooms nor floor whose size is known: a drawing shows them as unexplored, behind their doors.
"""

import heapq
import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray
from slamgym.drawing.boundaries import (
    WIDEST,
    boundary_log_odds,
    candidates,
    cross,
    first_of,
    line_widths,
)
from slamgym.drawing.evidence import STEP, Evidence
from slamgym.drawing.settings import DRAWN_DOORS, SMALLEST_ROOM
from slamgym.drawing.walls import WallPiece
from slamgym.metrics.layers import MapLayers

INTO_WALLS = 0.02
"""Lines of doors are drawn so far into the walls, so that they cut [m]."""
LEAST_LOG_ODDS = -3.0
"""Lines that are less likely are no candidates."""
ONE_PASSAGE = 0.35
"""Two lines whose middles are nearer than this share of the narrower one's width lie across one passage."""
FITTED = 0.5
"""The jambs of a drawn door lie at most so far from those that were seen [m]."""
OPEN_ROOM = 0.5
"""A room was partly seen if less than this share of its outline, doors left out, was seen as walls."""
MOST_UNEXPLORED = 0.25
"""Where more of the floor would go, the map just shows few walls."""
ON_LINE = 0.06
"""Faces so near to the line of a door to an unexplored part are no walls: none was seen there [m]. Corners so near to
its end are jambs."""


@dataclass(frozen=True)
class Gap:
    """A line across the floor from face to face."""

    start: tuple[float, float]
    end: tuple[float, float]
    log_odds: float = math.inf
    """How likely it is a boundary between two rooms."""
    kind: Literal["", "door", "opening"] = ""
    """If a person says it; else the width does."""

    @property
    def line(self) -> LineString:
        """From face to face."""
        return LineString([self.start, self.end])

    @property
    def width(self) -> float:
        """[m]."""
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])

    @property
    def cut(self) -> LineString:
        """A little longer than the line."""
        return lengthened(self.line, INTO_WALLS, INTO_WALLS)


@dataclass(frozen=True)
class Division:
    """The floor cut into rooms."""

    rooms: tuple[Polygon, ...]
    doors: tuple[Gap, ...]
    joins: tuple[tuple[int, int], ...]
    """The two rooms of each door, by their numbers."""


def lengthened(line: BaseGeometry, before: float, after: float) -> LineString:
    """A straight line made longer at its ends [m]."""
    (x0, y0), (x1, y1) = line.coords
    dx, dy = (x1 - x0) / line.length, (y1 - y0) / line.length
    return LineString([(x0 - before * dx, y0 - before * dy), (x1 + after * dx, y1 + after * dy)])


def likely_gaps(floor: MultiPolygon, seen: BoolArray, layers: MapLayers, frame: GridFrame) -> list[Gap]:
    """Boundaries that are likely enough, none of which crosses or repeats a likelier one.

    Args:
        floor: The free space with straight edges [m].
        seen: The same as cells.
        layers: What the model says of these cells.
        frame: Where they lie.
    """
    lines, signs = candidates(floor, seen, layers, frame)
    odds = boundary_log_odds(signs)
    order = np.argsort(-odds, kind="stable")
    order = order[odds[order] >= LEAST_LOG_ODDS]
    lines, odds = lines[order], odds[order]
    stays = first_of(len(lines), *_rivals(lines))
    return [
        Gap((x0, y0), (x1, y1), value)
        for ((x0, y0), (x1, y1)), value in zip(lines[stays].tolist(), odds[stays].tolist(), strict=True)
    ]


def _rivals(lines: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of lines that lie across one passage, or cross: the numbers of the first ones and of the second."""
    width = line_widths(lines)
    shapes = np.asarray(shapely.linestrings(lines))
    first, second = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=ONE_PASSAGE * WIDEST)
    first, second = first[first < second], second[first < second]
    one, other = lines[first], lines[second]
    apart = np.hypot(*(one.mean(axis=1) - other.mean(axis=1)).T)
    narrow = np.maximum(DRAWN_DOORS[0], np.minimum(width[first], width[second]))

    def parts(line: FloatArray, ends: FloatArray) -> BoolArray:
        sides = [cross(line[:, 1] - line[:, 0], ends[:, k] - line[:, 0]) for k in (0, 1)]
        return np.asarray(sides[0] * sides[1] < -1e-6)

    is_rival = (apart < ONE_PASSAGE * narrow) | (parts(one, other) & parts(other, one))
    return first[is_rival], second[is_rival]


def divide(floor: MultiPolygon, gaps: Sequence[Gap]) -> Division:
    """Choose the boundaries that part a floor into rooms.

    Args:
        floor: With straight edges [m].
        gaps: Likely boundaries; one with infinite log odds is kept wherever it parts the floor.
    """
    parts = _cut(floor, gaps)
    room = _joined(parts, gaps)
    kept = [
        gap
        for gap, (a, b) in zip(gaps, joined_rooms(parts, gaps), strict=True)
        if min(a, b) >= 0 and room[a] != room[b]
    ]
    rooms = _cut(floor, kept)
    rooms.sort(key=lambda part: (-round(part.centroid.y, 3), part.centroid.x))
    doors = [
        (gap, pair)
        for gap, pair in zip(kept, joined_rooms(rooms, kept), strict=True)
        if min(pair) >= 0 and pair[0] != pair[1]
    ]
    return Division(tuple(rooms), tuple(gap for gap, _ in doors), tuple(pair for _, pair in doors))


def _joined(parts: Sequence[Polygon], gaps: Sequence[Gap]) -> list[int]:
    """The room of each part: a number that all parts of a room share."""
    room = list(range(len(parts)))
    area = [part.area for part in parts]
    odds: list[dict[int, float]] = [defaultdict(float) for _ in parts]
    for gap, (a, b) in zip(gaps, joined_rooms(parts, gaps), strict=True):
        if min(a, b) >= 0 and a != b:
            odds[a][b] += gap.log_odds
            odds[b][a] += gap.log_odds

    def costs(a: int) -> Iterator[tuple[bool, float, int, int]]:
        # What is too small for a room is a niche, whatever stands before it.
        for b, value in odds[a].items():
            yield min(area[a], area[b]) >= SMALLEST_ROOM, value, min(a, b), max(a, b)

    queue = [cost for a in range(len(parts)) for cost in costs(a)]
    heapq.heapify(queue)
    while queue and queue[0][:2] < (True, 0.0):
        cost = heapq.heappop(queue)
        first, second = cost[2:]
        if cost not in costs(first):  # an entry from before one of them grew
            continue
        area[first] += area[second]
        del odds[first][second], odds[second][first]
        for other, value in odds[second].items():
            odds[first][other] += value
            odds[other][first] += value
            del odds[other][second]
        odds[second] = {}
        room[second] = first
        for cost in costs(first):
            heapq.heappush(queue, cost)
    for number in range(len(parts)):  # a room's number is that of one of its parts
        while room[number] != room[room[number]]:
            room[number] = room[room[number]]
    return room


def _cut(floor: MultiPolygon, gaps: Sequence[Gap]) -> list[Polygon]:
    """The parts of the floor between the lines of the gaps."""
    if not gaps:
        return polygon_parts(floor)
    shapely.prepare(floor)
    lines = shapely.union_all([floor.boundary, *(gap.cut for gap in gaps)], grid_size=1e-5)
    return [
        part
        for part in shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
        if part.area > 1e-4 and floor.contains(part.representative_point())
    ]


def joined_rooms(parts: Sequence[Polygon], gaps: Sequence[Gap]) -> list[tuple[int, int]]:
    """Which part of a floor lies on either side of each gap; -1 for none."""
    tree = shapely.STRtree(list(parts))
    found = []
    for gap in gaps:
        (x0, y0), (x1, y1) = gap.start, gap.end
        normal = np.array([y0 - y1, x1 - x0]) / gap.width
        middle = 0.5 * np.array([x0 + x1, y0 + y1])
        sides = []
        for sign in (1.0, -1.0):
            # Beside a line that lies close along a wall, a step may end in the wall.
            points = [Point(*(middle + sign * step * normal)) for step in (0.01, 0.03, 0.06, 0.12)]
            hits = [tree.query(point, predicate="intersects") for point in points]
            sides.append(next((int(hit[0]) for hit in hits if len(hit)), -1))
        found.append((sides[0], sides[1]))
    return found


def onto_faces(gap: Gap, floor: MultiPolygon) -> Gap:
    """A boundary whose ends lie on the faces that were drawn, at corners if there are some."""
    ends, corners = [], shapely.extract_unique_points(floor)
    for point in (gap.start, gap.end):
        line = shapely.shortest_line(corners, Point(point))
        if line.length > ON_LINE:
            line = shapely.shortest_line(floor.boundary, Point(point))
        x, y = line.coords[0] if line.length <= FITTED else point
        ends.append((float(x), float(y)))
    return replace(gap, start=ends[0], end=ends[1]) if ends[0] != ends[1] else gap


@dataclass(frozen=True)
class Explored:
    """A floor without what was only partly seen."""

    floor: MultiPolygon
    division: Division
    """A door to an unexplored part joins its room to -1."""
    walled: tuple[float, ...]
    """Share of each room's outline, without doors, that was seen as walls."""
    unexplored: tuple[Polygon, ...]


def explore(floor: MultiPolygon, division: Division, evidence: Evidence, sure: Collection[int]) -> Explored:
    """Take rooms that were only partly seen from a floor.

    Without this rule room F1 of real maps falls by 0.008.

    Args:
        floor: With straight edges [m].
        division: Its rooms.
        evidence: The map.
        sure: Numbers of rooms that stay in any case.
    """
    rooms = division.rooms
    near_doors = shapely.union_all([gap.line for gap in division.doors]).buffer(2.0 * STEP)
    walled = [max(evidence.share_walled(room, near_doors), k in sure) for k, room in enumerate(rooms)]
    kept = [k for k, share in enumerate(walled) if share >= OPEN_ROOM]
    unexplored = tuple(room for room, share in zip(rooms, walled, strict=True) if share < OPEN_ROOM)
    left_out = sum(float(room.area) for room in unexplored)
    if not unexplored or left_out > MOST_UNEXPLORED * floor.area:
        return Explored(floor, division, tuple(walled), ())
    number = {old: new for new, old in enumerate(kept)}
    doors = [
        (gap, (number.get(a, -1), number.get(b, -1)))
        for gap, (a, b) in zip(division.doors, division.joins, strict=True)
        if a in number or b in number
    ]
    explored = Division(
        tuple(rooms[k] for k in kept),
        tuple(gap for gap, _ in doors),
        tuple(pair for _, pair in doors),
    )
    rest = floor.difference(shapely.union_all(list(unexplored)).buffer(1e-4)).simplify(2e-3)
    shown = MultiPolygon([part for part in polygon_parts(rest) if part.area > 1e-2])
    return Explored(shown, explored, tuple(walled[k] for k in kept), unexplored)


def without_walls_in_doors(pieces: list[WallPiece], division: Division) -> list[WallPiece]:
    """Walls without the faces that stand in the doors to unexplored parts."""
    doors = [gap.line for gap, pair in zip(division.doors, division.joins, strict=True) if min(pair) < 0]
    shut = shapely.union_all(doors).buffer(ON_LINE)
    return [piece for piece in pieces if not shut.covers(shapely.LineString([piece.start, piece.end]))]
