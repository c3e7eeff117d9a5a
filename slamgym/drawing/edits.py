"""A person's last word on a drawing: walls and boundaries added or taken away, rooms named or taken away.

Corrections are a set, so their order says nothing; :mod:`slamgym.drawing.revise` carries them out. One that can't be
is left out, with a sentence that says why; all others are carried out. Coordinates are metres in the frame of the map.
A file of corrections holds::

    {"map": {"name": "flat", "sha256": "..."},
     "rooms": [{"id": "R01", "polygon": [[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 0.0]]]}],
     "corrections": [{"kind": "split", "line": [[1.0, 0.5], [1.0, 4.0]]},
                     {"kind": "join", "at": [4.1, 2.0]},
                     {"kind": "add_door", "line": [[4.0, 1.3], [4.0, 2.2]]},
                     {"kind": "no_door", "line": [[2.0, 6.1], [2.9, 6.1]]},
                     {"kind": "add_wall", "line": [[0.0, 3.0], [2.0, 3.0]], "thickness": 0.1},
                     {"kind": "remove_wall", "line": [[6.0, 0.0], [6.0, 3.0]], "thickness": 0.12},
                     {"kind": "glass_wall", "line": [[0.0, 0.0], [4.0, 0.0]]},
                     {"kind": "remove_room", "at": [9.0, 2.0]},
                     {"kind": "name_room", "at": [2.0, 1.0], "name": "Kitchen"}]}
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import shapely
from shapely import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import largest_part
from slamgym.core.config import Within, from_dict
from slamgym.core.documents import known_fields, read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.names import Label
from slamgym.core.types import OccupancyGrid
from slamgym.drawing.settings import OUTER_THICKNESS

THICKEST_ADDED_WALL = 2.0
"""Walls that a person adds or takes away are no thicker [m]."""
BEYOND_MAP = 5.0
"""Corrections lie at most so far from the known part of the map [m]: people click beside it, a wrong file lies away."""
SHORTEST_LINE = 0.1
"""Lines of corrections are longer [m]: nobody means two places that are nearer to each other."""
AT_PLACES = ("join", "name_room", "remove_room")
"""Kinds of corrections at a place; the others have a line."""
_Metres = Annotated[float, Within(ge=-1e5, le=1e5)]


@dataclass(frozen=True)
class Correction:
    """A change of a drawing."""

    kind: Literal[
        "split",
        "join",
        "add_door",
        "no_door",
        "add_wall",
        "remove_wall",
        "glass_wall",
        "name_room",
        "remove_room",
    ]
    line: tuple[tuple[_Metres, _Metres], ...] = ()
    """Two places, of all kinds but :data:`AT_PLACES` [m]. A split goes on to the next walls; a door lies
    between its places, and where it stands on open floor the rest of the way to the next walls becomes wall. Where
    there is no door no boundary lies whose ends are near the two places, now or in a later drawing. What stands along
    a line of glass is glass."""
    at: tuple[_Metres, ...] = ()
    """A place on the boundary at which two rooms are joined, or in the room that is named or taken away [m]."""
    thickness: Annotated[float, Within(gt=0.0, le=THICKEST_ADDED_WALL)] = OUTER_THICKNESS
    """Of a wall [m]."""
    name: Label = ""

    def __post_init__(self) -> None:
        if self.kind == "name_room" and (len(self.at) != 2 or not self.name):
            raise ConfigError("name_room needs 'at': [x, y] and a name")
        if self.kind in AT_PLACES and len(self.at) != 2:
            raise ConfigError(f"{self.kind} needs 'at': [x, y]")
        if self.kind not in AT_PLACES and len(self.line) != 2:
            raise ConfigError(f"{self.kind} needs 'line': [[x, y], [x, y]]")
        if self.line and LineString(self.line).length < SHORTEST_LINE:
            raise ConfigError(f"the line of {self.kind} must be at least {SHORTEST_LINE:g} m long")

    def as_dict(self) -> dict[str, Any]:
        """What JSON says of it."""
        return {
            name: value
            for name, value in vars(self).items()
            if value != getattr(Correction, name, None)
        }

    @property
    def shape(self) -> BaseGeometry:
        """Its line, or its place."""
        return LineString(self.line) if self.line else Point(self.at)


@dataclass(frozen=True)
class FormerRoom:
    """A room of the drawing that corrections were made on."""

    id: Label
    polygon: tuple[tuple[tuple[_Metres, _Metres], ...], ...]
    """Its outline and its holes [m]."""

    def __post_init__(self) -> None:
        if not self.polygon or min(map(len, self.polygon)) < 4:
            raise ConfigError(f"the polygon of room {self.id} needs rings of three places or more")

    @property
    def shape(self) -> Polygon:
        """The same for set operations."""
        outline, *holes = self.polygon
        return largest_part(shapely.make_valid(Polygon(outline, holes)))


@dataclass(frozen=True)
class Corrections:
    """All that a person says about the drawing of a map."""

    corrections: tuple[Correction, ...]
    map: dict[str, str] = field(default_factory=dict)
    """The map's name, and as ``sha256`` its :func:`map_digest`."""
    where: str = "the corrections"
    """The file, for errors."""
    faults: tuple[str, ...] = ()
    """Of those that can't be carried out, a sentence each."""
    rooms: tuple[FormerRoom, ...] = ()
    """Of the drawing that they were made on: by them they carry over to another map of the building."""

    def on_map(self, grid: OccupancyGrid) -> "Corrections":
        """Those that lie on the map whose known part this is."""
        around = box(*grid.frame.bounds).buffer(BEYOND_MAP)
        away = [entry for entry in self.corrections if not around.covers(entry.shape)]
        return self.without(dict.fromkeys(away, "it doesn't lie on the map"))

    def without(self, reasons: Mapping[Correction, str]) -> "Corrections":
        """All but some, which become faults."""
        kept = tuple(entry for entry in self.corrections if entry not in reasons)
        faults = [_fault(entry, reason) for entry, reason in reasons.items()]
        return replace(self, corrections=kept, faults=(*self.faults, *faults))

    def of(self, *kinds: str) -> Iterator[Correction]:
        """The corrections of some kinds, in an order of their own."""
        wanted = [entry for entry in self.corrections if entry.kind in kinds]
        return iter(sorted(wanted, key=repr))


def _fault(entry: Correction, reason: str) -> str:
    """The sentence on a correction that the drawing doesn't allow."""
    places = " to ".join(f"({x:.2f}, {y:.2f})" for x, y in entry.shape.coords)
    return f"correction left out, {entry.kind} at {places}: {reason}"


def read_corrections(path: Path | str) -> Corrections:
    """Read a file of corrections, and what is wrong with those of them that are none.

    Raises:
        InputFileError: If it isn't one.
    """
    document = read_json(path, "save it with the report of a drawing, NAME.html")
    entries = document.get("corrections") if isinstance(document, dict) else None
    if not isinstance(entries, list):
        raise InputFileError(
            path, "is no file of corrections; save it with the report of a drawing, NAME.html"
        )
    usable = []
    faults = []
    for number, entry in enumerate(entries, 1):
        try:
            usable.append(from_dict(Correction, entry))
        except ConfigError as fault:
            faults.append(f"correction {number} of {path} left out: {fault}")
    found = known_fields(Corrections, {**document, "corrections": [], "faults": []}, path)
    return replace(found, corrections=tuple(usable), faults=tuple(faults), where=str(path))


def map_digest(grid: OccupancyGrid) -> str:
    """SHA-256 of the cells of a map's known part, as a drawing has it, and of where they lie."""
    frame = grid.frame
    head = f"{frame.height_px} {frame.width_px} {frame.resolution:.6f} {frame.origin_x:.4f} {frame.origin_y:.4f}\n"
    return hashlib.sha256(head.encode() + grid.cells.tobytes()).hexdigest()
