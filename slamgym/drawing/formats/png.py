"""A picture of the drawing over the map that it was made from."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame
from slamgym.drawing.drawing import Drawing, DrawnPoint
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    INK,
    PAPER,
    SHIFT,
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

_FREE_TINT: Colour = (255, 255, 255)
_UNKNOWN_TINT: Colour = (226, 229, 233)
_SEEN_WALL: Colour = (33, 37, 41)
_DOOR: Colour = (25, 113, 194)
_ECHO: Colour = (232, 89, 12)
_DIMENSION: Colour = (201, 42, 42)


class Look(NamedTuple):
    """What a picture shows, and how."""

    inferred_wall: Colour = (150, 162, 178)
    inferred_floor: Colour = (203, 218, 240)
    unexplored: Colour = (250, 232, 184)
    is_thumbnail: bool = False
    """Without echoes, sizes, names and footer."""


DEFAULT_LOOK = Look()


def draw_picture(drawing: Drawing, side_px: int = SIDE_PX, look: Look = DEFAULT_LOOK) -> ByteArray:
    """Draw the map with the drawing on top: echoes orange, walls black (seen) or grey (inferred), doors blue.

    Args:
        drawing: What to draw.
        side_px: Longer side.
        look: Colours, and whether it is a thumbnail.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    min_x, min_y, max_x, max_y = drawing.bounds
    metres_per_px = (max(max_x - min_x, max_y - min_y) + 2 * PICTURE_MARGIN) / side_px
    frame = GridFrame.covering(drawing.bounds, metres_per_px, PICTURE_MARGIN)
    page = _ground(drawing, frame)

    def to_page(points: FloatArray) -> np.ndarray:
        return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)

    _fill(page, drawing.unexplored, look.unexplored, to_page)
    _fill(page, drawing.floor.geoms, _FREE_TINT, to_page)
    _fill(page, drawing.inferred_floor, look.inferred_floor, to_page)
    for wall in drawing.walls:
        _fill(page, [wall.polygon], _SEEN_WALL if wall.layer == "SEEN" else look.inferred_wall, to_page)
    if not look.is_thumbnail:
        _draw_echoes(page, drawing, frame)
    for door in drawing.doors:
        _line(page, door.start, door.end, _DOOR, 3 if door.kind == "door" else 1, to_page)
    if look.is_thumbnail:
        return page
    for dimension in drawing.dimensions:
        _draw_dimension(page, dimension.start, dimension.end, f"{dimension.length:.2f}", to_page)
    for room in drawing.rooms:
        middle = room.polygon.representative_point()
        text = f"{room.id} {room.area:.1f} m2"
        col, row = (to_page(np.array([[middle.x, middle.y]]))[0] >> SHIFT).tolist()
        draw_text(page, text, col - text_width(text, 0.4) // 2, row, 0.4, INK)
    return np.vstack([page, _footer(drawing, page.shape[1], metres_per_px)])


def _ground(drawing: Drawing, frame: GridFrame) -> ByteArray:
    """What the map knows, in the picture's frame."""
    page = blank(frame.shape, _UNKNOWN_TINT)
    free = _sampled(drawing, frame) == FREE
    page[free] = (246, 248, 250)
    return page


def _sampled(drawing: Drawing, frame: GridFrame) -> ByteArray:
    """The map's cells under the pixels of a frame."""
    cells, own = drawing.grid.cells, drawing.grid.frame
    x, _ = frame.to_point(0, np.arange(frame.width_px))
    _, y = frame.to_point(np.arange(frame.height_px), 0)
    rows, cols = own.to_cell(x[:1].repeat(len(y)), y)[0], own.to_cell(x, y[:1].repeat(len(x)))[1]
    inside = ((rows >= 0) & (rows < own.height_px))[:, None] & ((cols >= 0) & (cols < own.width_px))[None]
    rows, cols = np.clip(rows, 0, own.height_px - 1), np.clip(cols, 0, own.width_px - 1)
    return np.where(inside, cells[rows[:, None], cols[None]], 205).astype(np.uint8)


def _draw_echoes(page: ByteArray, drawing: Drawing, frame: GridFrame) -> None:
    """The map's occupied cells, through which the walls stay visible."""
    occupied = _sampled(drawing, frame) == OCCUPIED
    page[occupied] = (0.45 * page[occupied] + 0.55 * np.array(_ECHO)).astype(np.uint8)


def _fill(
    page: ByteArray, shapes: Iterable[Polygon], colour: Colour, to_page: Callable[[FloatArray], np.ndarray]
) -> None:
    for shape in shapes:
        rings = [
            to_page(shapely.get_coordinates(ring))
            for part in shapely.get_parts(shape)
            if part.geom_type == "Polygon"
            for ring in (part.exterior, *part.interiors)
        ]
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


def _draw_dimension(
    page: ByteArray,
    start: DrawnPoint,
    end: DrawnPoint,
    text: str,
    to_page: Callable[[FloatArray], np.ndarray],
) -> None:
    """A thin line with its length a third of the way along."""
    _line(page, start, end, _DIMENSION, 1, to_page)
    at = np.array([start]) + 0.3 * (np.array([end]) - np.array([start]))
    col, row = (to_page(at)[0] >> SHIFT).tolist()
    draw_text(page, text, col + 3, row - 3, 0.38, _DIMENSION)


def _footer(drawing: Drawing, width: int, metres_per_px: float) -> ByteArray:
    strip = blank((CAPTION_PX, width), PAPER)
    right = draw_scale_bar(strip, (16, 22), metres_per_px, 0.25 * width)
    caption = f"{drawing.name}   {counted(len(drawing.rooms), 'room')}   {drawing.area:.1f} m2"
    draw_text(strip, caption, right + 24, 27, fitting_size(caption, 0.5, width - right - 40))
    if drawing.doubts:
        doubts = "; ".join(drawing.doubts)
        draw_text(strip, doubts, 16, 52, fitting_size(doubts, 0.45, width - 32), BELIEVED_COLOUR)
    return strip
