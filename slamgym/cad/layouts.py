"""Layouts of homes and offices: which rooms, how large, and where.

Offices have rooms in rows along a corridor, a corridor round a core, or an open floor. Their depths and widths are
those of ordinary office buildings (Neufert, Architects' Data, on offices): rooms 4-6 m deep, 2.6-5 m wide, corridors
1.5-2.4 m.
"""

import numpy as np
import shapely

from slamgym.cad.cells import Box, Cell, Space, cut_out, snap, subdivide

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

MAX_CARVED = 3
_CORRIDOR_WIDTH = (1.05, 1.6)
_ROOM_DEPTH = (3.8, 5.6)
_OFFICE_CORRIDOR = (1.5, 2.4)
_CELL_WIDTH = {
    "Office": 3.4,
    "Room": 5.4,
    "Kitchen": 3.6,
    "Storage": 2.6,
    "Toilet": 2.6,
    "Lobby": 5.0,
}
_ROW_WEIGHTS = {"Office": 0.7, "Room": 0.16, "Storage": 0.05, "Kitchen": 0.04, "Toilet": 0.05}


def rooms_for_area(area: float, rng: np.random.Generator) -> int:
    """Draw the number of rooms of a home.

    HouseExpo's median number of rooms grows as 1.2 area^0.375: 4 at 30 m2, 7 at 112 m2, 11 at 400 m2. Its
    largest plans with few rooms are halls rather than homes: here a room has at most 60 m2 on average.
    """
    drawn = round(1.12 * area**0.375 * float(rng.lognormal(0.0, 0.36)))
    return int(np.clip(drawn, max(1, int(area / 60.0)), 26))


def lay_out_home(area: float, rooms: int, rng: np.random.Generator) -> list[Cell]:
    """Place the rooms of a home.

    Args:
        area: Floor area including interior walls [m2].
        rooms: Number of rooms, corridors apart.
        rng: Source of all draws.
    """
    public, private, carved = _programme(area, rooms, rng)
    wings = _wings(public, private, rng)
    main_spaces = [
        space for space in (*public, *private) if not any(space in wing for wing in wings)
    ]
    main_public = [space for space in public if space in main_spaces]
    main_private = [space for space in private if space in main_spaces]
    floor = sum(space.area for space in main_spaces)
    aspect = float(np.clip(rng.lognormal(np.log(1.2), 0.25), 1.0, 2.6))
    main = Box(0.0, 0.0, snap(np.sqrt(floor * aspect)), snap(np.sqrt(floor / aspect)))
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
    extra = rng.choice(_MORE, size=max(0, rooms - len(_SEQUENCE)), p=_MORE_WEIGHTS)
    # A small home has any of the usual rooms, not always the same ones.
    usual = list(_SEQUENCE[: max(3, rooms)])
    chosen = [*usual[:rooms], *extra]
    for index in range(2, len(chosen)):
        if rng.random() < 0.3:
            chosen[index] = str(rng.choice(_MORE, p=_MORE_WEIGHTS))
        if chosen[index] in _ONCE and chosen[index] in chosen[:index]:
            chosen[index] = "Bedroom"
    carved: list[str] = []
    for category in sorted(_CARVED & set(chosen)):
        if len(chosen) > 3 and len(carved) < MAX_CARVED and rng.random() < 0.45:
            chosen.remove(category)
            carved.append(category)
    sizes = {**_PUBLIC, **_PRIVATE}
    wanted = [(str(name), sizes[str(name)] * float(rng.lognormal(0.0, 0.22))) for name in chosen]
    scale = area / sum(size for _, size in wanted)
    # Baths and closets don't grow as the house does.
    wanted = [(name, size * scale ** (0.6 if name in _CARVED else 1.0)) for name, size in wanted]
    scale = area / sum(size for _, size in wanted)
    spaces = [Space(name, size * scale) for name, size in wanted]
    rng.shuffle(spaces)
    public = [space for space in spaces if space.category in _PUBLIC]
    private = [space for space in spaces if space.category not in _PUBLIC]
    return public, private, carved


def _wings(
    public: list[Space], private: list[Space], rng: np.random.Generator
) -> list[list[Space]]:
    """Choose rooms that stick out of the main block: they make L, T, U and Z shapes."""
    rest = [*private, *public]
    number = min(int(rng.choice([0, 1, 2, 3], p=[0.3, 0.36, 0.24, 0.1])), max(0, len(rest) - 2))
    wings: list[list[Space]] = []
    for _ in range(number):
        size = 1 if len(rest) < 6 else int(rng.integers(1, 4))
        start = int(rng.integers(0, len(rest) - size))
        wing, rest = rest[start : start + size], rest[:start] + rest[start + size :]
        wings.append(wing)
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
    share = sum(space.area for space in public) / sum(space.area for space in (*public, *private))
    front, back = box.cut(share, along_x=box.width >= box.height)
    return subdivide(front, public, rng) + _along_corridor(
        back, private, rng, box.width >= box.height
    )


def _along_corridor(
    box: Box, spaces: list[Space], rng: np.random.Generator, along_x: bool | None = None
) -> list[Cell]:
    """Rooms on one or both sides of a corridor that runs along x, or along y."""
    along_x = box.width >= box.height if along_x is None else along_x
    depth = box.height if along_x else box.width
    width = float(rng.uniform(*_CORRIDOR_WIDTH))
    if depth < width + 2.6:
        return subdivide(box, spaces, rng)
    count = len(spaces)
    split = (
        count
        if depth < width + 5.0
        else int(np.clip(round(count * rng.uniform(0.4, 0.6)), 1, count - 1))
    )
    total = sum(space.area for space in spaces)
    share = sum(space.area for space in spaces[:split]) / total * (1.0 - width / depth)
    share = (
        share if split == count else float(np.clip(share, 2.4 / depth, 1.0 - (width + 2.4) / depth))
    )
    near, rest = box.cut(share, along_x=not along_x)
    corridor, far = rest.cut(width / (rest.height if along_x else rest.width), along_x=not along_x)
    cells = [*subdivide(near, spaces[:split], rng)]
    if split < count:
        cells += subdivide(far, spaces[split:], rng)
    else:
        corridor = rest
    return [*cells, Cell("Hallway", corridor.polygon())]


def _attach_wing(
    cells: list[Cell], main: Box, wing: list[Space], rng: np.random.Generator
) -> list[Cell]:
    """Put a wing against a side of the main block where it overlaps nothing."""
    area = sum(space.area for space in wing)
    built = shapely.union_all([cell.polygon for cell in cells])
    for _ in range(30):
        horizontal = bool(rng.integers(2))  # at the top or bottom side
        side = main.width if horizontal else main.height
        width = float(np.clip(np.sqrt(area * rng.uniform(0.6, 1.7)), 2.0, 0.85 * side))
        depth = area / width
        offset = float(rng.choice([0.0, side - width, rng.uniform(0.0, side - width)]))
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
        x0, y0 = snap(main.x0 + offset), main.y1 if after else snap(main.y0 - depth)
        return Box(x0, y0, snap(x0 + width), snap(y0 + depth) if after else main.y0)
    x0, y0 = main.x1 if after else snap(main.x0 - depth), snap(main.y0 + offset)
    return Box(x0, y0, snap(x0 + depth) if after else main.x0, snap(y0 + width))


def _carve(cells: list[Cell], carved: list[str], rng: np.random.Generator) -> list[Cell]:
    """Cut small rooms out of larger ones: from a corner, which makes an L, or as a core to walk round."""
    for category in carved:
        order = sorted(
            range(len(cells)), key=lambda index: -cells[index].polygon.area * rng.uniform(0.6, 1.4)
        )
        for index in order[:3]:
            host = cells[index]
            box = (
                _niche(Box(*host.polygon.bounds), host.category in _PUBLIC, rng)
                if len(host.polygon.exterior.coords) == 5
                else None
            )
            if box is None or host.category in _CARVED | {"Hallway"} or host.polygon.interiors:
                continue
            rest = cut_out(host.polygon, box)
            cells[index] = Cell(host.category, rest)
            cells.append(Cell(category, box.polygon()))
            break
    return cells


def _niche(host: Box, may_be_core: bool, rng: np.random.Generator) -> Box | None:
    """A place for a small room within a large one that keeps enough width next to it."""
    width, height = snap(rng.uniform(1.5, 2.6)), snap(rng.uniform(1.4, 2.3))
    if rng.random() < 0.5:
        width, height = height, width
    free_x, free_y = host.width - width, host.height - height
    if may_be_core and min(free_x, free_y) > 2.8 and rng.random() < 0.4:
        x0, y0 = (
            snap(host.x0 + free_x * rng.uniform(0.45, 0.55)),
            snap(host.y0 + free_y * rng.uniform(0.45, 0.55)),
        )
    elif min(free_x, free_y) > 1.5:
        x0 = host.x0 if rng.random() < 0.5 else snap(host.x1 - width)
        y0 = host.y0 if rng.random() < 0.5 else snap(host.y1 - height)
    else:
        return None
    return Box(x0, y0, snap(x0 + width), snap(y0 + height))


def lay_out_office(area: float, rng: np.random.Generator) -> list[Cell]:
    """Place the rooms of an office floor of about ``area`` [m2]; the scheme is drawn among those that fit."""
    corridor, depth = snap(rng.uniform(*_OFFICE_CORRIDOR)), snap(rng.uniform(*_ROOM_DEPTH))
    scheme = rng.choice(["spine", "ring", "open"], p=[0.4, 0.35, 0.25])
    ring_height = 2 * depth + 2 * corridor + rng.uniform(3.6, 6.0)
    if scheme == "ring" and area > 1.1 * ring_height**2:
        return _ring(
            Box(0.0, 0.0, snap(area / ring_height), snap(ring_height)), depth, corridor, rng
        )
    spine_height = 2 * depth + corridor
    if scheme == "open" and area > 120.0:
        height = snap(depth + rng.uniform(7.0, 10.0))
        return _open_floor(Box(0.0, 0.0, snap(area / height), height), depth, rng)
    return _spine(
        Box(0.0, 0.0, snap(area / spine_height), snap(spine_height)), depth, corridor, rng
    )


def _spine(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """A corridor with rooms on both sides and a lobby at one end."""
    if box.width > 28.0:
        return _angled_spine(box, depth, corridor, rng)
    y0, y1 = snap(box.y0 + depth), snap(box.y0 + depth + corridor)
    lobby = snap(box.x0 + min(rng.uniform(3.5, 5.5), 0.4 * box.width))
    return [
        *_row(Box(lobby, box.y0, box.x1, y0), True, rng),
        *_row(Box(lobby, y1, box.x1, box.y1), True, rng),
        Cell("Hallway", Box(lobby, y0, box.x1, y1).polygon()),
        Cell("Lobby", Box(box.x0, box.y0, lobby, box.y1).polygon()),
    ]


def _angled_spine(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """Two spines that meet at a right angle in a lobby: an L-shaped building."""
    share = rng.uniform(0.4, 0.6)
    first, side = snap(share * box.width), box.height
    second = snap((1.0 - share) * box.width)
    y0, y1 = snap(depth), snap(depth + corridor)
    return [
        Cell("Lobby", Box(0.0, 0.0, side, side).polygon()),
        *_row(Box(side, 0.0, snap(side + first), y0), True, rng),
        *_row(Box(side, y1, snap(side + first), side), True, rng),
        Cell("Hallway", Box(side, y0, snap(side + first), y1).polygon()),
        *_row(Box(0.0, side, y0, snap(side + second)), False, rng),
        *_row(Box(y1, side, side, snap(side + second)), False, rng),
        Cell("Hallway", Box(y0, side, y1, snap(side + second)).polygon()),
    ]


def _ring(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """Rooms all round, a ring of corridor, and a core of service rooms in the middle."""
    hall = Box(box.x0, snap(box.y0 + depth), box.x1, snap(box.y1 - depth))
    if rng.random() < 0.6:  # rooms at the two ends too
        hall = Box(snap(box.x0 + depth), hall.y0, snap(box.x1 - depth), hall.y1)
    core = Box(
        snap(hall.x0 + corridor),
        snap(hall.y0 + corridor),
        snap(hall.x1 - corridor),
        snap(hall.y1 - corridor),
    )
    cells = [
        Cell("Hallway", cut_out(hall.polygon(), core)),
        *_row(Box(box.x0, box.y0, box.x1, hall.y0), True, rng),
        *_row(Box(box.x0, hall.y1, box.x1, box.y1), True, rng),
        *_row(core, True, rng, {"Toilet": 0.35, "Storage": 0.3, "Kitchen": 0.15, "Room": 0.2}),
    ]
    if hall.x0 > box.x0:
        cells += _row(Box(box.x0, hall.y0, hall.x0, hall.y1), False, rng)
        cells += _row(Box(hall.x1, hall.y0, box.x1, hall.y1), False, rng)
    return cells


def _open_floor(box: Box, depth: float, rng: np.random.Generator) -> list[Cell]:
    """A large open office with a row of rooms along one side."""
    y = snap(box.y0 + depth)
    return [
        *_row(Box(box.x0, box.y0, box.x1, y), True, rng),
        Cell("Office", Box(box.x0, y, box.x1, box.y1).polygon()),
    ]


def _row(
    box: Box, along_x: bool, rng: np.random.Generator, weights: dict[str, float] | None = None
) -> list[Cell]:
    """Rooms side by side along x, or along y."""
    weights = weights or _ROW_WEIGHTS
    length = box.width if along_x else box.height
    spaces: list[Space] = []
    while not spaces or sum(space.area for space in spaces) < length - 1.5:
        category = str(
            rng.choice(list(weights), p=np.array(list(weights.values())) / sum(weights.values()))
        )
        spaces.append(Space(category, _CELL_WIDTH[category] * float(rng.uniform(0.8, 1.3))))
    cells = []
    for index, space in enumerate(spaces[:-1]):
        room, box = box.cut(space.area / sum(rest.area for rest in spaces[index:]), along_x)
        cells.append(Cell(space.category, room.polygon()))
    return [*cells, Cell(spaces[-1].category, box.polygon())]
