"""The likelihood field of a map, and what it says of a scan at a pose: numba kernels.

Convention: grids of this module have row 0 at the bottom, as in :mod:`slamgym.slam.hit_count_kernels`.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.jit import kernel
from slamgym.core.types import FREE, OCCUPIED, ByteArray, Float32Array, FloatArray, OccupancyGrid
from slamgym.slam.hit_count_kernels import BeamTable

WALL, FLOOR, UNMAPPED = 0, 1, 2
Z_HIT, Z_RAND, Z_MAX = 0.75, 0.2, 0.05
"""Shares of beams that end at what is mapped, that end anywhere (people, moved furniture), and that a mapped surface
doesn't return (AMCL's ``laser_z_hit``, ``laser_z_rand``, ``laser_z_max``)."""
FIT_DISTANCE = 0.2
"""An end point that lies so near to a surface is explained [m]."""
IN_A_WALL = 5.0
"""Cost of a particle in a wall, in log-likelihood."""
NEUTRAL = -0.3
"""Log-likelihood of an end point that lies open in what the map doesn't know: about that of one that fits."""
LEAST_KNOWN = 0.2
"""If fewer of the beams end where the map is known, nothing can be said of the fit."""
TRACE_MARGIN = 0.3
"""A ray is followed up to so far before its end: surfaces there are the one that it met [m]."""
TRACE_SHARE = 0.9
"""A beam without return is followed over this share of the usable range."""


class LikelihoodField(NamedTuple):
    """A map as the sensor model sees it."""

    log_likelihood: Float32Array  # (rows, cols) of an end point there; 0 on a surface
    distance: Float32Array  # (rows, cols) from the cell's centre to the nearest surface's [m]
    floor: ByteArray  # (rows, cols) 1 where the map is free, 2 where it is unknown, 0 at walls
    origin_x: float  # lower left corner [m]
    origin_y: float  # [m]
    cell: float  # size of a cell [m]
    miss: float  # log-likelihood of an end point far from all surfaces
    no_return: float  # log-likelihood of no return where a surface is mapped


def make_field(grid: OccupancyGrid, sigma_hit: float, longest: float) -> LikelihoodField:
    """Compute the field of a map.

    A surface is an occupied cell next to a free one: what lies deeper in a wall is never seen.

    Args:
        grid: The map.
        sigma_hit: Spread of end points round surfaces [m].
        longest: Longest usable range, over which random readings are spread [m].

    Raises:
        SlamgymError: If the map has no floor or no wall.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    cells = grid.cells[::-1]
    floor = cells == FREE
    surface = (cells == OCCUPIED) & binary_dilation(floor, np.ones((3, 3), dtype=bool))
    if not floor.any() or not surface.any():
        lacking = "free floor" if not floor.any() else "wall beside free floor"
        raise SlamgymError(f"the map has no {lacking}: nothing can be localised on it; check its thresholds")
    distance = distance_transform_edt(~surface) * grid.frame.resolution
    density = Z_HIT / (math.sqrt(2.0 * math.pi) * sigma_hit)
    random = Z_RAND / longest
    likelihood = density * np.exp(-0.5 * np.square(distance / sigma_hit)) + random
    return LikelihoodField(
        log_likelihood=np.log(likelihood / (density + random)).astype(np.float32),
        distance=distance.astype(np.float32),
        floor=np.where(floor, FLOOR, np.where(cells == OCCUPIED, WALL, UNMAPPED)).astype(np.uint8),
        origin_x=float(grid.frame.origin_x),
        origin_y=float(grid.frame.origin_y),
        cell=float(grid.frame.resolution),
        miss=math.log(random / (density + random)),
        no_return=math.log(Z_MAX),
    )


@kernel
def _cell_at(field: LikelihoodField, x: float, y: float) -> tuple[int, int]:
    """Row and column of the cell at a point; (-1, -1) outside the map."""
    col = math.floor((x - field.origin_x) / field.cell)
    row = math.floor((y - field.origin_y) / field.cell)
    rows, cols = field.floor.shape
    return (row, col) if 0 <= row < rows and 0 <= col < cols else (-1, -1)


@kernel
def kind_of_cell(field: LikelihoodField, x: float, y: float) -> int:
    """The map at a point: ``WALL``, ``FLOOR`` or ``UNMAPPED``."""
    row, col = _cell_at(field, x, y)
    return int(field.floor[row, col]) if row >= 0 else UNMAPPED


@kernel
def point_log_likelihood(field: LikelihoodField, x: float, y: float) -> float:
    """Log-likelihood of an end point, bilinear between the centres of the cells."""
    u = (x - field.origin_x) / field.cell - 0.5
    v = (y - field.origin_y) / field.cell - 0.5
    col, row = math.floor(u), math.floor(v)
    grid = field.log_likelihood
    if row < 0 or col < 0 or row + 1 >= grid.shape[0] or col + 1 >= grid.shape[1]:
        return field.miss
    right, up = u - col, v - row
    low = grid[row, col] * (1.0 - right) + grid[row, col + 1] * right
    high = grid[row + 1, col] * (1.0 - right) + grid[row + 1, col + 1] * right
    return low * (1.0 - up) + high * up


@kernel
def weigh_poses(field: LikelihoodField, poses: FloatArray, points: FloatArray, out: FloatArray) -> None:
    """Log-likelihood of a scan at each pose, summed over its points.

    Args:
        field: The map.
        poses: (n, 3) robot poses [m, m, rad].
        points: (k, 2) end points in the robot frame [m].
        out: (n,) receives the sums.
    """
    for p in range(len(poses)):
        cos, sin = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        total = 0.0
        for i in range(len(points)):
            x = poses[p, 0] + cos * points[i, 0] - sin * points[i, 1]
            y = poses[p, 1] + sin * points[i, 0] + cos * points[i, 1]
            total += point_log_likelihood(field, x, y)
        out[p] = total


@kernel
def wall_cost(field: LikelihoodField, poses: FloatArray) -> FloatArray:
    """Cost that each pose (n, 3) pays for standing in a wall, (n,)."""
    cost = np.zeros(len(poses))
    for p in range(len(poses)):
        if kind_of_cell(field, poses[p, 0], poses[p, 1]) == WALL:
            cost[p] = IN_A_WALL
    return cost


@kernel
def _is_clear(field: LikelihoodField, x: float, y: float, across: float, up: float, length: float) -> bool:
    """Return True if a ray meets no surface for so long [m]; each step is as long as nothing is near."""
    driven = 0.0
    while driven < length:
        row, col = _cell_at(field, x + driven * across, y + driven * up)
        if row < 0:
            return True
        away = field.distance[row, col]
        if away < 0.5 * field.cell:
            return False
        driven += max(away - field.cell, 0.5 * field.cell)
    return True


@kernel
def explain_scan(
    field: LikelihoodField, pose: FloatArray, ranges: Float32Array, beams: BeamTable, step: int, excuses: bool
) -> tuple[float, float]:
    """Measure how much of a scan a map explains from a pose.

    Args:
        field: The map.
        pose: (3,) the robot [m, m, rad].
        ranges: (num_beams,) [m].
        beams: The scanner.
        step: Every so many beams are looked at.
        excuses: True if what lies where the map knows nothing speaks neither for nor against the pose.

    Returns:
        Share of the beams that end near a surface with none in between, of those that return, or should, where the map
        is known; negative if too few of them end there. And what must be added to the log-likelihood of the end points,
        because rays went through surfaces, or ended in the open where the map knows nothing.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x0 = pose[0] + cos * beams.mount[0] - sin * beams.mount[1]
    y0 = pose[1] + sin * beams.mount[0] + cos * beams.mount[1]
    returned, explained, unknown, correction = 0, 0, 0, 0.0
    for i in range(0, len(ranges), step):
        r = ranges[i]
        across = cos * beams.directions[i, 0] - sin * beams.directions[i, 1]
        up = sin * beams.directions[i, 0] + cos * beams.directions[i, 1]
        if r > beams.usable or r >= beams.range_max:
            open_space = TRACE_SHARE * beams.usable
            if beams.no_return_clears and not _is_clear(field, x0, y0, across, up, open_space):
                correction += field.no_return
                returned += 1  # something should have returned it
            continue
        if not r >= beams.range_min:
            continue
        returned += 1
        x, y = x0 + r * across, y0 + r * up
        if not _is_clear(field, x0, y0, across, up, r - TRACE_MARGIN):
            correction += field.miss - point_log_likelihood(field, x, y)
            continue
        row, col = _cell_at(field, x, y)
        if row >= 0 and field.distance[row, col] <= FIT_DISTANCE:
            explained += 1
        elif excuses and kind_of_cell(field, x, y) == UNMAPPED:
            unknown += 1
            correction += NEUTRAL - point_log_likelihood(field, x, y)
    known = returned - unknown
    return (explained / known if known > LEAST_KNOWN * returned else -1.0), correction
