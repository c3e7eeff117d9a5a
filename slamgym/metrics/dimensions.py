"""Dimensions of a drawn floor plan against the true one: widths of rooms, lengths and thicknesses of walls, areas.

Both plans are images on one frame whose values are the share of each cell that is floor: true and false, greys of a
drawing whose faces lie within cells, or the probabilities of a network. A face lies where the shares of the two cells
on its sides put it, so it is found within a cell; what is 0.5 or more counts as floor. Polygons are measured by drawing
them (:func:`slamgym.cad.floorplan.floor_share`).

What is measured is found in the true plan: pairs of facing walls of a room, straight faces, walls with floor on both
sides. At the same place the drawn plan is asked for the same length. Lines run along the image's axes.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray
from slamgym.metrics.maps import check_same_shape
from slamgym.metrics.rooms import label_rooms

FLOOR = 0.5
"""Share of floor from which a cell counts as floor."""
MIN_PIECE = 0.3
"""Two faces count as facing each other, and as a wall, from this length on [m]."""
MIN_WALL = 0.5
"""Shorter faces are no walls whose length is measured [m]."""
MIN_WIDTH = 0.5
"""Narrower spaces are niches, not rooms [m]."""
MAX_THICKNESS = 0.5
"""Anything thicker is no wall between two rooms [m]."""
SEARCH = 0.2
"""A drawn face or wall is looked for so far from the true one [m]: drift moves it."""
STRAIGHT = 0.3
"""Neighbouring lines whose ends differ by at most so many cells belong to one face."""
LENGTH_TOLERANCES = (0.02, 0.05, 0.10)
"""Tolerances of the shares of lengths that are right [m]."""


@dataclass(frozen=True)
class Dimensions:
    """Errors of the lengths of one drawing, drawn less true [m]; one value for each thing that was measured."""

    room_width: FloatArray = field(default_factory=lambda: np.empty(0))
    """Distance of two facing walls of a room."""
    wall_length: FloatArray = field(default_factory=lambda: np.empty(0))
    """Length of a straight face."""
    wall_thickness: FloatArray = field(default_factory=lambda: np.empty(0))
    """Thickness of walls with floor on both sides, where the drawing has one."""
    floor_area: float = 0.0
    """[m2]"""
    true_floor_area: float = 0.0
    """[m2]"""

    @property
    def area_ratio(self) -> float:
        """Drawn over true floor area; nan if there is no true floor."""
        if self.true_floor_area <= 0.0:
            return math.nan
        return self.floor_area / self.true_floor_area


def measure_dimensions(
    floor: BoolArray | Float32Array, true_floor: BoolArray | Float32Array, metres_per_px: float
) -> Dimensions:
    """Compare the lengths of a drawing with the true ones.

    Args:
        floor: Share of floor of each cell of the drawing, shape (rows, cols), laid over the truth without scaling.
        true_floor: The same of the true plan.
        metres_per_px: Scale of both [m].

    Raises:
        ValueError: If the shapes differ.
    """
    check_same_shape(floor, true_floor)
    drawn = np.asarray(floor, dtype=np.float32)
    truth = np.asarray(true_floor, dtype=np.float32)
    rooms = label_rooms(truth >= FLOOR, metres_per_px)
    widths = list[float]()
    lengths = list[float]()
    thicknesses = list[float]()
    along_rows = (drawn, truth, rooms)
    along_cols = (drawn.T, truth.T, rooms.T)
    for a, b, labels in (along_rows, along_cols):
        widths += _width_errors(a, b, labels, metres_per_px)
        thicknesses += _thickness_errors(a, b, metres_per_px)
        lengths += _length_errors(a, b, metres_per_px)
    return Dimensions(
        room_width=np.array(widths) * metres_per_px,
        wall_length=np.array(lengths) * metres_per_px,
        wall_thickness=np.array(thicknesses) * metres_per_px,
        floor_area=floor_area(drawn) * metres_per_px**2,
        true_floor_area=floor_area(truth) * metres_per_px**2,
    )


def _width_errors(
    drawn: Float32Array, truth: Float32Array, rooms: IntArray, metres_per_px: float
) -> Iterator[float]:
    """Errors of the distances of facing walls along the rows' axis [cells]; a width that isn't drawn counts as 0."""
    narrowest = MIN_WIDTH / metres_per_px
    across = []
    for line, labels in zip(truth, rooms, strict=True):
        wide = [run for run in floor_runs(line) if run.length >= narrowest]
        in_rooms = [run for run in wide if _in_one_room(run, labels)]
        across.append(in_rooms)
    runs = [floor_runs(line) for line in drawn]
    shortest = MIN_PIECE / metres_per_px
    return _run_errors(across, runs, shortest, 0.0, or_none=True)


def _thickness_errors(
    drawn: Float32Array, truth: Float32Array, metres_per_px: float
) -> Iterator[float]:
    """Errors of the thicknesses of walls along the rows' axis [cells], where the drawing has one."""
    thickest = MAX_THICKNESS / metres_per_px
    walls = []
    for line in truth:
        thin = [run for run in wall_runs(line) if run.length <= thickest]
        walls.append(thin)
    runs = [wall_runs(line) for line in drawn]
    shortest = MIN_PIECE / metres_per_px
    reach = SEARCH / metres_per_px
    return _run_errors(walls, runs, shortest, reach)


def floor_area(values: Float32Array) -> float:
    """Area of the floor [cells]: whole cells inside, the share of those at its faces.

    A faint share of cells far from any floor doesn't add up to some.
    """
    is_floor = values >= FLOOR
    inside = is_floor.astype(np.uint8)
    around = np.ones((3, 3), np.uint8)
    core = cv2.erode(inside, around, borderValue=0)
    widened = cv2.dilate(inside, around)
    rim = widened > core
    whole_cells = np.count_nonzero(core)
    rim_area = values[rim].sum(dtype=np.float64)
    return float(whole_cells + rim_area)


class Run(NamedTuple):
    """Adjacent cells of one kind in a line."""

    first: int
    last: int
    start: float
    """Where it begins [cells; the centre of a cell is at its index]."""
    end: float

    @property
    def length(self) -> float:
        """[cells]."""
        return self.end - self.start

    def overlap(self, low: float, high: float) -> float:
        """Length of the part between two places [cells]; negative if there is none."""
        end = min(self.end, high)
        start = max(self.start, low)
        return end - start


def floor_runs(line: Float32Array) -> list[Run]:
    """The runs of floor in a line of shares, their ends within cells.

    The share that is missing in the last cell of floor, and the share that is there in the first cell of wall, move
    the face: exact where a cell's value is its covered share.
    """
    inside = np.zeros(len(line) + 2, np.int8)
    inside[1:-1] = line >= FLOOR
    change = np.diff(inside)
    firsts = np.flatnonzero(change == 1)
    lasts = np.flatnonzero(change == -1) - 1
    padded = np.zeros(len(line) + 2)
    padded[1:-1] = line
    shares = padded[1:]
    before = padded[firsts]
    behind = padded[lasts + 2]
    starts = firsts + 0.5 - shares[firsts] - before
    ends = lasts - 0.5 + shares[lasts] + behind
    runs = map(Run, firsts.tolist(), lasts.tolist(), starts.tolist(), ends.tolist())
    return list(runs)


def wall_runs(line: Float32Array) -> list[Run]:
    """Runs of wall between two runs of floor; their thickness is by the shares of the cells and their neighbours."""
    walls = []
    for before, behind in itertools.pairwise(floor_runs(line)):
        first = before.last + 1
        last = behind.first - 1
        if first == last:  # one cell is all the wall there is: its share counts once
            floor_before = float(line[before.last])
            floor_behind = float(line[behind.first])
            half = 0.5 * (1.0 - float(line[first]) + 2.0 - floor_before - floor_behind)
            wall = Run(first, last, first - half, first + half)
        else:
            wall = Run(first, last, before.end, behind.start)
        walls.append(wall)
    return walls


@dataclass
class StraightPiece:
    """Runs of neighbouring lines that begin and end at the same places: two straight faces opposite each other."""

    line: int
    runs: list[Run]

    @property
    def trimmed(self) -> range:
        """Numbers of its runs without a fifth at both ends, where drawn corners may lie elsewhere."""
        count = len(self.runs)
        cut = count // 5
        return range(cut, count - cut)


def straight_pieces(runs_by_line: list[list[Run]], min_px: float) -> list[StraightPiece]:
    """Join runs of neighbouring lines with the same ends; pieces shorter than ``min_px`` are left out."""
    finished: list[StraightPiece] = []
    growing: list[StraightPiece] = []
    for line, runs in enumerate([*runs_by_line, []]):
        left = list(growing)
        following = []
        for run in runs:
            fitting = [piece for piece in left if _same_ends(piece.runs[-1], run)]
            piece = fitting[0] if fitting else StraightPiece(line, [])
            if fitting:
                left.remove(piece)
            piece.runs.append(run)
            following.append(piece)
        finished += left
        growing = following
    return [piece for piece in finished if len(piece.runs) >= min_px]


def _same_ends(a: Run, b: Run) -> bool:
    apart_at_start = abs(a.start - b.start)
    apart_at_end = abs(a.end - b.end)
    return apart_at_start <= STRAIGHT and apart_at_end <= STRAIGHT


def _run_errors(
    truth: list[list[Run]],
    drawn: list[list[Run]],
    min_px: float,
    search_px: float,
    or_none: bool = False,
) -> Iterator[float]:
    """Drawn minus true length of every straight piece of true runs, the median over its lines [cells].

    Args:
        truth: Runs by line.
        drawn: The same of the drawing.
        min_px: Shorter pieces are left out.
        search_px: How far from the true run a drawn one is looked for.
        or_none: Count a run that isn't drawn as one of no length; else it is left out.
    """
    for piece in straight_pieces(truth, min_px):
        errors = []
        for number in piece.trimmed:
            run = piece.runs[number]
            low = run.start - search_px
            high = run.end + search_px
            others = drawn[piece.line + number]
            nearest = max(others, key=lambda other: other.overlap(low, high), default=None)
            if nearest is not None and nearest.overlap(low, high) > 0.0:
                errors.append(nearest.length - run.length)
            elif or_none:
                errors.append(-run.length)
        if errors:
            yield float(np.median(errors))


def _in_one_room(run: Run, numbers: IntArray) -> bool:
    """True if nearly all cells of a run belong to the room of the middle one."""
    labels = numbers[run.first : run.last + 1]
    room = labels[len(labels) // 2]
    in_room = np.count_nonzero(labels == room)
    return bool(room > 0 and in_room >= 0.95 * len(labels))


def _length_errors(
    drawn: Float32Array, truth: Float32Array, metres_per_px: float
) -> Iterator[float]:
    """Length errors of every straight face along the columns' axis [cells]: drawn (with any excess) minus true."""
    reach = SEARCH / metres_per_px
    shortest = MIN_WALL / metres_per_px
    as_they_are = (truth, drawn)
    upside_down = (truth[::-1], drawn[::-1])
    for values, other in (as_they_are, upside_down):
        faces = [_upper_faces(column) for column in values.T]
        for piece in straight_pieces(faces, shortest):
            starts = [run.start for run in piece.runs]
            row = float(np.median(starts))
            first = piece.line
            last = first + len(starts) - 1
            drawn_length = _face_length(other, row, first, last, reach)
            true_length = _face_length(values, row, first, last, reach)
            yield drawn_length - true_length


def _upper_faces(column: Float32Array) -> list[Run]:
    """Where each run of floor begins, as runs of no length."""
    faces = []
    for run in floor_runs(column):
        face = Run(run.first, run.first, run.start, run.start)
        faces.append(face)
    return faces


def _face_length(values: Float32Array, row: float, first: int, last: int, reach: float) -> float:
    """Length of the face near a row between two columns, and beyond them as far as it continues [cells].

    A column counts by the share of floor on the one side (below) and of wall on the other: at an inner corner the
    floor ends within a column, at an outer one the wall does.
    """
    rows = values.shape[0]
    middle = round(row)
    near = max(1, round(0.25 * reach))
    far = math.ceil(reach) + 1
    floor_from = max(0, middle - near)
    floor_to = min(rows, middle + far)
    wall_from = max(0, middle - far)
    wall_to = min(rows, middle + near + 1)
    floor_side = values[floor_from:floor_to]
    wall_side = values[wall_from:wall_to]
    wall = np.ones(values.shape[1])
    if wall_side.size:
        wall = 1.0 - wall_side.min(axis=0)
    floor = floor_side.max(axis=0)
    face = floor * wall
    # A thin wall may be grey all along: against that, its ends are where it stops.
    usual = float(np.median(face[first : last + 1]))
    scaled = face / max(usual, FLOOR)
    shares = np.minimum(scaled, 1.0)
    runs = floor_runs(shares.astype(np.float32))
    length = 0.0
    for run in runs:
        if run.overlap(first, last) > 0.0:
            length += run.length
    return length
