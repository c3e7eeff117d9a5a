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

# Places tried for one piece before it is left out.
_TRIES = 10

# Floor for one group of furniture [m2], most groups in a room, and how complete further ones are.
_GROUP_AREA = 18.0
_MOST_GROUPS = 4
_LATER_GROUPS = 0.6

# Small things on the floor where it is most untidy [1/m2].
_SMALL_THINGS = 1.0

# Gap between a piece and its wall [m].
_WALL_GAP = (0.01, 0.06)

# Offsets from a corner that are tried, because another piece often stands there [m].
_FROM_CORNER = np.array([0.0, 0.0, 0.65, 1.0])


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
    groups = round(crowding * (1 + min(int(room.area / _GROUP_AREA), _MOST_GROUPS - 1)))
    for group, piece in itertools.product(range(groups), pieces_for(room.category)):
        for chance in rng.random(piece.number).tolist():
            if chance >= piece.chance * wish.share * (1.0 if group == 0 else _LATER_GROUPS):
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
        for kind in rng.integers(
            len(SMALL_THINGS), size=rng.poisson(wish.untidiness * _SMALL_THINGS * room.area)
        ):
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
    width, depth = float(rng.uniform(*piece.width)), float(rng.uniform(*piece.depth))
    if piece.share_of_wall:
        longest = math.dist(room.longest_wall[:2], room.longest_wall[2:]) - 2.0 * _WALL_GAP[1]
        width = min(max(width, piece.share_of_wall * longest), longest, piece.width[1])
    if piece.forms == ("round",) and abs(width - depth) < 0.1:
        depth = width
    shape = shape_of(piece, width, depth, rng, wish.places, wish.untidiness)
    draws = rng.random((_TRIES, 4))
    if piece.place == "wall":
        poses = _at_walls(shape.width, room.walls, _WALL_GAP, _FROM_CORNER, draws)
    else:
        spread = 0.3 if piece.place == "middle" else 1.2
        poses = _about_middle(shape, room, spread, draws)
    turned = piece.turned or UNTIDY_TABLES * wish.untidiness * (piece.place == "middle")
    if turned:
        poses[:, 2] += turned * rng.standard_normal(len(poses))
    boxes = _boxes(shape.depth, shape.width, poses)
    found = passages.first_fit(boxes, wish.radii)
    return PlacedPiece(shape, poses[found], boxes[found]) if found >= 0 else None


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
        length = math.hypot(walls[w, 2] - walls[w, 0], walls[w, 3] - walls[w, 1])
        total[w + 1] = total[w] + (length if length > width + 2.0 * gaps[0] else 0.0)
    number = len(draws) if total[-1] > 0.0 else 0
    poses = np.empty((number, 3))
    for i in range(number):
        wall = min(
            np.searchsorted(total, draws[i, 0] * total[-1], side="right") - 1, len(walls) - 1
        )
        x0, y0, x1, y1 = walls[wall]
        length = math.hypot(x1 - x0, y1 - y0)
        near, far = 0.5 * width + gaps[0], length - 0.5 * width - gaps[0]
        corner = from_corner[i % len(from_corner)]
        along = near + draws[i, 2] * (far - near)
        if draws[i, 1] < 0.33:
            along = min(near + corner, far)
        elif draws[i, 1] < 0.66:
            along = max(far - corner, near)
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        gap = gaps[0] + draws[i, 3] * (gaps[1] - gaps[0])
        poses[i] = x0 + along * ux - gap * uy, y0 + along * uy + gap * ux, math.atan2(ux, -uy)
    return poses


def _about_middle(shape: Shape, room: RoomArea, spread: float, draws: FloatArray) -> FloatArray:
    """Poses about a room's middle, the wider the later they are tried, parallel to its longest wall."""
    x0, y0, x1, y1 = room.longest_wall.tolist()
    wall = math.atan2(y1 - y0, x1 - x0)
    angle = wall + 0.5 * math.pi * np.floor(4.0 * draws[:, 2])
    wider = spread * np.linspace(1.0, 4.0 if spread < 1.0 else 1.0, len(draws))
    aside = wider[:, None] * room.spread * (2.0 * draws[:, :2] - 1.0)
    return np.column_stack([room.middle + aside - 0.5 * shape.depth * unit_vectors(angle), angle])


@kernel
def _boxes(depth: float, width: float, poses: FloatArray) -> FloatArray:
    """Boxes that a piece would cover at some poses, shape (N, 6)."""
    boxes = np.empty((len(poses), 6))
    for i in range(len(poses)):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        boxes[i, 0], boxes[i, 1] = poses[i, 0] + 0.5 * depth * cos, poses[i, 1] + 0.5 * depth * sin
        boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5] = cos, sin, 0.5 * depth, 0.5 * width
    return boxes


Solids = tuple[FloatArray, ...]
"""Corners of each solid, shape (K, 2) [m]."""


def put_down(pieces: Sequence[PlacedPiece]) -> tuple[Solids, tuple[tuple[Solids, ...], ...]]:
    """Shapes in the world's frame, all at once: what stays, and for each chair its places with its legs there."""
    if not pieces:
        return (), ()
    flat = [[*piece.shape.solids, *_legs(piece.shape)] for piece in pieces]
    sizes = [len(corners) for solids in flat for corners in solids]
    local = np.array([corner for solids in flat for corners in solids for corner in corners])
    owner = np.repeat(
        np.arange(len(pieces)), [sum(len(corners) for corners in solids) for solids in flat]
    )
    x, y, theta = np.array([piece.pose for piece in pieces])[owner].T
    cos, sin = np.cos(theta), np.sin(theta)
    world = np.column_stack(
        [x + cos * local[:, 0] - sin * local[:, 1], y + sin * local[:, 0] + cos * local[:, 1]]
    )
    ends = list(itertools.accumulate(sizes))
    solids = iter([world[end - size : end] for end, size in zip(ends, sizes, strict=True)])
    furniture: list[FloatArray] = []
    chairs = []
    for piece in pieces:
        furniture += itertools.islice(solids, len(piece.shape.solids))
        chairs += [
            tuple(tuple(itertools.islice(solids, len(place))) for place in chair)
            for chair in piece.shape.chairs
        ]
    return tuple(furniture), tuple(chairs)


def _legs(shape: Shape) -> list[Corners]:
    """The legs of all chairs in all their places."""
    return [leg for chair in shape.chairs for place in chair for leg in place]
