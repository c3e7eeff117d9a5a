"""Furniture: what stands in which kind of room, and where it goes.

Sizes are those of ordinary European furniture (Neufert, Architects' Data, on dwellings and offices). Pieces
that a scanner near the floor sees as legs, such as tables and chairs, are legs here.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.core.geometry import transform_points
from slamgym.core.types import FloatArray, Pose2D

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan, Room

# Side of a table leg and of a chair leg, and the side of a seat [m].
_TABLE_LEG = 0.06
_CHAIR_LEG = 0.03
_SEAT = 0.42

# Places tried for one piece before it is left out.
_TRIES = 12

# Gap between a piece and its wall [m].
_WALL_GAP = (0.01, 0.05)

# A wall counts as a room's if this far before it one stands in the room [m].
_BEFORE_WALL = 0.1


@dataclass(frozen=True)
class Piece:
    """A kind of furniture: ranges of width along its back and of depth away from it [m]."""

    width: tuple[float, float]
    depth: tuple[float, float]
    chance: float = 1.0  # that a furnished room has one
    at_wall: bool = True  # with its back to a wall, or free in the room
    on_legs: bool = False
    seats: int = 0  # chairs at each of the two long sides


@dataclass(frozen=True)
class PlacedPiece:
    """A piece in its place, world frame."""

    outline: shapely.Polygon  # what it covers, seen from above
    solids: tuple[shapely.Polygon, ...]  # what stands on the floor


_TABLE_WITH_CHAIRS = Piece((1.2, 1.8), (0.75, 0.95), 0.9, at_wall=False, on_legs=True, seats=2)
_SHELF = Piece((0.8, 1.6), (0.28, 0.4), 0.6)
_DESK = Piece((1.2, 1.6), (0.6, 0.8), 0.8, on_legs=True)
_TOILET = Piece((0.36, 0.4), (0.55, 0.7))
_BASIN = Piece((0.5, 0.9), (0.4, 0.5))

_CATALOGUE: dict[tuple[str, ...], tuple[Piece, ...]] = {
    ("bed", "child", "guest"): (
        Piece((0.9, 1.8), (1.95, 2.1)),
        Piece((1.0, 2.2), (0.58, 0.65), 0.9),
        Piece((0.4, 0.5), (0.35, 0.45), 0.7),
        Piece((1.0, 1.4), (0.55, 0.7), 0.4, on_legs=True),
    ),
    ("bath",): (Piece((1.5, 1.75), (0.7, 0.8), 0.8), _BASIN, _TOILET, Piece((0.6, 0.6), (0.55, 0.65), 0.4)),
    ("toilet", "wc", "restroom"): (_TOILET, _BASIN),
    ("kitchen", "pantry"): (
        Piece((1.8, 3.0), (0.6, 0.65)),
        Piece((0.6, 0.75), (0.6, 0.7)),
        _TABLE_WITH_CHAIRS,
    ),
    ("living", "lounge"): (
        Piece((1.7, 2.5), (0.85, 1.0)),
        Piece((1.2, 1.8), (0.38, 0.5), 0.9),
        Piece((0.9, 1.2), (0.5, 0.65), 0.8, at_wall=False),
        Piece((0.75, 0.95), (0.75, 0.9), 0.6),
        _SHELF,
    ),
    ("dining", "meeting", "conference"): (_TABLE_WITH_CHAIRS, Piece((1.2, 1.8), (0.4, 0.5), 0.7)),
    ("office", "study", "work"): (_DESK, _DESK, _SHELF, _SHELF),
    ("hall", "corridor", "entry", "lobby"): (Piece((0.6, 1.1), (0.25, 0.38), 0.5),),
    ("garage",): (Piece((1.75, 1.9), (4.0, 4.7), 0.6, at_wall=False), _SHELF, _SHELF),
    ("storage", "boiler", "wardrobe", "closet", "utility"): (
        _SHELF,
        Piece((0.4, 0.7), (0.35, 0.6), 0.8),
        Piece((0.4, 0.7), (0.35, 0.6), 0.5),
    ),
}

# For rooms of no known category.
_ANY_ROOM = (
    Piece((1.2, 2.0), (0.4, 0.6), 0.8),
    Piece((0.7, 1.0), (0.7, 0.95), 0.6),
    Piece((1.0, 1.5), (0.6, 0.8), 0.5, at_wall=False, on_legs=True, seats=1),
    _SHELF,
)


def pieces_for(category: str) -> tuple[Piece, ...]:
    """What belongs in a room of a category, in the order in which it is placed."""
    name = category.lower()
    for words, pieces in _CATALOGUE.items():
        if any(word in name for word in words):
            return pieces
    return _ANY_ROOM


def propose_places(
    piece: Piece, room: "Room", walls: FloatArray, rng: np.random.Generator
) -> Iterator[PlacedPiece]:
    """Places worth trying for a piece in a room; they may lie in a wall or in another piece.

    Args:
        piece: What is to be placed.
        room: Where.
        walls: The room's walls as :func:`room_walls` gives them.
        rng: Draws sizes and places.
    """
    width, depth = rng.uniform(*piece.width), rng.uniform(*piece.depth)
    for _ in range(_TRIES):
        pose = (
            _pose_at_wall(width, walls, rng)
            if piece.at_wall
            else _pose_in_room(room.polygon, walls, depth, rng)
        )
        if pose is not None:
            yield _place(piece, width, depth, pose)


def room_walls(plan: "FloorPlan", room: "Room") -> FloatArray:
    """The plan's walls that face a room, shape (W, 4), each with the free space on its left."""
    free = shapely.geometry.polygon.orient(plan.free_space)
    rings = [np.asarray(ring.coords) for ring in (free.exterior, *free.interiors)]
    walls = np.vstack([np.hstack([ring[:-1, :2], ring[1:, :2]]) for ring in rings])
    along = walls[:, 2:] - walls[:, :2]
    length = np.hypot(*along.T)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(length, 1e-9)[:, None]
    before = 0.5 * (walls[:, :2] + walls[:, 2:]) + _BEFORE_WALL * normal
    facing = shapely.contains_xy(room.polygon, before[:, 0], before[:, 1])
    found: FloatArray = walls[facing & (length > 0.3)]
    return found


def _pose_at_wall(width: float, walls: FloatArray, rng: np.random.Generator) -> Pose2D | None:
    """Middle of the piece's back, with x pointing into the room; every second piece goes into a corner."""
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    fitting = np.flatnonzero(length > width + 2 * _WALL_GAP[1])
    if len(fitting) == 0:
        return None
    wall = int(rng.choice(fitting, p=length[fitting] / length[fitting].sum()))
    near, far = 0.5 * width + _WALL_GAP[0], length[wall] - 0.5 * width - _WALL_GAP[0]
    along = rng.choice([near, far]) if rng.random() < 0.5 else rng.uniform(near, far)
    angle = math.atan2(walls[wall, 3] - walls[wall, 1], walls[wall, 2] - walls[wall, 0])
    gap = rng.uniform(*_WALL_GAP)
    x = walls[wall, 0] + along * math.cos(angle) - gap * math.sin(angle)
    y = walls[wall, 1] + along * math.sin(angle) + gap * math.cos(angle)
    return Pose2D(x, y, angle + 0.5 * math.pi)


def _pose_in_room(
    room: BaseGeometry, walls: FloatArray, depth: float, rng: np.random.Generator
) -> Pose2D | None:
    """About the room's middle, parallel to its longest wall."""
    if len(walls) == 0:
        return None
    longest = walls[np.argmax(np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]))]
    angle = math.atan2(longest[3] - longest[1], longest[2] - longest[0]) + rng.integers(2) * 0.5 * math.pi
    min_x, min_y, max_x, max_y = room.bounds
    x = room.centroid.x + 0.15 * (max_x - min_x) * rng.standard_normal() - 0.5 * depth * math.cos(angle)
    y = room.centroid.y + 0.15 * (max_y - min_y) * rng.standard_normal() - 0.5 * depth * math.sin(angle)
    return Pose2D(x, y, angle)


def _place(piece: Piece, width: float, depth: float, pose: Pose2D) -> PlacedPiece:
    """Put a piece down. In its own frame its back lies on the y axis and it reaches along +x."""
    body = (0.0, -0.5 * width, depth, 0.5 * width)
    boxes = _legs(body, _TABLE_LEG) if piece.on_legs else [body]
    boxes += [leg for seat in _seats(piece.seats, width, depth) for leg in _legs(seat, _CHAIR_LEG)]
    solids = tuple(_box(box, pose) for box in boxes)
    # Over a table on legs lies its top, so the outline takes the body too.
    hull = shapely.MultiPolygon([*solids, _box(body, pose)]).convex_hull
    assert isinstance(hull, shapely.Polygon)
    return PlacedPiece(hull, solids)


def _legs(box: Sequence[float], side: float) -> list[tuple[float, float, float, float]]:
    """Four square legs at the corners of a box."""
    x0, y0, x1, y1 = box
    return [(x, y, x + side, y + side) for x in (x0, x1 - side) for y in (y0, y1 - side)]


def _seats(number: int, width: float, depth: float) -> list[tuple[float, float, float, float]]:
    """Chairs at both long sides of a table, pushed in by half a seat."""
    if number == 0:
        return []
    middles = (np.arange(number) + 0.5) / number * width - 0.5 * width
    rows = (-0.5 * _SEAT, depth - 0.5 * _SEAT)
    return [(x, float(y) - 0.5 * _SEAT, x + _SEAT, float(y) + 0.5 * _SEAT) for x in rows for y in middles]


def _box(box: Sequence[float], pose: Pose2D) -> shapely.Polygon:
    x0, y0, x1, y1 = box
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return shapely.Polygon(transform_points(pose, corners))
