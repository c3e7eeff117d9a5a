"""Search for a scan over a whole map and all headings: every place that explains it nearly as well as the best one.

Branch and bound over grids of maxima (Hess et al. 2016, section V-B), which is exact: a block of places is looked
into only where its bound says that one of them may be good enough. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import ByteArray, FloatArray
from slamgym.slam.graph.matching import block_score
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.field import FLOOR, LikelihoodField

HIT = 255
SEARCH_CELL = 0.1
"""Least size of a cell of the search [m]."""
SEARCH_SIGMA = 0.12
"""Spread of the score round surfaces: wider than a cell, so that no place falls between cells [m]."""
CLOUD_POINTS = 150
HEADING_STEPS = (0.015, 0.07)
"""Bounds of the step in heading [rad]."""
LEVELS = (3, 7)
"""The largest blocks have sides of 2 to the power of this, in cells: larger where there are very many."""
MOST_BOUNDS = 4_000_000
MOST_PLACES = 20_000
APART, APART_TURN = 0.5, 0.35
"""Places nearer to each other than this are one [m], [rad]."""


class Place(NamedTuple):
    """A pose that explains a scan."""

    pose: FloatArray  # (3,)
    score: float  # 0 to 1: 1 if every point lies on a surface


@kernel
def search_heading(
    levels: ByteArray, floors: ByteArray, us: np.ndarray, vs: np.ndarray, bounds: np.ndarray, least: int,
    places: np.ndarray,
) -> int:  # fmt: skip
    """Find the best place of every block at one heading.

    Args:
        levels: (levels, rows, cols) grids of maxima of the score.
        floors: (levels, rows, cols) the same of the floor.
        us: (n,) int32 the points' columns with the robot in cell 0.
        vs: (n,) the rows.
        bounds: (block rows, block cols) of the top level: bounds of the score, 0 where there is no floor.
        least: Score from which on places are of interest.
        places: (most, 3) int64 receives score, column and row.

    Returns:
        How many were found.
    """
    top = len(levels) - 1
    stack = np.empty((4 * top + 8, 4), dtype=np.int64)
    count = 0
    for block_row in range(bounds.shape[0]):
        for block_col in range(bounds.shape[1]):
            if bounds[block_row, block_col] < least or count == len(places):
                continue
            best = least - 1
            stack[0, 0], stack[0, 1], stack[0, 2] = top, block_col << top, block_row << top
            stack[0, 3] = bounds[block_row, block_col]
            height = 1
            while height > 0:
                height -= 1
                h, u, v, bound = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
                if bound <= best:
                    continue
                if h == 0:
                    best = bound
                    places[count, 0], places[count, 1], places[count, 2] = bound, u, v
                    continue
                half = 1 << (h - 1)
                for child in range(4):
                    child_u, child_v = u + (child & 1) * half, v + (child >> 1) * half
                    if child_u >= floors.shape[2] or child_v >= floors.shape[1]:
                        continue
                    if floors[h - 1, child_v, child_u] == 0:
                        continue
                    value = block_score(levels[h - 1], half, us, vs, child_u, child_v)
                    if value > best:
                        stack[height, 0], stack[height, 1], stack[height, 2] = h - 1, child_u, child_v
                        stack[height, 3] = value
                        height += 1
            if best >= least:
                count += 1
    return count


@kernel
def bound_heading(
    levels: ByteArray, floors: ByteArray, us: np.ndarray, vs: np.ndarray, bounds: np.ndarray
) -> None:
    """Fill in the bounds that :func:`search_heading` takes."""
    top = len(levels) - 1
    for block_row in range(bounds.shape[0]):
        for block_col in range(bounds.shape[1]):
            bounds[block_row, block_col] = 0
            if floors[top, block_row << top, block_col << top]:
                bounds[block_row, block_col] = block_score(
                    levels[top], 1 << top, us, vs, block_col << top, block_row << top
                )


def _maxima(grid: ByteArray, levels: int) -> ByteArray:
    """(levels, rows, cols): ``[h, r, c]`` is the maximum of the 2^h x 2^h cells whose lower left one is ``[r, c]``."""
    out = np.empty((levels, *grid.shape), dtype=np.uint8)
    out[0] = grid
    for h in range(1, levels):
        step = 1 << (h - 1)
        out[h] = out[h - 1]
        np.maximum(out[h, :-step], out[h - 1, step:], out=out[h, :-step])
        across = out[h].copy()
        np.maximum(out[h, :, :-step], across[:, step:], out=out[h, :, :-step])
    return out


class GlobalSearch:
    """Searches one map."""

    def __init__(self, field: LikelihoodField, config: LocalizationConfig) -> None:
        self._config = config
        self._field = field
        factor = max(1, round(SEARCH_CELL / field.cell))
        self._cell = factor * field.cell
        rows, cols = (-(-size // factor) for size in field.floor.shape)
        padding = [(0, rows * factor - field.floor.shape[0]), (0, cols * factor - field.floor.shape[1])]
        blocks = (rows, factor, cols, factor)
        distance = np.pad(field.distance, padding, constant_values=1e3).reshape(blocks).min(axis=(1, 3))
        self._score = np.rint(HIT * np.exp(-0.5 * np.square(distance / SEARCH_SIGMA))).astype(np.uint8)
        floor = (field.floor == FLOOR).astype(np.uint8)
        self._floor = np.pad(floor, padding).reshape(blocks).max(axis=(1, 3))
        self._levels: ByteArray = np.zeros((0, 0, 0), dtype=np.uint8)
        self._floors = self._levels

    def _prepare(self, headings: int) -> None:
        """Make the grids of maxima, with blocks so large that not too many must be bounded."""
        top = LEVELS[0]
        while top < LEVELS[1] and headings * (self._floor.size >> (2 * top)) > MOST_BOUNDS:
            top += 1
        if len(self._levels) != top + 1:
            self._levels, self._floors = _maxima(self._score, top + 1), _maxima(self._floor, top + 1)

    def find(self, points: FloatArray) -> list[Place]:
        """The best places of a scan, or of several put together, the best first.

        Args:
            points: (n, 2) end points in the robot frame [m]; at least one.
        """
        points = points[np.linspace(0, len(points) - 1, min(len(points), CLOUD_POINTS)).astype(int)]
        far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
        step = min(max(self._cell / max(far, self._cell), HEADING_STEPS[0]), HEADING_STEPS[1])
        headings = np.arange(0.0, 2.0 * math.pi, 2.0 * math.pi / math.ceil(2.0 * math.pi / step))
        self._prepare(len(headings))
        top = len(self._levels) - 1
        shape = tuple(-(-size // (1 << top)) for size in self._floor.shape)
        bounds = np.zeros((len(headings), *shape), dtype=np.int32)
        cells = [self._cells(points, heading) for heading in headings]
        for at, (us, vs) in enumerate(cells):
            bound_heading(self._levels, self._floors, us, vs, bounds[at])
        places = np.empty((MOST_PLACES, 3), dtype=np.int64)
        best, margin = 0, round(self._config.score_margin * HIT * len(points))
        found: list[tuple[int, float, float, float]] = []
        # Headings in the order of their best bound: the first ones soon set a bar for the others.
        for at in np.argsort(-bounds.max(axis=(1, 2)), kind="stable"):
            least = max(best - margin, 1)
            if bounds[at].max() < least:
                break
            us, vs = cells[at]
            count = search_heading(self._levels, self._floors, us, vs, bounds[at], least, places)
            if count:
                best = max(best, int(places[:count, 0].max()))
            found += [(int(s), float(headings[at]), float(u), float(v)) for s, u, v in places[:count]]
        return self._distinct([place for place in found if place[0] >= best - margin], len(points))

    def _cells(self, points: FloatArray, heading: float) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of the points round a robot in the middle of cell (0, 0)."""
        cos, sin = math.cos(heading), math.sin(heading)
        us = np.floor((cos * points[:, 0] - sin * points[:, 1]) / self._cell + 0.5)
        vs = np.floor((sin * points[:, 0] + cos * points[:, 1]) / self._cell + 0.5)
        return us.astype(np.int32), vs.astype(np.int32)

    def _distinct(self, found: list[tuple[int, float, float, float]], num_points: int) -> list[Place]:
        """The best of neighbouring places, at most as many as the settings say."""
        kept: list[Place] = []
        poses = np.zeros((0, 3))
        for score, heading, u, v in sorted(found, reverse=True):
            x = self._field.origin_x + (u + 0.5) * self._cell
            y = self._field.origin_y + (v + 0.5) * self._cell
            near = np.hypot(poses[:, 0] - x, poses[:, 1] - y) < APART
            if (near & (np.abs(wrap_angle(poses[:, 2] - heading)) < APART_TURN)).any():
                continue
            kept.append(Place(np.array([x, y, wrap_angle(heading)]), score / (HIT * num_points)))
            poses = np.vstack([poses, kept[-1].pose])
            if len(kept) == self._config.most_hypotheses:
                break
        return kept
