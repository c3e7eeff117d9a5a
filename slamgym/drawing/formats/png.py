"""A picture of the drawing over the map that it was made from."""

from collections.abc import Sequence

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, FloatArray, GridFrame
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import values_at
from slamgym.drawing.formats.look import DRAWN_COLOURS, KEY_HEIGHT, DrawnLabel, Sheet, drawn_scene
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    INK,
    PAPER,
    SHIFT,
    UNKNOWN_TINT,
    WHITE,
    blank,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
    text_width,
)

SIDE_PX = 1600
"""Longer side of the drawing."""
_TEXT_SIZE, _LETTER_PX = 0.4, 11.0
"""OpenCV's size of the text, and how high its letters are."""
_WIDTHS = {"dimension": 1, "bar": 2}
"""Of lines [px]; others are three wide."""


def draw_picture(drawing: Drawing, side_px: int = SIDE_PX) -> ByteArray:
    """Draw the map with the drawing on top, in the colours of the legend below: RGB, shape (rows, cols, 3).

    Its longer side has so many pixels, without the legend.
    """
    metres_per_px = max(Sheet.of(drawing.bounds, 0.0)[2:4]) / side_px
    sheet = Sheet.of(drawing.bounds, _LETTER_PX * metres_per_px)
    bottom, right = sheet.top - sheet.height, sheet.left + sheet.width
    frame = GridFrame.covering((sheet.left, bottom, right, sheet.top), metres_per_px)
    places = frame.to_points(*np.indices(frame.shape))
    cells = values_at(drawing.grid.cells, drawing.grid.frame, places, UNKNOWN)
    cells[-round(KEY_HEIGHT * _LETTER_PX) :] = FREE
    page = blank(frame.shape, UNKNOWN_TINT)
    page[cells == FREE] = PAPER

    def to_page(points: FloatArray) -> np.ndarray:
        return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)

    tints = {name: colour for name, (colour, _) in DRAWN_COLOURS.items()}
    words = f" - {drawing.name} - {counted(len(drawing.rooms), 'room')} - {drawing.area:.1f} m2"
    shapes, labels = drawn_scene(drawing, sheet, words, drawing.doubts, turned=False)
    for _, kind, shape, _ in shapes:
        if isinstance(shape, Polygon):
            rings = [to_page(shapely.get_coordinates(ring)) for ring in shapely.get_rings(shape)]
            cv2.fillPoly(page, rings, tints.get(kind, WHITE), cv2.LINE_AA, SHIFT)
    echoes = cells == OCCUPIED
    page[echoes] = (0.45 * page[echoes] + 0.55 * np.array(tints["echo"])).astype(np.uint8)
    for _, kind, shape, _ in shapes:
        if not isinstance(shape, Polygon):
            lines = [to_page(shapely.get_coordinates(line)) for line in shapely.get_parts(shape)]
            cv2.polylines(
                page, lines, False, tints.get(kind, INK), _WIDTHS.get(kind, 3), cv2.LINE_AA, SHIFT
            )
    return _written(
        page, [(label, *(to_page(np.array([label.at]))[0] >> SHIFT).tolist()) for label in labels]
    )


def _written(page: ByteArray, labels: Sequence[tuple[DrawnLabel, int, int]]) -> ByteArray:
    """A page with labels at columns and rows, each with a halo."""
    colours = {
        "number": DRAWN_COLOURS["door"][0],
        "size": DRAWN_COLOURS["dimension"][0],
        "doubts": BELIEVED_COLOUR,
    }
    texts = []
    for label, col, row in labels:
        words, size = label.words.replace("²", "2"), _TEXT_SIZE  # which fonts of OpenCV 4 lack
        if label.kind in ("start", "doubts"):
            size = fitting_size(words, size, page.shape[1] - col)
        else:
            col -= text_width(words, size) // 2
        texts.append(
            (words, col, row + round(0.4 * _LETTER_PX), size, colours.get(label.kind, INK))
        )
    halo = np.zeros_like(page)
    for text in texts:
        draw_text(halo, *text[:4], WHITE)
    page = np.maximum(page, cv2.dilate(halo, np.ones((3, 3), np.uint8)))
    for text in texts:
        draw_text(page, *text)
    return page
