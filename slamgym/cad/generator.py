"""A seeded generator of believable homes and offices.

The layout comes first (:mod:`slamgym.cad.layouts`): cells that tile the building.
Then openings join the rooms (:mod:`slamgym.cad.doors`), walls get their thickness, and details such as
pillars and chimneys break up the rooms (:mod:`slamgym.cad.details`). Sizes follow HouseExpo
(``benchmarks/realism/plan_statistics.py`` compares them); unlike HouseExpo's single outlines, plans may have
loops: second doors, rings of corridor, cores, pillars and islands.
"""

from collections.abc import Callable, Sequence
from typing import Literal, TypeGuard

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.cells import GRID, Cell
from slamgym.cad.details import bay_windows, free_standing, wall_blocks
from slamgym.cad.doors import Opening, join_rooms
from slamgym.cad.floorplan import Door, FloorPlan, Room, check_plan
from slamgym.cad.layouts import lay_out_home, lay_out_office, rooms_for_area
from slamgym.core.config import Positive, Settings, Share
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.types import FloatArray

MIN_PASSAGE = 0.6
"""Every part of a plan can be reached through gaps at least this wide [m]."""
PLAN_MARGIN = 0.1
"""Distance of a plan's bounding box from the axes [m], as in HouseExpo."""
MAX_PLAN_ATTEMPTS = 100

Kind = Literal["mixed", "home", "office"]


# The defaults resemble HouseExpo, offices apart: its homes have a median area of 112 m2, 5th and 95th percentiles of 30
# and 373 m2, and walls of 0.10-0.12 m. Thicknesses are even whole centimetres.
_OFFICE_SHARE = 0.15
_HOME_AREA, _HOME_AREA_SIGMA = 112.0, 0.74  # [m2], of the logarithm
_HOME_AREA_RANGE = (20.0, 600.0)  # [m2]
_WALL_THICKNESS = (0.1, 0.12, 0.14)  # [m]
_OPEN_PLAN = {"home": 0.8, "office": 0.2}
"""Probability that two living areas are joined by a wide opening or none of the wall is left."""


class PlanGeneratorConfig(Settings):
    """What kind of plans the generator makes."""

    kind: Kind = "mixed"
    """Homes, offices, or both."""
    office_area: tuple[Positive, Positive] = (150.0, 700.0)
    """Smallest and largest office floor [m2]."""
    loops: Share = 0.35
    """Probability that a plan has doors that make loops; cores, pillars and islands make others."""


def generate_plan(
    seed: int | np.random.Generator, config: PlanGeneratorConfig | None = None, plan_id: str | None = None
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
    office = config.kind == "office" or (config.kind == "mixed" and rng.random() < _OFFICE_SHARE)
    kind = "office" if office else "home"
    if plan_id is None:
        plan_id = kind if isinstance(seed, np.random.Generator) else f"{kind}_{seed:06d}"
    # The size is drawn once: drawing it again after a failure would make large plans rare.
    area = _draw_area(office, config, rng)
    rooms = rooms_for_area(area, rng)
    for _ in range(MAX_PLAN_ATTEMPTS):
        cells = lay_out_office(area, rng) if office else lay_out_home(area, rooms, rng)
        plan = _build(plan_id, cells, config.loops, _OPEN_PLAN[kind], rng)
        if plan is not None:
            return plan
    raise ConfigError(
        f"no {kind} of {area:.0f} m2 came out in {MAX_PLAN_ATTEMPTS} attempts; ask for larger ones"
    )


def _draw_area(office: bool, config: PlanGeneratorConfig, rng: np.random.Generator) -> float:
    if office:
        return float(np.exp(rng.uniform(*np.log(config.office_area))))
    for _ in range(MAX_PLAN_ATTEMPTS):
        area = float(rng.lognormal(np.log(_HOME_AREA), _HOME_AREA_SIGMA))
        if _HOME_AREA_RANGE[0] <= area <= _HOME_AREA_RANGE[1]:
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
    for index, bay in bay_windows(cells, thickness, rng).items():
        wider = shapely.union(interiors[index], bay, grid_size=GRID)
        interiors[index] = wider if isinstance(wider, Polygon) else None
    rooms = [room for room in interiors if isinstance(room, Polygon)]
    solids = [*free_standing(cells, rng), *wall_blocks(cells, openings, thickness, rng)]
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
    if not isinstance(interior, Polygon) or not isinstance(narrowest, Polygon) or narrowest.is_empty:
        return None
    return interior


def _is_roomy(space: BaseGeometry) -> TypeGuard[Polygon]:
    """Whether everything hangs together through gaps of at least :data:`MIN_PASSAGE`."""
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
    swap, flip = bool(rng.integers(2)), bool(rng.integers(2))

    def turn(points: FloatArray) -> FloatArray:
        turned = points[:, ::-1] if swap else points
        return turned * [-1.0 if flip else 1.0, 1.0]

    min_x, min_y, _, _ = shapely.transform(space, turn).bounds

    def move(points: FloatArray) -> FloatArray:
        moved: FloatArray = np.round(turn(points) - [min_x - PLAN_MARGIN, min_y - PLAN_MARGIN], 2)
        return moved

    order = sorted(range(len(cells)), key=lambda index: cells[index].category)
    return FloorPlan(
        id=plan_id,
        free_space=shapely.transform(space, move),
        rooms=tuple(Room(cells[index].category, shapely.transform(rooms[index], move)) for index in order),
        doors=tuple(_moved(opening.door, move) for opening in openings if opening.door),
        source=f"generator:{plan_id}",
    )


def _moved(door: Door, move: Callable[[FloatArray], FloatArray]) -> Door:
    (x0, y0), (x1, y1) = move(np.array([door.start, door.end])).tolist()
    return Door((x0, y0), (x1, y1))
