"""What is in a building but not in its drawing: furniture and people."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.core.config import CountOrZero, NonNegative, Positive, Settings, Share
from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray
from slamgym.sim.furniture import PlacedPiece, pieces_for, propose_places, room_walls
from slamgym.sim.people import PERSON_RADIUS, Person
from slamgym.sim.robot import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

# Doors stay free for this far to either side [m].
_DOOR_ROOM = 0.45

# People walk at least this far from walls [m].
_WALKING_GAP = 0.05

# Detail of the plan's outline that doesn't matter for where a robot fits [m].
_SIMPLIFICATION = 0.01


class ClutterConfig(Settings, section="clutter"):
    """How much there is of it. The default is an empty building."""

    furniture: Share = 0.0
    """Share of the usual furniture that is there: 0 an empty building, 1 a furnished one."""

    people: CountOrZero = 0
    """Number of people who walk about."""

    passage: NonNegative = 0.1
    """Furniture leaves the passages this much wider than the robot on either side [m]."""

    walking_speed: tuple[Positive, Positive] = (0.4, 1.2)
    """Range of the people's speeds; unhurried indoors to brisk [m/s]."""

    def _check(self) -> None:
        if self.walking_speed[0] > self.walking_speed[1]:
            raise ConfigError(f"clutter.walking_speed must be (slowest, fastest), not {self.walking_speed}")


@dataclass(frozen=True)
class Clutter:
    """Furniture and people of one building, world frame."""

    furniture: tuple[shapely.Polygon, ...] = ()
    """What stands on the floor: bodies and single legs."""

    outlines: tuple[shapely.Polygon, ...] = ()
    """The pieces as seen from above, with what lies between their legs."""

    people: tuple[Person, ...] = ()
    walkable: shapely.Polygon = field(default_factory=shapely.Polygon)
    """Where the middle of a person may be."""

    def segments(self) -> FloatArray:
        """Outlines of the furniture, shape (S, 4) as x0, y0, x1, y1 [m]."""
        if not self.furniture:
            return np.empty((0, 4))
        rings = [np.asarray(piece.exterior.coords) for piece in self.furniture]
        return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings])


def make_clutter(
    plan: "FloorPlan", rng: np.random.Generator, config: ClutterConfig, robot: RobotConfig | None = None
) -> Clutter:
    """Furnish and populate a building.

    The robot stays able to reach every part of the building that it could reach empty, but for what the
    furniture itself covers or shields.

    Args:
        plan: The building.
        rng: Draws everything; the same state gives the same clutter.
        config: How much.
        robot: Who must still pass everywhere; a TurtleBot3 Waffle Pi where left out.

    Returns:
        The clutter.
    """
    pieces = _furnish(plan, rng, config, robot or RobotConfig()) if config.furniture > 0.0 else []
    solids = tuple(solid for piece in pieces for solid in piece.solids)
    outlines = tuple(piece.outline for piece in pieces)
    if config.people == 0:
        return Clutter(solids, outlines)
    walkable = largest_part(fitting_area(plan, PERSON_RADIUS + _WALKING_GAP, outlines))
    return Clutter(solids, outlines, _populate(walkable, rng, config), walkable)


def fitting_area(plan: "FloorPlan", radius: float, obstacles: Iterable[BaseGeometry] = ()) -> BaseGeometry:
    """Where the middle of a disc can be without touching a wall or an obstacle."""
    area = plan.free_space.simplify(_SIMPLIFICATION).buffer(-radius - _SIMPLIFICATION, quad_segs=4)
    grown = [obstacle.buffer(radius, quad_segs=4) for obstacle in obstacles]
    return area.difference(shapely.union_all(grown)) if grown else area


def largest_part(area: BaseGeometry) -> shapely.Polygon:
    """The largest connected part of an area; empty if the area is."""
    parts = [part for part in shapely.get_parts(area) if isinstance(part, shapely.Polygon)]
    return max(parts, key=lambda part: float(part.area), default=shapely.Polygon())


def sample_point(area: shapely.Polygon, rng: np.random.Generator) -> tuple[float, float]:
    """A point drawn evenly from an area that isn't empty."""
    shapely.prepare(area)
    low, high = np.reshape(area.bounds, (2, 2))
    for _ in range(100):
        points = rng.uniform(low, high, (32, 2))
        inside = np.flatnonzero(shapely.contains_xy(area, points[:, 0], points[:, 1]))
        if len(inside) > 0:
            return float(points[inside[0], 0]), float(points[inside[0], 1])
    # A sliver that thousands of draws miss.
    point = area.representative_point()
    return float(point.x), float(point.y)


def _furnish(
    plan: "FloorPlan", rng: np.random.Generator, config: ClutterConfig, robot: RobotConfig
) -> list[PlacedPiece]:
    """Furnish room after room and leave the passages free."""
    radius = robot.circumscribed_radius
    passages = [_Passages(plan, radius), _Passages(plan, radius + config.passage)]
    doors = [shapely.LineString([door.start, door.end]).buffer(_DOOR_ROOM) for door in plan.doors]
    shapely.prepare(plan.free_space)
    placed: list[PlacedPiece] = []
    for room in plan.rooms:
        walls = room_walls(plan, room)
        for piece in pieces_for(room.category):
            if rng.random() >= piece.chance * config.furniture:
                continue
            for place in propose_places(piece, room, walls, rng):
                outline = place.outline
                taken = (*doors, *(other.outline for other in placed))
                if not plan.free_space.contains(outline) or any(outline.intersects(other) for other in taken):
                    continue
                if all(passage.stays_open(outline) for passage in passages):
                    for passage in passages:
                        passage.block(outline)
                    placed.append(place)
                    break
    return placed


class _Passages:
    """Where a disc can go, as parts that must each stay in one piece."""

    def __init__(self, plan: "FloorPlan", radius: float) -> None:
        self._radius = radius
        self._parts = list(shapely.get_parts(fitting_area(plan, radius)))

    def stays_open(self, outline: shapely.Polygon) -> bool:
        """Whether an obstacle would neither cut a part in two nor fill it."""
        grown = outline.buffer(self._radius, quad_segs=4)
        return all(
            isinstance(rest, shapely.Polygon) and not rest.is_empty
            for rest in (part.difference(grown) for part in self._parts if part.intersects(grown))
        )

    def block(self, outline: shapely.Polygon) -> None:
        """Subtract the room that an obstacle takes."""
        grown = outline.buffer(self._radius, quad_segs=4)
        self._parts = [part.difference(grown) for part in self._parts]


def _populate(
    walkable: shapely.Polygon, rng: np.random.Generator, config: ClutterConfig
) -> tuple[Person, ...]:
    if walkable.is_empty:
        return ()
    return tuple(
        Person(
            sample_point(walkable, rng), float(rng.uniform(*config.walking_speed)), int(rng.integers(2**32))
        )
        for _ in range(config.people)
    )
