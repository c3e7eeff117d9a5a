"""Walls that a person says are glass: a laser can't tell."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import LineString

from slamgym.drawing.confidence import piece_between
from slamgym.drawing.drawing import DrawnWall
from slamgym.drawing.edits import SHORTEST_LINE, Corrections
from slamgym.drawing.evidence import SEEN_WITHIN
from slamgym.drawing.settings import SAME_DIRECTION
from slamgym.drawing.walls import WallPiece


def cut_at_glass(pieces: Sequence[WallPiece], corrections: Corrections) -> list[WallPiece]:
    """Walls, cut where glass begins and ends."""
    lines = [np.array(entry.line) @ (1.0, 1j) for entry in corrections.of("glass_wall")]
    cut = []
    for piece in pieces:
        marks = {0.0, 1.0}
        for line in lines:
            shares = ((line - piece.start) / (piece.end - piece.start)).real
            least = SHORTEST_LINE / piece.length
            marks |= {share for share in shares.tolist() if least < share < 1.0 - least}
        cut += [piece_between(piece, low, high) for low, high in itertools.pairwise(sorted(marks))]
    return cut


def with_glass(
    walls: Sequence[DrawnWall], corrections: Corrections
) -> tuple[list[DrawnWall], tuple[str, ...]]:
    """Walls of which some are glass, and a sentence for each correction that no wall stands along."""
    marked = list(walls)
    unused = {}
    for entry in corrections.of("glass_wall"):
        line = LineString(entry.line)
        found = [number for number, wall in enumerate(walls) if _is_along(line, wall)]
        for number in found:
            marked[number] = replace(marked[number], is_glass=True)
        if not found:
            unused[entry] = "no wall stands along it"
    return marked, replace(corrections, faults=()).without(unused).faults


def _is_along(line: LineString, wall: DrawnWall) -> bool:
    """True if a wall stands along a line of glass, no part of it beyond the line's ends."""
    (x0, y0), (x1, y1) = line.coords
    along = np.array([x1 - x0, y1 - y0]) / line.length
    own = np.subtract(wall.end, wall.start) / wall.length
    reach = 0.5 * wall.thickness + SEEN_WITHIN
    middle = wall.line.centroid
    share = shapely.line_locate_point(line, middle)
    is_beside = 0.0 < share < line.length and line.distance(middle) <= reach
    return bool(is_beside and abs(along @ own) >= math.cos(SAME_DIRECTION))
