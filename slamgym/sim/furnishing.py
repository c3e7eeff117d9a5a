"""Where furniture goes: along a room's walls and in its corners, about its middle, or anywhere."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.sim.furniture import (
    SMALL_THINGS,
    UNTIDY_TABLES,
    Corners,
    Piece,
    Shape,
    pieces_for,
    shape_of,
)
from slamgym.sim.passages import Passages
from slamgym.sim.rooms_and_doors import RoomArea

_TRIES = 10
"""So many places are tried for one piece before it is left out."""

_GROUP_AREA = 18.0
"""Floor for one group of furniture [m2]."""
_MOST_GROUPS = 4
"""So many groups of furniture stand in a room at most."""
_LATER_GROUPS = 0.6
"""Share of the first group's pieces that each further one has."""

_SMALL_THINGS = 1.0
"""Small things on the floor where it is most untidy [1/m2]."""

_WALL_GAP = (0.01, 0.06)
"""Least and largest gap between a piece and its wall [m]."""

_FROM_CORNER = np.array([0.0, 0.0, 0.65, 1.0])
"""Offsets from a corner that are tried, because another piece often stands there [m]."""


@dataclass(frozen=True)
class PlacedPiece:
    """A piece in its place, world frame."""

    shape: Shape
    pose: FloatArray  # of the middle of its back: x, y, theta
    box: FloatArray  # what it covers, as :mod:`slamgym.sim.passages` has boxes


@dataclass(frozen=True)
class Wish:
    """The way in which a building is to be furnished."""

    share: float  # of the usual furniture; more than 1 crowds the rooms
    radii: FloatArray  # discs that must still reach all they reached [m]
    places: int  # of each chair: where it stands first, and where it may be moved to
    untidiness: float = 0.0  # 0 to 1


def furnish(
    passages: Passages, room: RoomArea, wish: Wish, rng: np.random.Generator
) -> tuple[list[PlacedPiece], int]:
    """Put into a room what belongs there and what there is room for.

    Args:
        passages: The building as it has been filled so far; is filled further.
        room: The room.
        wish: How much.
        rng: Draws what there is and where it goes.

    Returns:
        What was placed, and how many pieces were left out.
    """
    placed: list[PlacedPiece] = []
    left_out = 0
    if len(room.walls) == 0:
        return placed, left_out
    # A large room holds several groups of furniture; every further one less complete.
    crowding = max(1.0, wish.share)
    usual_groups = 1 + min(int(room.area / _GROUP_AREA), _MOST_GROUPS - 1)
    groups = round(crowding * usual_groups)
    for group, piece in itertools.product(range(groups), pieces_for(room.category)):
        completeness = 1.0 if group == 0 else _LATER_GROUPS
        for draw in rng.random(piece.number).tolist():
            if draw >= piece.chance * wish.share * completeness:
                continue
            found = _place(passages, room, piece, wish, rng)
            if found is None and piece.seats:
                alone = replace(piece, seats=0, place="wall")
                found = _place(passages, room, alone, wish, rng)
            if found is None:
                left_out += 1
            else:
                placed.append(found)
    if wish.untidiness:
        number = rng.poisson(wish.untidiness * _SMALL_THINGS * room.area)
        for kind in rng.integers(len(SMALL_THINGS), size=number):
            found = _place(passages, room, SMALL_THINGS[kind], wish, rng)
            if found is not None:
                placed.append(found)
    return placed, left_out


def _place(
    passages: Passages, room: RoomArea, piece: Piece, wish: Wish, rng: np.random.Generator
) -> PlacedPiece | None:
    """Draw a piece's size and shape, and put it into the first of some places that has room for it."""
    if wish.share > 1.0 and "solid" in piece.forms and rng.random() < wish.share - 1.0:
        piece = replace(piece, forms=("solid",))
    width, depth = _draw_size(piece, room, rng)
    shape = shape_of(piece, width, depth, rng, wish.places, wish.untidiness)
    draws = rng.random((_TRIES, 4))
    if piece.place == "wall":
        poses = _at_walls(shape.width, room.walls, _WALL_GAP, _FROM_CORNER, draws)
    else:
        spread = 0.3 if piece.place == "middle" else 1.2
        poses = _about_middle(shape, room, spread, draws)
    turned = piece.turned
    if not turned and piece.place == "middle":
        turned = UNTIDY_TABLES * wish.untidiness
    if turned:
        poses[:, 2] += turned * rng.standard_normal(len(poses))
    boxes = _boxes(shape.depth, shape.width, poses)
    found = passages.first_fit(boxes, wish.radii)
    return PlacedPiece(shape, poses[found], boxes[found]) if found >= 0 else None


def _draw_size(piece: Piece, room: RoomArea, rng: np.random.Generator) -> tuple[float, float]:
    """Draw the width and the depth of a piece in a room [m]."""
    narrowest, widest = piece.width
    width = float(rng.uniform(narrowest, widest))
    depth = float(rng.uniform(*piece.depth))
    if piece.share_of_wall:
        wall = room.longest_wall
        longest = math.dist(wall[:2], wall[2:]) - 2.0 * _WALL_GAP[1]
        wanted = max(width, piece.share_of_wall * longest)
        width = min(wanted, longest, widest)
    if piece.forms == ("round",) and abs(width - depth) < 0.1:
        depth = width
    return width, depth


@kernel
def _at_walls(
    width: float,
    walls: FloatArray,
    gaps: tuple[float, float],
    from_corner: FloatArray,
    draws: FloatArray,
) -> FloatArray:
    """Poses of the middle of a piece's back, shape (N, 3); two of three are near a corner."""
    total = np.zeros(len(walls) + 1)
    for w in range(len(walls)):
        x0, y0, x1, y1 = walls[w]
        length = math.hypot(x1 - x0, y1 - y0)
        has_room = length > width + 2.0 * gaps[0]
        total[w + 1] = total[w] + (length if has_room else 0.0)
    number = len(draws) if total[-1] > 0.0 else 0
    poses = np.empty((number, 3))
    for i in range(number):
        after = np.searchsorted(total, draws[i, 0] * total[-1], side="right")
        wall = min(after - 1, len(walls) - 1)
        x0, y0, x1, y1 = walls[wall]
        length = math.hypot(x1 - x0, y1 - y0)
        near = 0.5 * width + gaps[0]
        far = length - 0.5 * width - gaps[0]
        corner = from_corner[i % len(from_corner)]
        along = near + draws[i, 2] * (far - near)
        if draws[i, 1] < 0.33:
            along = min(near + corner, far)
        elif draws[i, 1] < 0.66:
            along = max(far - corner, near)
        ux = (x1 - x0) / length
        uy = (y1 - y0) / length
        gap = gaps[0] + draws[i, 3] * (gaps[1] - gaps[0])
        poses[i, 0] = x0 + along * ux - gap * uy
        poses[i, 1] = y0 + along * uy + gap * ux
        poses[i, 2] = math.atan2(ux, -uy)
    return poses


def _about_middle(shape: Shape, room: RoomArea, spread: float, draws: FloatArray) -> FloatArray:
    """Poses about a room's middle, the wider the later they are tried, parallel to its longest wall."""
    x0, y0, x1, y1 = room.longest_wall.tolist()
    wall = math.atan2(y1 - y0, x1 - x0)
    angle = wall + 0.5 * math.pi * np.floor(4.0 * draws[:, 2])
    widest = 4.0 if spread < 1.0 else 1.0
    wider = spread * np.linspace(1.0, widest, len(draws))
    aside = wider[:, None] * room.spread * (2.0 * draws[:, :2] - 1.0)
    backs = room.middle + aside - 0.5 * shape.depth * unit_vectors(angle)
    return np.column_stack([backs, angle])


@kernel
def _boxes(depth: float, width: float, poses: FloatArray) -> FloatArray:
    """Boxes that a piece would cover at some poses, shape (N, 6)."""
    boxes = np.empty((len(poses), 6))
    for i in range(len(poses)):
        cos = math.cos(poses[i, 2])
        sin = math.sin(poses[i, 2])
        boxes[i, 0] = poses[i, 0] + 0.5 * depth * cos
        boxes[i, 1] = poses[i, 1] + 0.5 * depth * sin
        boxes[i, 2] = cos
        boxes[i, 3] = sin
        boxes[i, 4] = 0.5 * depth
        boxes[i, 5] = 0.5 * width
    return boxes


Solids = tuple[FloatArray, ...]
"""Corners of each solid, shape (K, 2) [m]."""


def put_down(pieces: Sequence[PlacedPiece]) -> tuple[Solids, tuple[tuple[Solids, ...], ...]]:
    """Shapes in the world's frame, all at once: what stays, and for each chair its places with its legs there."""
    if not pieces:
        return (), ()
    local: list[Corners] = []  # in the order in which they are handed out below
    owners: list[int] = []
    for number, piece in enumerate(pieces):
        solids = [*piece.shape.solids, *_legs(piece.shape)]
        local += solids
        owners += [number] * sum(len(corners) for corners in solids)
    poses = np.array([piece.pose for piece in pieces])
    standing = iter(_in_world(local, poses[owners]))
    furniture: list[FloatArray] = []
    chairs = []
    for piece in pieces:
        furniture += itertools.islice(standing, len(piece.shape.solids))
        for chair in piece.shape.chairs:
            places = [tuple(itertools.islice(standing, len(place))) for place in chair]
            chairs.append(tuple(places))
    return tuple(furniture), tuple(chairs)


def _in_world(local: Sequence[Corners], poses: FloatArray) -> list[FloatArray]:
    """Solids in the world's frame, from their corners and the pose of each corner's piece, shape (K, 3)."""
    corners = np.array([corner for solid in local for corner in solid])
    x, y, theta = poses.T
    cos = np.cos(theta)
    sin = np.sin(theta)
    local_x, local_y = corners.T
    world_x = x + cos * local_x - sin * local_y
    world_y = y + sin * local_x + cos * local_y
    world = np.column_stack([world_x, world_y])
    solids = []
    first = 0
    for solid in local:
        solids.append(world[first : first + len(solid)])
        first += len(solid)
    return solids


def _legs(shape: Shape) -> list[Corners]:
    """The legs of all chairs in all their places."""
    return [leg for chair in shape.chairs for place in chair for leg in place]
