"""A seeded generator of believable homes and offices.

The layout comes first (:mod:`slamgym.cad.home_layouts`, :mod:`slamgym.cad.office_layouts`): cells that tile the
building.
Then openings join the rooms (:mod:`slamgym.cad.doors`), walls get their thickness, and details such as
pillars, kitchen islands, chimney breasts, shafts and bay windows break up the rooms. Sizes follow HouseExpo
(``benchmarks/realism/plan_statistics.py`` compares them); unlike HouseExpo's single outlines, plans may have
loops: second doors, rings of corridor, cores, pillars and islands.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal, TypeGuard

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.cells import GRID, Box, Cell, Wall, snap
from slamgym.cad.doors import Opening, join_rooms
from slamgym.cad.floorplan import Door, FloorPlan, Room, check_plan
from slamgym.cad.home_layouts import lay_out_home, rooms_for_area
from slamgym.cad.office_layouts import lay_out_office
from slamgym.core.config import Positive, Settings, Share
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.types import FloatArray

MIN_PASSAGE = 0.6
"""Every part of a plan can be reached through gaps at least this wide [m]."""
PLAN_MARGIN = 0.1
"""Distance of a plan's bounding box from the axes [m], as in HouseExpo."""
MAX_PLAN_ATTEMPTS = 100
"""So often a layout is drawn again that can't be built."""

Kind = Literal["mixed", "home", "office"]


# The defaults resemble HouseExpo, offices apart: its homes have a median area of 112 m2, 5th and 95th percentiles of 30
# and 373 m2, and walls of 0.10-0.12 m.
_OFFICE_SHARE = 0.15
"""Share of offices among plans of both kinds."""
_HOME_AREA = 112.0
"""Median area of homes [m2]."""
_HOME_AREA_SIGMA = 0.74
"""Spread of the logarithm of their area."""
_HOME_AREA_RANGE = (20.0, 600.0)
"""Smallest and largest home [m2]."""
_WALL_THICKNESS = (0.1, 0.12, 0.14)
"""Even whole centimetres [m]."""
_OPEN_PLAN = {"home": 0.8, "office": 0.2}
"""Probability that two living areas are joined by a wide opening or none of the wall is left."""

_OPENING_CLEARANCE = 0.9
"""Free width kept round pillars and islands, and before doors [m]."""
_PILLAR_SPACING = (4.5, 6.5)
"""Distance between pillars [m]."""
_CHIMNEY_ROOMS = {"Living_Room", "Kitchen", "Bedroom", "Bathroom", "Dining_Room", "Hall"}
"""Rooms that may have a chimney breast or a shaft."""
_BAY_ROOMS = {"Living_Room", "Bedroom", "Dining_Room", "Kitchen"}
"""Rooms that may have a bay window."""
_PILLARS = 0.35
"""Probability that a room of more than 40 m2 has pillars."""
_ISLANDS = 0.3
"""Probability that a kitchen of more than 15 m2 has an island."""
_CHIMNEYS = 0.05
"""Probability that a wall of a room has a chimney breast or a shaft."""
_BAYS = 0.1
"""Probability that a room has a bay window, if it has an outer wall."""


class PlanGeneratorConfig(Settings):
    """The kind of plans that the generator makes."""

    kind: Kind = "mixed"
    """Homes, offices, or both."""
    office_area: tuple[Positive, Positive] = (150.0, 700.0)
    """Smallest and largest office floor [m2]."""
    loops: Share = 0.35
    """Probability that a plan has doors that make loops; cores, pillars and islands make others."""


def generate_plan(
    seed: int | np.random.Generator,
    config: PlanGeneratorConfig | None = None,
    plan_id: str | None = None,
) -> FloorPlan:
    """Make a floor plan.

    Every plan is valid and connected: a robot of radius 0.25 m can enter every room.

    Args:
        seed: The same seed gives the same plan; or a generator to draw from.
        config: The settings.
        plan_id: Name of the plan; by default made of its kind and seed.
    """
    config = config or PlanGeneratorConfig()
    rng = seed if isinstance(seed, np.random.Generator) else np.random.default_rng(seed)
    is_office = config.kind == "office"
    if config.kind == "mixed":
        is_office = rng.random() < _OFFICE_SHARE
    kind = "office" if is_office else "home"
    if plan_id is None:
        plan_id = kind if isinstance(seed, np.random.Generator) else f"{kind}_{seed:06d}"
    # The size is drawn once: drawing it again after a failure would make large plans rare.
    area = _draw_area(is_office, config, rng)
    rooms = rooms_for_area(area, rng)
    for _ in range(MAX_PLAN_ATTEMPTS):
        cells = lay_out_office(area, rng) if is_office else lay_out_home(area, rooms, rng)
        plan = _build(plan_id, cells, config.loops, _OPEN_PLAN[kind], rng)
        if plan is not None:
            return plan
    raise ConfigError(
        f"no {kind} of {area:.0f} m2 came out in {MAX_PLAN_ATTEMPTS} attempts; ask for larger ones"
    )


def _draw_area(is_office: bool, config: PlanGeneratorConfig, rng: np.random.Generator) -> float:
    if is_office:
        return float(np.exp(rng.uniform(*np.log(config.office_area))))
    smallest, largest = _HOME_AREA_RANGE
    for _ in range(MAX_PLAN_ATTEMPTS):
        area = float(rng.lognormal(np.log(_HOME_AREA), _HOME_AREA_SIGMA))
        if smallest <= area <= largest:
            return area
    return _HOME_AREA


def _build(
    plan_id: str, cells: Sequence[Cell], loops: float, open_plan: float, rng: np.random.Generator
) -> FloorPlan | None:
    """Turn a layout into a plan: openings, walls, details. None if it came out unusable."""
    thickness = float(rng.choice(_WALL_THICKNESS))
    openings = join_rooms(cells, thickness, rng, open_plan, loops)
    if openings is None:
        return None
    interiors = [_interior(cell.polygon, thickness) for cell in cells]
    if any(interior is None for interior in interiors):
        return None
    for index, bay in _bay_windows(cells, thickness, rng).items():
        wider = shapely.union(interiors[index], bay, grid_size=GRID)
        interiors[index] = wider if isinstance(wider, Polygon) else None
    rooms = [room for room in interiors if isinstance(room, Polygon)]
    solids = [*_free_standing(cells, rng), *_wall_blocks(cells, openings, thickness, rng)]
    passages = [opening.box.polygon() for opening in openings]
    space = shapely.union_all([*rooms, *passages], grid_size=GRID)
    for solid in solids:
        smaller = shapely.difference(space, solid, grid_size=GRID)
        if _is_roomy(smaller):
            space = smaller
    if not _is_roomy(space):
        return None
    plan = _place(plan_id, space, cells, rooms, openings, rng)
    try:
        check_plan(plan, robot_radius=0.25)
    except PlanError:
        return None
    return plan


def _interior(cell: Polygon, thickness: float) -> Polygon | None:
    """A cell without its walls, or None if less than a metre of width is left."""
    interior = cell.buffer(-0.5 * thickness, join_style="mitre")
    interior = shapely.set_precision(interior, GRID)
    narrowest = interior.buffer(-0.45, join_style="mitre")
    if not isinstance(narrowest, Polygon) or narrowest.is_empty:
        return None
    return interior if isinstance(interior, Polygon) else None


def _is_roomy(space: BaseGeometry) -> TypeGuard[Polygon]:
    """True if everything hangs together through gaps of at least :data:`MIN_PASSAGE`."""
    if not isinstance(space, Polygon) or not space.is_valid:
        return False
    return isinstance(space.buffer(-0.5 * MIN_PASSAGE, quad_segs=2), Polygon)


def _place(
    plan_id: str,
    space: Polygon,
    cells: Sequence[Cell],
    rooms: Sequence[Polygon],
    openings: Sequence[Opening],
    rng: np.random.Generator,
) -> FloorPlan:
    """Turn by a right angle or mirror, by chance, and move to the positive quadrant."""
    swap = bool(rng.integers(2))
    flip = bool(rng.integers(2))

    def turn(points: FloatArray) -> FloatArray:
        turned = points[:, ::-1] if swap else points
        return turned * [-1.0 if flip else 1.0, 1.0]

    min_x, min_y, _, _ = shapely.transform(space, turn).bounds
    origin = [min_x - PLAN_MARGIN, min_y - PLAN_MARGIN]

    def move(points: FloatArray) -> FloatArray:
        return np.round(turn(points) - origin, 2)

    placed = []
    for cell, room in zip(cells, rooms, strict=True):
        placed.append(Room(cell.category, shapely.transform(room, move)))
    placed.sort(key=lambda room: room.category)
    return FloorPlan(
        id=plan_id,
        free_space=shapely.transform(space, move),
        rooms=tuple(placed),
        doors=tuple(_moved(opening.door, move) for opening in openings if opening.door),
        source=f"generator:{plan_id}",
    )


def _moved(door: Door, move: Callable[[FloatArray], FloatArray]) -> Door:
    ends = np.array([door.start, door.end])
    (x0, y0), (x1, y1) = move(ends).tolist()
    return Door((x0, y0), (x1, y1))


def _free_standing(cells: Sequence[Cell], rng: np.random.Generator) -> list[Polygon]:
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
    is_box = len(polygon.exterior.coords) == 5 and not polygon.interiors
    return Box(*polygon.bounds) if is_box else None


def _island(box: Box, rng: np.random.Generator) -> list[Polygon]:
    """A kitchen island about the middle of the room, along its longer side."""
    length = rng.uniform(1.2, 2.2)
    depth = rng.uniform(0.7, 0.95)
    width, height = (length, depth) if box.width >= box.height else (depth, length)
    if min(box.width - width, box.height - height) < 2 * _OPENING_CLEARANCE + 0.3:
        return []
    x = 0.5 * (box.x0 + box.x1)
    y = 0.5 * (box.y0 + box.y1)
    return [_box_about(x, y, width / 2, height / 2)]


def _box_about(x: float, y: float, half_width: float, half_height: float) -> Polygon:
    """A box about a point [m], with its corners on the grid."""
    return shapely.box(
        snap(x - half_width), snap(y - half_height), snap(x + half_width), snap(y + half_height)
    )


def _pillars(box: Box, rng: np.random.Generator) -> list[Polygon]:
    """Pillars on a regular grid, square or round."""
    size = snap(rng.uniform(0.3, 0.55))
    is_round = bool(rng.random() < 0.3)
    spacing = rng.uniform(*_PILLAR_SPACING)
    columns = max(1, round(box.width / spacing) - 1)
    rows = max(1, round(box.height / spacing) - 1)
    xs = np.linspace(box.x0, box.x1, columns + 2)[1:-1]
    ys = np.linspace(box.y0, box.y1, rows + 2)[1:-1]
    return [_pillar(snap(x), snap(y), size, is_round) for x in xs for y in ys]


def _pillar(x: float, y: float, size: float, is_round: bool) -> Polygon:
    if not is_round:
        half = snap(0.5 * size)
        return _box_about(x, y, half, half)
    corners = []
    for angle in np.linspace(0.0, 2 * math.pi, 12, endpoint=False):
        corner_x = snap(x + 0.5 * size * math.cos(angle))
        corner_y = snap(y + 0.5 * size * math.sin(angle))
        corners.append((corner_x, corner_y))
    return Polygon(corners)


def _wall_blocks(
    cells: Sequence[Cell], openings: Sequence[Opening], thickness: float, rng: np.random.Generator
) -> list[Polygon]:
    """Chimney breasts and shafts that stand before a wall, clear of doors and of other walls' openings."""
    passages = [opening.box.polygon() for opening in openings]
    wider = [passage.buffer(_OPENING_CLEARANCE, join_style="mitre") for passage in passages]
    keep_free = shapely.union_all(wider)
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


def _edges(polygon: Polygon) -> list[Wall]:
    """Edges of a cell with the cell on their left."""
    oriented = shapely.geometry.polygon.orient(polygon)
    points = shapely.get_coordinates(oriented.exterior).tolist()
    return [Wall(x0, y0, x1, y1) for (x0, y0), (x1, y1) in itertools.pairwise(points)]


def _block(wall: Wall, thickness: float, rng: np.random.Generator) -> Polygon | None:
    """A block at a wall: a shaft in its corner, or a chimney breast along it."""
    length = wall.length
    width = snap(rng.uniform(0.4, 1.4))
    depth = snap(rng.uniform(0.2, 0.55))
    if length < width + 1.8:
        return None
    start = 0.0
    if rng.random() >= 0.5:  # not in the corner
        start = snap(rng.uniform(0.7, length - width - 0.7))
    stop = start + width
    far = snap(depth + 0.5 * thickness)
    return _along_wall(wall, [(start, 0.0), (stop, 0.0), (stop, far), (start, far)])


def _along_wall(wall: Wall, corners: Sequence[tuple[float, float]]) -> Polygon:
    """A polygon of corners by their distances along a wall and to its left [m]."""
    x0, y0, x1, y1 = wall
    ux = (x1 - x0) / wall.length
    uy = (y1 - y0) / wall.length
    points = []
    for along, left in corners:
        x = snap(x0 + along * ux - left * uy)
        y = snap(y0 + along * uy + left * ux)
        points.append((x, y))
    return Polygon(points)


def _bay_windows(
    cells: Sequence[Cell], thickness: float, rng: np.random.Generator
) -> dict[int, Polygon]:
    """Free space that bulges out of outer walls, with oblique sides, for some of the cells by their index."""
    built = shapely.union_all([cell.polygon for cell in cells])
    bays: dict[int, Polygon] = {}
    for index, cell in enumerate(cells):
        if cell.category not in _BAY_ROOMS or rng.random() >= _BAYS:
            continue
        for wall in _edges(cell.polygon):
            if wall.length <= 3.0:
                continue
            bay = _bay(wall, thickness, rng)
            # Its outer wall must not run into another part of the building either.
            outside = bay.buffer(thickness).difference(cell.polygon)
            if outside.intersection(built).area < 0.5 * thickness**2:
                bays[index] = bay
                break
    return bays


def _bay(wall: Wall, thickness: float, rng: np.random.Generator) -> Polygon:
    """A trapezium that leans out of a wall."""
    length = wall.length
    width = rng.uniform(1.6, min(3.0, length - 0.6))
    depth = rng.uniform(0.5, 0.9)
    slant = rng.uniform(0.2, 0.9) * depth
    start = 0.5 * (length - width)
    stop = start + width
    inside = 0.5 * thickness
    corners = [
        (start, inside),
        (start, 0.0),
        (start + slant, -depth),
        (stop - slant, -depth),
        (stop, 0.0),
        (stop, inside),
    ]
    return _along_wall(wall, corners)
