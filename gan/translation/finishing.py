"""The last steps of a translation: lines along faces where the truth has them, and walls that are one cell thin."""

import math

import cv2
import numpy as np

from slamgym.core.types import OCCUPIED, BoolArray, ByteArray, Float32Array

DIRECTIONS = 16
"""Number of directions in which a disc's rim is sampled."""


def shrunk_floor(free: Float32Array, depth_px: float) -> Float32Array:
    """Draw a line along every face, so deep on the floor: what images with such lines show of a true drawing.

    Args:
        free: Probability or share of floor, shape (H, W).
        depth_px: How deep [cells]; 0 keeps the image as it is.
    """
    shrunk = free
    for number in range(DIRECTIONS if depth_px > 0.0 else 0):
        angle = 2.0 * math.pi * number / DIRECTIONS
        right = depth_px * math.cos(angle)
        down = depth_px * math.sin(angle)
        shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
        moved = cv2.warpAffine(free, shift, free.shape[::-1], flags=cv2.INTER_LINEAR)
        shrunk = np.minimum(shrunk, moved)
    return np.asarray(shrunk, dtype=np.float32)


def thinned_walls(cells: ByteArray) -> ByteArray:
    """Leave one cell of every wall; what it covered becomes what lies next to it.

    Args:
        cells: SLAM map (H, W): 0 occupied, 205 unknown, 254 free.

    Returns:
        The same with walls one cell thick.
    """
    # Imported here: it takes a quarter of a second of every command that translates.
    from scipy.ndimage import distance_transform_edt

    occupied = cells == OCCUPIED
    if not occupied.any() or occupied.all():
        return cells
    rows, cols = distance_transform_edt(occupied, return_distances=False, return_indices=True)
    thinned = cells[rows, cols]
    thinned[_skeleton(occupied)] = OCCUPIED
    return thinned


def _skeleton(mask: BoolArray) -> BoolArray:
    """Zhang and Suen, *A Fast Parallel Algorithm for Thinning Digital Patterns*, CACM 27(3), 1984."""
    picture = np.pad(mask, 1)
    inner = picture[1:-1, 1:-1]
    changed = True
    while changed:
        changed = False
        for is_first in (True, False):
            goes = inner & _removable(picture, is_first)
            inner[goes] = False
            changed = changed or bool(goes.any())
    return inner


def _removable(picture: BoolArray, is_first: bool) -> BoolArray:
    """Where a cell may go, by its eight neighbours, in the first or second half of a pass; without the border."""
    # Clockwise from above: P2 to P9.
    shifts = ((1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1))
    ring = np.stack([np.roll(picture, shift, (0, 1))[1:-1, 1:-1] for shift in shifts])
    following = np.roll(ring, -1, axis=0)
    count = ring.sum(axis=0)
    rises = (~ring & following).sum(axis=0)
    up, right, down, left = ring[::2]
    kept_at_first = right & down & (up | left)
    kept_then = up & left & (right | down)
    kept = kept_at_first if is_first else kept_then
    is_border = (count >= 2) & (count <= 6) & (rises == 1)
    removable: BoolArray = is_border & ~kept
    return removable
