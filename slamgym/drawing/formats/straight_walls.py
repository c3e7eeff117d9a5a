"""Pieces of one straight wall as one wall: a building model has one for each, which runs through its doors."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from slamgym.core.types import IntArray
from slamgym.drawing.drawing import DrawnDoor, DrawnPoint, DrawnWall, Layer
from slamgym.drawing.settings import SEEN_SHARE
from slamgym.drawing.walls import SAME_THICKNESS

TOUCHING = 0.05
"""Pieces so near to each other can be one straight wall [m]."""


def straight_walls(
    pieces: Sequence[DrawnWall], doors: Sequence[DrawnDoor]
) -> tuple[list[DrawnWall], IntArray]:
    """Join what touches, or has a door between it, and agrees in line and thickness with the longest piece.

    Args:
        pieces: Walls as they are drawn.
        doors: Their doors, which know the pieces at their jambs.

    Returns:
        The walls, as thick and as sure as their longest piece, and for each piece the number of its wall.
    """
    bodies = [piece.polygon for piece in pieces]
    ends = np.array([(piece.start, piece.end) for piece in pieces]).reshape(-1, 2, 2)
    thickness, length = (
        np.array([(piece.thickness, piece.length) for piece in pieces]).reshape(-1, 2).T
    )
    touching = (
        shapely.STRtree(bodies).query(bodies, predicate="dwithin", distance=TOUCHING).T.tolist()
    )
    beside: list[list[int]] = [[] for _ in pieces]
    for one, other in [
        *touching,
        *(pair for door in doors for pair in itertools.permutations(door.walls, 2)),
    ]:
        beside[one].append(other)
    wall_of, walls = np.full(len(pieces), -1), list[DrawnWall]()
    for first in np.argsort(-length, kind="stable").tolist():
        if wall_of[first] >= 0:
            continue
        along = (ends[first, 1] - ends[first, 0]) / length[first]
        astray = np.abs((ends - ends[first, 0]) @ [-along[1], along[0]]).max(axis=1)
        agrees = np.maximum(astray, np.abs(thickness - thickness[first])) <= SAME_THICKNESS
        members = [first]
        for member in members:  # which grow in number
            joined = [k for k in dict.fromkeys(beside[member]) if agrees[k] and wall_of[k] < 0]
            members += [k for k in joined if k not in members]
        wall_of[members] = len(walls)
        walls.append(_joined([pieces[k] for k in members]) if len(members) > 1 else pieces[first])
    return walls, wall_of


def _joined(pieces: Sequence[DrawnWall]) -> DrawnWall:
    """A wall on the line of its longest piece, which is the first."""
    longest = pieces[0]
    start = np.array(longest.start)
    along = (longest.end - start) / longest.length

    def stretch(shapes: list[BaseGeometry]) -> list[DrawnPoint]:
        places = (shapely.get_coordinates(shapes) - start) @ along
        return [
            (float(x), float(y)) for x, y in start + np.outer([places.min(), places.max()], along)
        ]

    low, high = stretch([piece.line for piece in pieces])
    axis = LineString(stretch([piece.polygon for piece in pieces]))
    body = axis.buffer(0.5 * longest.thickness, cap_style="flat")
    seen = np.average(
        [piece.share_seen for piece in pieces], weights=[piece.length for piece in pieces]
    )
    layer: Layer = "SEEN" if seen >= SEEN_SHARE else "INFERRED"
    return replace(longest, polygon=body, start=low, end=high, share_seen=float(seen), layer=layer)
