"""Kernels of the costmap: what part of a canvas is known, and what its cells cost."""

import numpy as np

from slamgym.jit import kernel
from slamgym.types import ByteArray, Float32Array

_OCCUPIED = np.uint8(0)
_FREE = np.uint8(254)
_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


@kernel
def known_window(cells: ByteArray) -> tuple[int, int, int, int]:
    """Bounding box (first row, end row, first col, end col) of the known cells; all 0 if there is none.

    Rows are read from both ends inwards, so that a large empty canvas costs one pass and its middle less.
    """
    height, width = cells.shape
    first_col, end_col = width, 0
    first_row, end_row = height, 0
    for row in range(height):
        for col in range(width):
            if cells[row, col] == _FREE or cells[row, col] == _OCCUPIED:
                first_col = min(first_col, col)
                first_row = min(first_row, row)
                end_row = row + 1
                break
        if end_row != row + 1:
            continue
        for col in range(width - 1, end_col - 1, -1):
            if cells[row, col] == _FREE or cells[row, col] == _OCCUPIED:
                end_col = col + 1
                break
    if end_row == 0:
        return 0, 0, 0, 0
    return first_row, end_row, first_col, end_col


@kernel
def clear_body(cells: ByteArray, row: int, col: int, radius_px: float, core_px: float) -> None:
    """Free the cells under the robot: unknown ones within ``radius_px``, all within ``core_px``."""
    reach = int(radius_px) + 1
    for r in range(max(0, row - reach), min(cells.shape[0], row + reach + 1)):
        for c in range(max(0, col - reach), min(cells.shape[1], col + reach + 1)):
            squared = (r - row) ** 2 + (c - col) ** 2
            unknown = cells[r, c] != _OCCUPIED and cells[r, c] != _FREE
            if squared <= core_px**2 or (unknown and squared <= radius_px**2):
                cells[r, c] = _FREE


@kernel
def cost_cells(cells: ByteArray, distance_px: Float32Array, table: ByteArray) -> ByteArray:
    """Costs, shape (H, W), from the distance to the nearest occupied cell.

    Args:
        cells: ROS map values, shape (H, W).
        distance_px: Distance between centres of a cell and the nearest occupied one, shape (H, W) [cells].
        table: Cost by squared distance [cells^2]; the last entry holds for all that is farther.
    """
    height, width = cells.shape
    costs = np.empty((height, width), np.uint8)
    limit = np.float32(len(table) - 1)
    for row in range(height):
        for col in range(width):
            if cells[row, col] == _OCCUPIED:
                costs[row, col] = _LETHAL
            elif cells[row, col] == _FREE:
                squared = distance_px[row, col] * distance_px[row, col] + np.float32(0.5)
                costs[row, col] = table[int(squared)] if squared < limit else table[-1]
            else:
                costs[row, col] = _NO_INFORMATION
    return costs
