"""What breaks up plain rooms: pillars, kitchen islands, chimney breasts, shafts, bay windows."""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.cells import Box, Cell, snap
from slamgym.cad.doors import Opening

OPENING_CLEARANCE = 0.9
"""Free width kept round pillars and islands, and before doors [m]."""
_PILLAR_SPACING = (4.5, 6.5)
_CHIMNEY_ROOMS = {"Living_Room", "Kitchen", "Bedroom", "Bathroom", "Dining_Room", "Hall"}
_BAY_ROOMS = {"Living_Room", "Bedroom", "Dining_Room", "Kitchen"}
_PILLARS = 0.35
"""Probability that a room of more than 40 m2 has pillars."""
_ISLANDS = 0.3
"""Probability that a kitchen of more than 15 m2 has an island."""
_CHIMNEYS = 0.05
"""Probability that a wall of a room has a chimney breast or a shaft."""
_BAYS = 0.1
"""Probability that a room has a bay window, if it has an outer wall."""


def free_standing(cells: Sequence[Cell], rng: np.random.Generator) -> list[Polygon]:
    """Pillars and islands: what a robot can drive round."""
    solids: list[Polygon] = []
    for cell in cells:
        box = _inner_box(cell.polygon)
        if box is None:
            continue
        if cell.category == "Kitchen" and box.area > 15.0 and rng.random() < _ISLANDS:
            solids += _island(box, rng)
        elif box.area > 40.0 and rng.random() < _PILLARS:
            solids += _pillars(box, rng)
    return solids


def _inner_box(polygon: Polygon) -> Box | None:
    """The cell as a box, if it is one."""
    return Box(*polygon.bounds) if len(polygon.exterior.coords) == 5 and not polygon.interiors else None


def _island(box: Box, rng: np.random.Generator) -> list[Polygon]:
    """A kitchen island about the middle of the room, along its longer side."""
    length, depth = rng.uniform(1.2, 2.2), rng.uniform(0.7, 0.95)
    width, height = (length, depth) if box.width >= box.height else (depth, length)
    if min(box.width - width, box.height - height) < 2 * OPENING_CLEARANCE + 0.3:
        return []
    x, y = 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)
    return [shapely.box(snap(x - width / 2), snap(y - height / 2), snap(x + width / 2), snap(y + height / 2))]


def _pillars(box: Box, rng: np.random.Generator) -> list[Polygon]:
    """Pillars on a regular grid, square or round."""
    size, round_ = snap(rng.uniform(0.3, 0.55)), rng.random() < 0.3
    spacing = rng.uniform(*_PILLAR_SPACING)
    columns, rows = (max(1, round(side / spacing) - 1) for side in (box.width, box.height))
    xs = np.linspace(box.x0, box.x1, columns + 2)[1:-1]
    ys = np.linspace(box.y0, box.y1, rows + 2)[1:-1]
    return [_pillar(snap(x), snap(y), size, bool(round_)) for x in xs for y in ys]


def _pillar(x: float, y: float, size: float, is_round: bool) -> Polygon:
    if not is_round:
        half = snap(0.5 * size)
        return shapely.box(snap(x - half), snap(y - half), snap(x + half), snap(y + half))
    angles = np.linspace(0.0, 2 * math.pi, 12, endpoint=False)
    return Polygon([(snap(x + 0.5 * size * math.cos(a)), snap(y + 0.5 * size * math.sin(a))) for a in angles])


def wall_blocks(
    cells: Sequence[Cell],
    openings: Sequence[Opening],
    thickness: float,
    rng: np.random.Generator,
) -> list[Polygon]:
    """Chimney breasts and shafts that stand before a wall, clear of doors and of other walls' openings."""
    keep_free = shapely.union_all(
        [opening.box.polygon().buffer(OPENING_CLEARANCE, join_style="mitre") for opening in openings]
    )
    blocks = []
    for cell in cells:
        box = Box(*cell.polygon.bounds)
        if cell.category not in _CHIMNEY_ROOMS or min(box.width, box.height) < 2.6:
            continue
        for wall in _edges(cell.polygon):
            if rng.random() >= _CHIMNEYS:
                continue
            block = _block(wall, thickness, rng)
            if block is not None and not block.intersects(keep_free):
                blocks.append(block)
    return blocks


def _edges(polygon: Polygon) -> list[tuple[float, float, float, float]]:
    """Edges of a cell with the cell on their left."""
    points = shapely.get_coordinates(shapely.geometry.polygon.orient(polygon).exterior)
    return [(*a, *b) for a, b in zip(points[:-1].tolist(), points[1:].tolist(), strict=True)]


def _block(
    wall: tuple[float, float, float, float], thickness: float, rng: np.random.Generator
) -> Polygon | None:
    """A block at a wall: a shaft in its corner, or a chimney breast along it."""
    length = math.hypot(wall[2] - wall[0], wall[3] - wall[1])
    width, depth = snap(rng.uniform(0.4, 1.4)), snap(rng.uniform(0.2, 0.55))
    if length < width + 1.8:
        return None
    corner = rng.random() < 0.5
    start = 0.0 if corner else snap(rng.uniform(0.7, length - width - 0.7))
    far = snap(depth + 0.5 * thickness)
    return _along_wall(wall, [(start, 0.0), (start + width, 0.0), (start + width, far), (start, far)])


def _along_wall(wall: tuple[float, float, float, float], corners: Sequence[tuple[float, float]]) -> Polygon:
    """A polygon of corners by their distances along a wall and to its left [m]."""
    x0, y0, x1, y1 = wall
    length = math.hypot(x1 - x0, y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    return Polygon([(snap(x0 + a * ux - b * uy), snap(y0 + a * uy + b * ux)) for a, b in corners])


def bay_windows(cells: Sequence[Cell], thickness: float, rng: np.random.Generator) -> dict[int, Polygon]:
    """Free space that bulges out of outer walls, with oblique sides, for some of the cells by their index."""
    built = shapely.union_all([cell.polygon for cell in cells])
    bays: dict[int, Polygon] = {}
    for index, cell in enumerate(cells):
        if cell.category not in _BAY_ROOMS or rng.random() >= _BAYS:
            continue
        outer = [
            wall for wall in _edges(cell.polygon) if math.hypot(wall[2] - wall[0], wall[3] - wall[1]) > 3.0
        ]
        for wall in outer:
            bay = _bay(wall, thickness, rng)
            # Its outer wall must not run into another part of the building either.
            outside = bay.buffer(thickness).difference(cell.polygon)
            if outside.intersection(built).area < 0.5 * thickness**2:
                bays[index] = bay
                break
    return bays


def _bay(wall: tuple[float, float, float, float], thickness: float, rng: np.random.Generator) -> Polygon:
    """A trapezium that leans out of a wall."""
    length = math.hypot(wall[2] - wall[0], wall[3] - wall[1])
    width, depth = rng.uniform(1.6, min(3.0, length - 0.6)), rng.uniform(0.5, 0.9)
    start, inside, slant = 0.5 * (length - width), 0.5 * thickness, rng.uniform(0.2, 0.9) * depth
    corners = [
        (start, inside),
        (start, 0.0),
        (start + slant, -depth),
        (start + width - slant, -depth),
        (start + width, 0.0),
        (start + width, inside),
    ]
    return _along_wall(wall, corners)
