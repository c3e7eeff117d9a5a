"""The layers of a translated SLAM map: floor, wall, door, and what nobody saw.

Each pixel has four shares that add up to 1. A door is the floor between two jambs, so floor and door together are the
free space. Walls are drawn as deep as a wall may be; farther behind it, and beyond what the robot explored, lies the
unseen.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from slamgym.core.types import FREE, BoolArray, ByteArray, Float32Array
from slamgym.metrics.cleaning import without_small
from slamgym.metrics.maps import distance_to
from slamgym.metrics.rooms import label_rooms

WALL_DEPTH = 0.25
"""A wall is drawn so deep behind its face [m]: walls between rooms are thinner than twice this."""
DOOR_DEPTH = 0.1
"""A door's layer extends so far to both sides of the line between its jambs [m]."""
EXPLORED_MARGIN = 0.5
"""Floor is drawn at most so far beyond what the robot explored [m]."""
WIDEST_GAP = 2.0
"""Unseen places between free cells at most so far apart count as explored [m]: under a bed, behind a wardrobe."""
RAY_WIDTH = 0.15
"""Free space narrower than this is a ray that left through a window: it was seen, but nothing follows from it [m]."""
SMALLEST_FREE = 0.1
"""Separate free space smaller than this is noise, no evidence [m2]."""
USUAL_SCALE = 0.06
"""Scale of a map that comes without one [m/px]: the middle of rendered homes."""


@dataclass(frozen=True)
class MapLayers:
    """Probabilities for each cell of a map, all (H, W) in [0, 1]; together 1."""

    floor: Float32Array
    wall: Float32Array
    door: Float32Array
    unseen: Float32Array
    has_doors: bool = True
    """False if nobody looked for doors."""

    @property
    def free(self) -> Float32Array:
        """Free space: floor or door."""
        share = self.floor + self.door
        return np.minimum(share, 1.0)

    @staticmethod
    def of_floor(free: Float32Array, doors: BoolArray | None = None) -> "MapLayers":
        """Layers of a floor that is known: what isn't free is wall.

        Args:
            free: Share of free space, (H, W).
            doors: Cells that belong to doors; None if nobody looked for some.
        """
        door = np.zeros_like(free)
        if doors is not None:
            door[doors] = free[doors]
        floor = free - door
        wall = 1.0 - free
        unseen = np.zeros_like(free)
        return MapLayers(floor, wall, door, unseen, doors is not None)


def layer_shares(
    cad: ByteArray, doors: BoolArray, slam: ByteArray, metres_per_px: float
) -> ByteArray:
    """The layers that a translator shall draw for a pair.

    Args:
        cad: (H, W): 0 walls and outside, 254 or lighter inside, shades where a face crosses a pixel.
        doors: Its :func:`door_cells`, found before anything was cut off: a room cut in two would lose its doors.
        slam: The SLAM map in the same frame, (H, W).
        metres_per_px: Scale [m].

    Returns:
        (4, H, W): shares of floor, wall, door and unseen; they add up to 254.
    """
    explored = explored_floor(slam, metres_per_px, EXPLORED_MARGIN)
    drawn_floor = np.minimum(cad, FREE)
    known_floor = np.where(explored, drawn_floor, 0)
    floor = known_floor.astype(np.uint8)
    depth = max(WALL_DEPTH / metres_per_px, 1.0)
    to_floor = distance_to(floor > FREE // 2)
    near_floor = to_floor <= depth
    drawn_wall = FREE - floor
    wall = np.where(explored & near_floor, drawn_wall, 0)
    door = np.where(doors, floor, 0)
    open_floor = np.where(doors, 0, floor)
    unseen = FREE - floor - wall
    layers = np.stack([open_floor, wall, door, unseen])
    return layers.astype(np.uint8)


def door_cells(floor: BoolArray, metres_per_px: float) -> BoolArray:
    """Where two rooms meet (:mod:`slamgym.metrics.rooms`), and as far to both sides as a door's layer extends.

    Args:
        floor: (H, W).
        metres_per_px: Scale [m].
    """
    rooms = label_rooms(floor, metres_per_px)
    meet = np.zeros(rooms.shape, np.uint8)
    for labels, cells in ((rooms, meet), (rooms.T, meet.T)):
        before = labels[:-1]
        after = labels[1:]
        both_rooms = (before > 0) & (after > 0)
        cells[:-1] |= (before != after) & both_rooms
    depth = round(DOOR_DEPTH / metres_per_px)
    side = 2 * depth + 1
    around = np.ones((side, side), np.uint8)
    near = cv2.dilate(meet, around)
    return (near > 0) & floor


def explored_floor(slam: ByteArray, metres_per_px: float, margin: float) -> BoolArray:
    """Where a robot's map is evidence enough to predict floor.

    The free cells, with gaps closed up to a width of :data:`WIDEST_GAP`, grown by ``margin``. A
    frontier, where the free space ends at the unknown, is passed by no more than that.

    Args:
        slam: (H, W): 0 occupied, 205 unknown, 254 free.
        metres_per_px: Scale [m].
        margin: How far beyond the closed free space [m].

    Returns:
        (H, W), in the frame of ``slam``.
    """
    scale = metres_per_px
    half_gap = 0.5 * WIDEST_GAP / scale
    # Closing needs room around what touches the image's border.
    border = math.ceil(half_gap) + 2
    smallest = SMALLEST_FREE / scale**2
    large = without_small(slam == FREE, smallest)
    seen = np.pad(large, border)
    # Opening and closing by a disc are thresholds on distances, at any radius for one price.
    wide = without_rays(seen, scale)
    outside = distance_to(wide) > half_gap
    closed = distance_to(outside) > half_gap
    # It grows through walls, too: drift displaces them, and what lies behind one by a hand may be in front of it.
    is_near = distance_to(closed) <= margin / scale
    explored: BoolArray = is_near | seen
    inside = slice(border, -border)
    return explored[inside, inside]


def without_rays(free: BoolArray, metres_per_px: float) -> BoolArray:
    """Where a disc of :data:`RAY_WIDTH` fits into free space: it is opened by the disc.

    Args:
        free: (H, W).
        metres_per_px: Scale [m].
    """
    half = 0.5 * RAY_WIDTH / metres_per_px
    wide: BoolArray = distance_to(distance_to(~free) > half) <= half
    return wide
