"""Doors and rooms: which of the likely boundaries part the floor.

All candidates (:mod:`slamgym.drawing.boundaries`) that don't cross surer ones cut the free space into parts. Parts are
then joined as long as that lowers the energy, the sum of the log odds of the boundaries that are kept: greedy additive
edge contraction for the multicut of a graph (Keuper et al., *Efficient decomposition of image and mesh graphs by lifted
multicuts*, 2015). All boundaries between two rooms count together, so two rooms that three doubtful lines part are
joined, and loops are closed or open as a whole.
"""

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import polygon_edges
from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import FloatArray, IntArray
from slamgym.drawing.boundaries import WIDEST, line_widths
from slamgym.drawing.drawing import Segment
from slamgym.drawing.settings import DRAWN_DOORS, SAME_PLACE, SMALLEST_ROOM, THICKEST_WALL

AT_JAMB = 0.06
"""Corners so near to the end of a door's line are its jambs [m]: half of a thin wall. With 0.1 doors in exact floors
are 5 cm off, without it they end in the middle of their walls."""
DOUBTFUL = 2.0
"""Boundaries are doubtful if their log odds are no farther from even; lines that are less likely are none."""
ONE_PASSAGE = 0.35
"""Two lines whose middles are nearer than this share of the narrower one's width lie across one passage. Without this
rule drawings of 30 maps of real robots have 137 false doors, with it 14."""


@dataclass(frozen=True)
class Gap(Segment):
    """A line across the floor from face to face."""

    log_odds: float = math.inf
    """How likely it is a boundary between two rooms."""
    kind: Literal["", "door", "opening"] = ""
    """If a person says it; else the width does."""

    @property
    def cut(self) -> LineString:
        """A little longer than the line."""
        return lengthened(self.line, SAME_PLACE, SAME_PLACE)


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
    dx = (x1 - x0) / line.length
    dy = (y1 - y0) / line.length
    start = (x0 - before * dx, y0 - before * dy)
    end = (x1 + after * dx, y1 + after * dy)
    return LineString([start, end])


def likely_gaps(lines: FloatArray, odds: FloatArray) -> list[Gap]:
    """The lines that are likely and no likelier one crosses or repeats.

    Args:
        lines: Candidates for boundaries, (N, 2, 2) [m].
        odds: Their log odds, (N,).
    """
    order = np.argsort(-odds, kind="stable")
    order = order[odds[order] >= -DOUBTFUL]
    lines = lines[order]
    odds = odds[order]
    stays = np.ones(len(lines), np.bool_)
    rivals = _rivals(lines).T.tolist()
    for likelier, other in sorted(rivals):
        stays[other] &= not stays[likelier]
    gaps = []
    for index in np.flatnonzero(stays):
        (x0, y0), (x1, y1) = lines[index].tolist()
        gaps.append(Gap((x0, y0), (x1, y1), float(odds[index])))
    return gaps


def _rivals(lines: FloatArray) -> IntArray:
    """Pairs of lines that lie across one passage, or cross: the numbers of both, (2, P), the lower first."""
    width = line_widths(lines)
    middle = np.asarray(shapely.points(lines.mean(axis=1)))
    farthest = ONE_PASSAGE * WIDEST
    near = shapely.STRtree(middle).query(middle, predicate="dwithin", distance=farthest)
    narrow = np.maximum(DRAWN_DOORS[0], width[near].min(axis=0))
    is_one_passage = shapely.distance(*middle[near]) < ONE_PASSAGE * narrow
    shapes = np.asarray(shapely.linestrings(lines))
    crossing = shapely.STRtree(shapes).query(shapes, predicate="crosses")
    both = np.hstack([near[:, is_one_passage], crossing])
    return both[:, both[0] < both[1]]


def divide(floor: MultiPolygon, gaps: Sequence[Gap]) -> Division:
    """Choose the boundaries that part a floor into rooms.

    Args:
        floor: With straight edges [m].
        gaps: Likely boundaries; one with infinite log odds is kept wherever it parts the floor.
    """
    parts = cut_floor(floor, gaps)
    sides = joined_rooms(parts, gaps)
    areas = np.array([part.area for part in parts])
    odds = np.array([gap.log_odds for gap in gaps])
    room = _joined(areas, sides, odds)
    kept = []
    for gap, (a, b) in zip(gaps, sides, strict=True):
        if min(a, b) >= 0 and room[a] != room[b]:
            kept.append(gap)
    rooms = cut_floor(floor, kept)
    rooms.sort(key=_from_top_left)
    doors = []
    joins = []
    sides = joined_rooms(rooms, kept)
    for gap, (a, b) in zip(kept, sides.tolist(), strict=True):
        if min(a, b) >= 0 and a != b:
            doors.append(gap)
            joins.append((a, b))
    return Division(tuple(rooms), tuple(doors), tuple(joins))


def _from_top_left(part: Polygon) -> tuple[float, float]:
    """Key that orders rooms line by line."""
    centre = part.centroid
    return -round(centre.y, 3), centre.x


def _joined(area: FloatArray, pairs: IntArray, odds: FloatArray) -> list[int]:
    """The room of each part: a number that all parts of a room share.

    Args:
        area: Of the parts, (N,) [m2].
        pairs: The parts on both sides of each boundary, (G, 2); -1 for none.
        odds: Log odds of the boundaries, (G,).
    """
    graph = _PartGraph(area.tolist())
    for (a, b), boundary_odds in zip(pairs.tolist(), odds.tolist(), strict=True):
        if min(a, b) >= 0 and a != b:
            graph.connect(a, b, boundary_odds)
    graph.join_all()
    return [graph.room_of(part) for part in range(len(area))]


class _PartGraph:
    """Parts of a floor, and the log odds of all boundaries between two of them; the parts are joined to rooms.

    The next pair comes from a queue: an office of a thousand rooms takes ten times as long as one of a hundred.
    """

    def __init__(self, area: list[float]) -> None:
        self._area = area
        self._odds: list[dict[int, float]] = [{} for _ in area]
        self._room = list(range(len(area)))
        self._queue: list[tuple[bool, float, int, int]] = []

    def connect(self, a: int, b: int, odds: float) -> None:
        """Add a boundary between two parts."""
        total = self._odds[a].get(b, 0.0) + odds
        self._odds[a][b] = total
        self._odds[b][a] = total

    def room_of(self, part: int) -> int:
        """The part whose number stands for the room of a part."""
        while self._room[part] != part:
            self._room[part] = self._room[self._room[part]]
            part = self._room[part]
        return part

    def join_all(self) -> None:
        """Join two parts, the least likely boundary first, as long as that lowers the energy."""
        for part, around in enumerate(self._odds):
            self._enqueue(part, [other for other in around if other > part])
        while self._queue:
            is_room, odds, a, b = heapq.heappop(self._queue)
            is_of_now = self._odds[a].get(b) == odds and self._is_room(a, b) == is_room
            if is_of_now and (odds < 0.0 or not is_room):
                self._join(a, b)

    def _is_room(self, a: int, b: int) -> bool:
        # What is too small for a room is a niche, whatever stands before it.
        return min(self._area[a], self._area[b]) >= SMALLEST_ROOM

    def _enqueue(self, part: int, others: Iterable[int]) -> None:
        for other in others:
            a, b = sorted((part, other))
            entry = (self._is_room(a, b), self._odds[a][b], a, b)
            heapq.heappush(self._queue, entry)

    def _join(self, a: int, b: int) -> None:
        """Make two parts one, under the number of the one with more neighbours."""
        if len(self._odds[a]) < len(self._odds[b]):
            a, b = b, a
        was_niche = self._area[a] < SMALLEST_ROOM
        self._room[b] = a
        self._area[a] += self._area[b]
        moved = self._odds[b]
        self._odds[b] = {}
        del self._odds[a][b], moved[a]
        for other, odds in moved.items():
            del self._odds[other][b]
            self.connect(a, other, odds)
        self._enqueue(a, self._odds[a] if was_niche else moved)


def cut_floor(floor: MultiPolygon, gaps: Sequence[Gap]) -> list[Polygon]:
    """The parts of the floor between the lines of the gaps."""
    if not gaps:
        return polygon_parts(floor)
    shapely.prepare(floor)
    cuts = [gap.cut for gap in gaps]
    lines = shapely.union_all([floor.boundary, *cuts], grid_size=1e-5)
    polygons = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    parts = [part for part in polygons if part.area > 1e-4]
    return [part for part in parts if floor.contains(part.representative_point())]


def joined_rooms(parts: Sequence[Polygon], gaps: Sequence[Gap]) -> IntArray:
    """Which part of a floor lies on either side of each gap, (G, 2); -1 for none."""
    pairs = [(gap.start, gap.end) for gap in gaps]
    ends = np.array(pairs).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    normal = along[:, ::-1] * (-SAME_PLACE, SAME_PLACE)
    aside = normal / line_widths(ends)[:, None]
    middles = ends.mean(axis=1)
    beside = middles[None] + np.stack([aside, -aside])
    places = shapely.points(beside)
    tree = shapely.STRtree(list(parts))
    sides = np.full(places.shape, -1)
    for side, row in zip(places, sides, strict=True):
        place, part = tree.query(side, predicate="intersects")
        row[place] = part
    return sides.T


def onto_faces(gaps: Sequence[Gap], floor: MultiPolygon) -> list[Gap]:
    """Boundaries whose ends lie on the faces that were drawn, at corners if there are some.

    An end far from all faces stays where it is.
    """
    ends = [(gap.start, gap.end) for gap in gaps]
    if not ends:
        return []
    fitted = _nearest_on_faces(np.array(ends).reshape(-1, 2), floor).reshape(-1, 2, 2)
    moved = []
    for gap, ((start_x, start_y), (end_x, end_y)) in zip(gaps, fitted.tolist(), strict=True):
        start = (start_x, start_y)
        end = (end_x, end_y)
        has_length = start != end
        moved.append(replace(gap, start=start, end=end) if has_length else gap)
    return moved


def _nearest_on_faces(ends: FloatArray, floor: MultiPolygon) -> FloatArray:
    """The corners at points (N, 2), or else the nearest places on faces; points far from both stay."""
    edges = polygon_edges(floor)
    fitted = ends.copy()
    faces = np.asarray(shapely.linestrings(edges))
    corners = np.asarray(shapely.points(edges[:, 0]))
    points = np.asarray(shapely.points(ends))
    for shapes, most in ((faces, THICKEST_WALL), (corners, AT_JAMB)):
        tree = shapely.STRtree(shapes)
        end, found = tree.query_nearest(points, max_distance=most, all_matches=False)
        lines = shapely.shortest_line(tree.geometries[found], points[end])
        fitted[end] = shapely.get_coordinates(lines).reshape(-1, 2, 2)[:, 0]
    return fitted
