"""Which cells beams pass through."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray

_FRACTION = 32
_HALF = 1 << (_FRACTION - 1)


@kernel
def sweep(
    unseen: BoolArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    x: float,
    y: float,
    theta: float,
    directions: FloatArray,
    ranges: FloatArray,
    usable: float,
) -> int:
    """Mark the cells along each beam as seen.

    Convention: ``unseen`` has row 0 at the *bottom*, so that row and y grow together; ``x, y, theta`` is the
    pose of the sensor in the frame of the grid.

    Args:
        unseen: Cells still to be seen, shape (H, W); changed in place.
        origin_x: Lower left corner of the grid [m].
        origin_y: Lower left corner of the grid [m].
        resolution: Cell size [m].
        x: Sensor position [m].
        y: Sensor position [m].
        theta: Sensor heading [rad].
        directions: Unit vectors of the beams in the sensor frame, shape (num_beams, 2).
        ranges: True ranges, shape (num_beams,) [m]; inf where nothing was met.
        usable: Beams are followed no further than this [m].

    Returns:
        How many cells were seen for the first time.
    """
    height, width = unseen.shape
    flat = unseen.reshape(-1)
    cos, sin = math.cos(theta), math.sin(theta)
    scale = 1.0 / resolution
    start_col = math.floor((x - origin_x) * scale)
    start_row = math.floor((y - origin_y) * scale)
    if not (0 <= start_row < height and 0 <= start_col < width):
        return 0
    start = start_row * width + start_col
    fresh = 0
    for i in range(len(ranges)):
        length = min(ranges[i], usable)
        end_x = x + length * (cos * directions[i, 0] - sin * directions[i, 1])
        end_y = y + length * (sin * directions[i, 0] + cos * directions[i, 1])
        # Beams end at a wall or at the usable range; rounding may put the end a cell outside the grid.
        d_col = min(max(math.floor((end_x - origin_x) * scale), 0), width - 1) - start_col
        d_row = min(max(math.floor((end_y - origin_y) * scale), 0), height - 1) - start_row
        major_stride = 1 if d_col >= 0 else -1
        minor_stride = width if d_row >= 0 else -width
        major, minor = abs(d_col), abs(d_row)
        if minor > major:
            major, minor = minor, major
            major_stride, minor_stride = minor_stride, major_stride
        slope = (minor << _FRACTION) // max(major, 1)
        offset, along = _HALF, start
        for _ in range(major + 1):
            # An unsigned index isn't asked whether it counts from the end.
            cell = np.uint64(along + (offset >> _FRACTION) * minor_stride)
            if flat[cell]:
                flat[cell] = False
                fresh += 1
            along += major_stride
            offset += slope
    return fresh
