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
    drawn, truth = (np.asarray(values, dtype=np.float32) for values in (floor, true_floor))
    rooms = label_rooms(truth >= FLOOR, metres_per_px)
    doors = find_doors(rooms, truth >= FLOOR)
    # The rooms without what lies so near to a wall that a displaced wall may have it on its other side.
    cores = np.where(from_walls(truth >= FLOOR) * metres_per_px > 0.2, rooms, 0)
    kept = [door for door in doors if _is_open(door, drawn >= FLOOR, cores, metres_per_px)]
    widths = [
        _clear_width(door, drawn, metres_per_px) - _clear_width(door, truth, metres_per_px)
        for door in kept
    ]
    holes: dict[tuple[int, int], int] = defaultdict(int)
    for a, b, labels in ((drawn, truth, rooms), (drawn.T, truth.T, rooms.T)):
        for pair, count in _holes(a, b, labels, metres_per_px):
            holes[pair] += count
    return Openings(
        doors=len(doors),
        doors_kept=len(kept),
        door_width=np.array([width for width in widths if math.isfinite(width)]),
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
    return float(np.count_nonzero(floor & ~seen) / total) if total else 0.0


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
        mask[tuple(np.array(cells).T)] = 1
        # A border is a staircase of single steps: one cell of slack joins them.
        count, labels = cv2.connectedComponents(
            cv2.dilate(mask, np.ones((3, 3), np.uint8)), connectivity=8
        )
        for number in range(1, count):
            places = [cell for cell in cells if labels[cell] == number]
            row, col = max(places, key=lambda cell: radius[cell])
            doors.append(Doorway(row, col, pair))
    return doors


def room_borders(rooms: IntArray) -> list[tuple[tuple[int, int], list[tuple[int, int]]]]:
    """Pairs of rooms that meet, and the cells (row, col) along which they do."""
    borders: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for step in ((0, 1), (1, 0)):
        here = rooms[: rooms.shape[0] - step[0], : rooms.shape[1] - step[1]]
        there = rooms[step[0] :, step[1] :]
        for row, col in np.argwhere((here != there) & (here > 0) & (there > 0)).tolist():
            low, high = sorted((int(here[row, col]), int(there[row, col])))
            borders[low, high].append((row, col))
    return sorted(borders.items())


def from_walls(floor: BoolArray) -> Float32Array:
    """Distance of each floor cell from the nearest other cell, or the border of the image [cells]."""
    padded = np.pad(floor, 1).astype(np.uint8)
    away: Float32Array = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return away[1:-1, 1:-1]


def _is_open(door: Doorway, drawn: BoolArray, cores: IntArray, metres_per_px: float) -> bool:
    """True if drawn floor near a door joins its two rooms."""
    reach = math.ceil(1.0 / metres_per_px)
    window = (
        slice(max(0, door.row - reach), door.row + reach + 1),
        slice(max(0, door.col - reach), door.col + reach + 1),
    )
    _, parts = cv2.connectedComponents(drawn[window].astype(np.uint8), connectivity=4)
    sides = [
        set(np.unique(parts[drawn[window] & (cores[window] == room)]).tolist())
        for room in door.rooms
    ]
    return bool(sides[0] & sides[1])


def _clear_width(door: Doorway, values: Float32Array, metres_per_px: float) -> float:
    """The narrowest line across an opening, along either axis [m]; nan if there is none."""
    narrowest = math.nan
    for image, line, place in ((values, door.row, door.col), (values.T, door.col, door.row)):
        widths = []
        reach = math.ceil(REACH / metres_per_px)
        for shifted in range(max(0, line - reach), min(len(image), line + reach + 1)):
            runs = floor_runs(image[shifted])
            through = max(runs, key=lambda run: run.overlap(place - 4.0, place + 4.0), default=None)
            if through is not None and through.overlap(place - 4.0, place + 4.0) > 0.0:
                widths.append(through.length)
        if widths:
            narrowest = np.fmin(narrowest, min(widths) * metres_per_px)
    return float(narrowest)


def _holes(
    drawn: Float32Array, truth: Float32Array, rooms: IntArray, metres_per_px: float
) -> list[tuple[tuple[int, int], int]]:
    """Number of holes in every straight piece of wall between two rooms, across the image's rows."""
    beside, trimmed = round(BESIDE / metres_per_px), round(TRIMMED / metres_per_px)
    thickest, smallest = MAX_THICKNESS / metres_per_px, MIN_HOLE / metres_per_px
    by_line: list[list[Run]] = []
    for line, labels in zip(truth, rooms, strict=True):
        walls = [wall for wall in wall_runs(line) if wall.length <= thickest]
        by_line.append(
            [wall for wall in walls if 0 < labels[wall.first - 1] != labels[wall.last + 1] > 0]
        )
    found = []
    for piece in straight_pieces(by_line, smallest + 2 * trimmed):
        middle = len(piece.runs) // 2
        wall, labels = piece.runs[middle], rooms[piece.line + middle]
        low, high = sorted((int(labels[wall.first - 1]), int(labels[wall.last + 1])))
        opened = []
        for number in range(trimmed, len(piece.runs) - trimmed):
            wall, line = piece.runs[number], drawn[piece.line + number]
            part = line[max(0, wall.first - beside) : wall.last + beside + 1]
            opened.append((part >= FLOOR).all())  # floor from one side of the wall to the other
        holes = floor_runs(np.array(opened, np.float32))
        found.append(((low, high), sum(hole.length >= smallest for hole in holes)))
    return found
