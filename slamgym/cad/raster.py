"""Filling polygons on a grid, exactly: a cell belongs to a polygon if its centre does.

``cv2.fillPoly`` would also paint every cell that the boundary touches, which makes walls thinner by half a
cell on either side; here a scanline per row of cell centres collects the crossings of all edges at once.
"""

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, ByteArray, FloatArray, GridFrame


def fill_segments(segments: FloatArray, frame: GridFrame) -> BoolArray:
    """The cells whose centres lie inside closed rings, by the even-odd rule.

    Convention: segments are given in the frame's coordinates; the result is ``[row, col]``, row 0 at the top.

    Args:
        segments: All edges of all rings (outlines and holes) in any order, shape (S, 4) x0, y0, x1, y1 [m].
        frame: The grid.

    Returns:
        Shape (height_px, width_px), true inside.
    """
    height, width = frame.shape
    # In units of cells, with the centres of the cells at whole numbers and rows counted from the bottom.
    x0, x1 = ((segments[:, i] - frame.origin_x) / frame.resolution - 0.5 for i in (0, 2))
    y0, y1 = ((segments[:, i] - frame.origin_y) / frame.resolution - 0.5 for i in (1, 3))
    # An edge owns the rows in [lower end, upper end): a vertex on a row counts once, a horizontal edge never.
    first = np.clip(np.ceil(np.minimum(y0, y1)), 0, height).astype(np.int64)
    stop = np.clip(np.ceil(np.maximum(y0, y1)), 0, height).astype(np.int64)
    count = stop - first
    edge = np.repeat(np.arange(len(segments)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    slope = (x1 - x0)[edge] / (y1 - y0)[edge]
    crossing = x0[edge] + (row - y0[edge]) * slope
    col = np.clip(np.ceil(crossing), 0, width).astype(np.int64)
    crossings = np.bincount((height - 1 - row) * (width + 1) + col, minlength=height * (width + 1))
    parity = (crossings.reshape(height, width + 1) & 1).astype(np.uint8)
    inside: BoolArray = np.bitwise_xor.accumulate(parity, axis=1)[:, :width].astype(np.bool_)
    return inside


def map_values(inside: BoolArray, resolution: float, outside: int, wall_thickness: float) -> ByteArray:
    """Give free cells 254, cells within ``wall_thickness`` [m] of them 0, and all others ``outside``."""
    import cv2

    cells: ByteArray = np.where(inside, FREE, OCCUPIED).astype(np.uint8)
    if outside != OCCUPIED:
        if inside.any():
            # From centre to centre; half a cell less is the distance to the free cell's border.
            distance = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            far = distance * resolution > wall_thickness + 0.5 * resolution
        else:
            far = np.ones_like(inside)
        cells[far] = outside
    return cells
