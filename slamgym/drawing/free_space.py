"""The edges of a floor, and how far one sees across it."""

import math

import numpy as np
import shapely

from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import BoolArray, FloatArray, IntArray


class FreeSpace:
    """The edges of a floor, the floor on their left."""

    def __init__(self, floor: shapely.Geometry) -> None:
        """Take the edges of polygons apart."""
        rings = [shapely.get_coordinates(ring)[:-1] for ring in oriented_rings(floor)]
        following = [np.roll(ring, -1, axis=0) for ring in rings]
        self.start = np.concatenate(rings)
        self.along = np.concatenate(following) - self.start
        x, y = self.along.T
        self.length = np.hypot(x, y)
        divisor = np.maximum(self.length, 1e-12)
        self.direction = self.along / divisor[:, None]
        self.before = _numbers_before([len(ring) for ring in rings])
        self.after: IntArray = np.argsort(self.before)
        end = self.start + self.along
        ends = np.stack([self.start, end], axis=1)
        edges = shapely.linestrings(ends)
        self._edges = shapely.STRtree(np.asarray(edges))
        direction_before = self.direction[self.before]
        self.turn = cross(direction_before, self.direction)
        """Sine of the angle by which the outline turns to the left where each edge starts."""
        self.is_wall_corner: BoolArray = self.turn < -math.sin(math.radians(15.0))

    def edges_near(self, places: FloatArray, distance: float) -> tuple[IntArray, IntArray]:
        """Pairs of places (N, 2) and edges that lie so near [m]: the numbers of both."""
        points = shapely.points(places)
        place, edge = self._edges.query(points, predicate="dwithin", distance=distance)
        return place, edge

    def edges_near_edges(self, distance: float) -> list[IntArray]:
        """Numbers of the edges that lie so near [m] to each edge, itself included."""
        edges = self._edges.geometries
        edge, other = self._edges.query(edges, predicate="dwithin", distance=distance)
        order = np.lexsort((other, edge))
        following = np.arange(1, len(self.start))
        firsts = np.searchsorted(edge[order], following)
        return np.split(other[order], firsts)

    def reach(self, places: FloatArray, directions: FloatArray, most: float) -> FloatArray:
        """How far one can go from places (N, 2) in directions (N, 2) until an edge is met, ``most`` at most [m]."""
        farthest = places + most * directions
        ends = np.stack([places, farthest], axis=1)
        ray, edge = self._edges.query(shapely.linestrings(ends))
        way = directions[ray]
        along = self.along[edge]
        offset = self.start[edge] - places[ray]
        with np.errstate(divide="ignore", invalid="ignore"):
            product = cross(way, along)
            distance = cross(offset, along) / product
            share = cross(offset, way) / product
        is_on_edge = (share >= -1e-9) & (share <= 1.0 + 1e-9)
        is_hit = (distance > 1e-6) & is_on_edge
        found = np.full(len(places), most)
        np.minimum.at(found, ray[is_hit], distance[is_hit])
        return found


def _numbers_before(sizes: list[int]) -> IntArray:
    """For each edge of rings of these sizes the number of the edge before it in its ring."""
    numbers = []
    first = 0
    for size in sizes:
        own = first + np.arange(size)
        numbers.append(np.roll(own, 1))
        first += size
    return np.concatenate(numbers)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross products of vectors (..., 2)."""
    forward = a[..., 0] * b[..., 1]
    backward = a[..., 1] * b[..., 0]
    product: FloatArray = forward - backward
    return product
