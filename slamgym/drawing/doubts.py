"""What a person should check in a drawing: its scale, its direction, and how much of it was never seen."""

import cv2
import numpy as np
import shapely

from slamgym.core.types import FREE, GridFrame, OccupancyGrid
from slamgym.drawing.contours import trace_outlines
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import filled
from slamgym.drawing.floor import CleanedFloor
from slamgym.drawing.openings import divide
from slamgym.drawing.polygons import straightened
from slamgym.drawing.settings import DRAWN_DOORS
from slamgym.metrics.maps import distance_to
from slamgym.metrics.wall_direction import WallDirection

WIDE_FROM = 160.0
"""Floors from this size on may be those of smaller buildings at four times their scale [m2] ..."""
MIN_DOORS = 3
"""... if so many openings would be doors at a quarter of the scale ..."""
TIMES_MORE = 3
"""... and so many times as many as at the map's own. Of 25 maps at four times their scale this finds four of the 17
that clearances miss, and it doubts none at its own."""
CLEARANCES = (0.35, 4.0)
"""Between these lies, in each of 117 maps, what a tenth of the free floor is farther from all that isn't free [m]."""
REAL_ROOM = 4.0
"""Doors between smaller rooms are no evidence: the gaps of clutter [m2]."""
SMALLEST_FLOOR = 8.0
"""A map of a building shows more floor than this [m2]."""
MUCH_UNSEEN = 0.15
"""Share of the floor."""
MUCH_LEFT_OUT = 0.1
"""Share of the floor that the robot saw."""
MUCH_INFERRED = 0.5
"""Share of the walls' length."""


def find_doubts(drawing: Drawing, direction: WallDirection | None) -> list[str]:
    """One sentence for each doubt.

    Args:
        drawing: What was drawn.
        direction: Of the walls, as it was found; None if it was given.
    """
    doubts = []
    scale = scale_doubt(drawing)
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
    left_out = left_out_share(drawing)
    if left_out > MUCH_LEFT_OUT:
        doubts.append(
            f"{left_out:.0%} of the floor that the robot saw isn't drawn; another --model may keep it"
        )
    lengths = [wall.length for wall in drawing.walls]
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    if inferred > MUCH_INFERRED * sum(lengths):
        doubts.append(f"{inferred / sum(lengths):.0%} of the walls' length is inferred: few walls were seen")
    if len(drawing.floor.geoms) > 1:
        doubts.append(f"the floor falls into {len(drawing.floor.geoms)} parts that no opening joins")
    return doubts


def scale_doubt(drawing: Drawing) -> str | None:
    """A sentence if the map's scale makes no sense: floor too small, narrow or wide, or more doors at another."""
    if drawing.area < SMALLEST_FLOOR:
        return f"scale doubtful: the whole floor measures {drawing.area:.1f} m2; check the resolution"
    clearance = widest_clearance(drawing.grid)
    if not CLEARANCES[0] <= clearance <= CLEARANCES[1]:
        return (
            f"scale doubtful: a tenth of the floor is more than {clearance:.2f} m from all walls and furniture, in "
            f"buildings that is {CLEARANCES[0]:g} to {CLEARANCES[1]:g} m; check the resolution"
        )
    doors = _doors_at(drawing, 0.25) if drawing.area >= WIDE_FROM else []
    if len(doors) >= MIN_DOORS and len(doors) >= TIMES_MORE * len(_doors_at(drawing, 1.0)):
        return (
            f"scale doubtful: {len(doors)} openings between rooms are some {4.0 * np.median(doors):.2f} m wide; check "
            "the resolution"
        )
    return None


def widest_clearance(grid: OccupancyGrid) -> float:
    """How far from all that isn't free the widest tenth of the free floor is at least [m]."""
    free = np.pad(grid.cells == FREE, 1)
    return float(np.percentile(distance_to(~free)[free], 90.0)) * grid.frame.resolution


def left_out_share(drawing: Drawing) -> float:
    """Share of the free floor, without rays of one or two cells, that is neither drawn nor marked as unexplored."""
    free = cv2.morphologyEx(
        (drawing.grid.cells == FREE).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    drawn = filled(shapely.union_all([drawing.floor, *drawing.unexplored]), drawing.grid.frame)
    return float((free.astype(bool) & ~drawn).sum() / max(int(free.sum()), 1))


def _doors_at(drawing: Drawing, factor: float) -> list[float]:
    """Widths of what would be doors if cells were larger by a factor [m at that scale]; by cleaning, to compare."""
    cells, frame = drawing.grid.cells, drawing.grid.frame
    scaled = GridFrame(frame.resolution * factor, 0.0, 0.0, *cells.shape)
    probability = CleanedFloor().probability(OccupancyGrid(cells, scaled), drawing.angle_deg)
    outlines = trace_outlines(probability, 0.5, scaled)
    division = divide(straightened(outlines, drawing.angle_deg, scaled.resolution))
    return [
        gap.width
        for gap, pair in zip(division.doors, division.joins, strict=True)
        if gap.width <= DRAWN_DOORS[1] and min(division.rooms[k].area for k in pair) >= REAL_ROOM
    ]
