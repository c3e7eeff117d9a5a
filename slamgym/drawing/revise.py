"""A drawing with a person's corrections: walls first, then the boundaries between rooms, the rooms' names last."""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from slamgym.cad.polygons import polygon_parts
from slamgym.drawing.drawing import Segment
from slamgym.drawing.edits import Correction, Corrections
from slamgym.drawing.openings import Division, Gap, divide, lengthened, onto_faces
from slamgym.drawing.settings import (
    MARGIN,
    NARROWEST_DRAWN,
    SAME_PLACE,
    SMALLEST_ROOM,
    THICKEST_WALL,
    THINNEST_WALL,
)

SAME_DOOR = 0.3
"""Boundaries whose ends are so near to each other are one [m]."""


class Revised(NamedTuple):
    """A floor and its rooms with a person's corrections."""

    floor: MultiPolygon
    division: Division
    names: dict[int, str]
    """Of rooms, by their numbers."""
    faults: tuple[str, ...]
    """A sentence for each correction that couldn't be carried out."""


def revise(floor: MultiPolygon, gaps: Sequence[Gap], corrections: Corrections) -> Revised:
    """Carry out a person's corrections; one that can't be leaves no trace.

    Args:
        floor: As the map shows it.
        gaps: The likely boundaries of its rooms.
        corrections: A person's.
    """
    while True:
        revision = _Revision(corrections)
        changed = revision.floor(floor)
        division = revision.division(changed, gaps)
        changed, division = revision.without_rooms(changed, division)
        names = revision.names(division.rooms)
        if not revision.refused:
            return Revised(changed, division, names, corrections.faults)
        corrections = corrections.without(revision.refused)


class _Revision:
    """A drawing's floor and rooms with corrections, and which of these can't be carried out, with the reasons."""

    def __init__(self, corrections: Corrections) -> None:
        self._of = corrections.of
        self.refused: dict[Correction, str] = {}

    def floor(self, floor: MultiPolygon) -> MultiPolygon:
        """The floor with other walls, and with doors in them."""
        changed: BaseGeometry = floor
        for entry in self._of("remove_wall"):
            body = _removed(entry)
            solid = body.difference(floor)
            if solid.area < 0.1 * body.area or not body.intersects(floor):
                self.refused[entry] = "no wall stands there"
            else:
                changed = changed.union(body)
        for entry in self._of("add_wall"):
            if _share_within(entry.shape, changed) < 0.5:
                self.refused[entry] = "no floor lies there"
            else:
                changed = _with_wall(changed, entry.shape, entry.thickness, floor)
        for entry in self._of("add_door"):
            changed = _with_door(changed, entry)
        return floor if changed is floor else _without_slits(changed)

    def division(self, floor: MultiPolygon, gaps: Sequence[Gap]) -> Division:
        """The rooms of a floor that has the person's walls, and doors in them, with other boundaries."""
        gaps = self._without_joined(gaps)
        added = _added_gaps(floor, gaps, list(self._of("split", "add_door")))
        new = list(itertools.chain(*added.values()))
        division = divide(floor, _without_repeated(gaps, new))
        doors = _Lines(division.doors)
        for entry, lines in added.items():
            if not any(doors.same_as(line) for line in lines):
                self.refused[entry] = (
                    f"it doesn't part two rooms of {SMALLEST_ROOM:g} m2 or more; lead it from wall to wall"
                )
        return division

    def _without_joined(self, gaps: Sequence[Gap]) -> list[Gap]:
        """The boundaries that the person hasn't taken away."""
        tree = shapely.STRtree([gap.line for gap in gaps])
        gone = set[int]()
        for entry in self._of("join"):
            nearest = tree.query_nearest(entry.shape, max_distance=SAME_DOOR, all_matches=False)
            if not len(nearest):
                self.refused[entry] = "no door and no boundary between two rooms lies there"
            gone.update(nearest.tolist())
        lines = _Lines(gaps)
        for entry in self._of("no_door"):
            gone.update(lines.same_as(Segment(*entry.line)))
        return [gap for number, gap in enumerate(gaps) if number not in gone]

    def without_rooms(
        self, floor: MultiPolygon, division: Division
    ) -> tuple[MultiPolygon, Division]:
        """Floor and rooms without those that aren't there: a mirror shows some."""
        gone = set[int]()
        for entry in self._of("remove_room"):
            here = _room_at(division.rooms, entry)
            if here is None or len(gone | {here}) == len(division.rooms):
                self.refused[entry] = "no room lies there, or no other"
            else:
                gone.add(here)
        if not gone:
            return floor, division
        bodies = [division.rooms[number].buffer(1e-3, join_style="mitre") for number in gone]
        rest = _without_slits(floor.difference(shapely.union_all(bodies)))
        kept = [number for number in range(len(division.rooms)) if number not in gone]
        number_of = {old: new for new, old in enumerate(kept)}
        doors = []
        joins = []
        for door, (one, other) in zip(division.doors, division.joins, strict=True):
            if one in number_of and other in number_of:
                doors.append(door)
                joins.append((number_of[one], number_of[other]))
        rooms = tuple(division.rooms[number] for number in kept)
        return rest, Division(rooms, tuple(doors), tuple(joins))

    def names(self, rooms: Sequence[Polygon]) -> dict[int, str]:
        """The names that the person gave to rooms, by the rooms' numbers."""
        names = {}
        for entry in self._of("name_room"):
            here = _room_at(rooms, entry)
            if here is None:
                self.refused[entry] = "no room lies there"
            else:
                names[here] = entry.name
        return names


def _room_at(rooms: Sequence[Polygon], entry: Correction) -> int | None:
    """The number of the room in which a place lies."""
    here = [number for number, room in enumerate(rooms) if room.intersects(entry.shape)]
    return here[0] if here else None


def _with_door(floor: BaseGeometry, entry: Correction) -> BaseGeometry:
    """A floor on which a door hangs, with the wall around it, or in whose wall it is open."""
    line = entry.shape
    if _share_within(line, floor) >= 0.5:
        for rest in _beside_door(_at_jambs(entry, floor), floor):
            floor = _with_wall(floor, rest, entry.thickness, floor)
        return floor
    widened = line.buffer(THICKEST_WALL, cap_style="flat")
    passage = _parts_at(line, widened.difference(floor))
    rim = floor.intersection(passage.buffer(1e-3))
    # In a wall with rooms on both sides.
    joins_rooms = rim.area / 1e-3 > 1.5 * line.length
    return floor.union(passage) if joins_rooms else floor


def _removed(entry: Correction) -> BaseGeometry:
    """The body of a wall that is taken away."""
    # A little thicker, so that nothing is left between a wall and its rounded line.
    half = 0.5 * entry.thickness + SAME_PLACE
    return entry.shape.buffer(half, cap_style="flat")


def _with_wall(
    changed: BaseGeometry, line: BaseGeometry, thickness: float, floor: BaseGeometry
) -> BaseGeometry:
    """A floor with a new wall along a line."""
    beyond = []
    for point in line.coords:
        # A slit between its end and another wall is wall.
        is_free = floor.covers(Point(point).buffer(NARROWEST_DRAWN))
        beyond.append(0.0 if is_free else NARROWEST_DRAWN)
    before, after = beyond
    longer = lengthened(line, before, after)
    added = longer.buffer(0.5 * thickness, cap_style="flat").intersection(changed)
    return changed.difference(_parts_at(line, added))


def _at_jambs(entry: Correction, floor: BaseGeometry) -> Segment:
    """A door on the floor with its ends at corners, or else faces, if the floor between is too narrow to be drawn."""
    faces = floor.boundary
    corners = shapely.MultiPoint(shapely.get_coordinates(faces))
    jambs = [(shape, most) for most in (SAME_PLACE, NARROWEST_DRAWN) for shape in (corners, faces)]
    ends = []
    for point in map(Point, entry.line):
        near = [shape for shape, most in jambs if point.distance(shape) <= most]
        jamb = nearest_points(near[0], point)[0] if near else point
        ends.append((jamb.x, jamb.y))
    fitted = Segment(*ends)
    return fitted if fitted.length >= NARROWEST_DRAWN else Segment(*entry.line)


def _beside_door(door: Segment, floor: BaseGeometry) -> Iterator[LineString]:
    """Where the wall stands in which a door on the floor hangs: from ends that are at no jamb to the next walls."""
    for end, before, after in ((door.start, 1e3, -door.length), (door.end, -door.length, 1e3)):
        jamb = Point(end)
        if jamb.distance(floor.boundary) > SAME_PLACE:
            beyond = lengthened(door.line, before, after).intersection(floor)
            yield from (rest for rest in shapely.get_parts(beyond) if rest.distance(jamb) < 1e-6)


def _without_slits(floor: BaseGeometry) -> MultiPolygon:
    """A floor without slits and patches that nobody draws."""
    slit = 0.5 * THINNEST_WALL
    closed = floor.buffer(slit, join_style="mitre").buffer(-slit, join_style="mitre").simplify(2e-3)
    return MultiPolygon([part for part in polygon_parts(closed) if part.area > NARROWEST_DRAWN**2])


def _added_gaps(
    floor: MultiPolygon, gaps: Sequence[Gap], entries: Sequence[Correction]
) -> dict[Correction, list[Gap]]:
    """The boundaries that a person adds, by corrections."""
    if not entries:
        return {}
    crossings = _Crossings(floor, gaps)
    found = {}
    for entry in entries:
        if entry.kind == "split":
            found[entry] = list(crossings.of(entry))
        else:
            door = _at_jambs(entry, floor)
            found[entry] = [Gap(door.start, door.end, kind="door")]
    return found


def _without_repeated(gaps: Sequence[Gap], new: Sequence[Gap]) -> list[Gap]:
    """Old and new boundaries, without those that a later one of the new ones repeats."""
    if not new:
        return list(gaps)
    lines = _Lines(new)
    kept = [gap for gap in gaps if not lines.same_as(gap)]
    return kept + [gap for number, gap in enumerate(new) if max(lines.same_as(gap)) == number]


class _Lines:
    """Boundaries in which the same ones are found quickly."""

    def __init__(self, gaps: Sequence[Gap]) -> None:
        self._tree = shapely.STRtree([gap.line for gap in gaps])

    def same_as(self, line: Segment) -> list[int]:
        """Numbers of those whose ends are near those of a line."""
        near = self._tree.query(line.line, predicate="dwithin", distance=SAME_DOOR)
        apart = shapely.hausdorff_distance(self._tree.geometries[near], line.line)
        same: list[int] = near[apart <= SAME_DOOR].tolist()
        return same


def _parts_at(line: BaseGeometry, geometry: BaseGeometry) -> BaseGeometry:
    parts = [part for part in polygon_parts(geometry) if part.intersects(line)]
    return shapely.union_all(parts)


def _share_within(line: BaseGeometry, floor: BaseGeometry) -> float:
    return float(line.intersection(floor).length / line.length)


class _Crossings:
    """A floor, cut by the boundaries that it has, for lines that lead through its rooms."""

    def __init__(self, floor: MultiPolygon, gaps: Sequence[Gap]) -> None:
        self._floor = floor
        self._gaps = gaps
        self._known = _Lines(gaps)
        self._cuts = shapely.STRtree([gap.cut for gap in gaps])

    def of(self, entry: Correction) -> Iterator[Gap]:
        """Where a line, led on to the next walls, leads through rooms; it covers at least half of the way."""
        space = self._space_around(entry)
        # So it ends at corners, too, and doesn't run along walls.
        inside = space.buffer(-SAME_PLACE, join_style="mitre")
        line = lengthened(entry.shape, 1e3, 1e3)
        near = entry.shape.buffer(1e-3)
        for piece in shapely.get_parts(line.intersection(inside)):
            covered = piece.intersection(near).length
            if piece.length >= NARROWEST_DRAWN and covered >= 0.5 * piece.length:
                gap = Gap(piece.coords[0], piece.coords[-1], kind="opening")
                yield from onto_faces([gap], space)

    def _space_around(self, entry: Correction) -> MultiPolygon:
        """The rooms as far as a line through them can matter: a piece that it covers half of is twice as long."""
        line = lengthened(entry.shape, entry.shape.length, entry.shape.length)
        around = line.buffer(MARGIN)
        floor = self._floor.intersection(around)
        own = self._known.same_as(Segment(*entry.line))
        others = [self._gaps[k].cut for k in self._cuts.query(around).tolist() if k not in own]
        cut = floor.difference(shapely.union_all(others).buffer(1e-3))
        return MultiPolygon(polygon_parts(cut))
