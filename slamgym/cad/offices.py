"""Layouts of offices: rooms in rows along a corridor, a corridor round a core, or an open floor.

Depths and widths are those of ordinary office buildings (Neufert, Architects' Data, on offices): rooms 4-6 m
deep, 2.6-5 m wide, corridors 1.5-2.4 m.
"""

import numpy as np

from slamgym.cad.cells import Box, Cell, Space, cut_out, snap

_ROOM_DEPTH = (3.8, 5.6)
_CORRIDOR_WIDTH = (1.5, 2.4)
_CELL_WIDTH = {"Office": 3.4, "Room": 5.4, "Kitchen": 3.6, "Storage": 2.6, "Toilet": 2.6, "Lobby": 5.0}
_ROW_WEIGHTS = {"Office": 0.7, "Room": 0.16, "Storage": 0.05, "Kitchen": 0.04, "Toilet": 0.05}


def lay_out_office(area: float, rng: np.random.Generator) -> list[Cell]:
    """Place the rooms of an office floor of about ``area`` [m2]; the scheme is drawn among those that fit."""
    corridor, depth = snap(rng.uniform(*_CORRIDOR_WIDTH)), snap(rng.uniform(*_ROOM_DEPTH))
    scheme = rng.choice(["spine", "ring", "open"], p=[0.4, 0.35, 0.25])
    ring_height = 2 * depth + 2 * corridor + rng.uniform(3.6, 6.0)
    if scheme == "ring" and area > 1.1 * ring_height**2:
        return _ring(Box(0.0, 0.0, snap(area / ring_height), snap(ring_height)), depth, corridor, rng)
    spine_height = 2 * depth + corridor
    if scheme == "open" and area > 120.0:
        height = snap(depth + rng.uniform(7.0, 10.0))
        return _open_floor(Box(0.0, 0.0, snap(area / height), height), depth, rng)
    return _spine(Box(0.0, 0.0, snap(area / spine_height), snap(spine_height)), depth, corridor, rng)


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
        snap(hall.x0 + corridor), snap(hall.y0 + corridor), snap(hall.x1 - corridor), snap(hall.y1 - corridor)
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
        category = str(rng.choice(list(weights), p=np.array(list(weights.values())) / sum(weights.values())))
        spaces.append(Space(category, _CELL_WIDTH[category] * float(rng.uniform(0.8, 1.3))))
    total = sum(space.area for space in spaces)
    cells = []
    for index, space in enumerate(spaces[:-1]):
        room, box = box.cut(space.area / sum(rest.area for rest in spaces[index:]), along_x)
        cells.append(Cell(space.category, room.polygon()))
    assert total > 0.0
    return [*cells, Cell(spaces[-1].category, box.polygon())]
