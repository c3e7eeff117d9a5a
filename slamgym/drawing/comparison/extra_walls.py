"""Straight structures of a map that the plan doesn't have, and which of them are walls rather than furniture.

A wall is thin and seen from both sides, or long. What is seen from one side alone, with the unknown behind it, is the
front of a cupboard or a sofa.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from slamgym.core.types import FREE, BoolArray, FloatArray
from slamgym.drawing.comparison.faces import MapEvidence
from slamgym.drawing.comparison.records import Line

EXPLAINED = 0.15
"""Points of the map that are so near to a wall of the plan, or to where it has moved, belong to it [m]."""
BIN, GAP = 0.05, 0.2
"""Width of a straight structure, and the widest gap in it [m]."""
TURNS = 60
"""Directions in which structures are looked for."""
MAX_STRUCTURES = 60
"""A map with more has no structure at all."""
SHORTEST_EXTRA, LONG_EXTRA = 0.9, 3.5
"""Structures from the first length on are walls if they are seen from both sides, from the second on always [m]."""
THICKEST = 0.35
"""Thicker structures are furniture [m]."""
SEEN_ALONG = 0.6
"""Share of its length along which a structure is seen from a side that counts as seen."""


@dataclass(frozen=True)
class Structure:
    """A straight row of occupied cells."""

    line: Line
    length: float
    free: float
    """Share of its length with free space within the thickness of a wall, on the side that has more."""
    free_behind: float
    """The same on the other side."""

    @property
    def is_seen_from_both_sides(self) -> bool:
        """True if most of it is."""
        return self.free_behind >= SEEN_ALONG


def extra_structures(floor: BaseGeometry, evidence: MapEvidence, explained_by: FloatArray) -> list[Structure]:
    """The walls that a plan or a drawing doesn't have.

    Args:
        floor: Its floor; what lies outside isn't looked at.
        evidence: The map over it.
        explained_by: (N, 2) points of its walls where the map is expected to show them [m].
    """
    inner = floor.buffer(-0.5 * EXPLAINED)
    inside = shapely.contains_xy(inner, evidence.points[:, 0], evidence.points[:, 1])
    away = (
        KDTree(explained_by).query(evidence.points)[0] if len(explained_by) else np.full(len(inside), np.inf)
    )
    left = np.unique(np.round(evidence.points[inside & (away > EXPLAINED)], 6), axis=0)
    found: list[Structure] = []
    while len(left) >= SHORTEST_EXTRA / BIN * 0.5 and len(found) < MAX_STRUCTURES:
        longest = _longest_row(left)
        if longest is None:
            break
        members, line = longest
        left = left[~members]
        structure = _seen_from(line, evidence)
        if structure.is_seen_from_both_sides or (
            structure.length >= LONG_EXTRA and structure.free >= SEEN_ALONG
        ):
            found.append(structure)
    return _without_doubles(found)


def _longest_row(points: FloatArray) -> tuple[BoolArray, Line] | None:
    """The longest straight row of points: which they are, and its ends."""
    best, best_length = None, SHORTEST_EXTRA
    for angle in np.pi * np.arange(TURNS) / TURNS:
        along = points @ [np.cos(angle), np.sin(angle)]
        across = points @ [-np.sin(angle), np.cos(angle)]
        for shift in (0.0, 0.5):
            bins = np.floor(across / BIN + shift).astype(np.int64)
            order = np.lexsort((along, bins))
            breaks = np.flatnonzero((np.diff(bins[order]) != 0) | (np.diff(along[order]) > GAP)) + 1
            starts, stops = np.r_[0, breaks], np.r_[breaks, len(order)] - 1
            lengths = along[order[stops]] - along[order[starts]]
            run = int(lengths.argmax())
            if lengths[run] > best_length:
                best_length, best = float(lengths[run]), order[starts[run] : stops[run] + 1]
    if best is None:
        return None
    return _fitted(points, points[best])


def _fitted(points: FloatArray, row: FloatArray) -> tuple[BoolArray, Line]:
    """The line through a row, and all points that belong to it."""
    vx, vy, x, y = cv2.fitLine(row.astype(np.float32), cv2.DIST_L1, 0, 0.01, 0.01).ravel().tolist()
    unit, centre = np.array([vx, vy]), np.array([x, y])
    along, row_along = (points - centre) @ unit, (row - centre) @ unit
    across = (points - centre) @ [-vy, vx]
    low, high = float(row_along.min()), float(row_along.max())
    members = (np.abs(across) < 1.5 * BIN) & (along >= low - 0.1) & (along <= high + 0.1)
    start, end = centre + low * unit, centre + high * unit
    return members, (float(start[0]), float(start[1]), float(end[0]), float(end[1]))


def _seen_from(line: Line, evidence: MapEvidence) -> Structure:
    start, end = np.array(line[:2]), np.array(line[2:])
    length = float(np.hypot(*(end - start)))
    normal = np.array([start[1] - end[1], end[0] - start[0]]) / length
    points = start + np.linspace(0.05, 0.95, max(5, round(length / 0.05)))[:, None] * (end - start)
    depths = np.arange(0.1, THICKEST + 0.1, 0.05)[:, None] * normal
    sides = [
        float((evidence.values(points[:, None] + side * depths) == FREE).any(axis=1).mean())
        for side in (1.0, -1.0)
    ]
    return Structure(line, length, max(sides), min(sides))


def _without_doubles(found: list[Structure]) -> list[Structure]:
    """The two faces of one wall count once, by the longer."""
    kept: list[Structure] = []
    for structure in sorted(found, key=lambda entry: -entry.length):
        line = shapely.LineString(np.reshape(structure.line, (2, 2)))
        near = [shapely.LineString(np.reshape(other.line, (2, 2))).buffer(THICKEST) for other in kept]
        if not any(line.intersection(area).length > 0.7 * line.length for area in near):
            kept.append(structure)
    return kept
