"""Which part of a building a SLAM map is evidence of: what the robot saw free, and what lies close around it.

A real robot's map leaves half of the building unknown. A network whose targets show the whole building learns to
invent rooms there, so targets end, and translations are cut off, at the border of what was explored.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, BoolArray, ByteArray, Float32Array
from slamgym.metrics.cleaning import without_small

WIDEST_GAP = 2.0
"""Unseen places between free cells at most so far apart count as explored [m]: under a bed, behind a wardrobe."""
RAY_WIDTH = 0.15
"""Free space narrower than this is a ray that left through a window: it was seen, but nothing follows from it [m]."""
SMALLEST_FREE = 0.1
"""Separate free space smaller than this is noise, no evidence [m2]."""
USUAL_SCALE = 0.06
"""Of a map that comes without one [m/px]: the middle of rendered homes."""


def explored_floor(slam: ByteArray, metres_per_px: float, margin: float) -> BoolArray:
    """Where a robot's map is evidence enough to predict floor.

    The free cells, with gaps closed up to a width of :data:`WIDEST_GAP`, grown by ``margin``. A
    frontier, where the free space ends at the unknown, is passed by no more than that.

    Args:
        slam: (H, W): 0 occupied, 205 unknown, 254 free.
        metres_per_px: Scale [m]; nan takes :data:`USUAL_SCALE`.
        margin: How far beyond the closed free space [m].

    Returns:
        (H, W), in the frame of ``slam``.
    """
    scale = metres_per_px if np.isfinite(metres_per_px) else USUAL_SCALE
    half_gap, half_ray = 0.5 * WIDEST_GAP / scale, 0.5 * RAY_WIDTH / scale
    border = int(np.ceil(half_gap)) + 2  # closing needs room around what touches the image's border
    seen = np.pad(without_small(slam == FREE, SMALLEST_FREE / scale**2), border)
    # Opening and closing by a disc are thresholds on distances, at any radius for one price.
    wide = _distance_to(_distance_to(~seen) > half_ray) <= half_ray
    closed = _distance_to(_distance_to(wide) > half_gap) > half_gap
    # It grows through walls, too: drift displaces them, and what lies behind one by a hand may be in front of it.
    explored: BoolArray = (_distance_to(closed) <= margin / scale) | seen
    return explored[border:-border, border:-border]


def limited_to_explored(cad: ByteArray, slam: ByteArray, metres_per_px: float, margin: float) -> ByteArray:
    """A CAD map without the floor that the robot has no evidence of: the target for a map that was broken off.

    Args:
        cad: (H, W): 0 walls and outside, 254 inside, shades between.
        slam: The SLAM map in the same frame, (H, W).
        metres_per_px: Scale [m]; nan takes :data:`USUAL_SCALE`.
        margin: See :func:`explored_floor`.
    """
    return np.where(explored_floor(slam, metres_per_px, margin), cad, 0).astype(np.uint8)


def _distance_to(mask: BoolArray) -> Float32Array:
    """Distance of each cell to the nearest one of the mask [px]; infinite if there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance, dtype=np.float32)
