"""A drawing as a graph that Nav2's route server reads: places of rooms, and straight ways between them.

A shortest way round obstacles turns at their corners alone (Lozano-Perez and Wesley 1979), so the graph holds those
corners, moved off by the robot's radius, on which a shortest way between two rooms turns.
"""

import json
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely import MultiPolygon

from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import FloatArray, IntArray
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.settings import USUAL_CELL

ROUTE_RADIUS = 0.25
"""Ways keep so far from what stands [m]: the 0.22 m of a robot in Nav2's own parameters, and half a cell."""
LONGEST_WAY = 12.0
"""Corners farther apart aren't joined straight [m]: a longer way may have one corner more."""


class RouteGraph(NamedTuple):
    """Places and the straight ways between them, both ways each."""

    points: FloatArray  # (N, 2) [m]; the first are those of the rooms
    rooms: tuple[str, ...]  # names of the first places
    ways: IntArray  # (M, 2), smaller place first


def route_graph(drawing: Drawing) -> RouteGraph:
    """Lay ways between all rooms between which the map lets a robot of :data:`ROUTE_RADIUS` pass.

    A room's place is where it is widest; rooms too narrow for the robot have none.
    """
    free = drivable(drawing)
    names, places = _places(drawing, free)
    points = np.array([*places, *_corners(free)], dtype=np.float64).reshape(-1, 2)
    seen = _visible_pairs(points, free)
    lengths = np.linalg.norm(points[seen[:, 0]] - points[seen[:, 1]], axis=1)
    graph = csr_array((lengths, (seen[:, 0], seen[:, 1])), shape=(len(points), len(points)))
    used: set[tuple[int, int]] = set()
    for start in range(len(names)):
        _, before = dijkstra(graph, directed=False, indices=[start], return_predecessors=True)
        for end in range(start + 1, len(names)):
            place = end
            while before[0, place] >= 0:
                via = int(before[0, place])
                used.add((min(place, via), max(place, via)))
                place = via
    ways = np.array(sorted(used), dtype=np.int64).reshape(-1, 2)
    kept = np.union1d(np.arange(len(names)), ways)
    return RouteGraph(points[kept], tuple(names), np.searchsorted(kept, ways))


def drivable(drawing: Drawing) -> MultiPolygon:
    """Where the robot's centre may be: seen floor without what the map shows standing on it, less the radius."""
    closed = shapely.union_all([*drawing.echoes, *drawing.inferred_floor])
    floor = drawing.floor.difference(closed)
    return MultiPolygon(
        polygon_parts(floor.simplify(USUAL_CELL).buffer(-ROUTE_RADIUS, quad_segs=2))
    )


def _places(drawing: Drawing, free: MultiPolygon) -> tuple[list[str], list[tuple[float, float]]]:
    """Names of the rooms that hold the robot, and where each is widest."""
    names = []
    places = []
    for room in drawing.rooms:
        parts = polygon_parts(room.polygon.intersection(free))
        if parts:
            radii = [shapely.maximum_inscribed_circle(part, tolerance=USUAL_CELL) for part in parts]
            widest = max(radii, key=lambda radius: float(radius.length))
            names.append(room.name)
            x, y = widest.coords[0]
            places.append((x, y))
    return names, places


def _corners(free: MultiPolygon) -> list[tuple[float, float]]:
    """Corners of the free floor round which a way may turn: those that point into it."""
    corners: list[tuple[float, float]] = []
    for part in free.geoms:
        for number, ring in enumerate((part.exterior, *part.interiors)):
            line = np.array(ring.coords[:-1])
            if not ring.is_ccw:
                line = line[::-1]
            before = line - np.roll(line, 1, axis=0)
            after = np.roll(line, -1, axis=0) - line
            turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            inward = turn < 0.0 if number == 0 else turn > 0.0
            corners += [(x, y) for x, y in line[inward].tolist()]
    return corners


def _visible_pairs(points: FloatArray, free: MultiPolygon) -> IntArray:
    """Pairs of places (M, 2), smaller first, whose straight line lies on the free floor."""
    first, second = np.triu_indices(len(points), 1)
    near = np.linalg.norm(points[first] - points[second], axis=1) <= LONGEST_WAY
    first, second = first[near], second[near]
    lines = shapely.linestrings(np.stack([points[first], points[second]], axis=1))
    room = free.buffer(1e-3)  # a line along a wall is on the floor, whatever the last digit is
    shapely.prepare(room)
    return np.stack([first, second], axis=1)[shapely.covers(room, lines)]


def format_route_graph(drawing: Drawing) -> str:
    """A drawing's graph as GeoJSON; every number of a place or a way is unique, and each way is there both ways.

    Convention: metres, in the frame ``map``, that of the map which it was drawn from.
    """
    graph = route_graph(drawing)
    features: list[dict[str, Any]] = []
    for number, (x, y) in enumerate(graph.points.tolist()):
        properties: dict[str, object] = {"id": number, "frame": "map"}
        if number < len(graph.rooms):
            properties["metadata"] = {"room": graph.rooms[number]}
        place = [round(x, 3), round(y, 3)]
        features.append(_feature(properties, "Point", place))
    both = np.concatenate([graph.ways, graph.ways[:, ::-1]])
    for number, (start, end) in enumerate(both.tolist(), len(graph.points)):
        length = float(np.linalg.norm(graph.points[end] - graph.points[start]))
        properties = {"id": number, "startid": start, "endid": end, "cost": round(length, 3)}
        line = [features[place]["geometry"]["coordinates"] for place in (start, end)]
        features.append(_feature(properties, "MultiLineString", [line]))
    return (
        json.dumps({"type": "FeatureCollection", "name": drawing.name, "features": features}) + "\n"
    )


def _feature(properties: dict[str, object], kind: str, coordinates: object) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}
