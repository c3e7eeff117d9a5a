"""Doors and rooms of a floor: gaps between two jambs that separate one part of it from another.

A jamb is the end of a wall: a short face between two corners that reach into the floor. Opposite a jamb stands
another, or the face of a wall that runs across. The lines of all such gaps cut the floor into parts; a gap with the
same part on both sides, or that cuts off a niche, is no door. Where a jamb was too worn to be found, the watershed of
:mod:`slamgym.metrics.rooms` finds the passage.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.ops
from shapely import LineString, MultiPolygon, Point, Polygon

from slamgym.cad.floorplan import fill_segments, ring_segments
from slamgym.core.types import FloatArray, GridFrame
from slamgym.drawing.polygons import polygon_parts
from slamgym.drawing.settings import DrawingConfig
from slamgym.metrics.rooms import RoomRule, label_rooms

REACH = 0.02
"""Lines of doors are drawn so far into the walls, so that they cut [m]."""
PARALLEL = math.cos(math.radians(20.0))
"""Two faces that look at each other are antiparallel within this."""
WATERSHED_CELL = 0.05
"""[m]"""


@dataclass(frozen=True)
class Gap:
    """A line across the floor from face to face."""

    start: tuple[float, float]
    end: tuple[float, float]
    depth: float
    """Thickness of the wall [m]."""

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
        (x0, y0), (x1, y1) = self.start, self.end
        dx, dy = (x1 - x0) / self.width * REACH, (y1 - y0) / self.width * REACH
        return LineString([(x0 - dx, y0 - dy), (x1 + dx, y1 + dy)])


@dataclass(frozen=True)
class Division:
    """The floor cut into rooms."""

    rooms: tuple[Polygon, ...]
    doors: tuple[Gap, ...]
    joins: tuple[tuple[int, int], ...]
    """Of each door the two rooms, by their numbers."""


def divide(floor: MultiPolygon, config: DrawingConfig) -> Division:
    """Find doors, and the rooms between them.

    Args:
        floor: With straight edges [m].
        config: Sizes.
    """
    gaps = jamb_gaps(floor, config)
    parts, gaps = _separated(floor, gaps, config)
    worn = [gap for part in parts for gap in _watershed_gaps(part, config)]
    if worn:
        parts, gaps = _separated(floor, [*gaps, *worn], config)
    joins = _joins(parts, gaps)
    order = sorted(range(len(parts)), key=lambda i: (-round(parts[i].centroid.y, 3), parts[i].centroid.x))
    number = {old: new for new, old in enumerate(order)}
    kept = [(gap, (number[a], number[b])) for gap, (a, b) in zip(gaps, joins, strict=True)]
    return Division(
        tuple(parts[i] for i in order), tuple(gap for gap, _ in kept), tuple(pair for _, pair in kept)
    )


def _faces(floor: MultiPolygon) -> tuple[FloatArray, FloatArray, FloatArray]:
    """All edges with the floor on their left: starts and ends (N, 2), and whether each end is a corner that reaches
    into the floor (N, 2).
    """
    starts, ends, reflex = [], [], []
    for part in floor.geoms:
        oriented = shapely.geometry.polygon.orient(part)
        for ring in (oriented.exterior, *oriented.interiors):
            points = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
            incoming, outgoing = points - before, after - points
            turn = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
            lengths = np.hypot(*incoming.T) * np.hypot(*outgoing.T)
            sharp = turn < -0.4 * lengths
            starts.append(points)
            ends.append(after)
            reflex.append(np.column_stack([sharp, np.roll(sharp, -1)]))
    if not starts:
        empty = np.empty((0, 2))
        return empty, empty, empty
    return np.vstack(starts), np.vstack(ends), np.vstack(reflex)


def jamb_gaps(floor: MultiPolygon, config: DrawingConfig) -> list[Gap]:
    """Gaps as wide as a door between a jamb and what stands opposite, the narrowest first."""
    starts, ends, reflex = _faces(floor)
    if len(starts) == 0:
        return []
    vectors = ends - starts
    lengths = np.hypot(*vectors.T)
    directions = vectors / np.maximum(lengths, 1e-12)[:, None]
    jambs = np.flatnonzero((lengths <= config.max_thickness) & reflex.all(axis=1) & (lengths > 0.01))
    gaps = []
    for jamb in jambs.tolist():
        direction, length = directions[jamb], lengths[jamb]
        normal = np.array([-direction[1], direction[0]])  # into the floor
        facing = np.flatnonzero(directions @ direction < -PARALLEL)
        first, second = (points[facing] - starts[jamb] for points in (starts, ends))
        along = np.stack([first @ direction, second @ direction])
        low, high = np.maximum(along.min(axis=0), 0.0), np.minimum(along.max(axis=0), length)
        across = 0.5 * (first @ normal + second @ normal)
        good = (
            (high - low > 0.3 * length) & (across >= config.door_width[0]) & (across <= config.door_width[1])
        )
        for index in np.flatnonzero(good).tolist():
            middle = 0.5 * (low[index] + high[index])
            start = starts[jamb] + middle * direction
            gaps.append((jamb, int(facing[index]), start, start + across[index] * normal, length))
    found: dict[tuple[int, int], Gap] = {}
    for jamb, other, start, end, length in gaps:
        gap = Gap((float(start[0]), float(start[1])), (float(end[0]), float(end[1])), float(length))
        key = (min(jamb, other), max(jamb, other))
        inner = shapely.line_interpolate_point(gap.line, [0.03, 0.5 * gap.width, gap.width - 0.03])
        is_open = floor.buffer(1e-6).covers(LineString(inner.tolist()))
        if is_open and (key not in found or found[key].depth > gap.depth):
            found[key] = gap
    return sorted(found.values(), key=lambda gap: (gap.width, gap.start))


def _separated(
    floor: MultiPolygon, gaps: Sequence[Gap], config: DrawingConfig
) -> tuple[list[Polygon], list[Gap]]:
    """Cut along the gaps; those that don't separate two rooms go."""
    chosen: list[Gap] = []
    for gap in gaps:  # of lines that cross, or of both faces of one wall, the first stays
        if all(gap.line.distance(other.line) > 0.05 for other in chosen):
            chosen.append(gap)
    parts = _cut(floor, chosen)
    while chosen:
        joins = _joins(parts, chosen)
        idle = [index for index, (a, b) in enumerate(joins) if a == b or a < 0 or b < 0]
        if not idle:
            small = [i for i, part in enumerate(parts) if not _is_room(part, config)]
            beside = [index for index, pair in enumerate(joins) if set(pair) & set(small)]
            # The widest goes first: a niche is open, a closet has a door.
            idle = sorted(beside, key=lambda index: -chosen[index].width)[:1]
        if not idle:
            break
        chosen = [gap for index, gap in enumerate(chosen) if index not in idle]
        parts = _cut(floor, chosen)
    return parts, chosen


def _is_room(part: Polygon, config: DrawingConfig) -> bool:
    return part.area >= config.min_room and not part.buffer(-0.5 * config.min_room_width).is_empty


def _cut(floor: MultiPolygon, gaps: Sequence[Gap]) -> list[Polygon]:
    """The parts of the floor between the lines of the gaps."""
    if not gaps:
        return polygon_parts(floor)
    lines = shapely.union_all([floor.boundary, *(gap.cut for gap in gaps)])
    inner = shapely.prepared.prep(floor)
    return [
        part
        for part in polygon_parts(shapely.polygonize(shapely.get_parts(lines)))
        if part.area > 1e-4 and inner.contains(part.representative_point())
    ]


def _joins(parts: Sequence[Polygon], gaps: Sequence[Gap]) -> list[tuple[int, int]]:
    """Which part lies on either side of each gap; -1 for none."""
    tree = shapely.STRtree(list(parts))
    found = []
    for gap in gaps:
        (x0, y0), (x1, y1) = gap.start, gap.end
        normal = np.array([y0 - y1, x1 - x0]) / gap.width
        middle = 0.5 * np.array([x0 + x1, y0 + y1])
        sides = []
        for step in (0.01, -0.01):
            hits = tree.query(Point(*(middle + step * normal)), predicate="intersects")
            sides.append(int(hits[0]) if len(hits) else -1)
        found.append((sides[0], sides[1]))
    return found


def _watershed_gaps(part: Polygon, config: DrawingConfig) -> list[Gap]:
    """Passages of a door's width between two hills of a part's distance from its walls."""
    if part.area < 2.0 * config.min_room:
        return []
    cell = max(WATERSHED_CELL, math.sqrt(part.envelope.area / 4e6))
    frame = GridFrame.covering(part.bounds, cell, margin=2.0 * cell)
    free = fill_segments(ring_segments([part.exterior, *part.interiors]), frame)
    rule = RoomRule(
        max_doorway=config.door_width[1], min_area=config.min_room, min_width=config.min_room_width
    )
    labels = label_rooms(free, cell, rule)
    if labels.max(initial=0) < 2:
        return []
    gaps = []
    for middle in _passes(labels, frame):
        gap = _narrowest(part, middle, config)
        if gap is not None:
            gaps.append(gap)
    return sorted(gaps, key=lambda gap: (gap.width, gap.start))


def _passes(labels: np.ndarray, frame: GridFrame) -> list[FloatArray]:
    """The middle of each border between two rooms, piece by piece [m]."""
    import cv2

    border = np.zeros(labels.shape, np.uint8)
    for axis in (0, 1):
        first, second = (np.delete(labels, index, axis) for index in (-1, 0))
        differ = (first != second) & (first > 0) & (second > 0)
        border[: first.shape[0], : first.shape[1]] |= differ.astype(np.uint8)
    count, _, _, centroids = cv2.connectedComponentsWithStats(border, connectivity=8)
    return [np.array(frame.to_point(float(row), float(col))) for col, row in centroids[1:count]]


def _narrowest(part: Polygon, middle: FloatArray, config: DrawingConfig) -> Gap | None:
    """The shortest line from wall to wall near a point of a passage."""
    outline = part.boundary
    here = Point(*middle)
    reach = 0.75 * config.door_width[1]
    # Corners near the passage, and for each the nearest place of the outline on the other side of the middle.
    corners = shapely.get_coordinates(outline.intersection(here.buffer(reach)))
    nearest = outline.interpolate(outline.project(here)) if outline.geom_type == "LineString" else None
    starts = [*map(tuple, corners.tolist())] + ([(nearest.x, nearest.y)] if nearest is not None else [])
    best: Gap | None = None
    for start in sorted(set(starts)):
        to_middle = middle - np.array(start)
        if not 0.1 < float(np.hypot(*to_middle)) < reach:
            continue
        # The half plane beyond the middle.
        across = np.array([-to_middle[1], to_middle[0]])
        far = middle + 0.1 * to_middle
        side = Polygon(
            [
                far - 9 * across,
                far + 9 * across,
                far + 9 * across + 9 * to_middle,
                far - 9 * across + 9 * to_middle,
            ]
        )
        beyond = outline.intersection(side)
        if beyond.is_empty:
            continue
        end = shapely.ops.nearest_points(Point(start), beyond)[1]
        gap = Gap(start, (end.x, end.y), config.outer_thickness)
        if not config.door_width[0] <= gap.width <= config.door_width[1]:
            continue
        inner = shapely.line_interpolate_point(gap.line, [0.03, gap.width - 0.03])
        if part.covers(LineString(inner.tolist())) and (best is None or gap.width < best.width - 1e-6):
            best = gap
    return best
