"""Points to check in a drawing: its scale, its direction, and how much of it was never seen."""

from collections.abc import Iterator

import numpy as np
import shapely

from slamgym.core.progress import counted
from slamgym.core.types import FREE, OccupancyGrid
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.settings import MAJORITY
from slamgym.metrics.maps import distance_to
from slamgym.metrics.wall_direction import WallDirection

CLEARANCES = (0.35, 4.0)
"""Between these lies, in each of 117 maps, what a tenth of the free floor is farther from all that isn't free [m]."""
SMALLEST_FLOOR = 8.0
"""A map of a building shows more floor than this [m2]: what a resolution that is wrong leaves of one room."""
MUCH_LEFT_OUT = 0.02
"""Share of the seen floor that isn't left out without a word. Of 57 real maps 16 lose more besides named patches."""


def find_doubts(drawing: Drawing, direction: WallDirection | None) -> Iterator[str]:
    """One sentence for each doubt. The direction of the walls is None if it was given rather than found."""
    clearance = widest_clearance(drawing.grid)
    if drawing.area < SMALLEST_FLOOR:
        yield f"scale doubtful: the whole floor measures {drawing.area:.1f} m2; check the resolution"
    elif not CLEARANCES[0] <= clearance <= CLEARANCES[1]:
        yield (
            f"scale doubtful: a tenth of the floor is more than {clearance:.2f} m from all walls and furniture, in "
            f"buildings that is {CLEARANCES[0]:g} to {CLEARANCES[1]:g} m; check the resolution"
        )
    if direction is not None and direction.support <= 0.0:
        yield "direction doubtful: no long straight wall was found; give it with --angle"
    elif direction is not None and direction.is_doubtful:
        yield (
            f"direction doubtful: walls run along {direction.angle_deg:.1f} and, nearly as many, along "
            f"{direction.rival_deg:.1f} degrees; choose with --angle"
        )
    if drawing.is_half:
        yield "less than half of the seen floor is drawn; compare the drawing with its map"
    for part in drawing.left_out:
        place = part.representative_point()
        yield (
            f"{part.area:.1f} m2 of seen floor around ({place.x:.1f}, {place.y:.1f}) aren't drawn: walls close in too "
            "little of them"
        )
    rest = drawing.left_out_area - sum(part.area for part in drawing.left_out)
    if rest > MUCH_LEFT_OUT * drawing.seen_area:
        yield (
            f"{rest:.1f} m2 of seen floor, in strips and small patches, aren't drawn; compare the drawing with its map"
        )
    yield from missing_walls(drawing)
    if drawing.questions:
        drawn = sum(question.is_drawn for question in drawing.questions)
        yield (
            f"{counted(len(drawing.questions), 'boundary line')} between rooms may be wrong, {drawn} drawn and "
            f"{len(drawing.questions) - drawn} left out; the report (HTML) asks about each"
        )
    length = sum(wall.length for wall in drawing.walls)
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    if inferred > MAJORITY * length:
        yield f"{inferred / length:.0%} of the walls' length is inferred: few walls were seen"
    if len(drawing.floor.geoms) > 1:
        yield f"the floor falls into {len(drawing.floor.geoms)} parts that no opening joins"


def missing_walls(drawing: Drawing) -> Iterator[str]:
    """A sentence for each wall that the map shows and the drawing doesn't.

    Of 81 such walls on 57 real maps 44 part rooms.
    """
    from slamgym.drawing.comparison.extra_walls import extra_walls
    from slamgym.drawing.comparison.faces import map_evidence

    shapes = [drawing.floor.boundary, *(wall.polygon.boundary for wall in drawing.walls)]
    drawn = shapely.get_coordinates(shapely.segmentize(shapes, 0.05))
    for found in extra_walls(drawing.floor, map_evidence(drawing.grid), drawn):
        (x0, y0), (x1, y1) = found.coords
        yield (
            f"a straight wall of {found.length:.1f} m isn't drawn: the map shows one from ({x0:.1f}, {y0:.1f}) to "
            f"({x1:.1f}, {y1:.1f})"
        )


def widest_clearance(grid: OccupancyGrid) -> float:
    """Distance to the nearest cell that isn't free, exceeded by a tenth of the free cells [m]."""
    free = np.pad(grid.cells == FREE, 1)
    return float(np.percentile(distance_to(~free)[free], 90.0)) * grid.frame.resolution
