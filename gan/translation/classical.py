"""Baselines without learning that game the mean squared error: an oracle, and thick walls."""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, ByteArray
from slamgym.metrics.cleaning import odd, without_small
from slamgym.metrics.maps import distance_to

LARGEST_WALL_GAP = 1.0
"""What separates two places of floor by more is no wall [m]."""
SPECK = 0.05
"""What isn't free and smaller is a speck, no wall [m2]."""


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


def thickened_walls(slam: ByteArray, growth_px: float) -> BoolArray:
    """The free space of a SLAM map whose walls were grown.

    Args:
        slam: (H, W): 0 occupied, 205 unknown, 254 free.
        growth_px: By how much to each side.
    """
    grown: BoolArray = (slam == FREE) & (distance_to(slam == OCCUPIED) > growth_px)
    return grown


def wall_growth(cad: ByteArray, slam: ByteArray, metres_per_px: float) -> float:
    """By how many pixels the walls of a SLAM map have to grow to each side to be as thick as those of the CAD map.

    0 if they are thicker already, or if no wall stands between two places of floor.

    Args:
        cad: CAD map, shape (H, W): 0 walls and outside, 254 inside.
        slam: SLAM map, same shape.
        metres_per_px: Scale [m].
    """
    longest = LARGEST_WALL_GAP / metres_per_px
    not_free = without_small(slam != FREE, SPECK / metres_per_px**2)
    true_thickness = _usual_gap(cad > 127, longest)
    thickness = _usual_gap(~not_free, longest)
    if np.isnan(true_thickness) or np.isnan(thickness):
        return 0.0
    return max(0.0, 0.5 * (true_thickness - thickness))


def _usual_gap(floor: BoolArray, longest: float) -> float:
    """Median of the gaps between floor, along rows and columns, that aren't longer than so many pixels; nan without."""
    found = []
    for mask in (floor, floor.T):
        rows, cols = np.nonzero(mask)  # row by row
        gaps = np.diff(cols) - 1
        in_one_row = np.diff(rows) == 0
        found.append(gaps[in_one_row & (gaps > 0) & (gaps <= longest)])
    lengths = np.concatenate(found)
    return float(np.median(lengths)) if len(lengths) else np.nan
