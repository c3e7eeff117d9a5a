"""Polygons out of whatever shapely's set operations leave: points and lines fall away."""

import shapely
from shapely import Polygon


def polygon_parts(geometry: shapely.Geometry) -> list[Polygon]:
    """All polygons in a geometry that have an area."""
    if isinstance(geometry, Polygon):
        return [] if geometry.is_empty else [geometry]
    return [part for piece in getattr(geometry, "geoms", ()) for part in polygon_parts(piece)]


def largest_part(geometry: shapely.Geometry) -> Polygon:
    """The largest polygon in a geometry; an empty one if there is none."""
    return max(polygon_parts(geometry), key=lambda part: float(part.area), default=Polygon())
