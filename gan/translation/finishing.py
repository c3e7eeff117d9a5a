"""The last steps of a translation: floor ends where the map does, faces lie where they truly are, walls are thin.

Explored floor: half of the building is unknown in a real robot's map. A network whose targets show the whole building
learns to invent rooms there, so targets end, and translations are cut off, at the border of what was explored.

Faces: networks that learnt from drawings with a line along every face draw walls too thick, by an amount that is the
same everywhere; the places of the walls are right. Moving all faces back is a dilation of the greys by a radius within
a cell. Walls that would vanish by it keep a cell.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, ByteArray, Float32Array
from slamgym.metrics.cleaning import without_small
from slamgym.metrics.maps import distance_to

WIDEST_GAP = 2.0
"""Unseen places between free cells at most so far apart count as explored [m]: under a bed, behind a wardrobe."""
RAY_WIDTH = 0.15
"""Free space narrower than this is a ray that left through a window: it was seen, but nothing follows from it [m]."""
SMALLEST_FREE = 0.1
"""Separate free space smaller than this is noise, no evidence [m2]."""
USUAL_SCALE = 0.06
"""Scale of a map that comes without one [m/px]: the middle of rendered homes."""
DIRECTIONS = 16
"""Number of directions in which a disc's rim is sampled."""
CLOSED = 0.45
"""Largest value that a cell is given where a wall would be lost: less than a half, so it stays closed."""


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
    wide = distance_to(distance_to(~seen) > half_ray) <= half_ray
    closed = distance_to(distance_to(wide) > half_gap) > half_gap
    # It grows through walls, too: drift displaces them, and what lies behind one by a hand may be in front of it.
    explored: BoolArray = (distance_to(closed) <= margin / scale) | seen
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


def moved_faces(free: Float32Array, shift_px: float) -> Float32Array:
    """Move every face by a distance, walls getting thinner.

    Args:
        free: Probability or share of floor, shape (H, W).
        shift_px: How far [cells]; 0 or less keeps the image as it is.

    Returns:
        (H, W) in [0, 1]. A wall of which nothing would be left keeps its middle at :data:`CLOSED`.
    """
    if shift_px <= 0.0:
        return free
    grown = free.copy()
    for number in range(DIRECTIONS):
        angle = 2.0 * math.pi * number / DIRECTIONS
        shift = np.array([[1.0, 0.0, shift_px * math.cos(angle)], [0.0, 1.0, shift_px * math.sin(angle)]])
        moved = cv2.warpAffine(free, shift, free.shape[::-1], flags=cv2.INTER_LINEAR)
        np.maximum(grown, moved, out=grown)
    closed = thin_walls(free, math.ceil(2.0 * shift_px), math.ceil(shift_px))
    grown[closed] = np.minimum(grown[closed], CLOSED)
    return np.asarray(grown, dtype=np.float32)


def thin_walls(free: Float32Array, thickest_px: int, ends_px: int) -> BoolArray:
    """The middles of walls with floor on both sides, along a row or a column, (H, W).

    Args:
        free: Probability or share of floor, shape (H, W).
        thickest_px: Thicker walls have no middle.
        ends_px: How far a middle continues into the wall that it meets, which moves away from it.
    """
    found = np.zeros(free.shape, np.bool_)
    for floor, middles in ((free >= 0.5, found), (free.T >= 0.5, found.T)):
        wall = ~floor
        within = np.ones_like(floor)  # whether as many cells as now from here on are wall
        for thickness in range(1, min(thickest_px, len(floor) - 2) + 1):
            within = within[: len(floor) - thickness + 1] & wall[thickness - 1 :]
            run = floor[: -thickness - 1] & within[1:-1] & floor[thickness + 1 :]
            middles[1 + thickness // 2 :][: len(run)] |= run
        for _ in range(ends_px):
            ahead, behind = middles[:, :-1] & wall[:, 1:], middles[:, 1:] & wall[:, :-1]
            middles[:, 1:] |= ahead
            middles[:, :-1] |= behind
    return found


def thinned_walls(cells: ByteArray) -> ByteArray:
    """Leave one cell of every wall; what it covered becomes what lies next to it.

    Args:
        cells: SLAM map (H, W): 0 occupied, 205 unknown, 254 free.

    Returns:
        The same with walls one cell thick.
    """
    from scipy.ndimage import distance_transform_edt  # a quarter of a second of every command that translates

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
                    for shift in ((1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1))
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
