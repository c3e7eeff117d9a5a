"""Walls from corner to corner: a building model has one for each straight wall, with its steps, through its doors."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import largest_part
from slamgym.core.types import BoolArray, IntArray
from slamgym.drawing.drawing import DrawnDoor, DrawnPoint, DrawnWall, Layer
from slamgym.drawing.openings import lengthened
from slamgym.drawing.settings import MAJORITY, THICKEST_WALL, USUAL_CELL


def straight_walls(
    pieces: Sequence[DrawnWall], doors: Sequence[DrawnDoor]
) -> tuple[list[DrawnWall], IntArray]:
    """Join what touches, or has a door between it, and lies along the longest piece or is shorter than walls are thick.

    Either of two faces along one line may be drawn a cell beside it.

    Args:
        pieces: Walls as they are drawn.
        doors: Their doors, which know the pieces at their jambs.

    Returns:
        The walls, as thick and as sure as their longest piece, and for each piece the number of its wall. The body of
        a wall is that of all its pieces, and closes its doors.
    """
    pairs = [(piece.start, piece.end) for piece in pieces]
    ends = np.array(pairs).reshape(-1, 2, 2)
    thickness = np.array([piece.thickness for piece in pieces])
    length = np.array([piece.length for piece in pieces])
    is_glass = np.array([piece.is_glass for piece in pieces], np.bool_)
    beside = _pieces_beside(pieces, doors)
    wall_of = np.full(len(pieces), -1)
    walls = list[DrawnWall]()
    for first in np.argsort(-length, kind="stable").tolist():
        if wall_of[first] >= 0:
            continue
        start, end = ends[first]
        x, y = (end - start) / length[first]
        normal = [-y, x]
        away = np.abs((ends - start) @ normal).max(axis=1)
        thicker = np.abs(thickness - thickness[first])
        is_along = np.maximum(away, thicker) <= 2.0 * USUAL_CELL
        may_join = (
            (is_along | (length < THICKEST_WALL)) & (wall_of < 0) & (is_glass == is_glass[first])
        )
        members = _connected(first, beside, may_join)
        wall_of[members] = len(walls)
        walls.append(pieces[first])
        if len(members) > 1:
            shut = [door for door in doors if len(set(door.walls) & set(members)) > 1]
            along = [pieces[k] for k in members if is_along[k]]
            body = _body([pieces[k] for k in members], shut)
            walls[-1] = replace(_joined(along), polygon=body)
    return walls, wall_of


def _body(pieces: Sequence[DrawnWall], doors: Sequence[DrawnDoor]) -> Polygon:
    """All that stands of a wall, its doors closed."""
    shapes: list[BaseGeometry] = [piece.polygon for piece in pieces]
    for door in doors:
        longer = lengthened(door.line, USUAL_CELL, USUAL_CELL)
        shapes.append(longer.buffer(0.5 * door.depth, cap_style="flat"))
    wider = shapely.union_all(shapes).buffer(0.5 * USUAL_CELL, join_style="mitre")
    return largest_part(wider.buffer(-0.5 * USUAL_CELL, join_style="mitre"))


def _connected(first: int, beside: list[list[int]], may_join: BoolArray) -> list[int]:
    """A piece, and those that may join it and are beside it or beside another that does."""
    members = [first]
    for member in members:  # which grow in number
        for other in beside[member]:
            if may_join[other] and other not in members:
                members.append(other)
    return members


def _pieces_beside(pieces: Sequence[DrawnWall], doors: Sequence[DrawnDoor]) -> list[list[int]]:
    """For each piece the numbers of those that touch it, or stand at another jamb of one of its doors."""
    bodies = [piece.polygon for piece in pieces]
    tree = shapely.STRtree(bodies)
    touching = tree.query(bodies, predicate="dwithin", distance=USUAL_CELL)
    beside: list[list[int]] = [[] for _ in pieces]
    for one, other in touching.T.tolist():
        beside[one].append(other)
    for door in doors:
        for one, other in itertools.permutations(door.walls, 2):
            beside[one].append(other)
    return beside


def _joined(pieces: Sequence[DrawnWall]) -> DrawnWall:
    """A wall on the line of its longest piece, which is the first."""
    longest = pieces[0]
    start = np.array(longest.start)
    along = (longest.end - start) / longest.length

    def stretch(shapes: list[BaseGeometry]) -> list[DrawnPoint]:
        corners = shapely.get_coordinates(shapes)
        places = (corners - start) @ along
        outermost = [places.min(), places.max()]
        ends = start + np.outer(outermost, along)
        return [(float(x), float(y)) for x, y in ends]

    low, high = stretch([piece.line for piece in pieces])
    lengths = [piece.length for piece in pieces]
    shares = [piece.share_seen for piece in pieces]
    seen = float(np.average(shares, weights=lengths))
    layer: Layer = "SEEN" if seen >= MAJORITY else "INFERRED"
    return replace(longest, start=low, end=high, share_seen=seen, layer=layer)
