"""Kernel that cuts the robot's surroundings out of its map."""

import math

from slamgym.core.jit import kernel
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def cut_crop(
    cells: ByteArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    x: float,
    y: float,
    theta: float,
    crop_resolution: float,
    samples: int,
    out: ByteArray,
) -> None:
    """Read a map on a grid that stands on the robot and looks where it looks.

    Each cell of the crop is read at ``samples`` x ``samples`` points; occupied wins over free and free over
    unknown.

    Convention: ``cells`` has row 0 at the top, its origin is the lower left corner; ``x, y, theta`` is the
    robot in the frame of the cells. In the crop the robot is in the middle, ahead is up, its left is left.

    Args:
        cells: The map, shape (H, W).
        origin_x: Of the map [m].
        origin_y: Of the map [m].
        resolution: Cell size of the map [m].
        x: The robot [m].
        y: The robot [m].
        theta: Its heading [rad].
        crop_resolution: Cell size of the crop [m].
        samples: Points per side of a crop cell.
        out: Receives the crop, shape (h, w).
    """
    rows, cols = cells.shape
    flat = cells.reshape(-1)
    height, width = out.shape
    # Positions in the map in 1 / 2^32 of a cell. From sample to sample: (sin, cos) to the right in the crop,
    # (-cos, sin) down.
    step = crop_resolution / (samples * resolution) * _ONE
    cos, sin = round(step * math.cos(theta)), round(step * math.sin(theta))
    ahead, left = height * samples - 1, width * samples - 1
    first_col = round((x - origin_x) / resolution * _ONE) + (ahead * cos - left * sin) // 2
    first_row = round((rows - (y - origin_y) / resolution) * _ONE) - (ahead * sin + left * cos) // 2
    for i in range(height):
        for j in range(width):
            value = UNKNOWN
            for a in range(i * samples, (i + 1) * samples):
                col = first_col - a * cos + j * samples * sin
                row = first_row + a * sin + j * samples * cos
                for _ in range(samples):
                    r, c = row >> _FRACTION, col >> _FRACTION
                    if 0 <= r < rows and 0 <= c < cols:
                        cell = flat[r * cols + c]
                        if cell == OCCUPIED:
                            value = OCCUPIED
                        elif cell == FREE and value == UNKNOWN:
                            value = FREE
                    col += sin
                    row += cos
            out[i, j] = value
