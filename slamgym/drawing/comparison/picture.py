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

SIZE = 1400
"""Longer side of the drawing [px]."""
MARGIN = 0.7
"""Round plan and map [m]."""
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
    min_x, min_y, max_x, max_y = plan.bounds
    size = max(max_x - min_x, max_y - min_y) + 2.0 * MARGIN
    frame = GridFrame.covering(plan.bounds, size / SIZE, MARGIN)
    tints = np.full((256, 3), OUTLINE, np.uint8)
    tints[FREE], tints[OCCUPIED] = WHITE, FAINT
    to_map = inverse(comparison.registration.plan_from_map)
    points = transform_points(to_map, frame.to_points(*np.indices(frame.shape)))
    picture: ByteArray = tints[values_at(grid.cells, grid.frame, points, UNKNOWN)]
    if comparison.is_confident:
        for wall in comparison.walls:
            if wall.kind != "wall_moved":
                _line(picture, np.array(wall.line), frame, COLOURS[wall.kind][0], 2)
        for change in comparison.changes:
            _draw_change(picture, change, frame)
    else:
        for segment in plan.segments():
            _line(picture, segment, frame, FAINT, 1)
    rows, cols, _ = picture.shape
    draw_scale_bar(picture, (24, rows - 24), frame.resolution, 0.2 * cols, backed=True)
    return picture


def _draw_change(picture: ByteArray, change: PlanFinding, frame: GridFrame) -> None:
    colour, line = COLOURS[change.kind][0], np.array(change.line)
    if change.kind == "room_unexplored":
        x, y = frame_pixels(line[None, :2], frame, 1.0)[0].astype(int)
        draw_text(picture, f"{change.what}: not explored", int(x) - 60, int(y), 0.5, colour)
        return
    unit = (line[2:] - line[:2]) / max(float(np.hypot(*(line[2:] - line[:2]))), 1e-9)
    # What was built as the map shows it: with the map's own distortion.
    offset, aside = change.raw_offset or 0.0, np.array([-unit[1], unit[0]])
    shift = {"wall_moved": offset * aside, "door_moved": offset * unit}
    moved = line + np.tile(shift.get(change.kind, 0.0 * unit), 2)
    _line(picture, line, frame, colour, 1)
    _line(picture, moved, frame, colour, 5)
    text = "" if change.offset is None else f"{100.0 * change.offset:+.0f} cm"
    middle = frame_pixels((0.5 * (moved[:2] + moved[2:]))[None], frame, 1.0)[0]
    draw_text(picture, text, int(middle[0]) + 8, int(middle[1]) - 16, 0.55, colour)


def _line(
    picture: ByteArray, line: FloatArray, frame: GridFrame, colour: Colour, thickness: int
) -> None:
    pixels = fixed_point(frame_pixels(line.reshape(2, 2), frame, 1.0))
    cv2.polylines(picture, [pixels], False, colour, thickness, cv2.LINE_AA, SHIFT)
