"""Leaves of open doors: thin oblique pieces that reach into the floor with one end. They are no walls."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import MultiPolygon

from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import FloatArray
from slamgym.drawing.edges import main_axes
from slamgym.drawing.polygons import without_necks
from slamgym.drawing.settings import DrawingConfig

LEAF_LENGTHS = (0.35, 1.3)
"""Of the leaf of a door [m]."""
THICKEST_LEAF = 0.25
"""On average [m]."""
LEAF_OBLIQUE_DEG = 10.0
"""A piece nearer to a main direction may be a wall."""
WIDEST_LEAF_BASE = 0.6
"""Of a leaf, where it meets its wall [m]."""
LEAF_TIP = (1, 2, 3)
"""Corners of a leaf's free end."""


def without_leaves(floor: MultiPolygon, angles_deg: Sequence[float], config: DrawingConfig) -> MultiPolygon:
    """The floor with the leaves of open doors taken for floor.

    Args:
        floor: With straight edges [m].
        angles_deg: The main directions.
        config: Sizes.
    """
    axes = np.array(main_axes(angles_deg))
    leaves = []
    for ring in oriented_rings(floor):
        leaves += _leaves_of(shapely.get_coordinates(ring)[:-1], axes)
    if not leaves:
        return floor
    # A little wider, so that no slit is left.
    return without_necks(
        shapely.union_all([floor, *(shapely.make_valid(leaf).buffer(1e-3) for leaf in leaves)]), config
    )


def _leaves_of(points: FloatArray, axes: np.ndarray) -> list[shapely.Polygon]:
    """The areas of a ring's leaves; the floor lies on the ring's left."""
    count, found = len(points), []
    for tip in LEAF_TIP:
        if count < tip + 4:
            continue
        for first in range(count):
            corners = points[np.arange(first, first + tip + 2) % count]
            x, y = (corners - corners[0]).T
            # Negative: what the corners enclose is wall.
            area = -0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))
            base = float(np.hypot(*(corners[-1] - corners[0])))
            sides = np.array([corners[1] - corners[0], corners[-1] - corners[-2]]) @ np.array([1.0, 1j])
            length = float(np.abs(sides).mean())
            if not (LEAF_LENGTHS[0] <= length <= LEAF_LENGTHS[1] and 0.0 < area <= THICKEST_LEAF * length):
                continue
            direction = complex((sides[0] - sides[1]) / max(abs(sides[0] - sides[1]), 1e-9))
            along = float(np.abs((direction * axes.conj()).real).max())
            back = (sides[0] * sides[1].conjugate()).real < -0.8 * abs(sides[0]) * abs(sides[1])
            if (
                back
                and base <= min(WIDEST_LEAF_BASE, 0.8 * length)
                and along < np.cos(np.radians(LEAF_OBLIQUE_DEG))
            ):
                found.append(shapely.Polygon(corners))
    return found
