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

_LEG = 0.06
"""Side of a leg of a table, bed or sofa [m]."""
_CHAIR_LEG = 0.04
"""Side of a chair's leg [m]."""
_PANEL = 0.03
"""Thickness of a panel [m]."""

_SEAT = 0.42
"""Side of a seat [m]."""
_SEAT_ROOM = 0.55
"""Depth of the room before a table in which its chairs are moved about [m]."""

_PUSHED_IN = -0.15
"""Least distance of a tidy chair from its place at the table [m]: it is pushed in."""
_PULLED_OUT = 0.2
"""Largest distance of a tidy chair from its place at the table [m]."""
_ASIDE = 0.05
"""Largest distance of a tidy chair from its place to the side [m]."""
_TURNED = 0.2
"""Largest angle by which a tidy chair is turned [rad]."""

_UNTIDY_OUT = 0.3
"""Untidy chairs are pulled out farther by this at most [m]."""
_UNTIDY_ASIDE = 0.2
"""Untidy chairs stand farther to the side by this at most [m]."""
_UNTIDY_TURNED = math.pi
"""Untidy chairs are turned by this more at most [rad]: they stand at any angle."""
UNTIDY_TABLES = 0.3
"""Standard deviation of the angle of what stands in the middle of an untidy room [rad]."""

_CORNERS = 8
"""Number of corners of what is round."""

_FOLD_DEPTH = 0.06
"""Depth of a curtain's folds [m]."""
_FOLD_WIDTH = 0.1
"""Width of a curtain's folds [m]."""


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
    share_of_wall: float = 0.0  # that its width takes at least, if the range allows it


Corners = Sequence[tuple[float, float]]
"""Corners of a solid [m]."""


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
    front = back + depth
    # Where each side with chairs lies, and which way leads out of it.
    sides = [(front, 1.0)]
    if back:
        sides.append((back, -1.0))
    draws = rng.random((len(sides) * piece.seats, places, 3)).tolist()
    legs = "column" if piece.place == "wall" and rng.random() < 0.6 else "legs"
    chairs: list[list[Sequence[Corners]]] = []
    for edge, outwards in sides:
        for middle in middles:
            of_places = draws[len(chairs)]
            chairs.append(
                [_chair(legs, edge, outwards, middle, draw, untidiness) for draw in of_places]
            )
    row_of_chairs = middles[-1] - middles[0] + _SEAT * 1.5 + 2.0 * _ASIDE
    solids = _solids(form, back, width, depth)
    return Shape(front + _SEAT_ROOM, max(width, row_of_chairs), solids, chairs)


def _chair(
    legs: str, edge: float, outwards: float, middle: float, draw: Sequence[float], untidiness: float
) -> Sequence[Corners]:
    """The legs of a chair at a table's edge."""
    draw_out, draw_aside, draw_turn = draw
    out = _PUSHED_IN + draw_out * (_PULLED_OUT + untidiness * _UNTIDY_OUT - _PUSHED_IN)
    aside = _ASIDE + untidiness * _UNTIDY_ASIDE
    x = edge + outwards * out
    y = middle + (2.0 * draw_aside - 1.0) * aside
    if legs == "column":
        return [_square(x, y, _LEG)]
    turn = (2.0 * draw_turn - 1.0) * (_TURNED + untidiness * _UNTIDY_TURNED)
    half = 0.5 * (_SEAT - _CHAIR_LEG)
    cos = half * math.cos(turn)
    sin = half * math.sin(turn)
    corners = (
        (cos - sin, cos + sin),
        (-sin - cos, cos - sin),
        (sin - cos, -cos - sin),
        (sin + cos, sin - cos),
    )
    return [_square(x + dx, y + dy, _CHAIR_LEG) for dx, dy in corners]


def _solids(form: Form, back: float, width: float, depth: float) -> Sequence[Corners]:
    """Solids of a piece whose back lies at x = ``back``."""
    half = 0.5 * width
    front = back + depth
    middle = back + 0.5 * depth
    match form:
        case "solid":
            return [_box(back, -half, front, half)]
        case "round":
            return [_ellipse(middle, 0.5 * depth, half)]
        case "column":
            return [_square(middle, 0.0, _LEG)]
        case "panels":
            right = _box(back, -half, front, -half + _PANEL)
            left_edge = half - _PANEL
            left = _box(back, left_edge, front, left_edge + _PANEL)
            rear = _box(back, -half + _PANEL, back + _PANEL, left_edge)
            return [right, left, rear]
        case "wavy":
            return [_curtain(back, front, width)]
        case "legs":
            return _legs(back, front, width)


def _ellipse(middle: float, half_depth: float, half_width: float) -> Corners:
    """A round solid about a place on the x axis."""
    corners = []
    for corner in range(_CORNERS):
        angle = (corner + 0.5) * (2.0 * math.pi / _CORNERS)
        x = middle + half_depth * math.cos(angle)
        corners.append((x, half_width * math.sin(angle)))
    return corners


def _curtain(back: float, front: float, width: float) -> Corners:
    """A solid whose front is folded."""
    half = 0.5 * width
    points = 2 * max(2, round(width / _FOLD_WIDTH)) + 1
    corners = [(back, -half), (back, half)]
    for point in range(points):
        depth = 0.0 if point % 2 else _FOLD_DEPTH
        corners.append((front - depth, half - width * point / (points - 1)))
    return corners


def _legs(back: float, front: float, width: float) -> Sequence[Corners]:
    """Four legs in the corners; six if the piece is wide."""
    inset = 0.5 * _LEG
    outermost = 0.5 * width - inset
    rows = [-outermost, outermost] if width < 1.9 else [-outermost, 0.0, outermost]
    return [_square(x, y, _LEG) for x in (back + inset, front - inset) for y in rows]


def _square(x: float, y: float, side: float) -> Corners:
    half = 0.5 * side
    return _box(x - half, y - half, x + half, y + half)


def _box(x0: float, y0: float, x1: float, y1: float) -> Corners:
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


_APPLIANCE = Piece(width=(0.6, 0.65), depth=(0.6, 0.65), chance=0.5)
_ARMCHAIR = Piece(
    width=(0.75, 0.95), depth=(0.75, 0.9), forms=("solid", "legs"), chance=0.7, number=2, turned=0.3
)
_BASIN = Piece(width=(0.5, 0.9), depth=(0.4, 0.5), forms=("solid", "column", "legs"))
_BATHTUB = Piece(width=(1.5, 1.75), depth=(0.7, 0.8), chance=0.7)
_BED = Piece(width=(0.9, 1.8), depth=(1.95, 2.1), forms=("legs", "solid"))
_BEDSIDE_TABLE = Piece(
    width=(0.4, 0.5), depth=(0.35, 0.45), forms=("legs", "solid"), chance=0.8, number=2
)
_BICYCLE = Piece(width=(0.1, 0.15), depth=(1.5, 1.7), chance=0.4, number=2, turned=0.1)
_BIN = Piece(width=(0.2, 0.3), depth=(0.2, 0.3), forms=("round",), chance=0.5)
_BOX = Piece(width=(0.25, 0.5), depth=(0.2, 0.4), chance=0.3, number=2, turned=0.15)
_CAR = Piece(width=(1.75, 1.9), depth=(4.0, 4.7), forms=("legs",), chance=0.6, place="middle")
_CHAIR = Piece(
    width=(_SEAT, _SEAT), depth=(_SEAT, _SEAT), forms=("legs",), chance=0.5, number=2, turned=0.15
)
_CHEST = Piece(width=(0.8, 1.4), depth=(0.42, 0.5), forms=("solid", "legs"), chance=0.6)
_COFFEE_TABLE = Piece(
    width=(0.9, 1.2), depth=(0.5, 0.65), forms=("legs", "solid"), chance=0.8, place="middle"
)
_COUNTER = Piece(width=(1.5, 4.2), depth=(0.56, 0.62), share_of_wall=0.8)
_CURTAIN = Piece(width=(0.25, 0.5), depth=(0.1, 0.14), forms=("wavy",), chance=0.5, number=2)
_DESK = Piece(width=(1.2, 1.6), depth=(0.6, 0.8), forms=("legs", "panels"), chance=0.8, seats=1)
_DINING = Piece(
    width=(1.2, 1.8), depth=(0.75, 0.95), forms=("legs",), chance=0.9, place="middle", seats=2
)
_FRIDGE = Piece(width=(0.6, 0.75), depth=(0.6, 0.7))
_LAMP = Piece(width=(0.06, 0.06), depth=(0.06, 0.06), forms=("column",), chance=0.4)
_LONG_TABLE = Piece(
    width=(1.4, 2.4), depth=(0.8, 1.0), forms=("legs",), chance=0.9, place="middle", seats=3
)
_PLANT = Piece(width=(0.22, 0.4), depth=(0.22, 0.4), forms=("round",), chance=0.5, number=2)
_RADIATOR = Piece(width=(0.6, 1.6), depth=(0.08, 0.12), chance=0.7)
_ROUND_TABLE = Piece(
    width=(0.9, 1.1), depth=(0.9, 1.1), forms=("column",), chance=0.3, place="middle", seats=1
)
_SECOND_COUNTER = Piece(width=(1.2, 3.0), depth=(0.56, 0.62), chance=0.7, share_of_wall=0.6)
_SERVING_TABLE = Piece(width=(1.2, 1.8), depth=(0.4, 0.5), forms=("solid", "legs"), chance=0.7)
_SHELF = Piece(width=(0.8, 1.6), depth=(0.28, 0.4), chance=0.6)
_SHOES = Piece(width=(0.1, 0.24), depth=(0.27, 0.3), chance=0.7, number=3, turned=0.1)
_SHOE_CABINET = Piece(width=(0.6, 1.1), depth=(0.25, 0.38), forms=("solid", "legs"), chance=0.6)
_SIDEBOARD = Piece(width=(1.2, 2.2), depth=(0.38, 0.5), forms=("solid", "legs"), chance=0.9)
_SMALL_BIN = Piece(width=(0.12, 0.2), depth=(0.12, 0.2), forms=("round",), chance=0.7)
_SMALL_DESK = Piece(
    width=(1.0, 1.4), depth=(0.55, 0.7), forms=("legs", "panels"), chance=0.4, seats=1
)
_SMALL_TABLE = Piece(width=(0.7, 1.1), depth=(0.6, 0.75), forms=("legs",), chance=0.5, seats=1)
_SOFA = Piece(width=(1.7, 2.5), depth=(0.85, 1.0), forms=("solid", "legs"))
_TOILET = Piece(width=(0.28, 0.38), depth=(0.5, 0.7), forms=("round", "solid"))
_TOYS = Piece(
    width=(0.1, 0.2),
    depth=(0.1, 0.2),
    forms=("solid", "round"),
    chance=0.4,
    number=3,
    place="anywhere",
    turned=1.0,
)
_UMBRELLA_STAND = Piece(width=(0.2, 0.25), depth=(0.2, 0.25), forms=("round",), chance=0.3)
_WARDROBE = Piece(width=(1.0, 2.4), depth=(0.58, 0.65), chance=0.95)
_WASHING_MACHINE = Piece(width=(0.6, 0.6), depth=(0.55, 0.65), chance=0.5)

_BEDROOM = (
    _BED,
    _WARDROBE,
    _BEDSIDE_TABLE,
    _CHEST,
    _SMALL_DESK,
    _RADIATOR,
    _CURTAIN,
    _CHAIR,
    _BOX,
    _PLANT,
    _TOYS,
    _LAMP,
)
_BATHROOM = (_BATHTUB, _BASIN, _TOILET, _WASHING_MACHINE, _BIN, _RADIATOR)
_KITCHEN = (_COUNTER, _SECOND_COUNTER, _FRIDGE, _SMALL_TABLE, _DINING, _BIN, _RADIATOR, _CHAIR)
_LIVING_ROOM = (
    _SOFA,
    _SIDEBOARD,
    _COFFEE_TABLE,
    _ARMCHAIR,
    _SHELF,
    _RADIATOR,
    _CURTAIN,
    _PLANT,
    _LAMP,
    _CHAIR,
    _BOX,
    _TOYS,
    _DINING,
    _SHELF,
)
_DINING_ROOM = (_LONG_TABLE, _ROUND_TABLE, _SERVING_TABLE, _RADIATOR, _PLANT, _CHAIR, _SHELF)
_OFFICE = (_DESK, _DESK, _SHELF, _SHELF, _BIN, _RADIATOR, _PLANT, _BOX, _CHAIR)
_HALL = (_SHOE_CABINET, _SHOES, _RADIATOR, _PLANT, _UMBRELLA_STAND)
_GARAGE = (_CAR, _SHELF, _SHELF, _BOX, _BOX, _BIN, _BICYCLE)
_STORAGE = (_SHELF, _APPLIANCE, _BOX, _BOX, _BIN)

_CATALOGUE: dict[tuple[str, ...], tuple[Piece, ...]] = {
    ("bed", "child", "guest"): _BEDROOM,
    ("bath",): _BATHROOM,
    ("toilet", "wc", "restroom"): (_TOILET, _BASIN, _SMALL_BIN),
    ("kitchen", "pantry"): _KITCHEN,
    ("living", "lounge", "family"): _LIVING_ROOM,
    ("dining", "meeting", "conference"): _DINING_ROOM,
    ("office", "study", "work"): _OFFICE,
    ("hall", "corridor", "entry", "lobby"): _HALL,
    ("garage", "parking"): _GARAGE,
    ("storage", "boiler", "wardrobe", "closet", "utility", "freight", "laundry"): _STORAGE,
    ("balcony", "terrace", "veranda"): (_PLANT, _PLANT, _SMALL_TABLE, _CHAIR, _BOX),
}
"""Pieces of each kind of room, by words in its category; the first kind that fits counts."""

SMALL_THINGS = (
    Piece(width=(0.1, 0.3), depth=(0.1, 0.3), forms=("round", "solid"), turned=1.0),
    Piece(width=(0.08, 0.12), depth=(0.25, 0.3), turned=0.5),
    Piece(width=(0.05, 0.08), depth=(0.05, 0.08), forms=("column",)),
    Piece(width=(0.3, 0.45), depth=(0.3, 0.45), forms=("legs",), place="anywhere", turned=1.0),
    Piece(width=(0.2, 0.6), depth=(0.03, 0.05), turned=0.1),
    Piece(width=(0.1, 0.4), depth=(0.1, 0.3), turned=1.0),
)
"""Things that lie and stand about in untidy rooms: bags, toys, shoes, stands, stools, boards, boxes."""

_CABINET = Piece(width=(1.2, 2.0), depth=(0.4, 0.6), forms=("solid", "legs"), chance=0.8)
_SEATING = Piece(width=(0.7, 1.0), depth=(0.7, 0.95), forms=("solid", "legs"), chance=0.6)
_TABLE = Piece(
    width=(1.0, 1.5), depth=(0.6, 0.8), forms=("legs",), chance=0.5, place="middle", seats=1
)

_ANY_ROOM = (_CABINET, _SEATING, _TABLE, _SHELF, _RADIATOR, _CHAIR, _PLANT, _BOX, _BIN, _LAMP)
"""Pieces of rooms of no known category."""


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
