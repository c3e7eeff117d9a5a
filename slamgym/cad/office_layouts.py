"""Layouts of offices: rooms in rows along a corridor, a corridor round a core, or an open floor.

Depths and widths are those of ordinary office buildings (Neufert, Architects' Data, on offices): rooms 4-6 m deep,
2.6-5 m wide, corridors 1.5-2.4 m.
"""

from collections.abc import Mapping

import numpy as np

from slamgym.cad.cells import Box, Cell, Space, cut_out, snap, total_area

_ROOM_DEPTH = (3.8, 5.6)
"""Of offices [m]."""
_OFFICE_CORRIDOR = (1.5, 2.4)
"""Width of the corridors of offices [m]."""
_CELL_WIDTH = {
    "Office": 3.4,
    "Room": 5.4,
    "Kitchen": 3.6,
    "Storage": 2.6,
    "Toilet": 2.6,
    "Lobby": 5.0,
}
"""Width of the rooms of offices [m]."""
_ROW_WEIGHTS = {"Office": 0.7, "Room": 0.16, "Storage": 0.05, "Kitchen": 0.04, "Toilet": 0.05}
"""Shares of the rooms of offices."""
_CORE_WEIGHTS = {"Toilet": 0.35, "Storage": 0.3, "Kitchen": 0.15, "Room": 0.2}
"""Shares of the rooms in the core of a ring."""


def lay_out_office(area: float, rng: np.random.Generator) -> list[Cell]:
    """Place the rooms of an office floor of about ``area`` [m2]; the scheme is drawn among those that fit."""
    corridor = snap(rng.uniform(*_OFFICE_CORRIDOR))
    depth = snap(rng.uniform(*_ROOM_DEPTH))
    scheme = rng.choice(["spine", "ring", "open"], p=[0.4, 0.35, 0.25])
    ring_height = 2 * depth + 2 * corridor + rng.uniform(3.6, 6.0)
    if scheme == "ring" and area > 1.1 * ring_height**2:
        return _ring(_building(area, ring_height), depth, corridor, rng)
    if scheme == "open" and area > 120.0:
        height = snap(depth + rng.uniform(7.0, 10.0))
        return _open_floor(_building(area, height), depth, rng)
    return _spine(_building(area, 2 * depth + corridor), depth, corridor, rng)


def _building(area: float, height: float) -> Box:
    """A rectangular building of an area [m2] and a height along y [m]."""
    return Box(0.0, 0.0, snap(area / height), snap(height))


def _spine(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """A corridor with rooms on both sides and a lobby at one end."""
    if box.width > 28.0:
        return _angled_spine(box, depth, corridor, rng)
    # The corridor's two walls.
    near = snap(box.y0 + depth)
    far = snap(box.y0 + depth + corridor)
    lobby_end = snap(box.x0 + min(rng.uniform(3.5, 5.5), 0.4 * box.width))
    cells = _row(Box(lobby_end, box.y0, box.x1, near), rng)
    cells += _row(Box(lobby_end, far, box.x1, box.y1), rng)
    cells.append(Cell.of_box("Hallway", Box(lobby_end, near, box.x1, far)))
    cells.append(Cell.of_box("Lobby", Box(box.x0, box.y0, lobby_end, box.y1)))
    return cells


def _angled_spine(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """Two spines that meet at a right angle in a lobby: an L-shaped building."""
    share = rng.uniform(0.4, 0.6)
    side = box.height
    end_x = snap(side + snap(share * box.width))
    end_y = snap(side + snap((1.0 - share) * box.width))
    # The corridor's two walls.
    near = snap(depth)
    far = snap(depth + corridor)
    cells = [Cell.of_box("Lobby", Box(0.0, 0.0, side, side))]
    cells += _row(Box(side, 0.0, end_x, near), rng)
    cells += _row(Box(side, far, end_x, side), rng)
    cells.append(Cell.of_box("Hallway", Box(side, near, end_x, far)))
    cells += _row(Box(0.0, side, near, end_y), rng, along_x=False)
    cells += _row(Box(far, side, side, end_y), rng, along_x=False)
    cells.append(Cell.of_box("Hallway", Box(near, side, far, end_y)))
    return cells


def _ring(box: Box, depth: float, corridor: float, rng: np.random.Generator) -> list[Cell]:
    """Rooms all round, a ring of corridor, and a core of service rooms in the middle."""
    hall = _inset(box, 0.0, depth)
    if rng.random() < 0.6:  # rooms at the two ends too
        hall = _inset(box, depth, depth)
    core = _inset(hall, corridor, corridor)
    cells = [Cell("Hallway", cut_out(hall.polygon(), core))]
    cells += _row(box._replace(y1=hall.y0), rng)
    cells += _row(box._replace(y0=hall.y1), rng)
    cells += _row(core, rng, weights=_CORE_WEIGHTS)
    if hall.x0 > box.x0:
        cells += _row(Box(box.x0, hall.y0, hall.x0, hall.y1), rng, along_x=False)
        cells += _row(Box(hall.x1, hall.y0, box.x1, hall.y1), rng, along_x=False)
    return cells


def _inset(box: Box, margin_x: float, margin_y: float) -> Box:
    """A box without so much at each end [m]."""
    x0 = snap(box.x0 + margin_x)
    y0 = snap(box.y0 + margin_y)
    x1 = snap(box.x1 - margin_x)
    y1 = snap(box.y1 - margin_y)
    return Box(x0, y0, x1, y1)


def _open_floor(box: Box, depth: float, rng: np.random.Generator) -> list[Cell]:
    """A large open office with a row of rooms along one side."""
    y = snap(box.y0 + depth)
    cells = _row(box._replace(y1=y), rng)
    cells.append(Cell.of_box("Office", box._replace(y0=y)))
    return cells


def _row(
    box: Box,
    rng: np.random.Generator,
    along_x: bool = True,
    weights: Mapping[str, float] = _ROW_WEIGHTS,
) -> list[Cell]:
    """Rooms side by side along x, or along y."""
    length = box.width if along_x else box.height
    wanted = np.array(list(weights.values()))
    shares = wanted / sum(weights.values())
    # The width of a room stands for its area.
    spaces: list[Space] = []
    while not spaces or total_area(spaces) < length - 1.5:
        category = str(rng.choice(list(weights), p=shares))
        width = _CELL_WIDTH[category] * float(rng.uniform(0.8, 1.3))
        spaces.append(Space(category, width))
    cells = []
    for index, space in enumerate(spaces[:-1]):
        room, box = box.cut(space.area / total_area(spaces[index:]), along_x)
        cells.append(Cell.of_box(space.category, room))
    cells.append(Cell.of_box(spaces[-1].category, box))
    return cells
