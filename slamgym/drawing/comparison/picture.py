"""A comparison as a picture: the map in grey, the plan's walls by what has become of them, and a legend."""

from collections.abc import Sequence

import cv2
import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.geometry import transform_points
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame, OccupancyGrid
from slamgym.drawing.comparison.records import Change, PlanComparison
from slamgym.viz.canvas import (
    SHIFT,
    Colour,
    blank,
    draw_scale_bar,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
)

SIZE = 1400
"""Longer side of the drawing [px]."""
MARGIN = 0.7
"""Round plan and map [m]."""
LEGEND_ROW, TABLE_ROW, HEADING = 26, 24, 44
TABLE_ROWS = 28
"""So many changes are listed under the drawing; the files have them all."""

FREE_TINT, OCCUPIED_TINT, UNKNOWN_TINT = (255, 255, 255), (150, 155, 162), (228, 231, 235)
PRESENT: Colour = (47, 158, 68)
NOT_SEEN: Colour = (134, 142, 150)
COLOURS: dict[str, tuple[Colour, str]] = {
    "wall_moved": ((240, 140, 0), "wall moved (thin: planned, thick: built)"),
    "wall_covered": ((252, 196, 25), "covered by furniture, or moved"),
    "wall_missing": ((224, 49, 49), "wall missing"),
    "wall_extra": ((156, 54, 181), "wall not in the plan"),
    "opening_new": ((230, 73, 128), "opening not in the plan"),
    "door_moved": ((25, 113, 194), "door moved, or of another width"),
    "door_blocked": ((12, 53, 120), "door blocked"),
    "room_unexplored": ((134, 142, 150), "room not yet explored"),
}


def draw_comparison(comparison: PlanComparison, plan: FloorPlan, grid: OccupancyGrid) -> ByteArray:
    """Draw it.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    picture = draw_changes(comparison, plan, grid)
    width = max(picture.shape[1], 900)
    parts = [
        _heading(comparison, width),
        _padded(picture, width),
        _legend(comparison, width),
        _table(comparison, width),
    ]
    return np.vstack(parts)


def draw_changes(comparison: PlanComparison, plan: FloorPlan, grid: OccupancyGrid) -> ByteArray:
    """Draw the map and the plan's walls by what has become of them, without heading, legend and table.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    min_x, min_y, max_x, max_y = plan.bounds
    size = max(max_x - min_x, max_y - min_y) + 2.0 * MARGIN
    frame = GridFrame.covering(plan.bounds, size / SIZE, MARGIN)
    picture = _map_picture(comparison, grid, frame)
    if comparison.is_confident:
        for face in comparison.faces:
            colour = NOT_SEEN if face.state == "not_seen" else PRESENT
            if face.state != "moved":
                _line(picture, np.array(face.line), frame, colour, 2)
        for change in comparison.changes:
            _draw_change(picture, change, frame)
    else:
        for segment in plan.segments():
            _line(picture, segment, frame, NOT_SEEN, 1)
    draw_scale_bar(
        picture, (24, picture.shape[0] - 24), frame.resolution, 0.2 * picture.shape[1], backed=True
    )
    return picture


def _map_picture(comparison: PlanComparison, grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """The map's cells, resampled into the plan's frame."""
    tints = np.full((256, 3), UNKNOWN_TINT, np.uint8)
    tints[FREE], tints[OCCUPIED] = FREE_TINT, OCCUPIED_TINT
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    x, y = grid.frame.to_point(corners[:, 1], corners[:, 0])
    registration = comparison.registration
    there = transform_points(registration.plan_from_map, registration.scale * np.stack([x, y], axis=1))
    target = frame_pixels(there, frame, 1.0) - 0.5
    matrix = cv2.getAffineTransform(corners.astype(np.float32), target.astype(np.float32))
    size = (frame.width_px, frame.height_px)
    return np.asarray(
        cv2.warpAffine(tints[grid.cells], matrix, size, flags=cv2.INTER_NEAREST, borderValue=UNKNOWN_TINT),
        np.uint8,
    )


def _draw_change(picture: ByteArray, change: Change, frame: GridFrame) -> None:
    kind = "door_moved" if change.kind == "door_width" else change.kind
    colour = COLOURS[kind][0]
    line = np.array(change.line)
    if change.kind == "room_unexplored":
        x, y = frame_pixels(line[None, :2], frame, 1.0)[0].astype(int)
        draw_text(picture, f"{change.what}: not explored", int(x) - 60, int(y), 0.5, colour)
        return
    unit = (line[2:] - line[:2]) / max(float(np.hypot(*(line[2:] - line[:2]))), 1e-9)
    moved = line
    if change.offset is not None and change.kind in ("wall_moved", "wall_covered"):
        # The built wall as the map shows it: with the map's own distortion.
        moved = line + np.tile((change.raw_offset or change.offset) * np.array([-unit[1], unit[0]]), 2)
    elif change.offset is not None and change.kind == "door_moved":
        moved = line + np.tile(change.offset * unit, 2)
    if moved is not line:
        _line(picture, line, frame, colour, 1)
    _line(picture, moved, frame, colour, 5)
    text = "" if change.offset is None else f"{100.0 * change.offset:+.0f} cm"
    middle = frame_pixels((0.5 * (moved[:2] + moved[2:]))[None], frame, 1.0)[0]
    draw_text(picture, text, int(middle[0]) + 8, int(middle[1]) - 8, 0.55, colour)


def _line(picture: ByteArray, line: FloatArray, frame: GridFrame, colour: Colour, thickness: int) -> None:
    pixels = fixed_point(frame_pixels(line.reshape(2, 2), frame, 1.0))
    cv2.polylines(picture, [pixels], False, colour, thickness, cv2.LINE_AA, SHIFT)


def verdict(comparison: PlanComparison) -> str:
    """The result in a few words."""
    return (
        f"{len(comparison.changes)} changes" if comparison.is_confident else "NOT THE SAME BUILDING, it seems"
    )


def _heading(comparison: PlanComparison, width: int) -> ByteArray:
    strip = blank((HEADING + LEGEND_ROW * len(comparison.doubts), width))
    text = f"{verdict(comparison)}; {comparison.registration.explained:.0%} of the plan's walls in view are there"
    draw_text(strip, text, 12, 30, fitting_size(text, 0.7, width - 24))
    for row, doubt in enumerate(comparison.doubts):
        draw_text(
            strip,
            f"doubt: {doubt}",
            12,
            HEADING + 14 + LEGEND_ROW * row,
            fitting_size(doubt, 0.5, width - 120),
            (224, 49, 49),
        )
    return strip


def legend_entries(comparison: PlanComparison) -> list[tuple[Colour, str]]:
    """Colours that the picture uses, and what they mean."""
    kinds = {"door_moved" if change.kind == "door_width" else change.kind for change in comparison.changes}
    return [
        (PRESENT, "wall as planned"),
        (NOT_SEEN, "not seen"),
        *(COLOURS[kind] for kind in COLOURS if kind in kinds),
    ]


def _legend(comparison: PlanComparison, width: int) -> ByteArray:
    entries = legend_entries(comparison)
    columns = max(1, width // 450)
    strip = blank((LEGEND_ROW * -(-len(entries) // columns) + 14, width))
    for number, (colour, text) in enumerate(entries):
        left, top = 16 + (number % columns) * 450, 10 + LEGEND_ROW * (number // columns)
        cv2.line(strip, (left, top + 8), (left + 34, top + 8), colour, 5, cv2.LINE_AA)
        draw_text(strip, text, left + 44, top + 14, 0.5)
    return strip


def _table(comparison: PlanComparison, width: int) -> ByteArray:
    lines = table_lines(comparison.changes)
    if len(lines) > TABLE_ROWS:
        lines = [*lines[:TABLE_ROWS], f"... and {len(lines) - TABLE_ROWS} more in comparison.csv"]
    strip = blank((TABLE_ROW * len(lines) + 16, width))
    for row, text in enumerate(lines):
        draw_text(strip, text, 16, 18 + TABLE_ROW * row, fitting_size(text, 0.5, width - 32))
    return strip


def table_lines(changes: Sequence[Change]) -> list[str]:
    """A sentence a change."""
    lines = []
    for change in changes:
        text = f"{change.kind.replace('_', ' ')}: {change.what}"
        if change.kind != "room_unexplored":
            x, y = 0.5 * (change.line[0] + change.line[2]), 0.5 * (change.line[1] + change.line[3])
            text += f" at ({x:.1f}, {y:.1f})"
        if change.offset is not None and change.error is not None:
            text += f", by {100.0 * change.offset:+.0f} +- {100.0 * change.error:.0f} cm"
        if change.raw_offset is not None and change.kind in ("wall_moved", "wall_covered"):
            text += f" ({100.0 * change.raw_offset:+.0f} cm with the map's drift)"
        lines.append(text + (f"; {change.note}" if change.note else ""))
    return lines


def _padded(picture: ByteArray, width: int) -> ByteArray:
    padded = blank((picture.shape[0], width), UNKNOWN_TINT)
    padded[:, : picture.shape[1]] = picture
    return padded
