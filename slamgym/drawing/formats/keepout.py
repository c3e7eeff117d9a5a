"""A drawing as a mask of Nav2's keep-out filter: where a robot must not drive, whatever its map says."""

import numpy as np
import shapely

from slamgym.core.types import FREE, OCCUPIED, OccupancyGrid
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import filled


def keepout_mask(drawing: Drawing) -> OccupancyGrid:
    """Draw a mask on the cells of the map that the drawing is of.

    Kept out of (occupied) is all but the drawn floor, and floor that was never observed: a robot's own map calls that
    unknown, through which planners may drive. No cell is unknown, which the filter would pass over.
    """
    frame = drawing.grid.frame
    unseen = filled(shapely.union_all(drawing.inferred_floor), frame)
    allowed = filled(drawing.floor, frame) & ~unseen
    return OccupancyGrid(np.where(allowed, FREE, OCCUPIED).astype(np.uint8), frame)
