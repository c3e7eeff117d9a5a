"""Drawing scans into counts of hits and visits, and reading a map from them: numba kernels.

Convention: grids of this module have row 0 at the bottom (smallest y), so that row and y grow together; only
what leaves the package (:class:`slamgym.core.types.OccupancyGrid`) has row 0 at the top.
"""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array, FloatArray

_FRACTION = 32
_HALF = 1 << (_FRACTION - 1)


@kernel
def drawn_length(
    ranges: Float32Array, i: int, range_min: float, range_max: float, usable: float, no_return_clears: bool
) -> float:
    """How far beam ``i`` of a scan is drawn [m]; 0 for a beam that is left out, and at most ``usable``.

    A beam that returned from within ``usable`` is a hit. A longer one is cut and clears only; so does a beam
    without return (``+inf``) if ``no_return_clears`` and the beams beside it reach beyond ``usable`` as well:
    a lone one among hits is a failed measurement and would clear a spike through the wall. nan, ``-inf`` and
    ranges below ``range_min`` are left out.
    """
    r = ranges[i]
    if r >= range_max:
        if not no_return_clears:
            return 0.0
        if (i > 0 and ranges[i - 1] <= usable) or (i + 1 < len(ranges) and ranges[i + 1] <= usable):
            return 0.0
        return min(usable, range_max)
    if not r >= range_min:
        return 0.0
    return min(r, usable)


@kernel
def scan_bounds(
    poses: FloatArray,
    ranges: Float32Array,
    directions: FloatArray,
    mount: FloatArray,
    range_min: float,
    range_max: float,
    usable: float,
    no_return_clears: bool,
    bounds: FloatArray,
) -> None:
    """Stretch ``bounds`` (min x, min y, max x, max y) [m] over all that :func:`draw_scans` draws."""
    for k in range(len(poses)):
        cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        x0 = poses[k, 0] + cos * mount[0] - sin * mount[1]
        y0 = poses[k, 1] + sin * mount[0] + cos * mount[1]
        bounds[0], bounds[2] = min(bounds[0], x0), max(bounds[2], x0)
        bounds[1], bounds[3] = min(bounds[1], y0), max(bounds[3], y0)
        for i in range(ranges.shape[1]):
            length = drawn_length(ranges[k], i, range_min, range_max, usable, no_return_clears)
            x = x0 + length * (cos * directions[i, 0] - sin * directions[i, 1])
            y = y0 + length * (sin * directions[i, 0] + cos * directions[i, 1])
            bounds[0], bounds[2] = min(bounds[0], x), max(bounds[2], x)
            bounds[1], bounds[3] = min(bounds[1], y), max(bounds[3], y)


@kernel
def draw_scans(
    counts: np.ndarray,
    corner_col: int,
    corner_row: int,
    resolution: float,
    poses: FloatArray,
    ranges: Float32Array,
    directions: FloatArray,
    mount: FloatArray,
    range_min: float,
    range_max: float,
    usable: float,
    no_return_clears: bool,
    sign: int,
) -> None:
    """Draw scans into the counts, or take them out again.

    Each beam visits the cells from the sensor to its end (Bresenham's line, in fixed point) and hits the last
    one, as GMapping's ``registerScan`` does.

    Args:
        counts: (rows, cols, 2) int32 hits and visits, must cover the scans (:func:`scan_bounds`).
        corner_col: Column of the lattice that column 0 of ``counts`` is.
        corner_row: Row of the lattice that row 0 is.
        resolution: Cell size [m].
        poses: (scans, 3) robot poses [m, m, rad].
        ranges: (scans, num_beams) [m].
        directions: (num_beams, 2) unit vectors of the beams in the robot frame.
        mount: (2,) sensor position in the robot frame [m].
        range_min: Shorter ranges are left out [m].
        range_max: A range of this or more is no return [m].
        usable: Longest ray drawn [m].
        no_return_clears: Whether beams without return clear.
        sign: 1 draws, -1 takes out.
    """
    cols = counts.shape[1]
    flat = counts.reshape(-1, 2)
    scale = 1.0 / resolution
    for k in range(len(poses)):
        cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        x0 = poses[k, 0] + cos * mount[0] - sin * mount[1]
        y0 = poses[k, 1] + sin * mount[0] + cos * mount[1]
        start_col = math.floor(x0 * scale) - corner_col
        start_row = math.floor(y0 * scale) - corner_row
        start = start_row * cols + start_col
        for i in range(ranges.shape[1]):
            r = ranges[k, i]
            length = drawn_length(ranges[k], i, range_min, range_max, usable, no_return_clears)
            if length == 0.0:
                continue
            x = x0 + length * (cos * directions[i, 0] - sin * directions[i, 1])
            y = y0 + length * (sin * directions[i, 0] + cos * directions[i, 1])
            d_col = math.floor(x * scale) - corner_col - start_col
            d_row = math.floor(y * scale) - corner_row - start_row
            major_stride = 1 if d_col >= 0 else -1
            minor_stride = cols if d_row >= 0 else -cols
            major, minor = abs(d_col), abs(d_row)
            if minor > major:
                major, minor = minor, major
                major_stride, minor_stride = minor_stride, major_stride
            slope = (minor << _FRACTION) // max(major, 1)
            offset, cell = _HALF, start
            for _ in range(major):
                flat[cell + (offset >> _FRACTION) * minor_stride, 1] += sign
                cell += major_stride
                offset += slope
            if r <= usable and r < range_max:
                end = start + d_row * cols + d_col
                flat[end, 0] += sign
                flat[end, 1] += sign


@kernel
def classify(counts: np.ndarray, threshold: float, out: ByteArray) -> None:
    """Cell values from counts: occupied where hits / visits > ``threshold``, unknown where never visited."""
    for row in range(counts.shape[0]):
        for col in range(counts.shape[1]):
            hits, visits = counts[row, col, 0], counts[row, col, 1]
            value = OCCUPIED if hits > threshold * visits else FREE
            out[row, col] = value if visits > 0 else UNKNOWN


@kernel
def coarsen(
    cells: ByteArray,
    corner_x: float,
    corner_y: float,
    resolution: float,
    origin_x: float,
    origin_y: float,
    out_resolution: float,
    out: ByteArray,
) -> None:
    """Read the map on another grid: of the cells that overlap a coarse one occupied wins, then free.

    Args:
        cells: (rows, cols) values, row 0 at the bottom.
        corner_x: Lower left corner of ``cells`` [m].
        corner_y: Lower left corner of ``cells`` [m].
        resolution: Size of its cells [m].
        origin_x: Lower left corner of ``out`` [m].
        origin_y: Lower left corner of ``out`` [m].
        out_resolution: Size of its cells [m].
        out: (rows, cols) receives the values, row 0 at the top.
    """
    rows, cols = out.shape
    slack = 1e-6  # a border that coincides up to rounding overlaps nothing
    ratio = out_resolution / resolution
    for row in range(rows):
        bottom = (origin_y - corner_y) / resolution + (rows - 1 - row) * ratio
        first_row = max(math.floor(bottom + slack), 0)
        last_row = min(math.ceil(bottom + ratio - slack), cells.shape[0])
        for col in range(cols):
            left = (origin_x - corner_x) / resolution + col * ratio
            first_col = max(math.floor(left + slack), 0)
            last_col = min(math.ceil(left + ratio - slack), cells.shape[1])
            value = UNKNOWN
            for r in range(first_row, last_row):
                for c in range(first_col, last_col):
                    if cells[r, c] == OCCUPIED:
                        value = OCCUPIED
                    elif cells[r, c] == FREE and value == UNKNOWN:
                        value = FREE
            out[row, col] = value
