"""Doors and walls between rooms: which a drawing keeps, closes, or opens.

Doors are where two rooms of the true plan meet (:mod:`slamgym.metrics.rooms`); walls between rooms are where two of
them face each other across a wall. Both are looked at in the drawing at the same place.
"""

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray
from slamgym.metrics.dimensions import (
    FLOOR,
    MAX_THICKNESS,
    Run,
    floor_runs,
    straight_pieces,
    wall_runs,
)
from slamgym.metrics.maps import check_same_shape
from slamgym.metrics.rooms import label_rooms

REACH = 0.3
"""An opening is examined so far before and behind its narrowest place [m]: walls are thinner, drift is less."""
BESIDE = 0.35
"""Floor so near to a room's face counts as the room's, even if drift moves the wall [m]."""
MIN_HOLE = 0.3
"""A wall is opened by a hole from this width on [m]."""
TRIMMED = 0.2
"""Length left out at both ends of a wall, where a door's jamb may be drawn elsewhere [m]."""


_Pair = tuple[int, int]
"""Numbers of two rooms, the lower first."""
_Cell = tuple[int, int]
"""Row and column."""


class Doorway(NamedTuple):
    """Where two rooms meet, in cells; the opening lies across its line."""

    row: int
    col: int
    rooms: tuple[int, int]


@dataclass(frozen=True)
class Openings:
    """Doors and walls between rooms, as a drawing shows them."""

    doors: int = 0
    """True doors: openings between two rooms."""
    doors_kept: int = 0
    """Those that are open in the drawing."""
    door_width: FloatArray = field(default_factory=lambda: np.empty(0))
    """Errors of the clear widths of the doors that are kept, drawn less true [m]."""
    walls: int = 0
    """Pairs of rooms that face each other across a wall."""
    walls_opened: int = 0
    """Those with a hole in that wall."""
    doors_invented: int = 0
    """Holes in walls between rooms."""

    @property
    def doors_closed(self) -> int:
        """True doors across which the drawing has a wall."""
        return self.doors - self.doors_kept


def compare_openings(
    floor: BoolArray | Float32Array, true_floor: BoolArray | Float32Array, metres_per_px: float
) -> Openings:
    """Compare doors and walls between rooms with the true ones; arguments as of :func:`measure_dimensions`.

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(floor, true_floor)
    drawn = np.asarray(floor, dtype=np.float32)
    truth = np.asarray(true_floor, dtype=np.float32)
    is_drawn = drawn >= FLOOR
    is_floor = truth >= FLOOR
    rooms = label_rooms(is_floor, metres_per_px)
    doors = find_doors(rooms, is_floor)
    # The rooms without what lies so near to a wall that a displaced wall may have it on its other side.
    is_core = from_walls(is_floor) * metres_per_px > 0.2
    cores = np.where(is_core, rooms, 0)
    kept = [door for door in doors if _is_open(door, is_drawn, cores, metres_per_px)]
    widths = []
    for door in kept:
        width = _clear_width(door, drawn, metres_per_px)
        true_width = _clear_width(door, truth, metres_per_px)
        widths.append(width - true_width)
    found = _holes(drawn, truth, rooms, metres_per_px)
    found += _holes(drawn.T, truth.T, rooms.T, metres_per_px)
    holes: dict[tuple[int, int], int] = defaultdict(int)
    for pair, count in found:
        holes[pair] += count
    finite_widths = [width for width in widths if math.isfinite(width)]
    return Openings(
        doors=len(doors),
        doors_kept=len(kept),
        door_width=np.array(finite_widths),
        walls=len(holes),
        walls_opened=sum(count > 0 for count in holes.values()),
        doors_invented=sum(holes.values()),
    )


def unseen_share(floor: BoolArray, seen: BoolArray) -> float:
    """Share of the drawn floor that the robot never saw; 0 if no floor is drawn.

    Args:
        floor: Drawn floor, shape (rows, cols), in the frame of the robot's map.
        seen: Cells of that map that aren't unknown, same shape.

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(floor, seen)
    total = np.count_nonzero(floor)
    unseen = np.count_nonzero(floor & ~seen)
    return float(unseen / total) if total else 0.0


def find_doors(rooms: IntArray, floor: BoolArray) -> list[Doorway]:
    """Where the rooms of a plan meet: of each connected border of two rooms the place farthest from any wall.

    Args:
        rooms: Numbers of the rooms, 0 where there is none, shape (rows, cols).
        floor: Same shape.
    """
    radius = from_walls(floor)
    doors = []
    for pair, cells in room_borders(rooms):
        mask = np.zeros(rooms.shape, np.uint8)
        for cell in cells:
            mask[cell] = 1
        # A border is a staircase of single steps: one cell of slack joins them.
        around = np.ones((3, 3), np.uint8)
        widened = cv2.dilate(mask, around)
        count, labels = cv2.connectedComponents(widened, connectivity=8)
        for number in range(1, count):
            places = [cell for cell in cells if labels[cell] == number]
            row, col = max(places, key=lambda place: radius[place])
            door = Doorway(row, col, pair)
            doors.append(door)
    return doors


def room_borders(rooms: IntArray) -> list[tuple[_Pair, list[_Cell]]]:
    """Pairs of rooms that meet, and the cells (row, col) along which they do."""
    borders: dict[_Pair, list[_Cell]] = defaultdict(list)
    rows, cols = rooms.shape
    for down, right in ((0, 1), (1, 0)):
        here = rooms[: rows - down, : cols - right]
        there = rooms[down:, right:]
        both_rooms = (here > 0) & (there > 0)
        is_border = (here != there) & both_rooms
        for row, col in np.argwhere(is_border).tolist():
            room = here[row, col]
            other = there[row, col]
            pair = _pair(room, other)
            cell = (row, col)
            borders[pair].append(cell)
    return sorted(borders.items())


def _pair(room: np.int64, other: np.int64) -> _Pair:
    """The numbers of two rooms, the lower first."""
    low, high = sorted((int(room), int(other)))
    return low, high


def from_walls(floor: BoolArray) -> Float32Array:
    """Distance of each floor cell from the nearest other cell, or the border of the image [cells]."""
    padded = np.pad(floor, 1)
    image = padded.astype(np.uint8)
    away: Float32Array = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return away[1:-1, 1:-1]


def _is_open(door: Doorway, drawn: BoolArray, cores: IntArray, metres_per_px: float) -> bool:
    """True if drawn floor near a door joins its two rooms."""
    reach = math.ceil(1.0 / metres_per_px)
    rows = _within(door.row, reach)
    cols = _within(door.col, reach)
    floor = drawn[rows, cols]
    near_cores = cores[rows, cols]
    image = floor.astype(np.uint8)
    _, parts = cv2.connectedComponents(image, connectivity=4)
    room, other = door.rooms
    in_room = floor & (near_cores == room)
    in_other = floor & (near_cores == other)
    is_joined = np.isin(parts[in_room], parts[in_other])
    return bool(is_joined.any())


def _within(place: int, reach: int) -> slice:
    """The lines of an image at most so far from one of them."""
    first = max(0, place - reach)
    return slice(first, place + reach + 1)


def _clear_width(door: Doorway, values: Float32Array, metres_per_px: float) -> float:
    """The narrowest line across an opening, along either axis [m]; nan if there is none."""
    at_row = _narrowest_through(values, door.row, door.col, metres_per_px)
    at_col = _narrowest_through(values.T, door.col, door.row, metres_per_px)
    return float(np.fmin(at_row, at_col))


def _narrowest_through(values: Float32Array, line: int, place: int, metres_per_px: float) -> float:
    """Length of the shortest run of floor at a place of the lines around one [m]; nan if there is none."""
    reach = math.ceil(REACH / metres_per_px)
    low = place - 4.0
    high = place + 4.0
    narrowest = math.nan
    lines = _within(line, reach)
    for row in values[lines]:
        runs = floor_runs(row)
        through = max(runs, key=lambda run: run.overlap(low, high), default=None)
        if through is None:
            continue
        if through.overlap(low, high) > 0.0:
            narrowest = np.fmin(narrowest, through.length)
    return narrowest * metres_per_px


def _holes(
    drawn: Float32Array, truth: Float32Array, rooms: IntArray, metres_per_px: float
) -> list[tuple[tuple[int, int], int]]:
    """Number of holes in every straight piece of wall between two rooms, across the image's rows."""
    trimmed = round(TRIMMED / metres_per_px)
    smallest = MIN_HOLE / metres_per_px
    by_line = _walls_between_rooms(truth, rooms, metres_per_px)
    found = []
    shortest = smallest + 2 * trimmed
    for piece in straight_pieces(by_line, shortest):
        middle = len(piece.runs) // 2
        wall = piece.runs[middle]
        labels = rooms[piece.line + middle]
        before = labels[wall.first - 1]
        behind = labels[wall.last + 1]
        pair = _pair(before, behind)
        opened = []
        end = len(piece.runs) - trimmed
        for number in range(trimmed, end):
            line = drawn[piece.line + number]
            is_opened = _is_opened(piece.runs[number], line, metres_per_px)
            opened.append(is_opened)
        shares = np.array(opened, np.float32)
        holes = floor_runs(shares)
        count = sum(hole.length >= smallest for hole in holes)
        found.append((pair, count))
    return found


def _walls_between_rooms(
    truth: Float32Array, rooms: IntArray, metres_per_px: float
) -> list[list[Run]]:
    """The runs of wall between two different rooms in each row."""
    thickest = MAX_THICKNESS / metres_per_px
    by_line = []
    for line, labels in zip(truth, rooms, strict=True):
        walls = []
        for wall in wall_runs(line):
            before = labels[wall.first - 1]
            behind = labels[wall.last + 1]
            if wall.length <= thickest and before != behind and min(before, behind) > 0:
                walls.append(wall)
        by_line.append(walls)
    return by_line


def _is_opened(wall: Run, line: Float32Array, metres_per_px: float) -> bool:
    """True if a line of the drawing is floor from one side of a wall to the other."""
    beside = round(BESIDE / metres_per_px)
    first = max(0, wall.first - beside)
    end = wall.last + beside + 1
    is_floor = line[first:end] >= FLOOR
    return bool(is_floor.all())
