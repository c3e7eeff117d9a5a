"""Corners and angles of drawn rooms against the true ones, as in the literature on floor-plan reconstruction.

Stekovic et al., *MonteFloor: Extending MCTS for Reconstructing Accurate Large-Scale Floor Plans*, ICCV 2021, section 5:
a drawn corner is right if the true room that its own one stands for has a corner within 10 pixels of a building that
fills 256; its angle is right if it differs by less than 5 degrees. Outlines alone are compared, not holes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from shapely import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from slamgym.core.types import FloatArray

CORNER_WITHIN = 10.0 / 256.0
"""A true corner is so near, as a share of the building's longer side."""
ANGLE_WITHIN = math.radians(5.0)
"""An angle is right if it is off by less [rad]."""
SAME_ROOM = 0.5
"""A drawn room stands for a true one from this intersection over union on."""


@dataclass(frozen=True)
class CornerCounts:
    """Corners of drawings."""

    drawn: int
    true: int
    right: int
    """Drawn corners that are true ones."""
    right_angle: int
    """Those of them whose angle is right, too."""

    def __add__(self, other: "CornerCounts") -> "CornerCounts":
        """Those of both."""
        return CornerCounts(
            self.drawn + other.drawn,
            self.true + other.true,
            self.right + other.right,
            self.right_angle + other.right_angle,
        )

    def figures(self) -> dict[str, float]:
        """Precision, recall and F1 of corners, and of their angles; 0 of none."""
        found = {}
        for name, right in (("corner", self.right), ("angle", self.right_angle)):
            found[f"{name} precision"] = right / max(self.drawn, 1)
            found[f"{name} recall"] = right / max(self.true, 1)
            found[f"{name} F1"] = 2.0 * right / max(self.drawn + self.true, 1)
        return {name: round(value, 3) for name, value in found.items()}


def count_corners(
    rooms: Sequence[Polygon], true_rooms: Sequence[Polygon], straight_within: float
) -> CornerCounts:
    """Compare the corners of rooms.

    Args:
        rooms: As drawn [m].
        true_rooms: In the same frame [m].
        straight_within: Corners that stand out less from a straight line are none [m].
    """
    drawn_outlines = [_corners(room, straight_within) for room in rooms]
    true_outlines = [_corners(room, straight_within) for room in true_rooms]
    right = 0
    right_angle = 0
    min_x, min_y, max_x, max_y = MultiPolygon(list(true_rooms)).bounds
    within = CORNER_WITHIN * max(max_x - min_x, max_y - min_y)
    for room, outline in zip(rooms, drawn_outlines, strict=True):
        for true_room, true_outline in zip(true_rooms, true_outlines, strict=True):
            shared = room.intersection(true_room).area
            if shared > SAME_ROOM * (room.area + true_room.area - shared):
                found, of_angle = _matched(outline, true_outline, within)
                right += found
                right_angle += of_angle
    drawn = sum(map(len, drawn_outlines))
    return CornerCounts(drawn, sum(map(len, true_outlines)), right, right_angle)


def _corners(room: Polygon, straight_within: float) -> FloatArray:
    """Corners of a room's outline, counter-clockwise, (N, 2) [m]."""
    points = shapely.get_coordinates(orient(room).exterior)[:-1]
    # What is farthest from the middle is a corner: simplifying keeps the point with which it begins.
    first = int(np.argmax(np.hypot(*(points - points.mean(axis=0)).T)))
    ring = np.roll(points, -first, axis=0)
    simple = shapely.simplify(shapely.linearrings(ring), straight_within)
    return shapely.get_coordinates(simple)[:-1]


def _matched(outline: FloatArray, true_outline: FloatArray, within: float) -> tuple[int, int]:
    """How many corners are true ones, each at most once, and at how many of these the angle is right."""
    apart = cdist(outline, true_outline)
    # What is too far costs more than all that is near, so as many as can be are matched.
    cost = np.where(apart <= within, apart, within * (1 + min(apart.shape)))
    corner, true_corner = linear_sum_assignment(cost)
    is_near = apart[corner, true_corner] <= within
    difference = _angles(outline)[corner] - _angles(true_outline)[true_corner]
    is_right = is_near & (np.abs(difference) < ANGLE_WITHIN)
    return int(is_near.sum()), int(is_right.sum())


def _angles(outline: FloatArray) -> FloatArray:
    """The angle between the two sides at each corner on the inside, in [0, 2 pi)."""
    points = outline @ (1.0, 1j)
    before = np.roll(points, 1) - points
    behind = np.roll(points, -1) - points
    return np.angle(before / behind) % (2.0 * np.pi)
