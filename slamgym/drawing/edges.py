"""Straight edges of an outline: fitted to its points, turned to the main directions where they agree, joined.

Points, directions and lines are complex numbers, x + iy, in metres. An edge runs along the outline, what is free on
its left; its line is the points p with Re(conj(i d) p) = c for its direction d, |d| = 1.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from slamgym.core.types import FloatArray
from slamgym.drawing.settings import DrawingConfig

FREE_AXIS = -1
"""Of an edge that keeps its own direction."""
DRIFT_DEG = 1.0
"""A wall so near to a main direction is taken for one that drift has turned."""
TRIM = 0.15
"""Share of an edge's points at each end that don't count: corners are rounded."""
FEW_FACE_POINTS = 6
"""A face of so many points has no straight middle to fit."""
MIN_CROSSING = math.sin(math.radians(8.0))
"""Lines that cross at less than this have no well defined corner."""


@dataclass(frozen=True)
class Edge:
    """A straight piece of an outline."""

    direction: complex
    offset: float
    """Of its line to the left of the origin, seen along it [m]."""
    axis: int
    """Which main axis it runs along (an axis and its normal are two), or :data:`FREE_AXIS`."""
    start: complex
    end: complex
    """The points of the outline where it begins and ends; they lie near its line [m]."""

    @property
    def length(self) -> float:
        """[m]."""
        return abs(self.end - self.start)


def main_axes(angles_deg: Sequence[float]) -> list[complex]:
    """The axes of main directions, each followed by its normal."""
    axes = []
    for angle in angles_deg:
        axis = cmath.rect(1.0, math.radians(angle))
        axes += [axis, 1j * axis]
    return axes


def fit_edges(
    points: FloatArray, axes: Sequence[complex], tolerance: float, config: DrawingConfig
) -> list[Edge]:
    """Split a closed outline into straight edges.

    Args:
        points: (N, 2), what is free on the left [m].
        axes: The main axes.
        tolerance: How far the outline may stray from an edge [m].
        config: Sizes.

    Returns:
        At least three edges, or none if the outline is too small for that.
    """
    rounded = points.astype(np.float32)
    corners = cv2.approxPolyDP(rounded[:, None, :], tolerance, True)[:, 0, :]
    if len(corners) < 3:
        return []
    places: dict[Any, int] = {}
    for index, point in enumerate(map(tuple, rounded.tolist())):
        places.setdefault(point, index)
    at = sorted({places[corner] for corner in map(tuple, corners.tolist())})
    line = points[:, 0] + 1j * points[:, 1]
    ring = np.concatenate([line, line])
    ends = [*at[1:], at[0] + len(line)]
    return [_fitted(ring[a : b + 1], axes, config) for a, b in zip(at, ends, strict=True)]


def _fitted(run: np.ndarray, axes: Sequence[complex], config: DrawingConfig) -> Edge:
    """The line that fits a stretch of an outline best, turned to an axis if it lies along it."""
    start, end = complex(run[0]), complex(run[-1])
    chord = end - start
    cut = int(TRIM * len(run))
    inner = run[cut : len(run) - cut] if len(run) - 2 * cut >= 3 else run
    middle = complex(inner.mean())
    direction = chord / max(abs(chord), 1e-12)
    if len(inner) >= 5:
        spread = complex(((inner - middle) ** 2).sum())
        if abs(spread) > 0.0:
            fitted = cmath.exp(0.5j * cmath.phase(spread))
            direction = fitted if (fitted * direction.conjugate()).real > 0.0 else -fitted
    axis, turned = snapped(direction, abs(chord), axes, config)
    if len(run) <= FEW_FACE_POINTS:
        # Of a short face, as the end of a thin wall, rounded corners leave but the middle.
        third = (len(run) - 1) // 2
        middle = complex(run[third : len(run) - third].mean())
    return Edge(turned, offset_of(turned, middle), axis, start, end)


def snapped(
    direction: complex, length: float, axes: Sequence[complex], config: DrawingConfig
) -> tuple[int, complex]:
    """The axis that an edge of this direction and length runs along, and its direction then."""
    best, turned, least = FREE_AXIS, direction, math.inf
    for index, axis in enumerate(axes):
        cosine = (direction * axis.conjugate()).real
        along = axis if cosine > 0.0 else -axis
        angle = abs(cmath.phase(direction * along.conjugate()))
        allowed = config.snap_drift if angle <= math.radians(DRIFT_DEG) else config.snap
        if angle < min(least, math.radians(40.0)) and 0.5 * length * math.tan(angle) <= allowed:
            best, turned, least = index, along, angle
    return best, turned


def offset_of(direction: complex, point: complex) -> float:
    """Of the line through a point."""
    return ((1j * direction).conjugate() * point).real


def projected(edge: Edge, point: complex) -> complex:
    """The nearest point on an edge's line."""
    normal = 1j * edge.direction
    return point + normal * (edge.offset - offset_of(edge.direction, point))


def crossing(first: Edge, second: Edge) -> complex | None:
    """Where two lines cross; None if they hardly do."""
    turn = first.direction.conjugate() * second.direction
    if abs(turn.imag) < MIN_CROSSING:
        return None
    along = (first.offset * turn.real - second.offset) / turn.imag
    return along * first.direction + first.offset * 1j * first.direction


def joined(first: Edge, second: Edge) -> Edge:
    """One edge in place of two along the same axis: its line lies between theirs, by their lengths."""
    weight = first.length + second.length
    share = 0.5 if weight <= 0.0 else first.length / weight
    offset = share * first.offset + (1.0 - share) * second.offset
    return replace(first, offset=offset, end=second.end)


def simplified(edges: list[Edge], axes: Sequence[complex], config: DrawingConfig) -> list[Edge]:
    """Join edges that continue each other, and drop rounded corners and steps that are the map's.

    Edges along one axis that follow each other directly get an edge across between them.
    """
    ring = list(edges)
    changed = True
    while changed and len(ring) > 4:
        changed = False
        index = 0
        while index < len(ring) and len(ring) > 4:
            if _simplify_at(ring, index, axes, config):
                changed = True
                index = max(0, index - 2)
            else:
                index += 1
    return _with_connections(ring, axes)


def _simplify_at(ring: list[Edge], index: int, axes: Sequence[complex], config: DrawingConfig) -> bool:
    """Try one step of simplification on the edge at this place and the two behind it."""
    count = len(ring)
    second, third = (index + 1) % count, (index + 2) % count
    a, b, c = ring[index], ring[second], ring[third]
    if _continues(a, b, config):
        ring[index] = joined(a, b)
        del ring[second]
        return True
    if a.axis == FREE_AXIS and b.axis == FREE_AXIS and _is_one_line(a, b, config):
        ring[index] = _one_line(a, b)
        del ring[second]
        return True
    if _cap(ring, index, axes, config):
        return True
    short = b.length <= config.chamfer
    if short and b.axis == FREE_AXIS and a.axis != FREE_AXIS and c.axis != FREE_AXIS and a.axis != c.axis:
        corner = crossing(a, c)
        if corner is not None and max(abs(corner - b.start), abs(corner - b.end)) <= 1.5 * config.chamfer:
            ring[index], ring[third] = replace(a, end=corner), replace(c, start=corner)
            del ring[second]
            return True
    if b.length <= config.merge + config.tolerance and _continues(a, c, config):
        merged = joined(a, c)
        ring[index] = merged
        for gone in sorted((second, third), reverse=True):
            del ring[gone]
        return True
    return False


def _cap(ring: list[Edge], index: int, axes: Sequence[complex], config: DrawingConfig) -> bool:
    """Give the end of a wall, worn to one or two short oblique edges, its straight face; whether there was one."""
    count, a = len(ring), ring[index]
    for between in (1, 2):
        if a.axis == FREE_AXIS or count < between + 4:
            return False
        d = ring[(index + between + 1) % count]
        opposite = d.axis == a.axis and (d.direction * a.direction.conjugate()).real < 0.0
        places = [(index + k) % count for k in range(1, between + 1)]
        worn = [ring[k] for k in places]
        if not opposite or max(edge.length for edge in worn) > config.chamfer:
            continue
        if between == 1 and worn[0].axis == a.axis ^ 1:
            return False
        points = [point for edge in worn for point in (edge.start, edge.end)]
        tip = max(points, key=lambda point: (point * a.direction.conjugate()).real)
        first, second = projected(a, tip), projected(d, tip)
        if not 1e-6 < abs(second - first) <= config.max_thickness:
            continue
        axis = axes[a.axis ^ 1]
        direction = axis if ((second - first) * axis.conjugate()).real > 0.0 else -axis
        ring[places[0]] = Edge(direction, offset_of(direction, tip), a.axis ^ 1, first, second)
        for k in sorted(places[1:], reverse=True):
            del ring[k]
        return True
    return False


def _continues(a: Edge, b: Edge, config: DrawingConfig) -> bool:
    """Whether an edge goes on along the line of another."""
    same = a.axis != FREE_AXIS and a.axis == b.axis and (a.direction * b.direction.conjugate()).real > 0.0
    return same and abs(a.offset - b.offset) <= config.merge


def _is_one_line(a: Edge, b: Edge, config: DrawingConfig) -> bool:
    """Whether two edges of no axis lie along one line."""
    turn = abs(cmath.phase(b.direction * a.direction.conjugate()))
    if turn > math.radians(6.0):
        return False
    line = _one_line(a, b)
    strays = [abs(offset_of(line.direction, p) - line.offset) for p in (a.start, a.end, b.end)]
    return max(strays) <= 0.5 * config.merge


def _one_line(a: Edge, b: Edge) -> Edge:
    total = a.direction * a.length + b.direction * b.length
    direction = total / max(abs(total), 1e-12)
    middle = [0.5 * (edge.start + edge.end) for edge in (a, b)]
    places = [projected(edge, point) for edge, point in zip((a, b), middle, strict=True)]
    weight = a.length / max(a.length + b.length, 1e-12)
    offset = weight * offset_of(direction, places[0]) + (1.0 - weight) * offset_of(direction, places[1])
    return Edge(direction, offset, FREE_AXIS, a.start, b.end)


def _with_connections(ring: list[Edge], axes: Sequence[complex]) -> list[Edge]:
    """Put an edge across between two that follow each other along one axis."""
    result: list[Edge] = []
    for index, edge in enumerate(ring):
        result.append(edge)
        following = ring[(index + 1) % len(ring)]
        if edge.axis == FREE_AXIS or edge.axis != following.axis:
            continue
        place = 0.5 * (edge.end + following.start)
        first, second = projected(edge, place), projected(following, place)
        step = second - first
        if abs(step) < 1e-9:
            continue
        across = edge.axis ^ 1
        direction = axes[across] if (step * axes[across].conjugate()).real > 0.0 else -axes[across]
        result.append(Edge(direction, offset_of(direction, first), across, first, second))
    return result


def align_edges(
    rings: list[list[Edge]], axes: Sequence[complex], reach: float, gap: float
) -> list[list[Edge]]:
    """Give edges on one line one offset: the faces of a wall on both sides of a door.

    Args:
        rings: Edges of all outlines.
        axes: The main axes.
        reach: Offsets that differ by at most this are one [m].
        gap: Edges farther apart along the line are left alone [m].
    """
    result = [list(ring) for ring in rings]
    for axis in range(len(axes)):
        for heading in (axes[axis], -axes[axis]):
            members = [
                (edge.offset, i, k)
                for i, ring in enumerate(result)
                for k, edge in enumerate(ring)
                if edge.axis == axis and (edge.direction * heading.conjugate()).real > 0.0
            ]
            for group in _groups(sorted(members), result, reach, gap):
                lengths = [result[i][k].length for _, i, k in group]
                weights = np.array(lengths) + 1e-9
                offset = float(np.average([value for value, _, _ in group], weights=weights))
                for _, i, k in group:
                    result[i][k] = replace(result[i][k], offset=offset)
    return result


def _groups(
    members: list[tuple[float, int, int]], rings: list[list[Edge]], reach: float, gap: float
) -> list[list[tuple[float, int, int]]]:
    """Members on nearly one line that follow each other within a gap."""
    levels: list[list[tuple[float, int, int]]] = []
    for member in members:
        if levels and member[0] - levels[-1][0][0] <= reach:
            levels[-1].append(member)
        else:
            levels.append([member])
    groups = []
    for level in levels:
        placed = []
        for member in level:
            edge = rings[member[1]][member[2]]
            ends = [(p * edge.direction.conjugate()).real for p in (edge.start, edge.end)]
            placed.append((min(ends), max(ends), member))
        placed.sort()
        current, until = [placed[0][2]], placed[0][1]
        for low, high, member in placed[1:]:
            if low - until <= gap:
                current.append(member)
            else:
                groups.append(current)
                current = [member]
            until = max(until, high)
        groups.append(current)
    return [group for group in groups if len(group) > 1]
