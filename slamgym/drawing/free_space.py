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
        self.start = np.concatenate(rings)
        self.along = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
        self.length = np.hypot(*self.along.T)
        self.direction = self.along / np.maximum(self.length, 1e-12)[:, None]
        firsts = np.cumsum([0, *(len(ring) for ring in rings[:-1])])
        self.before = np.concatenate(
            [
                first + np.roll(np.arange(len(ring)), 1)
                for first, ring in zip(firsts, rings, strict=True)
            ]
        )
        self.after: IntArray = np.argsort(self.before)
        edges = shapely.linestrings(np.stack([self.start, self.start + self.along], axis=1))
        self._edges = shapely.STRtree(np.asarray(edges))
        self.turn = cross(self.direction[self.before], self.direction)
        """Sine of the angle by which the outline turns to the left where each edge starts."""
        self.is_wall_corner: BoolArray = self.turn < -math.sin(math.radians(15.0))

    def edges_near(self, places: FloatArray, distance: float) -> tuple[IntArray, IntArray]:
        """Pairs of places (N, 2) and edges that lie so near [m]: the numbers of both."""
        place, edge = self._edges.query(
            shapely.points(places), predicate="dwithin", distance=distance
        )
        return place, edge

    def edges_near_edges(self, distance: float) -> list[IntArray]:
        """Numbers of the edges that lie so near [m] to each edge, itself included."""
        edge, other = self._edges.query(
            self._edges.geometries, predicate="dwithin", distance=distance
        )
        order = np.lexsort((other, edge))
        return np.split(other[order], np.searchsorted(edge[order], np.arange(1, len(self.start))))

    def reach(self, places: FloatArray, directions: FloatArray, most: float) -> FloatArray:
        """How far one can go from places (N, 2) in directions (N, 2) until an edge is met, ``most`` at most [m]."""
        rays = shapely.linestrings(np.stack([places, places + most * directions], axis=1))
        ray, edge = self._edges.query(rays)
        way, along = directions[ray], self.along[edge]
        offset = self.start[edge] - places[ray]
        with np.errstate(divide="ignore", invalid="ignore"):
            product = cross(way, along)
            distance = cross(offset, along) / product
            share = cross(offset, way) / product
        is_hit = (distance > 1e-6) & (share >= -1e-9) & (share <= 1.0 + 1e-9)
        found = np.full(len(places), most)
        np.minimum.at(found, ray[is_hit], distance[is_hit])
        return found


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross products of vectors (..., 2)."""
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
