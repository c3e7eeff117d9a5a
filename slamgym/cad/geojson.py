"""Walls, doors, windows and rooms from GeoJSON (RFC 7946) in local metres.

Features say what they are by ``properties.kind``: wall, door, opening, window or room; others are passed over.
Where no feature has a kind all are walls: a plain MultiLineString or Polygon of walls is a plan, too.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.drawn_plan import DrawnWalls, edges_of, floor_of_walls, middle_line, stacked
from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.core.documents import parse_json
from slamgym.core.errors import PlanError, as_plan_error
from slamgym.core.files import read_bytes
from slamgym.core.limits import DRAWING_BYTES, ENTRIES, shown
from slamgym.core.types import FloatArray

_MAX_NAME = 100
"""Characters of a room's name."""
DEGREES = 0.05
"""A drawing in degrees is smaller than this; one in metres isn't."""

_NESTING = {"LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
"""Number of lists around the points of a geometry."""


def read_geojson(path: Path | str) -> FloorPlan:
    """Read a floor plan from a GeoJSON file.

    Raises:
        PlanError: If it is no GeoJSON in metres, has no walls or encloses no floor.
    """
    path = Path(path)
    source = str(path)
    with as_plan_error():
        content = read_bytes(path, DRAWING_BYTES)
    ENTRIES.check(source, content.count(b"["), PlanError)  # every point is a list
    value = parse_json(content, path, PlanError, DRAWING_BYTES)
    features = list(_features(value, source))
    drawn = _drawn_walls(features, source)
    corners = drawn.walls.reshape(-1, 2)
    if len(corners) and max(np.ptp(corners, axis=0)) < DEGREES:
        raise PlanError(
            source, "is smaller than 5 cm: its coordinates are degrees; project it to metres first"
        )
    return floor_of_walls(drawn, path.stem, source)


def open_geojson(path: Path, options: PlanOptions) -> PlanIndex:
    """The plan of a GeoJSON file."""
    del options  # nothing about the format is open
    return PlanIndex({path.stem: (path,)}, read_geojson)


class _Feature(NamedTuple):
    """A thing in a file."""

    kind: str
    """Empty where it has none."""
    name: str
    geometry: Mapping[str, Any]


def _features(value: Any, source: str) -> Iterator[_Feature]:
    """Everything in the file that has a geometry of a known kind."""
    if not isinstance(value, dict):
        raise PlanError(
            source, "is no GeoJSON; it must be a FeatureCollection, a Feature or a geometry"
        )
    if value.get("type") == "FeatureCollection":
        features = value.get("features")
        if not isinstance(features, list):
            raise PlanError(source, "'features' is not a list")
        ENTRIES.check(source, len(features), PlanError)
    else:
        features = [value if value.get("type") == "Feature" else {"geometry": value}]
    for feature in features:
        if not isinstance(feature, dict):
            raise PlanError(source, f"has the feature {shown(feature)}, which is no object")
        properties = feature.get("properties") or {}
        geometry = feature.get("geometry")
        if not isinstance(properties, dict) or not isinstance(geometry, dict | None):
            raise PlanError(source, "has a feature whose properties or geometry are no object")
        if geometry and str(geometry.get("type")) in _NESTING:
            kind = properties.get("kind", "")
            name = properties.get("name") or properties.get("category") or "Room"
            if not isinstance(kind, str) or not isinstance(name, str):
                raise PlanError(
                    source,
                    f"has a feature whose kind or name is no text: {shown(kind)}, {shown(name)}",
                )
            kind = "door" if kind.lower() == "opening" else kind.lower()
            yield _Feature(kind, name[:_MAX_NAME], geometry)


def _drawn_walls(features: Sequence[_Feature], source: str) -> DrawnWalls:
    """Walls, doors, windows and rooms of a file; all are walls where no feature has a kind."""
    has_kinds = any(feature.kind for feature in features)
    lines: dict[str, list[FloatArray]] = {"wall": [], "door": [], "window": []}
    rooms: list[Room] = []
    for feature in features:
        rings = _rings(feature.geometry, source)
        if feature.kind == "room":
            areas = [polygon for polygon in map(Polygon, rings) if _is_area(polygon)]
            rooms += [Room(feature.name, area) for area in areas]
        elif feature.kind in lines or not has_kinds:
            kind = feature.kind or "wall"
            if kind != "wall" and "Polygon" in feature.geometry["type"]:
                lines[kind] += [middle_line(Polygon(ring))[None] for ring in rings]
            else:
                lines[kind] += [edges_of(ring, closed=False) for ring in rings]
    return DrawnWalls(
        walls=stacked(lines["wall"]),
        doors=stacked(lines["door"]),
        windows=stacked(lines["window"]),
        rooms=tuple(rooms),
    )


def _rings(geometry: Mapping[str, Any], source: str) -> list[FloatArray]:
    """The lines or rings of a geometry, each of shape (N, 2)."""
    kind = geometry["type"]
    level: list[Any] = [geometry.get("coordinates")]
    for _ in range(_NESTING[kind] - 1):
        if not all(isinstance(part, list) for part in level):
            raise PlanError(
                source, f"has a {kind} whose coordinates are not nested as RFC 7946 says"
            )
        level = [inner for part in level for inner in part]
    lines = [_points(part, kind, source) for part in level]
    return [points for points in lines if len(points) >= 2]


def _points(value: Any, kind: str, source: str) -> FloatArray:
    try:
        points = np.array([[x, y] for x, y, *_ in value])
    except (TypeError, ValueError, OverflowError):
        points = np.array(None)
    if points.dtype.kind not in "iuf" or (points.size and points.ndim != 2):
        raise PlanError(source, f"has a {kind} whose coordinates are not lists of numbers")
    return points.reshape(-1, 2).astype(np.float64)


def _is_area(polygon: Polygon) -> bool:
    points = shapely.get_coordinates(polygon)
    return bool(np.isfinite(points).all() and polygon.is_valid and polygon.area > 0.0)
