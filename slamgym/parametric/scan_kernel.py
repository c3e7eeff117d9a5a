"""Kernel: draw scans into counts of hits and visits, as a grid mapper publishes them."""

import math

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, Int32Array


@kernel
def draw_scans(
    sensors: FloatArray,
    ranges: FloatArray,
    bearings: FloatArray,
    range_min: float,
    range_max: float,
    usable: float,
    hits: Int32Array,
    visits: Int32Array,
) -> None:
    """Visit the cells along each beam (Bresenham's line) and hit the last one.

    A range within ``usable`` is a hit. A longer one, or none, is cut there and only clears; a beam without
    return beside one that hit is left out as a failed measurement.

    Convention: everything is in cells: sensors are (col, row, heading) with continuous coordinates, rows
    growing downwards, heading and bearings counter-clockwise. Beams that leave the grid are drawn as far as
    it goes.

    Args:
        sensors: (T, 3).
        ranges: (T, B) [cells], ``inf`` for no return.
        bearings: (T, B) in the sensor frame [rad].
        range_min: Shorter ranges are left out [cells].
        range_max: A range of this or more is no return [cells].
        usable: Longest ray drawn [cells].
        hits: (H, W) out, added to.
        visits: (H, W) out, added to.
    """
    height, width = hits.shape
    for k in range(ranges.shape[0]):
        col0, row0 = math.floor(sensors[k, 0]), math.floor(sensors[k, 1])
        for b in range(ranges.shape[1]):
            r = ranges[k, b]
            if not r >= range_min:
                continue
            if r >= range_max and (
                (b > 0 and ranges[k, b - 1] <= usable)
                or (b + 1 < ranges.shape[1] and ranges[k, b + 1] <= usable)
            ):
                continue
            is_hit = r <= usable and r < range_max
            length = min(r, usable)
            direction = sensors[k, 2] + bearings[k, b]
            d_col = math.floor(sensors[k, 0] + length * math.cos(direction)) - col0
            d_row = math.floor(sensors[k, 1] - length * math.sin(direction)) - row0
            steps = max(abs(d_col), abs(d_row))
            for i in range(steps + (1 if is_hit else 0)):
                share = i / steps if steps > 0 else 0.0
                col = col0 + math.floor(d_col * share + 0.5)
                row = row0 + math.floor(d_row * share + 0.5)
                if not (0 <= row < height and 0 <= col < width):
                    continue
                visits[row, col] += 1
                if i == steps:
                    hits[row, col] += 1
