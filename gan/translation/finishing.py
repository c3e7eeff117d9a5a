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
        shift = np.array(
            [[1.0, 0.0, depth_px * math.cos(angle)], [0.0, 1.0, depth_px * math.sin(angle)]]
        )
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
    from scipy.ndimage import (
        distance_transform_edt,
    )  # a quarter of a second of every command that translates

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
    changed = True
    while changed:
        changed = False
        for first in (True, False):
            # Clockwise from above: P2 to P9.
            ring = np.stack(
                [
                    np.roll(picture, shift, (0, 1))[1:-1, 1:-1]
                    for shift in (
                        (1, 0),
                        (1, -1),
                        (0, -1),
                        (-1, -1),
                        (-1, 0),
                        (-1, 1),
                        (0, 1),
                        (1, 1),
                    )
                ]
            )
            count = ring.sum(axis=0)
            rises = (~ring & np.roll(ring, -1, axis=0)).sum(axis=0)
            up, right, down, left = ring[0], ring[2], ring[4], ring[6]
            ends = (
                ~(up & right & down) & ~(right & down & left)
                if first
                else ~(up & right & left) & ~(up & down & left)
            )
            inner = picture[1:-1, 1:-1]
            goes = inner & (count >= 2) & (count <= 6) & (rises == 1) & ends
            inner[goes] = False
            changed = changed or bool(goes.any())
    return picture[1:-1, 1:-1]
