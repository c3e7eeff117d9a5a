"""A finished map as localisation sees it: surfaces to align with, and what the map says of each beam of a scan.

Convention: grids of this module have row 0 at the bottom, as in :mod:`slamgym.slam.hit_count_kernels`.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.jit import kernel
from slamgym.core.types import FREE, UNKNOWN, BoolArray, Float32Array, FloatArray, OccupancyGrid
from slamgym.slam.branch_and_bound import HIT, maxima
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.submaps import SUBMAP_CELL, known_submap, known_surfaces
from slamgym.slam.hit_count_kernels import BeamTable, laser_at

MISS_NATS = 0.25
"""Evidence against a pose of a beam that the map doesn't explain: AMCL's beam model, taken to the power of 0.06, as
neighbouring beams err together (Thrun et al. 2005, section 6.3.4). Chosen with :data:`MOST_MISSED`."""
MOST_MISSED = 8.0
"""So many beams count at one place, however long it is seen: a cupboard that was moved is one error, not one a scan.
Chosen with four homes and eight days in two more; see docs/localization.md for others."""
PLACE_CELL = 0.2
"""Size of such a place [m]."""
PLACES_ROUND = 20
"""So many places round the map count, too."""
FIT_DISTANCE = 0.2
"""An end point that lies so near to a surface is explained; its squared distance speaks against the pose, as a Gaussian
of 8 cm does [m]."""
LEAST_KNOWN = 0.2
"""If fewer of the beams end where the map is known, nothing can be said of the fit."""
SEARCH_SIGMA = 0.12
"""Spread of the score round surfaces: wider than a cell, so that no place falls between cells [m]."""
LEVELS = 5
"""The largest blocks of a search have sides of 16 cells."""
TRACE_MARGIN = 0.3
"""A ray with return is followed up to so far before its end, as surfaces there are the one that it met [m]."""
TRACE_SHARE = 0.9
"""A ray without return is followed over this share of the usable range."""


class SurfaceField(NamedTuple):
    """Distances to a map's surfaces."""

    distance: Float32Array  # (rows, cols) from the cell's centre to the nearest surface's [m]
    is_unknown: BoolArray  # (rows, cols)
    corner: FloatArray  # (2,) the lower left one [m]
    cell: float  # size of a cell [m]


class KnownMap:
    """A finished map.

    Raises:
        SlamgymError: If the map has no wall beside free floor.
    """

    def __init__(self, grid: OccupancyGrid) -> None:
        from scipy.ndimage import distance_transform_edt

        frame = grid.frame
        cells = grid.cells[::-1]
        corner = np.array([frame.origin_x, frame.origin_y])
        surfaces = known_surfaces(grid)
        points = surfaces.points
        if len(points) == 0:
            raise SlamgymError(
                "the map has no wall beside free floor: nothing can be localised on it; check its thresholds"
            )
        middle = np.array([*points.mean(axis=0), 0.0])
        submap = known_submap(surfaces, middle)
        self.surfaces = AlignmentTarget([submap], middle[None])
        """What scans are aligned with."""
        cols, rows = ((points - corner) / frame.resolution).astype(np.int64).T
        is_surface = np.zeros(cells.shape, dtype=bool)
        is_surface[rows, cols] = True
        cells_away = distance_transform_edt(~is_surface)
        distance = (cells_away * frame.resolution).astype(np.float32)
        self.field = SurfaceField(distance, cells == UNKNOWN, corner, float(frame.resolution))
        """What scans are explained by."""
        ratio = SUBMAP_CELL / frame.resolution
        middles = [np.arange(0.5 * ratio, size, ratio).astype(np.int64) for size in cells.shape]
        sampled = np.ix_(*middles)
        deviations = distance[sampled] / SEARCH_SIGMA
        score = HIT * np.exp(-0.5 * np.square(deviations))
        self.levels = maxima(np.rint(score).astype(np.uint8), LEVELS)
        """Maxima of the score of a point in cells (rows, cols) of ``SUBMAP_CELL`` from the same corner."""
        is_free = cells[sampled] == FREE
        self.floors = maxima(is_free.astype(np.uint8), LEVELS)
        """Maxima of where a robot may stand, in the same cells."""

    def no_misses(self) -> Float32Array:
        """Beams counted at each place of the map (rows, cols) before any scan."""
        extent = np.array(self.field.distance.shape) * self.field.cell
        rows, cols = np.ceil(extent / PLACE_CELL).astype(int) + 2 * PLACES_ROUND
        return np.zeros((rows, cols), np.float32)

    def are_beyond(self, points: FloatArray) -> BoolArray:
        """True (n,) for points (n, 2) [m] where the map knows nothing, away from its surfaces."""
        field = self.field
        cols, rows = np.floor((points - field.corner) / field.cell).astype(np.int64).T
        height, width = field.is_unknown.shape
        inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        at = rows[inside], cols[inside]
        beyond = ~inside
        beyond[inside] = field.is_unknown[at] & (field.distance[at] > FIT_DISTANCE)
        return beyond


@kernel
def _clear_length(
    field: SurfaceField, x: float, y: float, across: float, up: float, length: float
) -> float:
    """How far a ray meets no surface [m], infinite if none for so long; each step is as long as nothing is near."""
    driven = 0.0
    while driven < length:
        away, _ = _distance_at(field, x + driven * across, y + driven * up)
        if away < 0.5 * field.cell:
            return driven
        driven += max(away - field.cell, 0.5 * field.cell)
    return math.inf


@kernel
def _distance_at(field: SurfaceField, x: float, y: float) -> tuple[float, bool]:
    """Distance from a point to the nearest surface [m], infinite outside the map, and True if it is unknown there."""
    col = math.floor((x - field.corner[0]) / field.cell)
    row = math.floor((y - field.corner[1]) / field.cell)
    rows, cols = field.distance.shape
    if row < 0 or col < 0 or row >= rows or col >= cols:
        return math.inf, True
    distance = float(field.distance[row, col])
    is_unknown = bool(field.is_unknown[row, col])
    return distance, is_unknown


@kernel
def explain_scan(
    field: SurfaceField,
    pose: FloatArray,
    ranges: Float32Array,
    beams: BeamTable,
    step: int,
    excuses: bool,
    missed: Float32Array,
) -> tuple[float, float]:
    """Measure how well a map explains a scan from a pose.

    Args:
        field: The map.
        pose: (3,) the robot [m, m, rad].
        ranges: (num_beams,) [m].
        beams: The scanner.
        step: Every so many beams are looked at.
        excuses: True if what lies where the map knows nothing speaks neither for nor against the pose.
        missed: (rows, cols) beams counted before at each place, see :meth:`KnownMap.no_misses`; receives these.

    Returns:
        New evidence against the pose in nats. And the share of the beams that end near a surface with none in between,
        of those that return, or should, where the map is known; negative if too few of them end there.
    """
    field = SurfaceField(*field)
    beams = BeamTable(*beams)
    x0, y0, cos, sin = laser_at(pose, beams)
    explained = 0
    unexplained = 0
    unknown = 0
    news = 0.0
    for i in range(0, len(ranges), step):
        r = ranges[i]
        is_returned = r <= beams.usable and r < beams.range_max
        if not (r >= beams.range_min and (is_returned or beams.no_return_clears)):
            continue
        across = cos * beams.directions[i, 0] - sin * beams.directions[i, 1]
        up = sin * beams.directions[i, 0] + cos * beams.directions[i, 1]
        length = r - TRACE_MARGIN if is_returned else TRACE_SHARE * beams.usable
        clear = _clear_length(field, x0, y0, across, up, length)
        is_clear = clear == math.inf
        if is_clear and not is_returned:
            continue
        x = x0 + min(clear, r) * across
        y = y0 + min(clear, r) * up
        away, is_unknown = _distance_at(field, x, y)
        miss = 1.0
        if is_clear and away <= FIT_DISTANCE:
            explained += 1
            miss = (away / FIT_DISTANCE) ** 2
        elif is_clear and is_unknown and excuses:
            unknown += 1
            continue
        else:
            unexplained += 1
        news += _newly_missed(missed, field, x, y, miss)
    known = explained + unexplained
    if known > LEAST_KNOWN * (known + unknown):
        return MISS_NATS * news, explained / known
    return MISS_NATS * news, -1.0


@kernel
def _newly_missed(
    missed: Float32Array, field: SurfaceField, x: float, y: float, miss: float
) -> float:
    """Count a beam that misses, or part of one, at a point; returns how much of it counts."""
    rows, cols = missed.shape
    col = math.floor((x - field.corner[0]) / PLACE_CELL) + PLACES_ROUND
    row = math.floor((y - field.corner[1]) / PLACE_CELL) + PLACES_ROUND
    col = min(max(col, 0), cols - 1)
    row = min(max(row, 0), rows - 1)
    counted = min(miss, MOST_MISSED - missed[row, col])
    missed[row, col] += counted
    return float(counted)
