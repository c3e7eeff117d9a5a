"""Polygons out of whatever shapely's set operations leave, where points and lines fall away, and their outlines."""

from collections.abc import Iterator

import shapely
from shapely import LinearRing, Polygon
from shapely.geometry.polygon import orient


def polygon_parts(geometry: shapely.Geometry) -> list[Polygon]:
    """All polygons in a geometry that have an area."""
    if isinstance(geometry, Polygon):
        return [] if geometry.is_empty else [geometry]
    return [part for piece in getattr(geometry, "geoms", ()) for part in polygon_parts(piece)]


def largest_part(geometry: shapely.Geometry) -> Polygon:
    """The largest polygon in a geometry; an empty one if there is none."""
    return max(polygon_parts(geometry), key=lambda part: float(part.area), default=Polygon())


def oriented_rings(geometry: shapely.Geometry) -> Iterator[LinearRing]:
    """The outlines of all polygons in a geometry and of their holes, each with the inside on its left."""
    for part in map(orient, polygon_parts(geometry)):
        yield part.exterior
        yield from part.interiors
