"""Fans: bulges of the floor that rays drew through a door, a window or a pane, and that end where the rays end.

Along a fan's outline hardly any wall was seen, and the passage at its mouth is short beside it. A part of a room whose
walls are hidden behind furniture was not seen free, or what was ends at the furniture's echoes; a corridor that was not
driven to its end is as wide as its end.
"""

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.drawing.evidence import Evidence, share_ended, share_known
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
ENDED = 0.5
"""What the robot saw free in a room ends at echoes along so much of its border, in a fan where the rays end."""
MOUTH_COST = 3.0
"""Of several mouths the one with the most outline without walls is taken; a metre of mouth counts as so many less."""


def find_fans(floor: MultiPolygon, evidence: Evidence, largest: float) -> list[tuple[Polygon, Gap]]:
    """The fans of a floor, and the gap that each was seen through.

    Args:
        floor: With straight edges [m].
        evidence: The map.
        largest: Of a fan [m2].
    """
    inside = floor.buffer(0.03, join_style="mitre")
    shapely.prepare(inside)
    found = []
    for ring in oriented_rings(floor):
        found += _fans_of(ring, inside, evidence, largest)
    return found


def _fans_of(
    ring: shapely.LinearRing, inside: BaseGeometry, evidence: Evidence, largest: float
) -> list[tuple[Polygon, Gap]]:
    # The floor is on the left. Corners of the outline stay corners: mouths lie at jambs.
    points = shapely.get_coordinates(shapely.segmentize(ring, OUTLINE_STEP))[:-1]
    walled = evidence.is_walled(points)
    taken = np.zeros(len(points), np.bool_)
    fans = []
    mouths = _mouths(points, walled, largest)
    is_open = shapely.covers(inside, shapely.linestrings(points[mouths % len(points)]))
    for first, last in mouths[is_open]:
        path = np.arange(first, last + 1) % len(points)
        if taken[path].any():
            continue
        bulge = Polygon(points[path])
        if not bulge.is_valid or not inside.covers(bulge):
            continue
        if share_known(bulge, evidence.grid) < SEEN_FREE or share_ended(bulge, evidence.grid) >= ENDED:
            continue
        taken[path] = True
        (x0, y0), (x1, y1) = points[path[[0, -1]]].tolist()
        fans.append((bulge, Gap((x0, y0), (x1, y1), evidence.config.outer_thickness)))
    return fans


def _mouths(points: FloatArray, walled: BoolArray, largest: float) -> IntArray:
    """First and last point of what may be a fan's outline, (N, 2), the best first; the last may be beyond the end."""
    count, following = len(points), np.roll(points, -1, axis=0)
    steps = np.hypot(*(following - points).T)
    open_steps = np.where(walled & np.roll(walled, -1), 0.0, steps)
    along, unwalled, swept = (
        np.concatenate([[0.0], np.cumsum(np.tile(some, 2))])
        for some in (steps, open_steps, 0.5 * _cross(points, following))
    )
    ends = np.flatnonzero(walled)
    if len(ends) < 2:
        return np.empty((0, 2), np.int64)
    pairs = ends[cKDTree(points[ends]).query_pairs(WIDEST_MOUTH, output_type="ndarray")]
    pairs = np.vstack([pairs, np.column_stack([pairs[:, 1], pairs[:, 0] + count])])
    first, last = np.sort(pairs, axis=1).T
    begin, end = points[first % count], points[last % count]
    mouth, area = np.hypot(*(end - begin).T), swept[last] - swept[first] + 0.5 * _cross(end, begin)
    length, bare = along[last] - along[first], unwalled[last] - unwalled[first]
    good = (length >= LEAST_BULGE * mouth) & (length >= SHORTEST_OUTLINE)
    good &= (bare >= UNWALLED * length) & (area >= SMALLEST_FAN) & (area <= largest)
    worth = bare - (length - bare) - MOUTH_COST * mouth
    order = np.argsort(-worth[good], kind="stable")
    return np.column_stack([first[good], last[good]])[order][:MOST_TRIED]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors, (N, 2) each: twice the area that they span, positive where b is on the left of a."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
