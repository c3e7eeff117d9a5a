"""Straight structures of a map that the plan doesn't have, and which of them are walls rather than furniture.

A wall is thin and seen from both sides. What is seen from one side alone, with the unknown behind it, is the front of a
cupboard or a sofa.
"""

import cv2
import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from slamgym.core.geometry import transform_points
from slamgym.core.types import FREE, FloatArray
from slamgym.drawing.comparison.faces import MapEvidence

EXPLAINED = 0.15
"""Points of the map that are so near to a wall of the plan, or to where it has moved, belong to it [m]."""
GAP = 0.2
"""Widest gap in a straight structure [m]."""
TURNS = 60
"""Directions in which structures are looked for."""
VOTES = 10
"""Cells that a straight structure has at least."""
SHORTEST_EXTRA = 0.8
"""Shorter structures are no walls [m]."""
THICKEST = 0.35
"""Thicker structures are furniture [m]."""
SEEN_ALONG = 0.6
"""Share of its length along which a structure is seen from a side that counts as seen."""


def extra_walls(
    floor: BaseGeometry, evidence: MapEvidence, explained_by: FloatArray
) -> list[LineString]:
    """The walls that a plan or a drawing doesn't have, the longest first.

    Args:
        floor: Its floor; what lies outside isn't looked at.
        evidence: The map over it.
        explained_by: (N, 2) points of its walls where the map is expected to show them [m].
    """
    inside = shapely.contains_xy(floor.buffer(-0.5 * EXPLAINED), evidence.points)
    inside &= KDTree(explained_by).query(evidence.points)[0] > EXPLAINED
    frame = evidence.grid.frame
    image = np.zeros(frame.shape, np.uint8)
    image[frame.to_cell(*evidence.on_map(evidence.points[inside]).T)] = 255
    shortest, gap = SHORTEST_EXTRA / frame.resolution, GAP / frame.resolution
    rows = cv2.HoughLinesP(image, 1.0, np.pi / TURNS, VOTES, minLineLength=shortest, maxLineGap=gap)
    cols, at_rows = (rows if rows is not None else np.empty(0)).reshape(-1, 2).T
    places = transform_points(evidence.plan_from_map, frame.to_points(at_rows, cols))
    lines = map(LineString, places.reshape(-1, 2, 2))
    kept: list[LineString] = []
    for line in sorted(lines, key=lambda line: -line.length):
        # The two faces of one wall count once.
        is_double = any(
            line.intersection(other.buffer(THICKEST)).length > 0.7 * line.length for other in kept
        )
        if not is_double and _is_seen_from_both_sides(line, evidence):
            kept.append(line)
    return kept


def _is_seen_from_both_sides(line: LineString, evidence: MapEvidence) -> bool:
    """True if there is free space within the thickness of a wall on either side of most of it."""
    start, end = np.array(line.coords)
    normal = np.array([start[1] - end[1], end[0] - start[0]]) / line.length
    points = start + np.linspace(0.05, 0.95, max(5, round(line.length / 0.05)))[:, None] * (
        end - start
    )
    depths = np.arange(0.1, THICKEST + 0.1, 0.05)[:, None] * normal
    sides = (points[:, None] + depths, points[:, None] - depths)
    return all((evidence.values(side) == FREE).any(axis=1).mean() >= SEEN_ALONG for side in sides)
