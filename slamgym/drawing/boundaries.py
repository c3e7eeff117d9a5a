"""Candidates for the boundaries between rooms, and the probability of each.

A boundary begins where a wall ends: at a corner that points into the free space. Each such corner gives the shortest
lines to what stands opposite, as far as :data:`WIDEST` goes. The translator's layer of doors, and the shape of the
space on both sides, then say how likely each line is.
"""

import math
from collections import defaultdict

import cv2
import numpy as np
from shapely import MultiPolygon

from slamgym.core.types import BoolArray, Float32Array, FloatArray, GridFrame
from slamgym.drawing.evidence import values_at
from slamgym.drawing.free_space import FreeSpace, cross
from slamgym.metrics.layers import MapLayers

WIDEST, NARROWEST = 2.6, 0.35
"""Widths between which candidates lie [m]."""
MOST_OPPOSITE = 4
"""Lines from a corner to what stands opposite."""
APART = math.cos(math.radians(25.0))
"""Cosine of the least angle between two of them."""
DOOR_REACH = 0.1
"""The layer of doors is looked at so far around a line [m]."""
JAMB_STEPS = 0.1 * np.arange(0.5, 13.0)
"""Places beyond the ends of a boundary at which the wall is looked for [m]."""

CONSTANT, WEIGHTS = 1.04, np.array([1.12, 0.65, 0.76, 1.32, 1.01])
"""Coefficients of a logistic function of :func:`boundary_signs`, by ``benchmarks/drawing/boundaries.py``.

The constant is larger by 1 than the fitted one: a boundary that is missed spoils two rooms, one too many splits one."""


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
    door = (layers.door / np.maximum(layers.free, 0.1)).astype(np.float32)
    return lines, boundary_signs(lines, space, free, door, frame)


def candidate_lines(space: FreeSpace) -> FloatArray:
    """The shortest lines from corners of walls to what stands opposite, (N, 2, 2) [m], some of them twice."""
    corners = np.flatnonzero(space.is_wall_corner)
    of, edge = space.edges_near(space.start[corners], WIDEST)
    corner = corners[of]
    place, along = space.start[corner], space.along[edge]
    share = ((place - space.start[edge]) * along).sum(axis=1) / np.maximum(
        space.length[edge] ** 2, 1e-12
    )
    share = np.clip(share, 0.0, 1.0)
    end = space.start[edge] + share[:, None] * along
    width = np.hypot(*(end - place).T)
    is_end = (share < 1e-6) | (share > 1.0 - 1e-6)
    opposite_corner = space.is_wall_corner[np.where(share < 0.5, edge, space.after[edge])]
    good = np.flatnonzero((width > NARROWEST) & (width < WIDEST) & (opposite_corner | ~is_end))
    good = good[np.lexsort((width[good], of[good]))]
    rank = np.arange(len(good)) - np.searchsorted(of[good], of[good])
    good = good[rank < 3 * MOST_OPPOSITE]
    place, corner, width = place[good], corner[good], width[good]
    ways = (end[good] - place) / width[:, None]
    inside = np.maximum(
        cross(space.direction[space.before[corner]], ways), cross(space.direction[corner], ways)
    )
    seen = space.reach(place + 1e-4 * ways, ways, 1.1 * WIDEST) > width - 0.02
    kept: dict[int, list[int]] = defaultdict(list)
    for index in np.flatnonzero(seen & (inside > -1e-3)).tolist():
        some = kept[int(corner[index])]
        if len(some) < MOST_OPPOSITE and (ways[some] @ ways[index] < APART).all():
            some.append(index)
    chosen = np.array([index for some in kept.values() for index in some], np.int64)
    chosen = chosen[np.argsort(width[chosen], kind="stable")]
    return np.stack([place[chosen], end[good][chosen]], axis=1)


def line_widths(lines: FloatArray) -> FloatArray:
    """Widths of lines (N, 2, 2), from end to end."""
    return np.asarray(np.hypot(*(lines[:, 1] - lines[:, 0]).T))


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
    along = (lines[:, 1] - lines[:, 0]) / width[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    middle = lines.mean(axis=1)
    size = 2 * round(DOOR_REACH / frame.resolution) + 1
    share = np.linspace(0.05, 0.95, 13)[None, :, None]
    across = lines[:, :1] + share * (lines[:, 1:] - lines[:, :1])
    on_line = values_at(cv2.dilate(door, np.ones((size, size), np.uint8)), frame, across, 0.0)
    depths = [space.reach(middle + 1e-3 * way, way, 5.0) for way in (aside, -aside)]
    solids = []
    for end, way in ((lines[:, 0], -along), (lines[:, 1], along)):
        beyond = end[:, None] + JAMB_STEPS[None, :, None] * way[:, None]
        solids.append(0.1 * (values_at(free, frame, beyond, 0) == 0).cumprod(axis=1).sum(axis=1))
    least, mean = _log_odds(on_line.min(axis=1)), _log_odds(on_line.mean(axis=1))
    return np.column_stack(
        [least, mean, np.log(width), np.log1p(np.minimum(*depths)), np.maximum(*solids)]
    )


def _log_odds(share: FloatArray) -> FloatArray:
    """Log odds of shares in [0, 1], which stay finite."""
    return np.asarray(np.log((share + 0.01) / (1.01 - share)))


def boundary_log_odds(signs: FloatArray) -> FloatArray:
    """Log odds of lines being boundaries between rooms, from :func:`boundary_signs`."""
    return CONSTANT + signs @ WEIGHTS
