"""A picture of the drawing over the map that it was made from."""

import cv2
import numpy as np
import shapely
from shapely import LineString, Polygon

from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, FloatArray, GridFrame
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import values_at
from slamgym.drawing.formats.look import DRAWN_COLOURS, LEGEND_ROWS, drawn_shapes, place_labels
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    INK,
    PAPER,
    SHIFT,
    UNKNOWN_TINT,
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

_TEXT_SIZE = 0.4


def draw_picture(drawing: Drawing, side_px: int = SIDE_PX) -> ByteArray:
    """Draw the map with the drawing on top, in the colours of the legend below.

    Args:
        drawing: What to draw.
        side_px: Longer side.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    min_x, min_y, max_x, max_y = drawing.bounds
    metres_per_px = (max(max_x - min_x, max_y - min_y) + 2 * PICTURE_MARGIN) / side_px
    frame = GridFrame.covering(drawing.bounds, metres_per_px, PICTURE_MARGIN)
    places = frame.to_points(*np.indices(frame.shape))
    cells = values_at(drawing.grid.cells, drawing.grid.frame, places, UNKNOWN)
    page = blank(frame.shape, UNKNOWN_TINT)
    page[cells == FREE] = PAPER

    def to_page(points: FloatArray) -> np.ndarray:
        return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)

    def draw_line(line: LineString, colour: Colour, width: int) -> None:
        ends = to_page(shapely.get_coordinates(line))
        cv2.polylines(page, [ends], False, colour, width, cv2.LINE_AA, SHIFT)

    tints = {name: colour for name, (colour, _) in DRAWN_COLOURS.items()}
    shapes = list(drawn_shapes(drawing))
    for _, kind, shape, _ in shapes:
        if isinstance(shape, Polygon):
            rings = [to_page(shapely.get_coordinates(ring)) for ring in shapely.get_rings(shape)]
            cv2.fillPoly(page, rings, tints.get(kind, WHITE), cv2.LINE_AA, SHIFT)
    echoes = cells == OCCUPIED
    page[echoes] = (0.45 * page[echoes] + 0.55 * np.array(tints["echo"])).astype(np.uint8)
    for _, kind, shape, _ in shapes:
        if isinstance(shape, LineString):
            draw_line(shape, tints[kind], 3)
    colours = {"name": INK, "number": tints["door"], "size": tints["dimension"]}
    height_px, letter_px = 22.5 * _TEXT_SIZE, 0.01 * text_width("R01 12.3 m" * 10, _TEXT_SIZE)
    labels, lines = place_labels(drawing, letter_px * metres_per_px, height_px * metres_per_px, turned=False)
    for line in lines:
        draw_line(LineString([line.start, line.end]), tints["dimension"], 1)
    texts = []
    for label in labels:
        words = label.words.replace("²", "2")  # which fonts of OpenCV 4 lack
        col, row = (to_page(np.array([label.at]))[0] >> SHIFT).tolist()
        left, baseline = col - text_width(words, _TEXT_SIZE) // 2, row + round(0.5 * height_px)
        texts.append((words, left, baseline, _TEXT_SIZE, colours[label.kind]))
    halo = np.zeros_like(page)
    for text in texts:
        draw_text(halo, *text[:4], WHITE)
    page = np.maximum(page, cv2.dilate(halo, np.ones((3, 3), np.uint8)))
    for text in texts:
        draw_text(page, *text)
    return np.vstack([page, _footer(drawing, page.shape[1], metres_per_px)])


def _footer(drawing: Drawing, width: int, metres_per_px: float) -> ByteArray:
    below = 20 * LEGEND_ROWS
    strip = blank((CAPTION_PX + below, width), PAPER)
    for number, (colour, words) in enumerate(DRAWN_COLOURS.values()):
        column, row = divmod(number, LEGEND_ROWS)
        left, bottom = 16 + column * 240, 22 + 20 * row
        cv2.rectangle(strip, (left, bottom - 9), (left + 12, bottom), colour, cv2.FILLED)
        draw_text(strip, words, left + 18, bottom, _TEXT_SIZE)
    right = draw_scale_bar(strip, (16, 22 + below), metres_per_px, 0.25 * width)
    caption = f"{drawing.name}   {counted(len(drawing.rooms), 'room')}   {drawing.area:.1f} m2"
    draw_text(strip, caption, right + 24, 27 + below, fitting_size(caption, 0.5, width - right - 40))
    if drawing.doubts:
        doubts = "; ".join(drawing.doubts)
        draw_text(strip, doubts, 16, 52 + below, fitting_size(doubts, 0.45, width - 32), BELIEVED_COLOUR)
    return strip
