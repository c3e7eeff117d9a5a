"""Candidates for the boundaries between rooms, and the probability of each.

A boundary begins where a wall ends: at a corner that points into the free space. Each such corner gives the shortest
lines to what stands opposite, as far as :data:`WIDEST` goes. The translator's layer of doors, and the shape of the
space on both sides, then say how likely each line is.
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from shapely import MultiPolygon

from slamgym.core.types import BoolArray, Float32Array, FloatArray, GridFrame, IntArray
from slamgym.drawing.evidence import values_at
from slamgym.drawing.free_space import FreeSpace, cross
from slamgym.metrics.layers import MapLayers

WIDEST = 2.6
"""Candidates are narrower [m]."""
NARROWEST = 0.35
"""Candidates are wider [m]."""
MOST_OPPOSITE = 4
"""Lines from a corner to what stands opposite."""
APART = math.cos(math.radians(25.0))
"""Cosine of the least angle between two of them."""
DOOR_REACH = 0.1
"""The layer of doors is looked at so far around a line [m]."""
JAMB_STEPS = 0.1 * np.arange(0.5, 13.0)
"""Places beyond the ends of a boundary at which the wall is looked for [m]."""

BOUNDARY_CONSTANT = 1.04
"""Constant of a logistic function of :func:`boundary_signs`, by ``benchmarks/drawing/boundaries.py``.

It is larger by 1 than the fitted one: a boundary that is missed spoils two rooms, one too many splits one."""
BOUNDARY_WEIGHTS = np.array([1.12, 0.65, 0.76, 1.32, 1.01])
"""Coefficients of the signs in the same function, one each."""


def candidates(
    floor: MultiPolygon, free: BoolArray, layers: MapLayers, frame: GridFrame
) -> tuple[FloatArray, FloatArray]:
    """Lines that may be boundaries, and their :func:`boundary_signs`.

    What was seen free is free whatever the model says of it, so the probability of a door is that among free cells. The
    layer alone has room F1 0.91 instead of 0.92 on 30 maps of real robots.

    Args:
        floor: The free space with straight edges [m].
        free: The same as cells.
        layers: What the model says of them.
        frame: Where they lie.
    """
    space = FreeSpace(floor)
    lines = candidate_lines(space)
    among_free = layers.door / np.maximum(layers.free, 0.1)
    door = among_free.astype(np.float32)
    return lines, boundary_signs(lines, space, free, door, frame)


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


def boundary_signs(
    lines: FloatArray, space: FreeSpace, free: BoolArray, door: Float32Array, frame: GridFrame
) -> FloatArray:
    """The signs that tell boundaries from other lines, (N, 5).

    They are the log odds of a door along the line (least and mean), the logarithm of its width, how deep the space is
    on the side where it ends sooner, and how far the wall goes on beyond the end where it goes on farther. The average
    precision on 30 maps of real robots, cross-validated over buildings, is 0.897, as with four more signs (how much
    wider the space gets, and the other sides); without the last sign it is 0.892, without the last two 0.880.

    Args:
        lines: (N, 2, 2) [m].
        space: The free space that they cross.
        free: The same as cells.
        door: Probability of these cells being a door.
        frame: Where the cells lie.
    """
    width = line_widths(lines)
    start = lines[:, 0]
    end = lines[:, 1]
    along = (end - start) / width[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    on_line = _doors_along(lines, door, frame)
    depth = _depth(lines, aside, space)
    other_depth = _depth(lines, -aside, space)
    wall_before = _wall_beyond(start, -along, free, frame)
    wall_after = _wall_beyond(end, along, free, frame)
    return np.column_stack(
        [
            _log_odds(on_line.min(axis=1)),
            _log_odds(on_line.mean(axis=1)),
            np.log(width),
            np.log1p(np.minimum(depth, other_depth)),
            np.maximum(wall_before, wall_after),
        ]
    )


def _doors_along(lines: FloatArray, door: Float32Array, frame: GridFrame) -> FloatArray:
    """Largest probabilities of a door around places along lines, (N, places)."""
    size = 2 * round(DOOR_REACH / frame.resolution) + 1
    around = cv2.dilate(door, np.ones((size, size), np.uint8))
    start = lines[:, :1]
    end = lines[:, 1:]
    share = np.linspace(0.05, 0.95, 13)[None, :, None]
    places = start + share * (end - start)
    return values_at(around, frame, places, 0.0)


def _depth(lines: FloatArray, aside: FloatArray, space: FreeSpace) -> FloatArray:
    """How far the floor goes on from the middles of lines in directions (N, 2), (N,) [m]."""
    middle = lines.mean(axis=1)
    return space.reach(middle + 1e-3 * aside, aside, 5.0)


def _wall_beyond(
    end: FloatArray, away: FloatArray, free: BoolArray, frame: GridFrame
) -> FloatArray:
    """How far the wall goes on beyond ends (N, 2) of lines in directions (N, 2), (N,) [m]."""
    places = end[:, None] + JAMB_STEPS[None, :, None] * away[:, None]
    is_solid = values_at(free, frame, places, 0) == 0
    steps = is_solid.cumprod(axis=1).sum(axis=1)
    return np.asarray(0.1 * steps)


def _log_odds(share: FloatArray) -> FloatArray:
    """Log odds of shares in [0, 1], which stay finite."""
    odds = (share + 0.01) / (1.01 - share)
    return np.asarray(np.log(odds))


def boundary_log_odds(signs: FloatArray) -> FloatArray:
    """Log odds of lines being boundaries between rooms, from :func:`boundary_signs`."""
    return BOUNDARY_CONSTANT + signs @ BOUNDARY_WEIGHTS
