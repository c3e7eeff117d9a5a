"""Layouts of homes: which rooms, how large, and where."""

from collections.abc import Sequence

import numpy as np
import shapely

from slamgym.cad.cells import Box, Cell, Space, cut_out, snap, subdivide, total_area

_PUBLIC = {"Living_Room": 30.0, "Kitchen": 17.0, "Dining_Room": 18.0, "Hall": 12.0}
"""Wanted areas [m2] in a home of middling size; only their ratios matter."""
_PRIVATE = {
    "Bedroom": 17.0,
    "Bathroom": 8.0,
    "Toilet": 4.0,
    "Office": 13.0,
    "Child_Room": 13.0,
    "Guest_Room": 14.0,
    "Room": 13.0,
    "Storage": 5.0,
    "Wardrobe": 4.5,
    "Gym": 18.0,
    "Garage": 30.0,
}
_ONCE = {"Garage", "Gym", "Hall", "Guest_Room"}
"""No home has two of these."""
_CARVED = {"Bathroom", "Toilet", "Wardrobe", "Storage"}
"""Small rooms that may be cut out of a corner of a larger one."""

# The order in which rooms join a home as it grows; HouseExpo has a bedroom, a bath and a kitchen in nearly
# every home, and a toilet, a living room and an office in every second or third.
_SEQUENCE = (
    "Kitchen",
    "Bathroom",
    "Bedroom",
    "Living_Room",
    "Toilet",
    "Bedroom",
    "Dining_Room",
    "Bathroom",
)
_MORE = (
    "Bedroom",
    "Office",
    "Garage",
    "Room",
    "Child_Room",
    "Storage",
    "Wardrobe",
    "Guest_Room",
    "Hall",
    "Gym",
)
_MORE_WEIGHTS = (0.17, 0.14, 0.14, 0.14, 0.08, 0.09, 0.08, 0.07, 0.06, 0.03)

"""Shares of the rooms that a large home has beyond the usual ones, and of those that stand for a usual one."""

MAX_CARVED = 3
"""Most rooms that are cut out of others."""
_CORRIDOR_WIDTH = (1.05, 1.6)
"""Of homes [m]."""


def rooms_for_area(area: float, rng: np.random.Generator) -> int:
    """Draw the number of rooms of a home.

    HouseExpo's median number of rooms grows as 1.2 area^0.375: 4 at 30 m2, 7 at 112 m2, 11 at 400 m2. Its
    largest plans with few rooms are halls rather than homes: here a room has at most 60 m2 on average.
    """
    usual = 1.12 * area**0.375
    drawn = round(usual * float(rng.lognormal(0.0, 0.36)))
    fewest = max(1, int(area / 60.0))
    return int(np.clip(drawn, fewest, 26))


def lay_out_home(area: float, rooms: int, rng: np.random.Generator) -> list[Cell]:
    """Place the rooms of a home.

    Args:
        area: Floor area including interior walls [m2].
        rooms: Number of rooms, corridors apart.
        rng: Source of all draws.
    """
    public, private, carved = _programme(area, rooms, rng)
    wings = _wings(public, private, rng)
    in_wings = [space for wing in wings for space in wing]
    main_public = [space for space in public if space not in in_wings]
    main_private = [space for space in private if space not in in_wings]
    floor = total_area([*main_public, *main_private])
    aspect = float(np.clip(rng.lognormal(np.log(1.2), 0.25), 1.0, 2.6))
    width = snap(np.sqrt(floor * aspect))
    height = snap(np.sqrt(floor / aspect))
    main = Box(0.0, 0.0, width, height)
    cells = _fill_main(main, main_public, main_private, rng)
    for wing in wings:
        cells += _attach_wing(cells, main, wing, rng)
    return _carve(cells, carved, rng)


def _programme(
    area: float, rooms: int, rng: np.random.Generator
) -> tuple[list[Space], list[Space], list[str]]:
    """Public rooms, private rooms, and small rooms to be cut out of others, with areas that sum to it."""
    if rooms == 1:
        return [Space("Room", area)], [], []
    chosen = _chosen_rooms(rooms, rng)
    carved: list[str] = []
    for category in sorted(_CARVED & set(chosen)):
        if len(chosen) > 3 and len(carved) < MAX_CARVED and rng.random() < 0.45:
            chosen.remove(category)
            carved.append(category)
    spaces = _sized(chosen, area, rng)
    rng.shuffle(spaces)
    public = [space for space in spaces if space.category in _PUBLIC]
    private = [space for space in spaces if space.category not in _PUBLIC]
    return public, private, carved


def _chosen_rooms(rooms: int, rng: np.random.Generator) -> list[str]:
    """Categories of the rooms of a home: a small one has any of the usual rooms, not always the same ones."""
    extra = rng.choice(_MORE, size=max(0, rooms - len(_SEQUENCE)), p=_MORE_WEIGHTS)
    chosen = [*_SEQUENCE[:rooms], *map(str, extra)]
    for index in range(2, len(chosen)):
        if rng.random() < 0.3:
            chosen[index] = str(rng.choice(_MORE, p=_MORE_WEIGHTS))
        if chosen[index] in _ONCE and chosen[index] in chosen[:index]:
            chosen[index] = "Bedroom"
    return chosen


def _sized(categories: Sequence[str], area: float, rng: np.random.Generator) -> list[Space]:
    """Rooms whose areas sum to that of the home."""
    usual = {**_PUBLIC, **_PRIVATE}
    spaces = []
    for category in categories:
        size = usual[category] * float(rng.lognormal(0.0, 0.22))
        spaces.append(Space(category, size))
    growth = area / total_area(spaces)
    grown = []
    for space in spaces:
        # Baths and closets don't grow as the house does.
        power = 0.6 if space.category in _CARVED else 1.0
        grown.append(Space(space.category, space.area * growth**power))
    scale = area / total_area(grown)
    return [Space(space.category, space.area * scale) for space in grown]


def _wings(
    public: list[Space], private: list[Space], rng: np.random.Generator
) -> list[list[Space]]:
    """Choose rooms that stick out of the main block: they make L, T, U and Z shapes."""
    rest = [*private, *public]
    drawn = int(rng.choice([0, 1, 2, 3], p=[0.3, 0.36, 0.24, 0.1]))
    number = min(drawn, max(0, len(rest) - 2))
    wings: list[list[Space]] = []
    for _ in range(number):
        size = 1 if len(rest) < 6 else int(rng.integers(1, 4))
        start = int(rng.integers(0, len(rest) - size))
        wings.append(rest[start : start + size])
        rest = rest[:start] + rest[start + size :]
        if len(rest) < 4:
            break
    return wings


def _fill_main(
    box: Box, public: list[Space], private: list[Space], rng: np.random.Generator
) -> list[Cell]:
    """Divide the main block: public rooms at one end, private ones along a corridor at the other."""
    if len(private) < 3 or rng.random() < 0.3:
        return subdivide(box, [*public, *private], rng)
    if not public:
        return _along_corridor(box, private, rng)
    along_x = box.width >= box.height
    share = total_area(public) / total_area([*public, *private])
    front, back = box.cut(share, along_x)
    cells = subdivide(front, public, rng)
    return cells + _along_corridor(back, private, rng, along_x)


def _along_corridor(
    box: Box, spaces: list[Space], rng: np.random.Generator, along_x: bool | None = None
) -> list[Cell]:
    """Rooms on one or both sides of a corridor that runs along x, or along y."""
    if along_x is None:
        along_x = box.width >= box.height
    depth = box.height if along_x else box.width
    width = float(rng.uniform(*_CORRIDOR_WIDTH))
    if depth < width + 2.6:
        return subdivide(box, spaces, rng)
    room_depth = 1.0 - width / depth
    if depth < width + 5.0:
        near, corridor = box.cut(room_depth, along_x=not along_x)
        return [*subdivide(near, spaces, rng), Cell.of_box("Hallway", corridor)]
    count = len(spaces)
    split = int(np.clip(round(count * rng.uniform(0.4, 0.6)), 1, count - 1))
    share = total_area(spaces[:split]) / total_area(spaces) * room_depth
    share = float(np.clip(share, 2.4 / depth, 1.0 - (width + 2.4) / depth))
    near, rest = box.cut(share, along_x=not along_x)
    rest_depth = rest.height if along_x else rest.width
    corridor, far = rest.cut(width / rest_depth, along_x=not along_x)
    cells = subdivide(near, spaces[:split], rng)
    cells += subdivide(far, spaces[split:], rng)
    cells.append(Cell.of_box("Hallway", corridor))
    return cells


def _attach_wing(
    cells: list[Cell], main: Box, wing: list[Space], rng: np.random.Generator
) -> list[Cell]:
    """Put a wing against a side of the main block where it overlaps nothing."""
    area = total_area(wing)
    built = shapely.union_all([cell.polygon for cell in cells])
    for _ in range(30):
        horizontal = bool(rng.integers(2))  # at the top or bottom side
        side = main.width if horizontal else main.height
        wanted = np.sqrt(area * rng.uniform(0.6, 1.7))
        width = float(np.clip(wanted, 2.0, 0.85 * side))
        depth = area / width
        last = side - width
        offset = float(rng.choice([0.0, last, rng.uniform(0.0, last)]))
        if depth > 2.2 * width:
            continue
        box = _beside(main, horizontal, bool(rng.integers(2)), offset, width, depth)
        if built.intersection(box.polygon()).area < 1e-6:
            return subdivide(box, wing, rng)
    return []


def _beside(
    main: Box, horizontal: bool, after: bool, offset: float, width: float, depth: float
) -> Box:
    """A box that touches the main block from outside."""
    if horizontal:
        x0 = snap(main.x0 + offset)
        x1 = snap(x0 + width)
        if after:
            return Box(x0, main.y1, x1, snap(main.y1 + depth))
        return Box(x0, snap(main.y0 - depth), x1, main.y0)
    y0 = snap(main.y0 + offset)
    y1 = snap(y0 + width)
    if after:
        return Box(main.x1, y0, snap(main.x1 + depth), y1)
    return Box(snap(main.x0 - depth), y0, main.x0, y1)


def _carve(cells: list[Cell], carved: list[str], rng: np.random.Generator) -> list[Cell]:
    """Cut small rooms out of larger ones: from a corner, which makes an L, or as a core to walk round."""
    for category in carved:
        badness = [-cell.polygon.area * rng.uniform(0.6, 1.4) for cell in cells]
        for index in np.argsort(badness, kind="stable")[:3].tolist():
            host = cells[index]
            if len(host.polygon.exterior.coords) != 5:
                continue
            box = _niche(Box(*host.polygon.bounds), host.category in _PUBLIC, rng)
            if box is None or host.category in _CARVED | {"Hallway"} or host.polygon.interiors:
                continue
            cells[index] = Cell(host.category, cut_out(host.polygon, box))
            cells.append(Cell.of_box(category, box))
            break
    return cells


def _niche(host: Box, may_be_core: bool, rng: np.random.Generator) -> Box | None:
    """A place for a small room within a large one that keeps enough width next to it."""
    width = snap(rng.uniform(1.5, 2.6))
    height = snap(rng.uniform(1.4, 2.3))
    if rng.random() < 0.5:
        width, height = height, width
    free_x = host.width - width
    free_y = host.height - height
    narrowest = min(free_x, free_y)
    if may_be_core and narrowest > 2.8 and rng.random() < 0.4:
        x0 = snap(host.x0 + free_x * rng.uniform(0.45, 0.55))
        y0 = snap(host.y0 + free_y * rng.uniform(0.45, 0.55))
    elif narrowest > 1.5:
        x0 = host.x0 if rng.random() < 0.5 else snap(host.x1 - width)
        y0 = host.y0 if rng.random() < 0.5 else snap(host.y1 - height)
    else:
        return None
    return Box(x0, y0, snap(x0 + width), snap(y0 + height))
