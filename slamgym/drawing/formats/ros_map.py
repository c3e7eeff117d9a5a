"""A drawing as a map that a robot can use: floor is free, what bounds it is occupied, all else is unknown."""

from slamgym.cad.floorplan import fill_segments, map_values, ring_segments
from slamgym.core.types import UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing.drawing import Drawing

WALL = 0.2
"""Round the floor so much is occupied [m]; a robot sees the walls' faces alone."""


def drawing_map(drawing: Drawing, resolution: float | None = None) -> OccupancyGrid:
    """Draw the floor, seen and inferred, as an occupancy grid in the frame of the map that it was drawn from.

    Args:
        drawing: What was drawn.
        resolution: Size of a cell [m]; that of the map by default.
    """
    cell = resolution or drawing.grid.frame.resolution
    frame = GridFrame.covering(drawing.floor.bounds, cell, margin=WALL)
    rings = [ring for part in drawing.floor.geoms for ring in (part.exterior, *part.interiors)]
    inside = fill_segments(ring_segments(rings), frame)
    return OccupancyGrid(map_values(inside, cell, UNKNOWN, WALL), frame)
