"""Kernel: which cells each scan of a trajectory sees (grid traversal after Amanatides and Woo 1987)."""

import math

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, Int32Array


@kernel
def observe_cells(
    occupied: BoolArray,
    sensors: FloatArray,
    angles: FloatArray,
    range_min_px: float,
    range_max_px: float,
    values: Float32Array,
    first: Int32Array,
    last: Int32Array,
    count: Int32Array,
    best: Int32Array,
    hits: Int32Array,
    sums: Float32Array,
) -> None:
    """Cast every beam of every scan and keep a record per cell.

    Convention: sensor poses are in cells: ``sensors[k] = (col, row, heading)`` with continuous coordinates
    (cell ``[i, j]`` covers col in [j, j + 1), row in [i, i + 1)), row growing downwards, heading
    counter-clockwise in the world as always.

    Args:
        occupied: (H, W); a beam ends in the first occupied cell after the sensor's own or at the edge of
            the grid.
        sensors: (T, 3).
        angles: (B,) beam directions in the sensor frame [rad].
        range_min_px: Walls nearer than this give no hit [cells].
        range_max_px: Reach of a beam [cells].
        values: (T, C) what each scan adds to ``sums`` of the cells it sees; C may be 0.
        first: (H, W) out, first scan that sees the cell; -1 before.
        last: (H, W) out, last scan that sees it; -1 before.
        count: (H, W) out, number of scans that see it.
        best: (H, W) out, scan that sees the wall cell from the smallest distance; -1 before.
        hits: (T, B) out, flat index of the wall cell each beam meets, -1 for none.
        sums: (H, W, C) out.
    """
    height, width = occupied.shape
    for k in range(sensors.shape[0]):
        x0, y0 = sensors[k, 0], sensors[k, 1]
        for b in range(angles.shape[0]):
            hits[k, b] = -1
            direction = sensors[k, 2] + angles[b]
            dx, dy = math.cos(direction), -math.sin(direction)
            col, row = math.floor(x0), math.floor(y0)
            step_col, step_row = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
            per_col = 1.0 / abs(dx) if dx != 0.0 else math.inf
            per_row = 1.0 / abs(dy) if dy != 0.0 else math.inf
            next_col = ((col + 1 - x0) if dx > 0.0 else (x0 - col)) * per_col if dx != 0.0 else math.inf
            next_row = ((row + 1 - y0) if dy > 0.0 else (y0 - row)) * per_row if dy != 0.0 else math.inf
            travelled = 0.0
            while travelled <= range_max_px and 0 <= row < height and 0 <= col < width:
                if last[row, col] != k:
                    last[row, col] = k
                    count[row, col] += 1
                    if first[row, col] < 0:
                        first[row, col] = k
                    for c in range(values.shape[1]):
                        sums[row, col, c] += values[k, c]
                if occupied[row, col] and travelled > 0.0:
                    if travelled >= range_min_px:
                        hits[k, b] = row * width + col
                        j = best[row, col]
                        if j < 0 or (
                            math.hypot(col + 0.5 - x0, row + 0.5 - y0)
                            < math.hypot(col + 0.5 - sensors[j, 0], row + 0.5 - sensors[j, 1])
                        ):
                            best[row, col] = k
                    break
                if next_col < next_row:
                    travelled = next_col
                    next_col += per_col
                    col += step_col
                else:
                    travelled = next_row
                    next_row += per_row
                    row += step_row
