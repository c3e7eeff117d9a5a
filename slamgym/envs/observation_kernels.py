"""Kernel that cuts the robot's surroundings out of its map."""

import math

from slamgym.jit import kernel
from slamgym.types import FREE, OCCUPIED, UNKNOWN, ByteArray


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
    height, width = out.shape
    # From samples to cells of the map: one step to the right in the crop, one step down.
    step = crop_resolution / (samples * resolution)
    cos, sin = step * math.cos(theta), step * math.sin(theta)
    ahead, left = 0.5 * (height * samples - 1), 0.5 * (width * samples - 1)
    first_col = (x - origin_x) / resolution + ahead * cos - left * sin
    first_row = rows - (y - origin_y) / resolution - ahead * sin - left * cos
    for i in range(height):
        for j in range(width):
            value = UNKNOWN
            for a in range(i * samples, (i + 1) * samples):
                for b in range(j * samples, (j + 1) * samples):
                    col = math.floor(first_col - a * cos + b * sin)
                    row = math.floor(first_row + a * sin + b * cos)
                    if 0 <= row < rows and 0 <= col < cols:
                        cell = cells[row, col]
                        if cell == OCCUPIED:
                            value = OCCUPIED
                        elif cell == FREE and value == UNKNOWN:
                            value = FREE
            out[i, j] = value
