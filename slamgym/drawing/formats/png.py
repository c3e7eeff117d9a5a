"""A picture of the drawing over the map that it was made from, upright."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.geometry import unit_vectors
from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, FloatArray, GridFrame
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.look import (
    DRAWN_COLOURS,
    KEY_HEIGHT,
    DrawnLabel,
    DrawnShape,
    Sheet,
    drawn_scene,
)
from slamgym.drawing.formats.upright import turn_deg, upright
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    INK,
    PAPER,
    SHIFT,
    UNKNOWN_TINT,
    WHITE,
    Colour,
    blank,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
    text_width,
)

SIDE_PX = 1600
"""Longer side of the drawing."""
_TEXT_SIZE = 0.7
"""OpenCV's size of the text: readable where the picture is shown half as large."""
_LETTER_PX = 19.0
"""Height of letters of that size [px]."""
_WIDTHS = {"dimension": 1, "bar": 2}
"""Of lines [px]; others are three wide."""
_TINTS = {name: colour for name, (colour, _) in DRAWN_COLOURS.items()}
"""Colours of shapes by their kind; areas of other kinds are white, lines dark."""
_LABEL_COLOURS = {
    "number": DRAWN_COLOURS["door"][0],
    "size": DRAWN_COLOURS["dimension"][0],
    "doubts": BELIEVED_COLOUR,
}
"""Colours of labels by their kind; others are dark."""


def draw_picture(drawing: Drawing, side_px: int = SIDE_PX) -> ByteArray:
    """Draw the map with the drawing on top, in the colours of the legend below: RGB, shape (rows, cols, 3).

    Its longer side has so many pixels, without the legend.
    """
    shown = upright(drawing)
    unlabelled = Sheet.of(shown.bounds, 0.0)
    metres_per_px = max(unlabelled.width, unlabelled.height) / side_px
    sheet = Sheet.of(shown.bounds, _LETTER_PX * metres_per_px)
    frame = _frame(sheet, metres_per_px)
    cells = _cells_below(drawing, frame)
    words = f" - {drawing.name} - {counted(len(drawing.rooms), 'room')} - {drawing.area:.1f} m2"
    shapes, labels = drawn_scene(shown, sheet, words, drawing.doubts, turned=False)
    page = blank(frame.shape, UNKNOWN_TINT)
    page[cells == FREE] = PAPER
    _fill_areas(page, shapes, frame)
    echoes = cells == OCCUPIED
    echo_tint = np.array(_TINTS["echo"])
    page[echoes] = (0.45 * page[echoes] + 0.55 * echo_tint).astype(np.uint8)
    _draw_lines(page, shapes, frame)
    return _written(page, labels, frame)


def _frame(sheet: Sheet, metres_per_px: float) -> GridFrame:
    """A frame whose cells are the pixels of a sheet."""
    bottom = sheet.top - sheet.height
    right = sheet.left + sheet.width
    return GridFrame.covering((sheet.left, bottom, right, sheet.top), metres_per_px)


def _cells_below(drawing: Drawing, frame: GridFrame) -> ByteArray:
    """The map's cells under the pixels of a picture; free below the legend."""
    corners = frame.to_points(np.array([0, 0, 1]), np.array([0, 1, 0]))
    back = np.radians(-turn_deg(drawing))
    places = corners @ unit_vectors(np.array([back, back + 0.5 * np.pi]))
    first, right, down = frame_pixels(places, drawing.grid.frame, 1.0) - 0.5
    to_map = np.column_stack([right - first, down - first, first])
    nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    cells = cv2.warpAffine(
        drawing.grid.cells, to_map, frame.shape[::-1], flags=nearest, borderValue=UNKNOWN
    )
    legend_px = round(KEY_HEIGHT * _LETTER_PX)
    cells[-legend_px:] = FREE
    return cells


def _to_page(points: FloatArray, frame: GridFrame) -> np.ndarray:
    """Points of the map [m] as fixed-point pixels."""
    return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)


def _fill_areas(page: ByteArray, shapes: Sequence[DrawnShape], frame: GridFrame) -> None:
    """Fill the areas among shapes."""
    for drawn in shapes:
        if isinstance(drawn.shape, Polygon):
            rings = shapely.get_rings(drawn.shape)
            outlines = [_to_page(shapely.get_coordinates(ring), frame) for ring in rings]
            cv2.fillPoly(page, outlines, _TINTS.get(drawn.kind, WHITE), cv2.LINE_AA, SHIFT)


def _draw_lines(page: ByteArray, shapes: Sequence[DrawnShape], frame: GridFrame) -> None:
    """Draw the lines among shapes."""
    for drawn in shapes:
        if not isinstance(drawn.shape, Polygon):
            parts = shapely.get_parts(drawn.shape)
            lines = [_to_page(shapely.get_coordinates(part), frame) for part in parts]
            tint = _TINTS.get(drawn.kind, INK)
            width = _WIDTHS.get(drawn.kind, 3)
            cv2.polylines(page, lines, False, tint, width, cv2.LINE_AA, SHIFT)


class _Text(NamedTuple):
    """A line of text in pixels."""

    words: str
    left: int
    baseline: int
    size: float
    colour: Colour


def _written(page: ByteArray, labels: Sequence[DrawnLabel], frame: GridFrame) -> ByteArray:
    """A page with labels, each with a halo."""
    texts = []
    for label in labels:
        place = _to_page(np.array([label.at]), frame)[0]
        col, row = (place >> SHIFT).tolist()
        texts.append(_text(label, col, row, page.shape[1]))
    halo = np.zeros_like(page)
    for text in texts:
        draw_text(halo, text.words, text.left, text.baseline, text.size, WHITE)
    around = np.ones((3, 3), np.uint8)
    page = np.maximum(page, cv2.dilate(halo, around))
    for text in texts:
        draw_text(page, text.words, text.left, text.baseline, text.size, text.colour)
    return page


def _text(label: DrawnLabel, col: int, row: int, page_width: int) -> _Text:
    """A label at a column and row of a page so many pixels wide."""
    words = label.words.replace("²", "2")  # which fonts of OpenCV 4 lack
    baseline = row + round(0.4 * _LETTER_PX)
    colour = _LABEL_COLOURS.get(label.kind, INK)
    if label.kind in ("start", "doubts"):
        size = fitting_size(words, _TEXT_SIZE, page_width - col)
        return _Text(words, col, baseline, size, colour)
    left = col - text_width(words, _TEXT_SIZE) // 2
    return _Text(words, left, baseline, _TEXT_SIZE, colour)
