"""From a SLAM map to the free space of a CAD map without learning.

What a careful user would put together from an image processing library: drop what no wall can be (rays through
windows, specks of furniture and noise), close the gaps of walls, and keep the space that the robot could drive in.
A median filter is not among the steps, since it erases walls one pixel thick; nor is turning the map to its dominant
wall direction, which only the straightening of outlines would need, and straightening made the maps worse
(docs/notes/translators.md).
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, BoolArray, ByteArray

NARROWEST_FLOOR = 0.25
"""Free space narrower than this is a ray that left through a window or between two walls [m]."""
LARGEST_FURNITURE = 0.6
"""Things in a room of at most this length and width are furniture, people or noise, not walls [m]."""
WIDEST_WALL_GAP = 0.2
"""Gaps in a wall narrower than this are closed [m]."""
SMALLEST_SPACE = 1.0
"""Separate free space smaller than this is dropped [m2]."""


def clean_map(slam: ByteArray, metres_per_px: float) -> BoolArray:
    """Free space as an architect might have drawn it.

    Args:
        slam: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free.
        metres_per_px: Scale [m].

    Returns:
        Free cells, shape (H, W), in the frame of ``slam``.
    """
    furniture_px = LARGEST_FURNITURE / metres_per_px
    free = fill_furniture(slam == FREE, furniture_px)
    not_free = ~free
    walls = not_free.astype(np.uint8)
    gap = disc(WIDEST_WALL_GAP / metres_per_px)
    walls = cv2.morphologyEx(walls, cv2.MORPH_CLOSE, gap)
    floor = disc(NARROWEST_FLOOR / metres_per_px)
    opened = cv2.morphologyEx(1 - walls, cv2.MORPH_OPEN, floor)
    smallest_px = SMALLEST_SPACE / metres_per_px**2
    return without_small(opened > 0, smallest_px)


def fill_furniture(free: BoolArray, size_px: float) -> BoolArray:
    """Fill holes in the free space that fit into a square of this side [px]."""
    others = ~free
    image = others.astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    width = stats[:, cv2.CC_STAT_WIDTH]
    height = stats[:, cv2.CC_STAT_HEIGHT]
    side = np.maximum(width, height)
    small = side <= size_px
    small[0] = False  # the background of the labelling: the free space itself
    return free | small[labels]


def without_small(free: BoolArray, min_px: float) -> BoolArray:
    """Drop separate parts of less than ``min_px`` cells."""
    image = free.astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    large = area >= min_px
    large[0] = False
    return large[labels]


def odd(diameter_px: float) -> int:
    """The nearest odd number, 1 at least."""
    half = round((diameter_px - 1.0) / 2.0)
    return max(1, 2 * half + 1)


def disc(diameter_px: float) -> np.ndarray:
    """A structuring element of the nearest odd diameter, 1 px at least."""
    side = odd(diameter_px)
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(element)
