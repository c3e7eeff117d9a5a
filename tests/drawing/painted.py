"""Maps of floors that are known exactly, and a model that sees them as they are."""

import cv2
import numpy as np
import shapely
from shapely import Polygon, affinity

from slamgym.cad.floorplan import fill_segments, ring_segments
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.metrics.layers import MapLayers, door_cells

FINE = 8
"""Samples of a cell along each side."""

DOOR = shapely.box(4.0, 1.3, 4.1, 2.2)
"""0.9 m wide, in a wall of 10 cm."""
FLAT = shapely.union_all(
    [
        Polygon([(0, 0), (4, 0), (4, 3), (2.5, 3), (2.5, 5), (0, 5)]),
        DOOR,
        shapely.box(4.1, 0, 7.3, 3),
    ]
)
"""An L-shaped room of 17 m2 and a room of 9.6 m2."""


class Painted:
    """A floor model that knows the floor, and the doors in it or finds them."""

    def __init__(self, floor, doors=None):
        self.floor, self.doors = floor, doors

    def __call__(self, grid, angle_deg):
        free = shares(self.floor, grid.frame)
        if self.doors is None:
            return MapLayers.of_floor(free, door_cells(free >= 0.5, grid.frame.resolution))
        return MapLayers.of_floor(free, shares(self.doors, grid.frame) > 0.0)


def shares(floor, frame):
    """How much of each cell is floor."""
    fine = GridFrame(
        frame.resolution / FINE,
        frame.origin_x,
        frame.origin_y,
        frame.height_px * FINE,
        frame.width_px * FINE,
    )
    rings = [ring for part in shapely.get_parts(floor) for ring in (part.exterior, *part.interiors)]
    inside = fill_segments(ring_segments(rings), fine)
    blocks = inside.reshape(frame.height_px, FINE, frame.width_px, FINE)
    return blocks.mean(axis=(1, 3)).astype(np.float32)


def painted(floor, resolution=0.05, turn_deg=0.0):
    """A map of a floor turned by an angle, the floor then, and a model that knows it."""
    floor = affinity.rotate(floor, turn_deg, origin=(0, 0))
    frame = GridFrame.covering(floor.bounds, resolution, margin=0.513)
    cells = np.where(shares(floor, frame) >= 0.5, FREE, UNKNOWN).astype(np.uint8)
    near = cv2.dilate((cells == FREE).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    cells[near & (cells != FREE)] = OCCUPIED
    return OccupancyGrid(cells, frame), floor, Painted(floor)
