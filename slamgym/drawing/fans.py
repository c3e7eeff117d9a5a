"""Fans: bulges of the floor that rays drew through a door, a window or a pane, and that end where the rays end.

Along a fan's outline hardly any wall was seen, and the passage at its mouth is short beside it. A part of a room whose
walls are hidden behind furniture was not seen free; a corridor that was not driven to its end is as wide as its end.
"""

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.drawing.evidence import Evidence, share_known
from slamgym.drawing.openings import Gap

OUTLINE_STEP = 0.1
"""Between two places of an outline that are looked at [m]."""
WIDEST_MOUTH = 3.0
"""[m]"""
LEAST_BULGE = 2.2
"""A fan's outline is at least so many times as long as its mouth is wide."""
SHORTEST_OUTLINE = 2.0
"""[m]"""
UNWALLED = 0.65
"""So much of its outline shows no wall."""
MOST_TRIED = 2000
"""Mouths of an outline."""
SMALLEST_FAN = 1.0
"""[m2]"""
SEEN_FREE = 0.5
"""So much of it was seen."""
MOUTH_COST = 3.0
"""Of several mouths the one with the most outline without walls is taken; a metre of mouth counts as so many less."""


def find_fans(floor: MultiPolygon, evidence: Evidence) -> list[tuple[Polygon, Gap]]:
    """The fans of a floor, and the gap that each was seen through.

    Args:
        floor: With straight edges [m].
        evidence: The map.
    """
    inside = floor.buffer(0.03, join_style="mitre")
    shapely.prepare(inside)
    found = []
    for part in floor.geoms:
        for ring in (part.exterior, *part.interiors):
            found += _fans_of(ring, inside, evidence)
    return found


def _fans_of(ring: shapely.LinearRing, inside: BaseGeometry, evidence: Evidence) -> list[tuple[Polygon, Gap]]:
    # Corners of the outline stay corners: mouths lie at jambs.
    points = shapely.get_coordinates(shapely.segmentize(ring, OUTLINE_STEP))[:-1]
    walled = evidence.is_walled(points)
    taken = np.zeros(len(points), np.bool_)
    fans = []
    for first, last in _mouths(points, walled):
        path = np.arange(first, last + 1) % len(points)
        if taken[path].any():
            continue
        bulge, mouth = Polygon(points[path]), LineString(points[path[[0, -1]]])
        if not bulge.is_valid or bulge.area < SMALLEST_FAN or not inside.covers(mouth):
            continue
        if not inside.covers(bulge) or share_known(bulge, evidence.grid) < SEEN_FREE:
            continue
        taken[path] = True
        (x0, y0), (x1, y1) = mouth.coords
        fans.append((bulge, Gap((x0, y0), (x1, y1), evidence.config.outer_thickness)))
    return fans


def _mouths(points: FloatArray, walled: BoolArray) -> IntArray:
    """First and last point of what may be a fan's outline, (N, 2), the best first; the last may be beyond the end."""
    count = len(points)
    steps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    open_steps = np.where(walled & np.roll(walled, -1), 0.0, steps)
    along, unwalled = (np.concatenate([[0.0], np.cumsum(np.tile(some, 2))]) for some in (steps, open_steps))
    ends = np.flatnonzero(walled)
    if len(ends) < 2:
        return np.empty((0, 2), np.int64)
    pairs = ends[cKDTree(points[ends]).query_pairs(WIDEST_MOUTH, output_type="ndarray")]
    pairs = np.vstack([pairs, np.column_stack([pairs[:, 1], pairs[:, 0] + count])])
    first, last = np.sort(pairs, axis=1).T
    mouth = np.hypot(*(points[last % count] - points[first % count]).T)
    length, bare = along[last] - along[first], unwalled[last] - unwalled[first]
    good = (length >= LEAST_BULGE * mouth) & (bare >= UNWALLED * length) & (length >= SHORTEST_OUTLINE)
    worth = bare - (length - bare) - MOUTH_COST * mouth
    order = np.argsort(-worth[good], kind="stable")
    return np.column_stack([first[good], last[good]])[order][:MOST_TRIED]
