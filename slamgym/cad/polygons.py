"""Polygons from the results of shapely's set operations, their outlines, and a bound on their cost.

What shapely makes of an outline can grow with its square: a polygon of 2,000 random points crosses itself a million
times, and repairing it takes gigabytes; a comb of 12,000 teeth is valid, but shrinking it by the robot's radius takes
as many. So the cost is bounded before it is begun.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from shapely import LinearRing, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from slamgym.core.errors import PlanError
from slamgym.core.limits import CROSSINGS, NEAR_PAIRS
from slamgym.core.types import FloatArray

_SMALL = 1000
"""So few walls can't be crowded."""
_AT_ONCE = 64
"""Walls whose neighbours are looked up together: 50 MB of pairs at most."""


def polygon_parts(geometry: shapely.Geometry) -> list[Polygon]:
    """All polygons in a geometry that have an area."""
    if isinstance(geometry, Polygon):
        return [] if geometry.is_empty else [geometry]
    parts = []
    for piece in getattr(geometry, "geoms", ()):
        parts += polygon_parts(piece)
    return parts


def largest_part(geometry: shapely.Geometry) -> Polygon:
    """The largest polygon in a geometry; an empty one if there is none."""
    return max(polygon_parts(geometry), key=lambda part: float(part.area), default=Polygon())


def connected_part(geometry: shapely.Geometry, least_share: float, source: str) -> Polygon:
    """The largest polygon in a geometry, unless too little of the floor hangs together.

    Args:
        geometry: The floor.
        least_share: The share of its area that the polygon must make up.
        source: Named in errors.

    Raises:
        PlanError: If it makes up less.
    """
    parts = polygon_parts(geometry)
    largest = largest_part(geometry)
    total = sum(part.area for part in parts)
    if largest.is_empty or not largest.area >= least_share * total:
        raise PlanError(
            source,
            f"the free space falls into {len(parts)} disjoint parts, the largest {largest.area:.1f} of {total:.1f} m2; "
            "connect them",
        )
    return largest


def oriented_rings(geometry: shapely.Geometry) -> Iterator[LinearRing]:
    """The outlines of all polygons in a geometry and of their holes, each with the inside on its left."""
    for part in map(orient, polygon_parts(geometry)):
        yield part.exterior
        yield from part.interiors


def make_valid(polygon: Polygon, source: str) -> BaseGeometry:
    """Repair a polygon, unless it crosses itself so often that the parts would be innumerable.

    Args:
        polygon: Perhaps invalid.
        source: Named in errors.

    Raises:
        PlanError: If it crosses itself too often.
    """
    if not polygon.is_valid:
        edges = []
        for ring in (polygon.exterior, *polygon.interiors):
            points = shapely.get_coordinates(ring)
            edges.append(np.hstack([points[:-1], points[1:]]))
        refuse_crossings(np.vstack(edges), source)
    return shapely.make_valid(polygon)


def refuse_crowded(segments: FloatArray, margin: float, source: str) -> None:
    """Refuse walls of which too many pairs are near each other.

    Args:
        segments: Shape (S, 4) x0, y0, x1, y1 [m].
        margin: What counts as near [m], judged by the boxes round the walls.
        source: Named in errors.

    Raises:
        PlanError: If there are more pairs than allowed.
    """
    if len(segments) <= _SMALL:
        return
    low = np.minimum(segments[:, :2], segments[:, 2:])
    high = np.maximum(segments[:, :2], segments[:, 2:])
    boxes: Any = shapely.box(*low.T, *high.T)
    tree = shapely.STRtree(boxes)
    around: Any = shapely.box(*(low - margin).T, *(high + margin).T)
    pairs = 0
    for start in range(0, len(around), _AT_ONCE):
        pairs += tree.query(around[start : start + _AT_ONCE]).shape[1]
        NEAR_PAIRS.check(source, pairs, PlanError)


def refuse_crossings(segments: FloatArray, source: str, before: int = 0) -> int:
    """Refuse the edges of a line that crosses itself too often.

    Args:
        segments: Shape (S, 4) [m], one after the other.
        source: Named in errors.
        before: Crossings found in other lines of the same source.

    Returns:
        How many there are now.

    Raises:
        PlanError: If there are more than allowed.
    """
    refuse_crowded(segments, 0.0, source)
    lines: Any = shapely.linestrings(segments.reshape(-1, 2, 2))
    tree = shapely.STRtree(lines)
    crossings = 0
    for start in range(0, len(lines), _AT_ONCE):
        some = lines[start : start + _AT_ONCE]
        pairs = tree.query(some, predicate="intersects")
        # Every edge meets itself and its two neighbours.
        crossings += pairs.shape[1] - 3 * len(some)
        CROSSINGS.check(source, before + crossings // 2, PlanError)
    return before + max(crossings, 0) // 2
