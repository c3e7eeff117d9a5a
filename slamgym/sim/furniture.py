"""Furniture as a scanner 12 to 18 cm above the floor sees it: what stands in which kind of room.

Sizes are those of ordinary European furniture (Neufert, Architects' Data, on dwellings and offices). What
stands on legs is legs here, what reaches the floor is solid, a wall-hung basin isn't there at all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Form = Literal["solid", "legs", "panels", "column", "round", "wavy"]
"""``panels``: a back and two sides, as desks and open shelves have; ``column``: one leg in the middle, as of
round tables and office chairs; ``wavy``: a curtain."""

# Sides of the legs of tables, beds and sofas, and of chairs; thickness of a panel [m].
_LEG = 0.06
_CHAIR_LEG = 0.04
_PANEL = 0.03

# Side of a seat, and the room before a table in which its chairs are moved about [m].
_SEAT = 0.42
_SEAT_ROOM = 0.55

# How far chairs are pushed in (below 0) or pulled out, and to the side [m]; how much they are turned [rad].
_PULLED_OUT = (-0.15, 0.2)
_ASIDE = 0.05
_TURNED = 0.2

# What untidiness adds to these: chairs stand anywhere about their table, at any angle; tables are moved a little.
_UNTIDY_OUT = 0.3
_UNTIDY_ASIDE = 0.2
_UNTIDY_TURNED = math.pi
UNTIDY_TABLES = 0.3
"""Standard deviation of the angle of what stands in the middle of an untidy room [rad]."""

# Corners of what is round.
_CORNERS = 8

# Depth and width of a curtain's folds [m].
_FOLD = (0.06, 0.1)


@dataclass(frozen=True)
class Piece:
    """A kind of furniture: ranges of width along its back and of depth away from it [m]."""

    width: tuple[float, float]
    depth: tuple[float, float]
    forms: tuple[Form, ...] = ("solid",)  # one is drawn
    chance: float = 1.0  # that a furnished room has one
    number: int = 1  # at most
    place: Literal["wall", "middle", "anywhere"] = "wall"
    seats: int = 0  # chairs at each long side that isn't at a wall
    turned: float = 0.0  # standard deviation of its angle [rad]
    share_of_wall: float = (
        0.0  # its width is at least this share of its wall, if the range allows it
    )


Corners = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Shape:
    """Solids that stand on the floor, in a frame whose y axis is the piece's back and whose x axis leads away."""

    depth: float  # of all it needs, with the room for its chairs [m]
    width: float
    solids: Sequence[Corners]  # corners of each [m]
    chairs: Sequence[Sequence[Sequence[Corners]]] = ()  # per chair, per place: its legs


def shape_of(
    piece: Piece,
    width: float,
    depth: float,
    rng: np.random.Generator,
    places: int,
    untidiness: float = 0.0,
) -> Shape:
    """Draw the shape of a piece of a size: its form, and the places of its chairs, of which the first is now.

    Args:
        piece: Its kind.
        width: [m]
        depth: [m]
        rng: Draws form and places.
        places: Of each chair.
        untidiness: How far chairs are from where they belong, 0 to 1.
    """
    form = piece.forms[int(rng.integers(len(piece.forms)))]
    if not piece.seats:
        return Shape(depth, width, _solids(form, 0.0, width, depth))
    # With its back to a wall a table has chairs on one side only.
    back = _SEAT_ROOM if piece.place != "wall" else 0.0
    middles = [((seat + 0.5) / piece.seats - 0.5) * width for seat in range(piece.seats)]
    sides = [(back + depth, 1.0)] + ([(back, -1.0)] if back else [])
    draws = iter(rng.random((len(sides) * piece.seats, places, 3)).tolist())
    chair_legs = "column" if piece.place == "wall" and rng.random() < 0.6 else "legs"
    chairs = tuple(
        tuple(_chair(chair_legs, edge, outwards, middle, draw, untidiness) for draw in next(draws))
        for edge, outwards in sides
        for middle in middles
    )
    reach = max(width, middles[-1] - middles[0] + _SEAT * 1.5 + 2.0 * _ASIDE)
    return Shape(back + depth + _SEAT_ROOM, reach, _solids(form, back, width, depth), chairs)


def _chair(
    legs: str, edge: float, outwards: float, middle: float, draw: Sequence[float], untidiness: float
) -> Sequence[Corners]:
    """The legs of a chair at a table's edge."""
    out = _PULLED_OUT[0] + draw[0] * (_PULLED_OUT[1] + untidiness * _UNTIDY_OUT - _PULLED_OUT[0])
    aside = _ASIDE + untidiness * _UNTIDY_ASIDE
    x, y = edge + outwards * out, middle + (2.0 * draw[1] - 1.0) * aside
    if legs == "column":
        return (_square(x, y, _LEG),)
    turn = (2.0 * draw[2] - 1.0) * (_TURNED + untidiness * _UNTIDY_TURNED)
    half = 0.5 * (_SEAT - _CHAIR_LEG)
    cos, sin = half * math.cos(turn), half * math.sin(turn)
    corners = (
        (cos - sin, cos + sin),
        (-sin - cos, cos - sin),
        (sin - cos, -cos - sin),
        (sin + cos, sin - cos),
    )
    return tuple(_square(x + dx, y + dy, _CHAIR_LEG) for dx, dy in corners)


def _solids(form: Form, back: float, width: float, depth: float) -> Sequence[Corners]:
    """Solids of a piece whose back lies at x = ``back``."""
    half, front, middle = 0.5 * width, back + depth, back + 0.5 * depth
    if form == "solid":
        return (_box(back, -half, front, half),)
    if form == "round":
        angles = [(corner + 0.5) * (2.0 * math.pi / _CORNERS) for corner in range(_CORNERS)]
        return (
            [(middle + 0.5 * depth * math.cos(angle), half * math.sin(angle)) for angle in angles],
        )
    if form == "column":
        return (_square(middle, 0.0, _LEG),)
    if form == "panels":
        sides = [_box(back, y, front, y + _PANEL) for y in (-half, half - _PANEL)]
        return (*sides, _box(back, -half + _PANEL, back + _PANEL, half - _PANEL))
    if form == "wavy":
        points = 2 * max(2, round(width / _FOLD[1])) + 1
        front_edge = [
            (front - (0.0 if point % 2 else _FOLD[0]), half - width * point / (points - 1))
            for point in range(points)
        ]
        return ([(back, -half), (back, half), *front_edge],)
    inset = 0.5 * _LEG
    rows = [-half + inset, half - inset] if width < 1.9 else [-half + inset, 0.0, half - inset]
    return tuple(_square(x, y, _LEG) for x in (back + inset, front - inset) for y in rows)


def _square(x: float, y: float, side: float) -> Corners:
    half = 0.5 * side
    return _box(x - half, y - half, x + half, y + half)


def _box(x0: float, y0: float, x1: float, y1: float) -> Corners:
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


_SHELF = Piece((0.8, 1.6), (0.28, 0.4), chance=0.6)
_BOX = Piece((0.25, 0.5), (0.2, 0.4), chance=0.3, number=2, turned=0.15)
_BIN = Piece((0.2, 0.3), (0.2, 0.3), ("round",), 0.5)
_PLANT = Piece((0.22, 0.4), (0.22, 0.4), ("round",), 0.5, number=2)
_RADIATOR = Piece((0.6, 1.6), (0.08, 0.12), chance=0.7)
_LAMP = Piece((0.06, 0.06), (0.06, 0.06), ("column",), 0.4)
_CHAIR = Piece((_SEAT, _SEAT), (_SEAT, _SEAT), ("legs",), 0.5, number=2, turned=0.15)
_TOYS = Piece(
    (0.1, 0.2), (0.1, 0.2), ("solid", "round"), 0.4, number=3, place="anywhere", turned=1.0
)
_SHOES = Piece((0.1, 0.24), (0.27, 0.3), chance=0.7, number=3, turned=0.1)
_DINING = Piece((1.2, 1.8), (0.75, 0.95), ("legs",), 0.9, place="middle", seats=2)
_ROUND_TABLE = Piece((0.9, 1.1), (0.9, 1.1), ("column",), 0.3, place="middle", seats=1)
_DESK = Piece((1.2, 1.6), (0.6, 0.8), ("legs", "panels"), 0.8, seats=1)
_SMALL_TABLE = Piece((0.7, 1.1), (0.6, 0.75), ("legs",), 0.5, seats=1)
_TOILET = Piece((0.28, 0.38), (0.5, 0.7), ("round", "solid"))
_BASIN = Piece((0.5, 0.9), (0.4, 0.5), ("solid", "column", "legs"))
_CURTAIN = Piece((0.25, 0.5), (0.1, 0.14), ("wavy",), 0.5, number=2)

_CATALOGUE: dict[tuple[str, ...], tuple[Piece, ...]] = {
    ("bed", "child", "guest"): (
        Piece((0.9, 1.8), (1.95, 2.1), ("legs", "solid")),
        Piece((1.0, 2.4), (0.58, 0.65), chance=0.95),
        Piece((0.4, 0.5), (0.35, 0.45), ("legs", "solid"), 0.8, number=2),
        Piece((0.8, 1.4), (0.42, 0.5), ("solid", "legs"), 0.6),
        Piece((1.0, 1.4), (0.55, 0.7), ("legs", "panels"), 0.4, seats=1),
        _RADIATOR, _CURTAIN, _CHAIR, _BOX, _PLANT, _TOYS, _LAMP,
    ),
    ("bath",): (
        Piece((1.5, 1.75), (0.7, 0.8), chance=0.7), _BASIN, _TOILET,
        Piece((0.6, 0.6), (0.55, 0.65), chance=0.5), _BIN, _RADIATOR,
    ),
    ("toilet", "wc", "restroom"): (_TOILET, _BASIN, Piece((0.12, 0.2), (0.12, 0.2), ("round",), 0.7)),
    ("kitchen", "pantry"): (
        Piece((1.5, 4.2), (0.56, 0.62), share_of_wall=0.8),
        Piece((1.2, 3.0), (0.56, 0.62), chance=0.7, share_of_wall=0.6),
        Piece((0.6, 0.75), (0.6, 0.7)),
        _SMALL_TABLE, _DINING, _BIN, _RADIATOR, _CHAIR,
    ),
    ("living", "lounge", "family"): (
        Piece((1.7, 2.5), (0.85, 1.0), ("solid", "legs")),
        Piece((1.2, 2.2), (0.38, 0.5), ("solid", "legs"), 0.9),
        Piece((0.9, 1.2), (0.5, 0.65), ("legs", "solid"), 0.8, place="middle"),
        Piece((0.75, 0.95), (0.75, 0.9), ("solid", "legs"), 0.7, number=2, turned=0.3),
        _SHELF, _RADIATOR, _CURTAIN, _PLANT, _LAMP, _CHAIR, _BOX, _TOYS, _DINING, _SHELF,
    ),
    ("dining", "meeting", "conference"): (
        Piece((1.4, 2.4), (0.8, 1.0), ("legs",), 0.9, place="middle", seats=3), _ROUND_TABLE,
        Piece((1.2, 1.8), (0.4, 0.5), ("solid", "legs"), 0.7), _RADIATOR, _PLANT, _CHAIR, _SHELF,
    ),
    ("office", "study", "work"): (
        _DESK, _DESK, _SHELF, _SHELF, _BIN, _RADIATOR, _PLANT, _BOX, _CHAIR,
    ),
    ("hall", "corridor", "entry", "lobby"): (
        Piece((0.6, 1.1), (0.25, 0.38), ("solid", "legs"), 0.6), _SHOES, _RADIATOR, _PLANT,
        Piece((0.2, 0.25), (0.2, 0.25), ("round",), 0.3),
    ),
    ("garage", "parking"): (
        Piece((1.75, 1.9), (4.0, 4.7), ("legs",), 0.6, place="middle"), _SHELF, _SHELF, _BOX, _BOX, _BIN,
        Piece((0.1, 0.15), (1.5, 1.7), chance=0.4, number=2, turned=0.1),
    ),
    ("storage", "boiler", "wardrobe", "closet", "utility", "freight", "laundry"): (
        _SHELF, Piece((0.6, 0.65), (0.6, 0.65), chance=0.5), _BOX, _BOX, _BIN,
    ),
    ("balcony", "terrace", "veranda"): (_PLANT, _PLANT, _SMALL_TABLE, _CHAIR, _BOX),
}  # fmt: skip

SMALL_THINGS = (
    Piece((0.1, 0.3), (0.1, 0.3), ("round", "solid"), turned=1.0),
    Piece((0.08, 0.12), (0.25, 0.3), turned=0.5),
    Piece((0.05, 0.08), (0.05, 0.08), ("column",)),
    Piece((0.3, 0.45), (0.3, 0.45), ("legs",), place="anywhere", turned=1.0),
    Piece((0.2, 0.6), (0.03, 0.05), turned=0.1),
    Piece((0.1, 0.4), (0.1, 0.3), turned=1.0),
)
"""Things that lie and stand about in untidy rooms: bags, toys, shoes, stands, stools, boards, boxes."""

# For rooms of no known category.
_ANY_ROOM = (
    Piece((1.2, 2.0), (0.4, 0.6), ("solid", "legs"), 0.8),
    Piece((0.7, 1.0), (0.7, 0.95), ("solid", "legs"), 0.6),
    Piece((1.0, 1.5), (0.6, 0.8), ("legs",), 0.5, place="middle", seats=1),
    _SHELF, _RADIATOR, _CHAIR, _PLANT, _BOX, _BIN, _LAMP,
)  # fmt: skip


def pieces_for(category: str) -> tuple[Piece, ...]:
    """Pieces that belong in a room of a category, in the order in which it is placed."""
    name = category.lower()
    for words, pieces in _CATALOGUE.items():
        if any(word in name for word in words):
            return pieces
    return _ANY_ROOM


def likely_category(area: float, aspect: float, rng: np.random.Generator) -> str:
    """Guess what a room without a category is, by its area [m2] and its length over its width."""
    if aspect > 3.0 and area < 25.0:
        return "Hallway"
    guesses: tuple[tuple[float, tuple[str, ...]], ...] = (
        (2.5, ("Toilet", "Storage")),
        (6.0, ("Bathroom", "Bathroom", "Storage", "Hallway")),
        (9.0, ("Kitchen", "Bedroom", "Office", "Bathroom")),
        (16.0, ("Bedroom", "Bedroom", "Kitchen", "Office", "Dining_Room")),
        (math.inf, ("Living_Room", "Living_Room", "Dining_Room", "Office", "Bedroom")),
    )
    names = next(names for limit, names in guesses if area < limit)
    return names[int(rng.integers(len(names)))]
