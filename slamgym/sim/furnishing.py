"""Where furniture goes: along a room's walls and in its corners, about its middle, or anywhere."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import transform_points
from slamgym.core.types import FloatArray, Pose2D
from slamgym.sim.furniture import CURTAIN, Piece, Shape, pieces_for, shape_of
from slamgym.sim.passages import Passages
from slamgym.sim.room_areas import RoomArea

# Places tried for one piece before it is left out.
_TRIES = 14

# Floor for one group of furniture [m2], most groups in a room, and how complete further ones are.
_GROUP_AREA = 18.0
_MOST_GROUPS = 4
_LATER_GROUPS = 0.6

# Gap between a piece and its wall [m].
_WALL_GAP = (0.01, 0.06)

# Offsets from a corner that are tried, because another piece often stands there [m].
_FROM_CORNER = (0.0, 0.0, 0.65, 1.0)


@dataclass(frozen=True)
class PlacedPiece:
    """A piece in its place, world frame."""

    box: FloatArray  # what it covers, as :mod:`slamgym.sim.passages` has boxes
    solids: tuple[FloatArray, ...]  # what stands on the floor: corners of each, shape (K, 2) [m]
    chairs: tuple[tuple[tuple[FloatArray, ...], ...], ...]  # per chair, per place: its legs


def furnish(
    passages: Passages, room: RoomArea, radii: FloatArray, share: float, rng: np.random.Generator
) -> tuple[list[PlacedPiece], int]:
    """Put into a room what belongs there and what there is room for.

    Args:
        passages: The building as it has been filled so far; goes on.
        room: The room.
        radii: Discs of these radii must still reach all they reached [m].
        share: Of the usual furniture.
        rng: Draws what there is and where it goes.

    Returns:
        What was placed, and how many pieces were left out.
    """
    placed: list[PlacedPiece] = []
    left_out = 0
    if len(room.walls) == 0:
        return placed, left_out
    # A large room holds several groups of furniture; every further one less complete.
    groups = 1 + min(int(room.area / _GROUP_AREA), _MOST_GROUPS - 1)
    for group, piece in itertools.product(range(groups), pieces_for(room.category)):
        for chance in rng.random(piece.number).tolist():
            if chance >= piece.chance * share * (1.0 if group == 0 else _LATER_GROUPS):
                continue
            found = _place(passages, room, piece, radii, rng)
            if found is None:
                left_out += 1
            else:
                placed.append(found)
    return placed, left_out


def hang_curtains(
    passages: Passages, glass: FloatArray, radii: FloatArray, share: float, rng: np.random.Generator
) -> list[PlacedPiece]:
    """Curtains at both sides of windows, shape (N, 4), each with the room on its left."""
    placed = []
    for x0, y0, x1, y1 in glass.tolist():
        if rng.random() >= CURTAIN.chance * share:
            continue
        length, angle = math.hypot(x1 - x0, y1 - y0), math.atan2(y1 - y0, x1 - x0)
        width = min(float(rng.uniform(*CURTAIN.width)), 0.4 * length)
        shape = shape_of(CURTAIN, width, float(rng.uniform(*CURTAIN.depth)), rng)
        for along in (0.5 * width, length - 0.5 * width):
            x = x0 + along * math.cos(angle) - _WALL_GAP[1] * math.sin(angle)
            y = y0 + along * math.sin(angle) + _WALL_GAP[1] * math.cos(angle)
            pose = np.array([[x, y, angle + 0.5 * math.pi]])
            if passages.first_fit(_boxes(shape, pose), radii) == 0:
                placed.append(_put_down(shape, pose[0]))
    return placed


def _place(
    passages: Passages, room: RoomArea, piece: Piece, radii: FloatArray, rng: np.random.Generator
) -> PlacedPiece | None:
    """Draw a piece's size and shape, and put it into the first of some places that has room for it."""
    length = np.hypot(room.walls[:, 2] - room.walls[:, 0], room.walls[:, 3] - room.walls[:, 1])
    width, depth = float(rng.uniform(*piece.width)), float(rng.uniform(*piece.depth))
    if piece.share_of_wall:
        longest = float(length.max()) - 2.0 * _WALL_GAP[1]
        width = min(max(width, piece.share_of_wall * longest), longest, piece.width[1])
    if piece.forms == ("round",) and abs(width - depth) < 0.1:
        depth = width
    shape = shape_of(piece, width, depth, rng)
    draws = rng.random((_TRIES, 4))
    if piece.place == "wall":
        poses = _at_walls(shape, room.walls, length, draws)
    else:
        longest_wall = room.walls[np.argmax(length)]
        spread = 0.3 if piece.place == "middle" else 1.2
        poses = _about_middle(shape, room, longest_wall, spread, draws)
    if piece.turned:
        poses[:, 2] += piece.turned * rng.standard_normal(len(poses))
    found = passages.first_fit(_boxes(shape, poses), radii) if len(poses) else -1
    return _put_down(shape, poses[found]) if found >= 0 else None


def _at_walls(shape: Shape, walls: FloatArray, length: FloatArray, draws: FloatArray) -> FloatArray:
    """Poses of the middle of a piece's back, shape (N, 3); two of three are near a corner."""
    fitting = np.flatnonzero(length > shape.width + 2.0 * _WALL_GAP[0])
    if len(fitting) == 0:
        return np.empty((0, 3))
    total = np.cumsum(length[fitting])
    index = fitting[np.searchsorted(total, draws[:, 0] * total[-1], side="right")]
    x0, y0, x1, y1 = walls[index].T
    long = length[index]
    near, far = 0.5 * shape.width + _WALL_GAP[0], long - 0.5 * shape.width - _WALL_GAP[0]
    corner = np.array(_FROM_CORNER)[np.arange(len(draws)) % len(_FROM_CORNER)]
    along = np.where(
        draws[:, 1] < 0.33,
        np.minimum(near + corner, far),
        np.where(draws[:, 1] < 0.66, np.maximum(far - corner, near), near + draws[:, 2] * (far - near)),
    )
    ux, uy = (x1 - x0) / long, (y1 - y0) / long
    gap = _WALL_GAP[0] + draws[:, 3] * (_WALL_GAP[1] - _WALL_GAP[0])
    return np.column_stack([x0 + along * ux - gap * uy, y0 + along * uy + gap * ux, np.arctan2(ux, -uy)])


def _about_middle(
    shape: Shape, room: RoomArea, longest: FloatArray, spread: float, draws: FloatArray
) -> FloatArray:
    """Poses about a room's middle, the wider the later they are tried, parallel to its longest wall."""
    wall = math.atan2(longest[3] - longest[1], longest[2] - longest[0])
    angle = wall + 0.5 * math.pi * np.floor(4.0 * draws[:, 2])
    wider = spread * np.linspace(1.0, 4.0 if spread < 1.0 else 1.0, len(draws))
    x = (
        room.middle[0]
        + wider * room.spread[0] * (2.0 * draws[:, 0] - 1.0)
        - 0.5 * shape.depth * np.cos(angle)
    )
    y = (
        room.middle[1]
        + wider * room.spread[1] * (2.0 * draws[:, 1] - 1.0)
        - 0.5 * shape.depth * np.sin(angle)
    )
    return np.column_stack([x, y, angle])


def _boxes(shape: Shape, poses: FloatArray) -> FloatArray:
    """What a piece would cover at some poses, shape (N, 6)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    half = 0.5 * shape.depth
    sizes = np.broadcast_to([half, 0.5 * shape.width], (len(poses), 2))
    return np.column_stack([poses[:, 0] + half * cos, poses[:, 1] + half * sin, cos, sin, sizes])


def _put_down(shape: Shape, pose: FloatArray) -> PlacedPiece:
    """A shape in the world. All its solids are moved at once."""
    solids = [*shape.solids, *(leg for chair in shape.chairs for place in chair for leg in place)]
    moved = _moved(solids, Pose2D(*pose.tolist()))
    rest = iter(moved[len(shape.solids) :])
    chairs = tuple(tuple(tuple(next(rest) for _ in place) for place in chair) for chair in shape.chairs)
    return PlacedPiece(_boxes(shape, pose[None])[0], tuple(moved[: len(shape.solids)]), chairs)


def _moved(solids: Sequence[FloatArray], pose: Pose2D) -> list[FloatArray]:
    """Corners in the world's frame."""
    ends = np.cumsum([len(corners) for corners in solids])
    return np.split(transform_points(pose, np.vstack(solids)), ends[:-1])
