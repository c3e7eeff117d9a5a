"""Straight structures of a map that the plan doesn't have, and which of them are walls rather than furniture.

A wall is thin and seen from both sides. What is seen from one side alone, with the unknown behind it, is the front of a
cupboard or a sofa.
"""

import math

import cv2
import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from slamgym.core.geometry import transform_points
from slamgym.core.types import FREE, FloatArray
from slamgym.drawing.comparison.faces import MapEvidence
from slamgym.drawing.evidence import SEEN_WITHIN
from slamgym.drawing.settings import MAJORITY, USUAL_CELL
from slamgym.metrics.cleaning import WIDEST_WALL_GAP

TURNS = 60
"""Directions in which structures are looked for."""
SHORTEST_EXTRA = 0.8
"""Shorter structures are no walls [m]. With 0.5 51 of 58 changes of 9 furnished homes are found instead of 47, and 8
that are none instead of 6."""
THICKEST = 0.35
"""Thicker structures are furniture [m]. With 0.5 9 furnished homes have 8 false changes instead of 5."""


def extra_walls(
    floor: BaseGeometry, evidence: MapEvidence, explained_by: FloatArray
) -> list[LineString]:
    """The walls that a plan or a drawing doesn't have, the longest first.

    Args:
        floor: Its floor; what lies outside isn't looked at.
        evidence: The map over it.
        explained_by: (N, 2) points of its walls where the map is expected to show them [m].
    """
    unexplained = _unexplained(floor, evidence, explained_by)
    lines = map(LineString, _straight_pieces(unexplained, evidence))
    kept: list[LineString] = []
    for line in sorted(lines, key=lambda line: -line.length):
        if not _is_along_any(line, kept) and _is_seen_from_both_sides(line, evidence):
            kept.append(line)
    return kept


def _unexplained(
    floor: BaseGeometry, evidence: MapEvidence, explained_by: FloatArray
) -> FloatArray:
    """Points on the faces of a map's walls that lie on the floor and far from what explains them, (N, 2) [m]."""
    points = evidence.points
    inside = points[shapely.contains_xy(floor.buffer(-0.5 * SEEN_WITHIN), points)]
    tree = shapely.STRtree(np.asarray(shapely.points(explained_by)))
    explained, _ = tree.query_nearest(
        shapely.points(inside), max_distance=SEEN_WITHIN, all_matches=False
    )
    return np.delete(inside, explained, axis=0)


def _straight_pieces(points: FloatArray, evidence: MapEvidence) -> FloatArray:
    """Ends of straight lines through points (N, 2), (L, 2, 2) [m]."""
    frame = evidence.grid.frame
    image = np.zeros(frame.shape, np.uint8)
    image[frame.to_cell(*evidence.on_map(points).T)] = 255
    shortest = SHORTEST_EXTRA / frame.resolution
    gap = WIDEST_WALL_GAP / frame.resolution
    turn = np.pi / TURNS
    rows = cv2.HoughLinesP(
        image, 1.0, turn, math.ceil(shortest), minLineLength=shortest, maxLineGap=gap
    )
    if rows is None:
        return np.empty((0, 2, 2))
    cols, at_rows = rows.reshape(-1, 2).T
    ends = transform_points(evidence.plan_from_map, frame.to_points(at_rows, cols))
    return ends.reshape(-1, 2, 2)


def _is_along_any(line: LineString, others: list[LineString]) -> bool:
    """True if most of a line lies near another one: the two faces of one wall count once."""
    for other in others:
        near = other.buffer(THICKEST)
        if line.intersection(near).length > 0.7 * line.length:
            return True
    return False


def _is_seen_from_both_sides(line: LineString, evidence: MapEvidence) -> bool:
    """True if there is free space within the thickness of a wall on either side of most of it."""
    start, end = np.array(line.coords)
    along = end - start
    along_x, along_y = along
    normal = np.array([-along_y, along_x]) / line.length
    count = max(5, round(line.length / USUAL_CELL))
    points = start + np.linspace(0.05, 0.95, count)[:, None] * along
    depths = np.arange(0.1, THICKEST + 0.1, USUAL_CELL)[:, None] * normal
    on_left = _share_seen(points[:, None] + depths, evidence)
    on_right = _share_seen(points[:, None] - depths, evidence)
    return min(on_left, on_right) >= MAJORITY


def _share_seen(places: FloatArray, evidence: MapEvidence) -> float:
    """Share of the rows of places (N, D, 2) with a free cell."""
    is_free = evidence.values(places) == FREE
    return float(is_free.any(axis=1).mean())
