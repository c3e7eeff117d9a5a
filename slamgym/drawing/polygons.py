"""From outlines to valid polygons with straight edges: the floor."""

import cmath
import itertools
import math

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import Float32Array, FloatArray, GridFrame
from slamgym.drawing.contours import trace_outlines
from slamgym.drawing.edges import Edge, crossing, fit_edges, projected, simplified
from slamgym.drawing.settings import NARROWEST_DRAWN, SMALLEST_ROOM, THINNEST_WALL, USUAL_CELL

SMALLEST_HOLE = 0.05
"""Things on the floor, and patches of floor that was never observed, smaller than this aren't drawn [m2]. If
all are drawn room F1 of 57 real maps falls by 0.026 +- 0.011."""
CORNER_GRID = 1e-4
"""Corners lie on a grid of this [m], so that files that round keep polygons valid."""


def straightened(picture: Float32Array, frame: GridFrame, angle_deg: float) -> MultiPolygon:
    """The floor with straight edges.

    Args:
        picture: Probability of floor, (H, W).
        frame: Where its cells lie.
        angle_deg: The main direction.

    Returns:
        Valid; empty if nothing is large enough.
    """
    axis = cmath.rect(1.0, math.radians(angle_deg))
    tolerance = max(USUAL_CELL, frame.resolution)
    rings = list[Polygon]()
    for outline in trace_outlines(picture, frame, SMALLEST_ROOM, SMALLEST_HOLE):
        points = shapely.get_coordinates(outline)[:-1]
        edges = simplified(fit_edges(points, axis, tolerance))
        ring = ring_corners(edges, 4.0 * tolerance) if edges else outline
        rings.append(Polygon(ring))
    # What lies within an odd number of rings is floor: holes are none, and what stands in them is. Where an edge runs
    # backwards, because its neighbours have eaten it up, nothing is left.
    return without_necks(shapely.make_valid(MultiPolygon(rings)))


def ring_corners(edges: list[Edge], most: float) -> FloatArray:
    """The corners of a closed ring of edges: where they cross, if that is near to where they meet.

    Args:
        edges: In their order.
        most: Farthest that a corner may lie from the outline's own [m].

    Returns:
        (N, 2), one that two edges share twice [m].
    """
    ends = []
    for edge, following in itertools.pairwise([*edges, edges[0]]):
        gap = edge.end - following.start
        place = 0.5 * (edge.end + following.start)
        corner = crossing(edge, following)
        if corner is not None and abs(corner - place) <= max(most, abs(gap)):
            ends += [corner, corner]
        else:
            ends += [projected(edge, place), projected(following, place)]
    points = np.array(ends)
    return np.column_stack([points.real, points.imag])


def without_necks(floor: BaseGeometry) -> MultiPolygon:
    """A floor of valid polygons [m] without slits and parts that only touch, its corners on the grid."""
    neck = 0.5 * NARROWEST_DRAWN
    slit = 0.5 * THINNEST_WALL
    for step in (-neck, neck + slit, -slit):
        floor = shapely.buffer(floor, step, join_style="mitre", mitre_limit=1.5)
    # Mitred buffers may come out crossing themselves, which set_precision doesn't take.
    floor = shapely.make_valid(floor)
    floor = shapely.set_precision(floor, CORNER_GRID)
    smallest = 0.5 * SMALLEST_ROOM
    return MultiPolygon([part for part in polygon_parts(floor) if part.area >= smallest])
