"""Parts of the floor that were only glimpsed: fans of rays through a door, a window or a pane.

They end where the rays end, not at walls, so they are neither rooms nor floor whose size is known: a drawing shows them
as unexplored, behind the door that they were seen through.
"""

from dataclasses import dataclass

import shapely
from shapely import MultiPolygon, Polygon

from slamgym.cad.polygons import polygon_parts
from slamgym.drawing.evidence import Evidence, share_ended
from slamgym.drawing.fans import ENDED, find_fans
from slamgym.drawing.openings import Division, Gap, divide, joined_rooms
from slamgym.drawing.walls import WallPiece

OPEN_ROOM = 0.5
"""A part of the floor was glimpsed if less than this share of its outline, doors left out, was seen as walls."""
MOST_GLIMPSED = 0.25
"""Where more of the floor would go, the map just shows few walls."""
ON_LINE = 0.06
"""Faces so near to the line of a door to a glimpsed part are no walls: nobody knows a wall there [m]."""


@dataclass(frozen=True)
class Explored:
    """A floor without what was only glimpsed."""

    floor: MultiPolygon
    division: Division
    """A door to a glimpsed part joins its room to -1."""
    walled: tuple[float, ...]
    """Of each room the share of its outline, doors left out, that was seen as walls."""
    glimpsed: tuple[Polygon, ...]


def explore(floor: MultiPolygon, evidence: Evidence) -> Explored:
    """Divide a floor into rooms, without those that were only glimpsed, and without fans.

    Args:
        floor: With straight edges [m].
        evidence: The map.
    """
    config, least = evidence.config, (1.0 - MOST_GLIMPSED) * floor.area
    rooms = _without_glimpses(floor, divide(floor, config), evidence, least)
    fans = find_fans(rooms.floor, evidence, rooms.floor.area - least)
    bulges = tuple(fan for fan, _ in fans)
    if not fans:
        return rooms
    rest = _without(rooms.floor, bulges)
    if rest.area < least:
        return rooms
    left = _without_glimpses(rest, divide(rest, config), evidence, least)
    # What was seen through a gap is gone from the floor, and the gap with it.
    gaps = _doors_to_glimpsed(rooms.division)
    gaps += [mouth for _, mouth in fans if mouth.width >= config.door_width[0]]
    joins = joined_rooms(left.division.rooms, gaps)
    through = [(gap, pair) for gap, pair in zip(gaps, joins, strict=True) if max(pair) >= 0 > min(pair)]
    division = Division(
        left.division.rooms,
        (*left.division.doors, *(gap for gap, _ in through)),
        (*left.division.joins, *(pair for _, pair in through)),
    )
    glimpsed = (*rooms.glimpsed, *bulges, *left.glimpsed)
    return Explored(left.floor, division, left.walled, glimpsed)


def _without_glimpses(floor: MultiPolygon, division: Division, evidence: Evidence, least: float) -> Explored:
    """Take the glimpsed rooms from a floor, but none that two other rooms are joined by; ``least`` [m2] must stay."""
    rooms = division.rooms
    lines = shapely.union_all([gap.line for gap in division.doors])
    walled = [evidence.share_walled(room, lines) for room in rooms]
    kept = set(range(len(rooms)))
    is_open = [
        share < OPEN_ROOM and share_ended(room, evidence.grid) < ENDED
        for room, share in zip(rooms, walled, strict=True)
    ]
    for k in sorted(kept, key=lambda k: walled[k]):
        rest = kept - {k}
        if is_open[k] and rest and _num_parts(rest, division) <= _num_parts(kept, division):
            kept = rest
    glimpsed = tuple(room for k, room in enumerate(rooms) if k not in kept)
    if not glimpsed or sum(float(rooms[k].area) for k in kept) < least:
        return Explored(floor, division, tuple(walled), ())
    number = {old: new for new, old in enumerate(sorted(kept))}
    doors = [
        (gap, (number.get(a, -1), number.get(b, -1)))
        for gap, (a, b) in zip(division.doors, division.joins, strict=True)
        if a in number or b in number
    ]
    explored = Division(
        tuple(rooms[k] for k in sorted(kept)),
        tuple(gap for gap, _ in doors),
        tuple(pair for _, pair in doors),
    )
    return Explored(_without(floor, glimpsed), explored, tuple(walled[k] for k in sorted(kept)), glimpsed)


def without_walls_in_doors(pieces: list[WallPiece], division: Division) -> list[WallPiece]:
    """Walls without the faces that stand in the doors to glimpsed parts."""
    doors = _doors_to_glimpsed(division)
    if not doors:
        return pieces
    shut = shapely.union_all([gap.line for gap in doors]).buffer(ON_LINE)
    return [piece for piece in pieces if not shut.covers(shapely.LineString([piece.start, piece.end]))]


def _doors_to_glimpsed(division: Division) -> list[Gap]:
    return [gap for gap, pair in zip(division.doors, division.joins, strict=True) if min(pair) < 0]


def _num_parts(rooms: set[int], division: Division) -> int:
    """Into how many parts some rooms fall that no door joins."""
    part = {room: room for room in rooms}
    for a, b in division.joins:
        if a in part and b in part:
            joined = part[a]
            part = {room: part[b] if own == joined else own for room, own in part.items()}
    return len(set(part.values()))


def _without(floor: MultiPolygon, parts: tuple[Polygon, ...]) -> MultiPolygon:
    taken = shapely.union_all(list(parts))
    left: list[Polygon] = []
    for part in floor.geoms:
        if part.intersection(taken).area < 1e-3:
            left.append(part)
            continue
        rest = part.difference(taken.buffer(1e-4)).simplify(2e-3)
        left += [piece for piece in polygon_parts(rest) if piece.area > 1e-2]
    return MultiPolygon(left)
