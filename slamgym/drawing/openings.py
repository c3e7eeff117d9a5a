"""Doors and rooms: which of the likely boundaries part the floor.

All candidates (:mod:`slamgym.drawing.boundaries`) that don't cross surer ones cut the free space into parts. Parts are
then joined as long as that lowers the energy, the sum of the log odds of the boundaries that are kept: greedy additive
edge contraction for the multicut of a graph (Keuper et al., *Efficient decomposition of image and mesh graphs by lifted
multicuts*, 2015). All boundaries between two rooms count together, so two rooms that three doubtful lines part are
joined, and loops are closed or open as a whole.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray
from slamgym.drawing.boundaries import WIDEST, boundary_log_odds, candidates, line_widths
from slamgym.drawing.drawing import DrawnPoint, Segment
from slamgym.drawing.settings import DRAWN_DOORS, SMALLEST_ROOM
from slamgym.metrics.layers import MapLayers

INTO_WALLS = 0.02
"""Lines of doors are drawn so far into the walls, so that they cut; rooms lie so near beside them [m]."""
LEAST_LOG_ODDS = -3.0
"""Lines that are less likely are no candidates."""
ONE_PASSAGE = 0.35
"""Two lines whose middles are nearer than this share of the narrower one's width lie across one passage. Without this
rule drawings of 30 maps of real robots have 137 false doors, with it 14."""
FITTED = 0.5
"""The jambs of a drawn door lie at most so far from those that were seen [m]."""
AT_JAMB = 0.06
"""Corners so near to the end of a door's line are jambs [m]."""


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
    dx = (x1 - x0) / line.length
    dy = (y1 - y0) / line.length
    start = (x0 - before * dx, y0 - before * dy)
    end = (x1 + after * dx, y1 + after * dy)
    return LineString([start, end])


def likely_gaps(
    floor: MultiPolygon, seen: BoolArray, layers: MapLayers, frame: GridFrame
) -> list[Gap]:
    """The :func:`~slamgym.drawing.boundaries.candidates` that are likely and no likelier one crosses or repeats."""
    lines, signs = candidates(floor, seen, layers, frame)
    odds = boundary_log_odds(signs)
    order = np.argsort(-odds, kind="stable")
    order = order[odds[order] >= LEAST_LOG_ODDS]
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
    parts = _cut(floor, gaps)
    sides = joined_rooms(parts, gaps)
    areas = np.array([part.area for part in parts])
    odds = np.array([gap.log_odds for gap in gaps])
    room = _joined(areas, sides, odds)
    kept = []
    for gap, (a, b) in zip(gaps, sides, strict=True):
        if min(a, b) >= 0 and room[a] != room[b]:
            kept.append(gap)
    rooms = _cut(floor, kept)
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


def _joined(area: FloatArray, pairs: IntArray, odds: FloatArray) -> IntArray:
    """The room of each part: a number that all parts of a room share.

    Args:
        area: Of the parts, (N,) [m2].
        pairs: The parts on both sides of each boundary, (G, 2); -1 for none.
        odds: Log odds of the boundaries, (G,).
    """
    count = len(area)
    room = np.arange(count)
    is_inside = pairs.min(axis=1) >= 0
    pairs = pairs[is_inside]
    odds = odds[is_inside]
    while True:
        pairs = np.sort(room[pairs], axis=1)
        low = pairs[:, 0]
        high = pairs[:, 1]
        is_apart = low != high
        code, number = np.unique(pairs[is_apart] @ (count, 1), return_inverse=True)
        pairs = np.stack(np.divmod(code, count), axis=1)
        odds = np.bincount(number, odds[is_apart]).astype(np.float64)
        # What is too small for a room is a niche, whatever stands before it.
        is_room = area[pairs].min(axis=1) >= SMALLEST_ROOM
        next_one = np.lexsort((odds, is_room))[:1]
        should_join = ~is_room | (odds < 0.0)
        if not should_join[next_one].any():
            return room
        first, second = pairs[next_one[0]]
        area[first] += area[second]
        room[room == second] = first


def _cut(floor: MultiPolygon, gaps: Sequence[Gap]) -> list[Polygon]:
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
    normal = along[:, ::-1] * (-INTO_WALLS, INTO_WALLS)
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


def onto_faces(gap: Gap, floor: MultiPolygon) -> Gap:
    """A boundary whose ends lie on the faces that were drawn, at corners if there are some."""
    start = _onto_face(gap.start, floor)
    end = _onto_face(gap.end, floor)
    return replace(gap, start=start, end=end) if start != end else gap


def _onto_face(point: DrawnPoint, floor: MultiPolygon) -> DrawnPoint:
    """The corner at a point, or else the nearest place on a face; the point itself if that is far."""
    line = shapely.shortest_line(shapely.extract_unique_points(floor), Point(point))
    if line.length > AT_JAMB:
        line = shapely.shortest_line(floor.boundary, Point(point))
    x, y = line.coords[0] if line.length <= FITTED else point
    return float(x), float(y)
