"""What a person should check in a drawing: its scale, its direction, and how much of it was never seen."""

import numpy as np

from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.drawing.contours import trace_outlines
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.floor import CleanedFloor
from slamgym.drawing.openings import jamb_gaps
from slamgym.drawing.polygons import straightened
from slamgym.drawing.settings import DrawingConfig
from slamgym.gan.translation.wall_direction import WallDirection

USUAL_CELLS = (0.009, 0.11)
"""Cells of robots' maps [m]."""
SCALES = (0.25, 4.0)
"""Wrong scales that are tried: doors 20 cm or 4 m wide."""
MIN_DOORS = 3
"""So many doors at another scale are evidence."""
MUCH_UNSEEN = 0.15
"""Share of the floor."""


def find_doubts(drawing: Drawing, direction: WallDirection | None, config: DrawingConfig) -> list[str]:
    """One sentence for each doubt.

    Args:
        drawing: What was drawn.
        direction: Of the walls, as it was found; None if it was given.
        config: Sizes.
    """
    doubts = []
    scale = scale_doubt(drawing, config)
    if scale:
        doubts.append(scale)
    if direction is not None and direction.support <= 0.0:
        doubts.append("direction doubtful: no long straight wall was found; give it with --angle")
    elif direction is not None and direction.is_doubtful:
        doubts.append(
            f"direction doubtful: walls run along {direction.angle_deg:.1f} and, nearly as many, along "
            f"{direction.rival_deg:.1f} degrees; choose with --angle"
        )
    unseen = sum(float(part.area) for part in drawing.inferred_floor)
    if unseen > MUCH_UNSEEN * drawing.area:
        doubts.append(
            f"{unseen / drawing.area:.0%} of the floor was never observed; it is in the layer INFERRED"
        )
    if len(drawing.floor.geoms) > 1:
        doubts.append(f"the floor falls into {len(drawing.floor.geoms)} parts that no opening joins")
    return doubts


def scale_doubt(drawing: Drawing, config: DrawingConfig) -> str | None:
    """A sentence if the map's scale makes no sense: more gaps would be doors if it were another."""
    frame = drawing.grid.frame
    if not USUAL_CELLS[0] <= frame.resolution <= USUAL_CELLS[1]:
        return f"scale doubtful: cells of {frame.resolution:g} m; robots' maps have 0.01 to 0.1 m"
    own = len(jamb_gaps(drawing.floor, config))
    for factor in SCALES:
        other = _gaps_at(drawing.grid, drawing.angle_deg, factor, config)
        if len(other) >= max(MIN_DOORS, 3 * own + 1):
            width = float(np.median(other)) / factor
            return (
                f"scale doubtful: {len(other)} gaps between walls are some {width:.2f} m wide, and {own} as wide as "
                "doors; check the resolution"
            )
    return None


def _gaps_at(grid: OccupancyGrid, angle_deg: float, factor: float, config: DrawingConfig) -> list[float]:
    """Widths of what would be doors if cells were larger by a factor [m at that scale]."""
    frame = grid.frame
    scaled = GridFrame(frame.resolution * factor, 0.0, 0.0, *grid.cells.shape)
    probability = CleanedFloor().probability(OccupancyGrid(grid.cells, scaled), angle_deg)
    floor = straightened(trace_outlines(probability, 0.5, scaled), [angle_deg], scaled.resolution, config)
    return [gap.width for gap in jamb_gaps(floor, config)]
