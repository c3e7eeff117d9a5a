"""A baseline without learning: an oracle that games the mean squared error."""

import cv2
import numpy as np

from slamgym.core.types import BoolArray, ByteArray
from slamgym.metrics.cleaning import odd


def outline_only(cad: ByteArray, metres_per_px: float, thickest_wall: float = 0.5) -> BoolArray:
    """The CAD map with all its inner walls erased: an oracle that games the mean squared error.

    Args:
        cad: CAD map, shape (H, W): 0 walls and outside, 254 inside.
        metres_per_px: Scale [m].
        thickest_wall: Walls between rooms are at most so thick [m].

    Returns:
        Free cells, shape (H, W): everything inside of the building's outline.
    """
    radius = thickest_wall / metres_per_px
    # Wide enough that closing doesn't join the building to the image's border.
    border = int(np.ceil(radius)) + 2
    free = (cad > 127).astype(np.uint8)
    free = np.pad(free, border)
    side = odd(radius)
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (side, side))
    closed = cv2.morphologyEx(free, cv2.MORPH_CLOSE, square)
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(free)
    cv2.drawContours(filled, contours, -1, 1, cv2.FILLED)
    inside = filled[border:-border, border:-border]
    return inside > 0
