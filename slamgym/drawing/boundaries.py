"""Candidates for the boundaries between rooms, and the odds of each.

A boundary begins where a wall ends: at a corner that points into the free space. Each such corner gives the shortest
lines to what stands opposite, as far as :data:`WIDEST` goes. A logistic function of their
:mod:`~slamgym.drawing.signs` then says how likely each is.
"""

import functools
import itertools
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.config import from_dict
from slamgym.core.documents import read_json
from slamgym.core.provenance import check_origin
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.drawing.free_space import FreeSpace, cross
from slamgym.drawing.signs import Signs

WIDEST = 2.6
"""Candidates are narrower [m]."""
NARROWEST = 0.35
"""Candidates are wider [m]. From 0.2 on room F1 of 57 real maps is lower by 0.009 +- 0.005."""
MOST_OPPOSITE = 4
"""Lines from a corner to what stands opposite."""
APART = math.cos(math.radians(25.0))
"""Cosine of the least angle between two of them: without it there are 29 % more, and rooms as good."""
PRETRAINED = Path(__file__).parent / "pretrained" / "boundaries.json"
"""As ``benchmarks/drawing/boundaries.py`` fits them to annotated maps; beside it stands which."""


@dataclass(frozen=True)
class BoundaryModel:
    """Log odds of lines being boundaries between rooms: a constant, and a weight for each sign."""

    constant: float
    weights: dict[str, float]
    """By the names of the signs."""

    def log_odds(self, signs: Signs) -> FloatArray:
        """Log odds of N lines, (N,)."""
        terms = [weight * signs[name] for name, weight in self.weights.items()]
        return np.asarray(self.constant + np.sum(terms, axis=0))


@dataclass(frozen=True)
class BoundaryModels:
    """Two of them, for maps in which a network looked for doors and for others."""

    with_doors: BoundaryModel
    without_doors: BoundaryModel
    about: dict[str, Any]
    """Which maps they were fitted to."""

    @staticmethod
    @functools.cache
    def pretrained() -> "BoundaryModels":
        """Those that come with the package."""
        content = read_json(PRETRAINED)
        check_origin(PRETRAINED)
        return from_dict(BoundaryModels, content)


def candidate_lines(space: FreeSpace) -> FloatArray:
    """The shortest lines from corners of walls to what stands opposite, (N, 2, 2) [m], some of them twice."""
    lines = _lines_from_corners(space)
    nearest = _shortest_of_each(lines.corner, lines.width, 3 * MOST_OPPOSITE)
    lines = lines.take(nearest)
    usable = np.flatnonzero(_runs_inside(lines, space) & _is_unobstructed(lines, space))
    chosen = _spread(lines, usable.tolist())
    chosen = chosen[np.argsort(lines.width[chosen], kind="stable")]
    lines = lines.take(chosen)
    return np.stack([lines.start, lines.end], axis=1)


class _Lines(NamedTuple):
    """Lines from corners of walls to what stands opposite."""

    corner: IntArray  # (N,) numbers of the edges that start where they begin
    start: FloatArray  # (N, 2) [m]
    end: FloatArray  # (N, 2) [m]
    width: FloatArray  # (N,) [m]

    @property
    def direction(self) -> FloatArray:
        """From the corner, (N, 2)."""
        return (self.end - self.start) / self.width[:, None]

    def take(self, chosen: IntArray) -> "_Lines":
        """Some of them, by their numbers."""
        return _Lines(self.corner[chosen], self.start[chosen], self.end[chosen], self.width[chosen])


def _lines_from_corners(space: FreeSpace) -> _Lines:
    """Lines from all corners to the nearest points of the edges around, of the widths that boundaries have."""
    corners = np.flatnonzero(space.is_wall_corner)
    number, edge = space.edges_near(space.start[corners], WIDEST)
    corner = corners[number]
    start = space.start[corner]
    along = space.along[edge]
    edge_start = space.start[edge]
    share = ((start - edge_start) * along).sum(axis=1)
    share /= np.maximum(space.length[edge] ** 2, 1e-12)
    share = np.clip(share, 0.0, 1.0)
    end = edge_start + share[:, None] * along
    width = line_widths(np.stack([start, end], axis=1))
    is_end = (share < 1e-6) | (share > 1.0 - 1e-6)
    nearer_end = np.where(share < 0.5, edge, space.after[edge])
    may_end_there = space.is_wall_corner[nearer_end] | ~is_end
    may_be_boundary = (width > NARROWEST) & (width < WIDEST)
    good = np.flatnonzero(may_be_boundary & may_end_there)
    return _Lines(corner, start, end, width).take(good)


def _shortest_of_each(corner: IntArray, width: FloatArray, most: int) -> IntArray:
    """Numbers of at most so many lines of each corner, by corners and widths."""
    order = np.lexsort((width, corner))
    firsts = np.searchsorted(corner[order], corner[order])
    rank = np.arange(len(order)) - firsts
    return order[rank < most]


def _runs_inside(lines: _Lines, space: FreeSpace) -> BoolArray:
    """True for lines that leave their corner to the floor's side of one of its edges at least."""
    direction = lines.direction
    edge_before = space.before[lines.corner]
    before = cross(space.direction[edge_before], direction)
    behind = cross(space.direction[lines.corner], direction)
    return np.maximum(before, behind) > -1e-3


def _is_unobstructed(lines: _Lines, space: FreeSpace) -> BoolArray:
    """True for lines that meet no edge before their end."""
    direction = lines.direction
    start = lines.start + 1e-4 * direction
    reach = space.reach(start, direction, 1.1 * WIDEST)
    return reach > lines.width - 0.02


def _spread(lines: _Lines, usable: Sequence[int]) -> IntArray:
    """Numbers of the first usable lines of each corner that differ in direction, corner by corner."""
    direction = lines.direction
    kept: dict[int, list[int]] = defaultdict(list)
    for index in usable:
        own = kept[int(lines.corner[index])]
        differs = (direction[own] @ direction[index] < APART).all()
        if len(own) < MOST_OPPOSITE and differs:
            own.append(index)
    return np.array(list(itertools.chain(*kept.values())), np.int64)


def line_widths(lines: FloatArray) -> FloatArray:
    """Widths of lines (N, 2, 2), from end to end."""
    x, y = (lines[:, 1] - lines[:, 0]).T
    return np.asarray(np.hypot(x, y))
