"""Kernels of sight: what lies along the rays from a cell until an obstacle ends them."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import ByteArray, FloatArray

_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


@kernel
def visible_unknown(costs: ByteArray, row: int, col: int, max_range: float) -> float:
    """Unknown area in sight of a cell, by 72 rays that end at lethal cells [cells^2].

    Its rays run clockwise and are added up in this order, on which the last bit of the sum depends.
    """
    step = 2.0 * np.pi / 72
    area = 0.0
    for i in range(72):
        area = _add_unknown(costs, row, col, np.sin(i * step), np.cos(i * step), max_range, step, area)
    return area


@kernel
def unknown_by_ray(costs: ByteArray, row: int, col: int, max_range: float) -> FloatArray:
    """Unknown area in sight of a cell in each direction, shape (72,) [cells^2].

    Ray i points i * 5 degrees counter-clockwise from +x.
    """
    step = 2.0 * np.pi / 72
    areas = np.zeros(72)
    for i in range(72):
        areas[i] = _add_unknown(costs, row, col, -np.sin(i * step), np.cos(i * step), max_range, step, 0.0)
    return areas


@kernel
def _add_unknown(
    costs: ByteArray, row: int, col: int, dr: float, dc: float, max_range: float, step: float, area: float
) -> float:
    """An area with the unknown along a ray added to it [cells^2].

    The ray stands for its sector, so a cell at distance r counts r times the angle between two rays. It ends at
    a lethal cell; beyond the costmap all is unknown.
    """
    height, width = costs.shape
    for r in range(1, int(max_range) + 1):
        rr, cc = int(np.floor(row + r * dr + 0.5)), int(np.floor(col + r * dc + 0.5))
        cost = _NO_INFORMATION
        if 0 <= rr < height and 0 <= cc < width:
            cost = costs[rr, cc]
        if cost == _LETHAL:
            break
        if cost == _NO_INFORMATION:
            area += r * step
    return area
