"""A drawing that dimensions can be taken from: walls, doors, rooms, and parts that were never seen.

Convention: metres, in the frame of the MAP that it was drawn from (x right, y up, the origin of its yaml), not turned;
``angle_deg`` says how far its main walls are turned against the x axis, counter-clockwise.
"""

import functools
import math
from dataclasses import dataclass, field
from typing import Any, Literal

import shapely
from shapely import LineString, MultiPolygon, Polygon

from slamgym.cad.floorplan import Door as PlanDoor
from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.floorplan import Room as PlanRoom
from slamgym.core.types import OccupancyGrid
from slamgym.drawing.evidence import echo_outlines
from slamgym.drawing.settings import DRAWN_DOORS

Layer = Literal["SEEN", "INFERRED"]
"""SEEN: the map holds evidence of it. INFERRED: drawn because buildings are like that."""

DrawnPoint = tuple[float, float]
"""x, y [m]."""


@dataclass(frozen=True)
class Segment:
    """A straight line from point to point."""

    start: DrawnPoint
    end: DrawnPoint

    @property
    def length(self) -> float:
        """[m]."""
        return math.dist(self.start, self.end)

    @property
    def line(self) -> LineString:
        """The same for set operations."""
        return LineString([self.start, self.end])


@dataclass(frozen=True)
class DrawnWall(Segment):
    """A straight piece of wall: its centre line."""

    polygon: Polygon
    """Its body; at corners the bodies of two walls overlap."""
    thickness: float
    """[m]"""
    thickness_known: bool
    """True if both faces were drawn; else the thickness is that of the settings."""
    confidence: float
    """Probability that a true wall lies within 20 cm, in [0, 1]."""
    share_seen: float
    """Share of its length along which the map has occupied cells."""
    layer: Layer
    is_glass: bool = False
    """A person says so; a laser goes through glass, or sees a mirror in it."""


@dataclass(frozen=True)
class DrawnDoor(Segment):
    """A door, or an opening in a wall: the segment across its middle, from jamb to jamb."""

    depth: float
    """Thickness of the wall that it is in [m]."""
    rooms: tuple[str, ...]
    """Ids of the two rooms that it joins."""
    walls: tuple[int, ...]
    """Numbers of the walls at its jambs."""
    confidence: float
    """Probability that it parts two rooms, in [0, 1]."""
    layer: Layer
    kind: Literal["door", "opening"] = "door"
    """An opening is wider than doors are; a map doesn't tell whether a double door hangs in it."""

    @property
    def width(self) -> float:
        """Clear width [m]."""
        return self.length


@dataclass(frozen=True)
class DrawnRoom:
    """A room, closed by walls and by the lines of its doors."""

    id: str
    polygon: Polygon
    """Valid; its holes are pillars, islands and cores."""
    share_seen: float
    """Share of its area that the robot saw."""
    layer: Layer
    name: str
    """What it is called: its id, or as a person says."""

    @property
    def area(self) -> float:
        """[m2]."""
        return float(self.polygon.area)


@dataclass(frozen=True)
class Dimension(Segment):
    """A dimension line: a clear width between two faces, or a length of the building."""

    of: str
    """Id of the room, or ``building``."""


@dataclass(frozen=True)
class Question(Segment):
    """A line across the floor of which a person says whether it is a boundary between two rooms."""

    log_odds: float
    """That it is one."""
    is_drawn: bool
    """Whether the drawing has it."""

    @property
    def confirming(self) -> Literal["add_door", "split"]:
        """The kind of correction (:mod:`slamgym.drawing.edits`) that says it is one; ``no_door`` says that it isn't."""
        return "add_door" if self.length <= DRAWN_DOORS[1] else "split"


@dataclass(frozen=True)
class Drawing:
    """Everything that is drawn of one map."""

    name: str
    grid: OccupancyGrid
    """The map that it was drawn from."""
    floor: MultiPolygon
    """All floor between the walls."""
    angle_deg: float
    """Direction of the main walls in [-45, 45), counter-clockwise from the x axis."""
    walls: tuple[DrawnWall, ...] = ()
    doors: tuple[DrawnDoor, ...] = ()
    rooms: tuple[DrawnRoom, ...] = ()
    inferred_floor: tuple[Polygon, ...] = ()
    """Floor that the robot never observed."""
    left_out: tuple[Polygon, ...] = ()
    """Floor that the robot saw and the map doesn't bear out, the largest part first, nothing narrow or small."""
    left_out_area: float = 0.0
    """All of it, what is narrow or small too [m2]."""
    seen_area: float = 0.0
    """All that the robot saw free [m2]."""
    dimensions: tuple[Dimension, ...] = ()
    doubts: tuple[str, ...] = ()
    """Points that a person should check, one sentence each."""
    questions: tuple[Question, ...] = ()
    """Boundaries between rooms that are as likely drawn wrongly, or wrongly left out, the most doubtful first."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Source, model, settings, version."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(min x, min y, max x, max y) of what is drawn, dimension lines included [m]."""
        lines = (dimension.line for dimension in self.dimensions)
        shapes = [self.floor, *(wall.polygon for wall in self.walls), *lines]
        min_x, min_y, max_x, max_y = shapely.total_bounds(shapes).tolist()
        return min_x, min_y, max_x, max_y

    @functools.cached_property
    def echoes(self) -> list[Polygon]:
        """Outlines of what the map has of walls and things; several formats show them."""
        return echo_outlines(self.grid)

    @property
    def area(self) -> float:
        """Area of the floor [m2]."""
        return float(self.floor.area)

    @property
    def is_half(self) -> bool:
        """True if less than half of the seen floor is drawn."""
        return self.left_out_area > 0.5 * self.seen_area

    def as_plan(self) -> FloorPlan:
        """The largest part of the floor as a plan that can be explored; rooms without a name are called ``Room``."""
        largest = max(self.floor.geoms, key=lambda part: float(part.area))
        inside = largest.buffer(0.05)
        rooms = [room for room in self.rooms if room.polygon.representative_point().within(inside)]
        doors = [door for door in self.doors if door.line.centroid.within(inside)]
        return FloorPlan(
            self.name,
            largest,
            tuple(
                PlanRoom("Room" if room.name == room.id else room.name, room.polygon)
                for room in rooms
            ),
            tuple(PlanDoor(door.start, door.end) for door in doors),
            str(self.provenance.get("source", self.name)),
        )
