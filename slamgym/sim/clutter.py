"""Things in a building that its drawing doesn't have: furniture, doors' leaves, people."""

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from slamgym.core.config import Settings, Share, Within
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.sim.furnishing import PlacedPiece, Wish, furnish, put_down
from slamgym.sim.passages import Passages
from slamgym.sim.people import PERSON_RADIUS, Person, Walkable
from slamgym.sim.robot import RobotConfig
from slamgym.sim.rooms_and_doors import (
    RoomArea,
    doors_of,
    has_leaf,
    is_closed,
    leaf_boxes,
    room_areas,
)

if TYPE_CHECKING:
    from slamgym.cad.floorplan import Door, FloorPlan

_logger = logging.getLogger(__name__)

_DOOR_ROOM = 0.45
"""Doors' surroundings stay free of furniture for this far to either side [m]."""
_PLACES = 3
"""Places of chairs and doors' leaves that change while the robot drives, the first one among them."""
_HINGES = 3
"""So many hinges are tried where a door's leaf doesn't fit."""
_PASSAGE = 0.1
"""Furniture keeps the passages this much wider than the robot on either side: a hand's breadth [m]."""
_WALKING_GAP = 0.05
"""People walk at least this far from walls [m]."""
_WALKING_SPEED = (0.4, 1.2)
"""Least and largest speed of people: unhurried indoors to brisk [m/s]."""
_LEG = 0.1
"""What is smaller than this is seen as its two diagonals, which have the same shadow as the square about them [m]."""


class ClutterConfig(Settings, section="clutter"):
    """Amounts of furniture, doors and people. The default is an empty building."""

    furniture: Annotated[float, Within(ge=0.0, le=3.0)] = 0.0
    """Share of the usual furniture that is there: 0 an empty building, 1 a furnished one, 2 a crowded one with twice as
    many groups in its rooms, of which more is solid down to the floor. Where the robot couldn't pass any more, less is
    placed."""

    untidiness: Share = 0.0
    """Untidiness of furnished rooms: chairs stand at any angle about their tables, and small things on the floor,
    one for each square metre at 1."""

    doors: Share = 0.0
    """Share of the doors with a leaf in them, which stands open, half open or closed."""

    closed_doors: Share = 0.15
    """Share of the leaves that are closed, where the robot gets into every room all the same."""

    ajar_doors: Share = 0.0
    """Share of these that stand ajar instead: a scanner sees through the gap, the robot doesn't pass."""

    cut_off: bool = False
    """Closed doors may cut rooms off; :attr:`Clutter.cut_off` names them."""

    changes: Annotated[float, Within(ge=0.0, le=1000.0)] = 0.0
    """Rate at which a chair is moved or a door's leaf swings while the robot drives [1/min]."""

    people: Annotated[int, Within(ge=0, le=200)] = 0
    """Number of people who walk about."""

    @property
    def is_empty(self) -> bool:
        """True if there is none of it."""
        return not (self.furniture or self.doors or self.people)


@dataclass(frozen=True)
class Clutter:
    """Furniture, doors' leaves and people of one building, world frame."""

    furniture: tuple[FloatArray, ...] = ()
    """Solids that stand on the floor and stay there, bodies and single legs: corners of each, shape (K, 2) [m]."""

    outlines: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    """Areas that pieces cover as seen from above, with what lies between their legs, the room for their chairs and all
    places of doors' leaves: boxes as :mod:`slamgym.sim.passages` has them, shape (B, 6)."""

    movables: tuple[tuple[tuple[FloatArray, ...], ...], ...] = ()
    """Chairs and doors' leaves: of each the places where it may stand, the first one first, and there its solids
    as in ``furniture``."""

    people: tuple[Person, ...] = ()
    walkable: Walkable | None = None
    """Where the middle of a person may be."""

    passages: Passages | None = None
    """Where a disc can go, in whichever place each piece stands; None without any clutter."""

    cut_off: tuple[str, ...] = ()
    """Rooms that the robot could enter if they were empty: behind a closed door, or too small for what is in them."""

    left_out: int = 0
    """Pieces for which there was no room."""

    changes: float = 0.0
    """Rate at which one of the movables goes to another place [1/s]."""

    seed: int = 0
    """Seed of these changes."""

    def segments(self) -> FloatArray:
        """Outlines of what stands at first, shape (S, 4) as x0, y0, x1, y1 [m]: furniture, then the movables."""
        return self._segments

    @cached_property
    def _segments(self) -> FloatArray:
        if not self.changes:
            return outlines_of(self.solids())
        parts = [outlines_of(self.furniture)]
        parts += [outlines_of(places[0]) for places in self.movables]
        return np.vstack(parts)

    def solids(self) -> tuple[FloatArray, ...]:
        """Everything that stands on the floor at first: corners of each, shape (K, 2) [m]."""
        movable = itertools.chain.from_iterable(places[0] for places in self.movables)
        return (*self.furniture, *movable)


def outlines_of(solids: Sequence[FloatArray]) -> FloatArray:
    """Segments of solids that contacts and scanners meet, shape (S, 4) [m]: diagonals of legs, and others' edges."""
    boxes = np.array([corners for corners in solids if len(corners) == 4]).reshape(-1, 4, 2)
    sides = np.ptp(boxes, axis=1)
    is_leg = sides.max(axis=1, initial=0.0) < _LEG
    parts = [_diagonals(boxes[is_leg]), _edges(boxes[~is_leg])]
    rest = [corners for corners in solids if len(corners) != 4]
    parts += [_edges(corners[None]) for corners in rest]
    return np.vstack(parts)


def _diagonals(boxes: FloatArray) -> FloatArray:
    """Both diagonals of each box, from corners of shape (B, 4, 2), shape (2 B, 4) [m]."""
    opposite = boxes.reshape(-1, 2, 2, 2).transpose(0, 2, 1, 3)
    return opposite.reshape(-1, 4)


def _edges(solids: FloatArray) -> FloatArray:
    """All edges of solids with K corners, from corners of shape (B, K, 2), shape (B K, 4) [m]."""
    following = np.roll(solids, -1, axis=1)
    edges = np.concatenate([solids, following], axis=2)
    return edges.reshape(-1, 4)


def make_clutter(
    plan: "FloorPlan",
    rng: np.random.Generator,
    config: ClutterConfig,
    robot: RobotConfig | None = None,
) -> Clutter:
    """Furnish and populate a building.

    The robot stays able to reach every part of the building that it could reach empty, but for what the
    furniture itself covers and, where the settings allow it, rooms behind closed doors.

    Args:
        plan: The building.
        rng: Draws everything; the same state gives the same clutter.
        config: How much.
        robot: Who must still pass everywhere; a TurtleBot3 Waffle Pi where left out.

    Returns:
        The clutter.
    """
    radius = (robot or RobotConfig()).radius
    walking = PERSON_RADIUS + _WALKING_GAP
    passages = Passages(plan, max(radius + _PASSAGE, walking) + 0.01)
    rooms, labels = room_areas(plan, passages, rng)
    # Furniture keeps all parts connected, so only closed doors ask for more than a look at what it covers.
    reach = passages.largest_part if config.cut_off else passages.fits
    before = _rooms_with(labels, reach(radius))
    leaves: list[list[FloatArray]] = []
    if config.furniture or config.doors:
        doors = doors_of(plan)
        leaves = _hang_leaves(passages, doors, radius, config, rng)
        for door in doors:
            passages.reserve(_surroundings(door))
    placed, left_out = _place_pieces(passages, rooms, radius, config, rng)
    furniture, chairs = put_down(placed)
    outlines = [piece.box for piece in placed]
    doors_as_movables = []
    for places in leaves:
        outlines += places
        doors_as_movables.append(tuple((_corners(leaf),) for leaf in places))
    lost = before - _rooms_with(labels, reach(radius))
    people, walkable = _populate(passages, walking, config, rng)
    if left_out:
        _logger.info(
            "%s: no room for %d pieces of furniture; %d stand", plan.id, left_out, len(placed)
        )
    return Clutter(
        furniture=furniture,
        outlines=np.array(outlines).reshape(-1, 6),
        movables=(*chairs, *doors_as_movables),
        people=people,
        walkable=walkable,
        passages=passages,
        cut_off=tuple(room.name for room in rooms if room.label in lost),
        left_out=left_out,
        changes=config.changes / 60.0,
        seed=int(rng.integers(2**32)),
    )


def _rooms_with(labels: IntArray, cells: BoolArray) -> set[int]:
    """Labels of the rooms that have some of the cells."""
    return set(np.flatnonzero(np.bincount(labels[cells])).tolist())


def _hang_leaves(
    passages: Passages,
    doors: Sequence["Door"],
    radius: float,
    config: ClutterConfig,
    rng: np.random.Generator,
) -> list[list[FloatArray]]:
    """Put leaves into doors: of each the boxes where it may stand, none of which is in the robot's way."""
    leaves = []
    closed_share = (config.closed_doors, config.ajar_doors)
    for door in doors:
        if not has_leaf(door) or rng.random() >= config.doors:
            continue
        for _ in range(_HINGES):
            places: list[FloatArray] = []
            for leaf in leaf_boxes(door, closed_share, rng, _PLACES):
                if not _hang(passages, door, leaf, radius, config.cut_off):
                    continue
                places.append(leaf)
                if config.changes == 0.0:
                    break
            if places:
                leaves.append(places)
                for leaf in places:
                    passages.reserve(leaf)
                break
    return leaves


def _hang(
    passages: Passages, door: "Door", leaf: FloatArray, radius: float, may_cut_off: bool
) -> bool:
    """Put a leaf somewhere unless it is in the robot's way; returns True if it stands."""
    if not is_closed(door, leaf):
        return passages.first_fit(leaf[None], np.array([radius]), reserve=False) == 0
    if not passages.is_clear(leaf):
        return False
    if not may_cut_off and _cuts_off(passages, leaf, radius):
        return False
    passages.block(leaf)
    return True


def _cuts_off(passages: Passages, leaf: FloatArray, radius: float) -> bool:
    """True if a closed door would cut the building in two."""
    _, before = passages.parts(radius)
    _, after = passages.with_box(leaf).parts(radius)
    return bool(after.max() > before.max())


def _surroundings(door: "Door") -> FloatArray:
    """A door with the space that furniture keeps free on either side of it."""
    x0, y0 = door.start
    x1, y1 = door.end
    ux = (x1 - x0) / door.width
    uy = (y1 - y0) / door.width
    half_length = 0.5 * door.width + _DOOR_ROOM
    return np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), ux, uy, half_length, _DOOR_ROOM])


def _corners(box: FloatArray) -> FloatArray:
    """The corners of a box, shape (4, 2) [m]."""
    _, _, ux, uy, half_length, half_width = box
    along = box[2:4] * half_length
    across = np.array([-uy, ux]) * half_width
    return box[:2] + np.array([-along - across, along - across, along + across, across - along])


def _place_pieces(
    passages: Passages,
    rooms: Sequence[RoomArea],
    radius: float,
    config: ClutterConfig,
    rng: np.random.Generator,
) -> tuple[list[PlacedPiece], int]:
    """Furniture, room after room, and how many pieces found no room."""
    if not config.furniture:
        return [], 0
    places = _PLACES if config.changes else 1
    wish = Wish(config.furniture, np.array([radius + _PASSAGE, radius]), places, config.untidiness)
    placed = []
    left_out = 0
    for room in rooms:
        pieces, missing = furnish(passages, room, wish, rng)
        placed += pieces
        left_out += missing
    return placed, left_out


def _populate(
    passages: Passages, radius: float, config: ClutterConfig, rng: np.random.Generator
) -> tuple[tuple[Person, ...], Walkable | None]:
    """People on the largest part of the floor where one can walk; none where no one fits."""
    if config.people == 0:
        return (), None
    cells = passages.largest_part(radius)
    if not cells.any():
        return (), None
    people = []
    for _ in range(config.people):
        start = passages.sample_point(cells, rng)
        speed = float(rng.uniform(*_WALKING_SPEED))
        people.append(Person(start, speed, int(rng.integers(2**32))))
    return tuple(people), Walkable(cells, passages.origin)
