"""A comparison as a picture: the map in grey, the plan's walls by what has become of them."""

import cv2
import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
)
from slamgym.drawing.comparison.records import PlanComparison, PlanFinding
from slamgym.drawing.evidence import values_at
from slamgym.drawing.formats.png import SIDE_PX
from slamgym.drawing.settings import MARGIN
from slamgym.viz.canvas import (
    FAINT,
    OUTLINE,
    SHIFT,
    SURE_COLOUR,
    TRUE_COLOUR,
    WHITE,
    Colour,
    draw_scale_bar,
    draw_text,
    fixed_point,
    frame_pixels,
)

COLOURS: dict[str, tuple[Colour, str]] = {
    "wall_present": (SURE_COLOUR, "wall as planned"),
    "wall_not_seen": (FAINT, "wall not seen"),
    "wall_unclear": (FAINT, "wall hidden, or unclear"),
    "wall_moved": ((240, 140, 0), "wall moved (thin: planned, thick: built)"),
    "wall_missing": ((224, 49, 49), "wall missing"),
    "wall_extra": ((156, 54, 181), "wall not in the plan"),
    "opening_new": ((230, 73, 128), "opening not in the plan"),
    "door_moved": (TRUE_COLOUR, "door moved"),
    "door_width": (TRUE_COLOUR, "door of another width"),
    "door_blocked": ((12, 53, 120), "door blocked"),
    "room_unexplored": (FAINT, "room not yet explored"),
}


def draw_comparison(comparison: PlanComparison, plan: FloorPlan, grid: OccupancyGrid) -> ByteArray:
    """Draw the map and the plan's walls by what has become of them: RGB, shape (rows, cols, 3)."""
    frame = _frame(plan)
    picture = _map_below(comparison, grid, frame)
    if comparison.is_confident:
        for wall in comparison.walls:
            if wall.kind != "wall_moved":
                colour, _ = COLOURS[wall.kind]
                _line(picture, np.array(wall.line), frame, colour, 2)
        for change in comparison.changes:
            _draw_change(picture, change, frame)
    else:
        for segment in plan.segments():
            _line(picture, segment, frame, FAINT, 1)
    rows, cols, _ = picture.shape
    draw_scale_bar(picture, (24, rows - 24), frame.resolution, 0.2 * cols, backed=True)
    return picture


def _frame(plan: FloorPlan) -> GridFrame:
    """A frame round a plan whose cells are the picture's pixels."""
    min_x, min_y, max_x, max_y = plan.bounds
    size = max(max_x - min_x, max_y - min_y) + 2.0 * MARGIN
    return GridFrame.covering(plan.bounds, size / SIDE_PX, MARGIN)


def _map_below(comparison: PlanComparison, grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """The map as it lies on the plan, in grey."""
    tints = np.full((256, 3), OUTLINE, np.uint8)
    tints[FREE] = WHITE
    tints[OCCUPIED] = FAINT
    to_map = inverse(comparison.registration.plan_from_map)
    places = frame.to_points(*np.indices(frame.shape))
    points = transform_points(to_map, places)
    cells = values_at(grid.cells, grid.frame, points, UNKNOWN)
    picture: ByteArray = tints[cells]
    return picture


def _draw_change(picture: ByteArray, change: PlanFinding, frame: GridFrame) -> None:
    colour, _ = COLOURS[change.kind]
    if change.kind == "room_unexplored":
        place = np.array([change.line[:2]])
        x, y = frame_pixels(place, frame, 1.0)[0].tolist()
        draw_text(picture, f"{change.what}: not explored", int(x) - 60, int(y), 0.5, colour)
        return
    line = np.array(change.line).reshape(2, 2)
    built = line + _shift(change)
    _line(picture, line, frame, colour, 1)
    _line(picture, built, frame, colour, 5)
    text = "" if change.offset is None else f"{100.0 * change.offset:+.0f} cm"
    middle = 0.5 * (built[0] + built[1])
    x, y = frame_pixels(middle[None], frame, 1.0)[0].tolist()
    draw_text(picture, text, int(x) + 8, int(y) - 16, 0.55, colour)


def _shift(change: PlanFinding) -> FloatArray:
    """By how much what was built lies beside what was planned, with the map's own distortion, (2,) [m]."""
    offset = change.raw_offset or 0.0
    start, end = np.array(change.line).reshape(2, 2)
    along = end - start
    unit = along / max(float(np.hypot(*along)), 1e-9)
    if change.kind == "wall_moved":
        return offset * np.array([-unit[1], unit[0]])
    if change.kind == "door_moved":
        return np.asarray(offset * unit)
    return np.zeros(2)


def _line(
    picture: ByteArray, line: FloatArray, frame: GridFrame, colour: Colour, thickness: int
) -> None:
    ends = frame_pixels(line.reshape(2, 2), frame, 1.0)
    pixels = fixed_point(ends)
    cv2.polylines(picture, [pixels], False, colour, thickness, cv2.LINE_AA, SHIFT)
