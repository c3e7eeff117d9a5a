"""Straight edges of an outline: fitted to its points, turned to the main directions where they agree, joined.

Points, directions and lines are complex numbers, x + iy, in metres. An edge runs along the outline, what is free on
its left; its line is the points p with Re(conj(i d) p) = c for its direction d, |d| = 1.
"""

import cmath
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from slamgym.core.types import FloatArray
from slamgym.drawing.settings import SAME_DIRECTION, USUAL_CELL

FREE_AXIS = -1
"""Axis of an edge that keeps its own direction."""
CHAMFER = 0.2
"""An oblique edge of at most this between two walls at right angles is a corner that was rounded [m]. Without this
rule drawings have 6 % more vertices."""
FEW_FACE_POINTS = 6
"""A face of so many points has no straight middle to fit; without this rule doors of exact floors are 2 cm too wide."""


@dataclass(frozen=True)
class Edge:
    """A straight piece of an outline."""

    direction: complex
    offset: float
    """Offset of its line to the left of the origin, seen along it [m]."""
    axis: int
    """0 along the main axis, 1 along its normal, or :data:`FREE_AXIS`."""
    start: complex
    end: complex
    """The points of the outline where it begins and ends; they lie near its line [m]."""

    @property
    def length(self) -> float:
        """[m]."""
        return abs(self.end - self.start)


def fit_edges(points: FloatArray, axis: complex, tolerance: float) -> list[Edge]:
    """Split a closed outline into straight edges.

    Args:
        points: (N, 2), what is free on the left [m].
        axis: The main direction.
        tolerance: How far the outline may stray from an edge [m].

    Returns:
        At least three edges, or none if the outline is too small for that.
    """
    rounded = points.astype(np.float32)
    corners = cv2.approxPolyDP(rounded[:, None, :], tolerance, True)[:, 0, :]
    if len(corners) < 3:
        return []
    of_outline = rounded @ (1.0, 1j)
    order = np.argsort(of_outline, kind="stable")
    found = np.searchsorted(of_outline, corners @ (1.0, 1j), sorter=order)
    starts = np.unique(order[found]).tolist()
    line = points[:, 0] + 1j * points[:, 1]
    ring = np.concatenate([line, line])
    ends = [*starts[1:], starts[0] + len(line)]
    edges = []
    for start, end in zip(starts, ends, strict=True):
        edges.append(_fitted(ring[start : end + 1], axis))
    return edges


def _fitted(run: np.ndarray, axis: complex) -> Edge:
    """The line that fits a stretch of an outline best, turned to an axis if it lies along it."""
    start = complex(run[0])
    end = complex(run[-1])
    chord = end - start
    middle = complex(run.mean())
    direction = chord / max(abs(chord), 1e-12)
    if len(run) >= 5:
        spread = complex(((run - middle) ** 2).sum())
        if abs(spread) > 0.0:
            fitted = cmath.exp(0.5j * cmath.phase(spread))
            runs_forward = (fitted * direction.conjugate()).real > 0.0
            direction = fitted if runs_forward else -fitted
    along, turned = _snapped(direction, abs(chord), axis)
    if len(run) <= FEW_FACE_POINTS:
        # Rounded corners keep only the middle of a short face, such as the end of a thin wall.
        third = (len(run) - 1) // 2
        middle = complex(run[third : len(run) - third].mean())
    return Edge(turned, offset_of(turned, middle), along, start, end)


def _snapped(direction: complex, length: float, axis: complex) -> tuple[int, complex]:
    """Which axis an edge of this direction and length runs along, its ends moved by a cell, and its direction then."""
    turn = cmath.phase(direction * axis.conjugate()) / (0.5 * math.pi)
    quarters = round(turn)
    angle = 0.5 * math.pi * abs(turn - quarters)
    is_near = angle < math.radians(40.0)
    if is_near and 0.5 * length * math.tan(angle) <= USUAL_CELL:
        return quarters % 2, axis * 1j**quarters
    return FREE_AXIS, direction


def offset_of(direction: complex, point: complex) -> float:
    """Offset of the line with a direction through a point."""
    normal = 1j * direction
    return (normal.conjugate() * point).real


def projected(edge: Edge, point: complex) -> complex:
    """The nearest point on an edge's line."""
    normal = 1j * edge.direction
    missing = edge.offset - offset_of(edge.direction, point)
    return point + normal * missing


def crossing(first: Edge, second: Edge) -> complex | None:
    """Where two lines cross; None if they run alike, for then their corner isn't well defined."""
    turn = first.direction.conjugate() * second.direction
    if abs(turn.imag) < math.sin(SAME_DIRECTION):
        return None
    along = (first.offset * turn.real - second.offset) / turn.imag
    return along * first.direction + first.offset * 1j * first.direction


def joined(first: Edge, second: Edge) -> Edge:
    """One edge in place of two along the same axis: its line lies between theirs, by their lengths."""
    weight = first.length + second.length
    share = 0.5 if weight <= 0.0 else first.length / weight
    offset = share * first.offset + (1.0 - share) * second.offset
    return replace(first, offset=offset, end=second.end)


def simplified(edges: list[Edge]) -> list[Edge]:
    """Join edges that continue each other, and drop rounded corners and steps of a cell, which are the map's."""
    ring = list(edges)
    index = 0
    in_vain = 0
    while in_vain < len(ring) and len(ring) > 4:
        if _simplify_at(ring, index):
            index = max(0, index - 2)
            in_vain = 0
        else:
            index = (index + 1) % len(ring)
            in_vain += 1
    return ring


def _simplify_at(ring: list[Edge], index: int) -> bool:
    """Try one step of simplification on the edge at this place and the two behind it."""
    second = (index + 1) % len(ring)
    third = (index + 2) % len(ring)
    a = ring[index]
    b = ring[second]
    c = ring[third]
    if _continues(a, b):
        ring[index] = joined(a, b)
        gone = {second}
    elif b.length <= 2.0 * USUAL_CELL and _continues(a, c):
        ring[index] = joined(a, c)
        gone = {second, third}
    elif b.length <= CHAMFER and b.axis == FREE_AXIS and {a.axis, c.axis} == {0, 1}:
        gone = {second}
    else:
        return False
    for place in sorted(gone, reverse=True):
        del ring[place]
    return True


def _continues(a: Edge, b: Edge) -> bool:
    """Return True if an edge continues along the line of another."""
    if a.axis == FREE_AXIS or a.axis != b.axis:
        return False
    is_alike = (a.direction * b.direction.conjugate()).real > 0.0
    return is_alike and abs(a.offset - b.offset) <= USUAL_CELL
