"""A picture of the drawing over the map that it was made from."""

from collections.abc import Callable, Iterable

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.geometry import transform_points
from slamgym.core.progress import counted
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)
from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    FAINT,
    INK,
    PAPER,
    SHIFT,
    TRUE_COLOUR,
    UNKNOWN_TINT,
    UNSEEN_TINT,
    WALL_TINT,
    WHITE,
    Colour,
    blank,
    draw_scale_bar,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
    text_width,
)

SIDE_PX = 1600
"""Longer side of the drawing."""
PICTURE_MARGIN = 1.2
"""Round what is drawn [m]."""
CAPTION_PX = 64

_UNEXPLORED: Colour = (250, 232, 184)
_ECHO: Colour = (232, 89, 12)


def draw_picture(drawing: Drawing, side_px: int = SIDE_PX) -> ByteArray:
    """Draw the map with the drawing on top: echoes orange, walls black (seen) or grey (inferred), doors blue.

    Args:
        drawing: What to draw.
        side_px: Longer side.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    min_x, min_y, max_x, max_y = drawing.bounds
    metres_per_px = (max(max_x - min_x, max_y - min_y) + 2 * PICTURE_MARGIN) / side_px
    frame = GridFrame.covering(drawing.bounds, metres_per_px, PICTURE_MARGIN)
    cells = cells_in(drawing.grid, frame)
    page = blank(frame.shape, UNKNOWN_TINT)
    page[cells == FREE] = PAPER

    def to_page(points: FloatArray) -> np.ndarray:
        return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)

    _fill(page, drawing.unexplored, _UNEXPLORED, to_page)
    _fill(page, drawing.floor.geoms, WHITE, to_page)
    _fill(page, drawing.inferred_floor, UNSEEN_TINT, to_page)
    for wall in drawing.walls:
        _fill(page, [wall.polygon], WALL_TINT if wall.layer == "SEEN" else FAINT, to_page)
    page[cells == OCCUPIED] = (0.45 * page[cells == OCCUPIED] + 0.55 * np.array(_ECHO)).astype(np.uint8)
    for door in drawing.doors:
        _line(page, door.start, door.end, TRUE_COLOUR, 3 if door.kind == "door" else 1, to_page)
    for line in drawing.dimensions:
        _line(page, line.start, line.end, BELIEVED_COLOUR, 1, to_page)
        start, end = np.array([line.start]), np.array([line.end])
        col, row = (to_page(start + 0.3 * (end - start))[0] >> SHIFT).tolist()
        draw_text(page, f"{line.length:.2f}", col + 3, row - 3, 0.38, BELIEVED_COLOUR)
    for room in drawing.rooms:
        middle = room.polygon.representative_point()
        text = f"{room.id} {room.area:.1f} m2"
        col, row = (to_page(np.array([[middle.x, middle.y]]))[0] >> SHIFT).tolist()
        draw_text(page, text, col - text_width(text, 0.4) // 2, row, 0.4, INK)
    return np.vstack([page, _footer(drawing, page.shape[1], metres_per_px)])


def cells_in(
    grid: OccupancyGrid, frame: GridFrame, pose: Pose2D = Pose2D(0.0, 0.0, 0.0), scale: float = 1.0
) -> ByteArray:
    """A map's cells under the pixels of a frame, unknown beyond the map.

    Args:
        grid: The map.
        frame: The pixels.
        pose: Pose of the map in the coordinates of the frame.
        scale: Factor of the map's lengths.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    x, y = grid.frame.to_point(corners[:, 1], corners[:, 0])
    target = frame_pixels(transform_points(pose, scale * np.stack([x, y], axis=1)), frame, 1.0) - 0.5
    matrix = cv2.getAffineTransform(corners.astype(np.float32), target.astype(np.float32))
    size = (frame.width_px, frame.height_px)
    found = cv2.warpAffine(grid.cells, matrix, size, flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)
    return np.asarray(found, np.uint8)


def _fill(
    page: ByteArray, shapes: Iterable[Polygon], colour: Colour, to_page: Callable[[FloatArray], np.ndarray]
) -> None:
    for shape in shapes:
        rings = [to_page(shapely.get_coordinates(ring)) for ring in shapely.get_rings(shape)]
        if rings:
            cv2.fillPoly(page, rings, colour, cv2.LINE_AA, SHIFT)


def _line(
    page: ByteArray,
    start: DrawnPoint,
    end: DrawnPoint,
    colour: Colour,
    width: int,
    to_page: Callable[[FloatArray], np.ndarray],
) -> None:
    cv2.polylines(page, [to_page(np.array([start, end]))], False, colour, width, cv2.LINE_AA, SHIFT)


def _footer(drawing: Drawing, width: int, metres_per_px: float) -> ByteArray:
    strip = blank((CAPTION_PX, width), PAPER)
    right = draw_scale_bar(strip, (16, 22), metres_per_px, 0.25 * width)
    caption = f"{drawing.name}   {counted(len(drawing.rooms), 'room')}   {drawing.area:.1f} m2"
    draw_text(strip, caption, right + 24, 27, fitting_size(caption, 0.5, width - right - 40))
    if drawing.doubts:
        doubts = "; ".join(drawing.doubts)
        draw_text(strip, doubts, 16, 52, fitting_size(doubts, 0.45, width - 32), BELIEVED_COLOUR)
    return strip
