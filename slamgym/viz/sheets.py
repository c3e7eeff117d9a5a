"""Sheets: cards of panels over lines of text; and the panels that show errors: maps laid over each other, paths."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray, GridFrame
from slamgym.metrics.map_error import wall_faces
from slamgym.metrics.maps import distance_to
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    FAINT,
    INK,
    OUTLINE,
    PAPER,
    TRUE_COLOUR,
    UNSEEN_TINT,
    WHITE,
    Colour,
    blank,
    draw_path,
    draw_text,
    fitted,
    fitting_size,
    fixed_point,
    frame_pixels,
    text_width,
    with_heading,
)

GAP_PX = 12
"""Between panels, and round them."""
LINE_PX = 22
"""Height of a line of text below a card."""
PAIR_PX = 340
"""Panels of a contact sheet."""
GRID_PX = 256
"""Panels of a grid."""
ROWS_IN_A_BLOCK = 8
"""A grid of more rows stands in two blocks."""
MAX_COLUMNS_OF_TWO_BLOCKS = 6
"""A grid of more columns stands in one block."""

ERROR_SCALE = 0.3
"""Distance to the nearest CAD wall that is drawn in full red [m]."""

_BEYOND: Colour = (250, 226, 222)
"""Colour of free space seen beyond the walls."""
_ESTIMATE: Colour = (74, 124, 190)
"""Colour of the estimated path."""
# Green - yellow - red in equal steps of lightness, readable on white.
_ERROR_COLOURS = np.array(
    [(0, 128, 70), (166, 190, 40), (244, 165, 30), (225, 87, 40), (190, 18, 38)], dtype=np.float64
)


class Card(NamedTuple):
    """Pictures side by side above lines of text."""

    panels: Sequence[ByteArray]
    """(H, W) grey or (H, W, 3) RGB, any size."""
    lines: Sequence[str] = ()


def draw_sheet(
    cards: Sequence[Card], columns: int, panel_px: int, titles: Sequence[str] = ()
) -> ByteArray:
    """Draw cards row by row.

    Args:
        cards: At least one, all with as many panels.
        columns: Cards side by side, if there are so many.
        panel_px: Side of the squares that panels are scaled to.
        titles: What stands over the panels of every column of cards.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    columns = max(1, min(columns, len(cards)))
    rows = math.ceil(len(cards) / columns)
    step = panel_px + GAP_PX
    panels = len(cards[0].panels)
    width = panels * step + GAP_PX
    lines = max(len(card.lines) for card in cards)
    height = step + LINE_PX * lines + GAP_PX // 2
    top = LINE_PX + 4 if titles else 0
    full_height = top + height * rows
    full_width = width * columns
    sheet = blank((full_height, full_width))
    for column in range(columns):
        for number, title in enumerate(titles):
            left = column * width + GAP_PX + number * step
            size = fitting_size(title, 0.5, panel_px)
            draw_text(sheet, title, left, top - 2, size)
    for number, card in enumerate(cards):
        row, column = divmod(number, columns)
        y = top + row * height
        x = column * width
        area = sheet[y : y + height, x : x + width]
        _draw_card(area, card, panel_px)
    return sheet


def _draw_card(area: ByteArray, card: Card, panel_px: int) -> None:
    bottom = GAP_PX + panel_px
    for number, panel in enumerate(card.panels):
        left = GAP_PX + number * (panel_px + GAP_PX)
        right = left + panel_px
        picture = fitted(panel, panel_px)
        rows, cols = picture.shape[:2]
        y = (panel_px - rows) // 2
        x = (panel_px - cols) // 2
        square = area[GAP_PX:bottom, left:right]
        square[:] = picture[0, 0]
        square[y : y + rows, x : x + cols] = picture
        corner = (left - 1, GAP_PX - 1)
        opposite = (right, bottom)
        cv2.rectangle(area, corner, opposite, OUTLINE, 1)
    room = area.shape[1] - 2 * GAP_PX
    for number, line in enumerate(card.lines):
        baseline = bottom + LINE_PX * (number + 1) - 5
        is_first = number == 0
        largest = 0.5 if is_first else 0.45
        colour = INK if is_first else FAINT
        size = fitting_size(line, largest, room)
        draw_text(area, line, GAP_PX, baseline, size, colour)


def draw_grid(
    titles: Sequence[str], rows: Sequence[Sequence[ByteArray]], captions: Sequence[str] = ()
) -> ByteArray:
    """Draw pictures in a grid with a title over each column; many rows of few columns stand in two blocks.

    Args:
        titles: Over the columns.
        rows: At least one; each with one picture per column: (H, W) grey or (H, W, 3) RGB, any size.
        captions: A line under each row.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    is_long = len(rows) > ROWS_IN_A_BLOCK
    is_narrow = len(titles) <= MAX_COLUMNS_OF_TWO_BLOCKS
    blocks = 2 if is_long and is_narrow else 1
    cards = []
    for number, row in enumerate(rows):
        lines = captions[number : number + 1]
        cards.append(Card(row, lines))
    return draw_sheet(cards, blocks, GRID_PX, titles)


@dataclass(frozen=True)
class SheetEntry:
    """One pair on a contact sheet."""

    title: str
    details: str
    cad: ByteArray  # (rows, cols)
    slam: ByteArray  # (rows, cols)
    frame: GridFrame
    path: FloatArray  # (N, 2) estimated path [m], the frame's coordinates


def draw_contact_sheet(heading: str, entries: Sequence[SheetEntry], columns: int = 2) -> ByteArray:
    """Draw pairs as cards of three panels: CAD map, SLAM map, and where the SLAM map's walls are wrong.

    Args:
        heading: The sheet's title.
        entries: The pairs, at least one, drawn row by row.
        columns: Cards side by side.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    cards = []
    for entry in entries:
        errors = draw_wall_errors(entry.cad, entry.slam, entry.frame, entry.path)
        panels = [entry.cad, entry.slam, errors]
        lines = [entry.title, entry.details]
        cards.append(Card(panels, lines))
    titles = ["CAD map", "SLAM map", "SLAM walls by their distance to CAD walls"]
    sheet = draw_sheet(cards, columns, PAIR_PX, titles)
    sheet = with_heading(sheet, heading)
    _draw_error_scale(sheet)
    return sheet


def _draw_error_scale(sheet: ByteArray) -> None:
    """Draw the legend for the colours of errors, in the upper right corner."""
    label = f"{ERROR_SCALE:g} m"
    width = text_width(label, 0.45)
    right = sheet.shape[1] - GAP_PX - width
    draw_text(sheet, label, right, 28, 0.45, FAINT)
    bar = sheet[15:29, right - 188 : right - 8]
    distances = np.linspace(0.0, ERROR_SCALE, bar.shape[1])
    bar[:] = error_colour(distances)
    draw_text(sheet, "0", right - 204, 28, 0.45, FAINT)


def draw_wall_errors(
    cad: ByteArray, slam: ByteArray, frame: GridFrame, path: FloatArray
) -> ByteArray:
    """Draw a SLAM map over the CAD map, at twice the maps' size.

    Occupied cells are coloured by their distance to the nearest CAD wall, space that the robot never saw is blue,
    and free space seen beyond the walls is pink.

    Args:
        cad: (rows, cols).
        slam: (rows, cols).
        frame: Of both.
        path: The estimated path (N, 2 or more), in the frame [m].

    Returns:
        RGB, shape (2 rows, 2 cols, 3).
    """
    inside = cad == FREE
    faces = wall_faces(inside)
    picture = blank(cad.shape, PAPER)
    picture[inside] = WHITE
    picture[inside & (slam == UNKNOWN)] = UNSEEN_TINT
    picture[~inside & (slam == FREE)] = _BEYOND
    picture[faces] = FAINT
    occupied = slam == OCCUPIED
    away = distance_to(faces) * frame.resolution
    picture[occupied] = error_colour(away[occupied])
    higher = np.repeat(picture, 2, axis=0)
    picture = np.repeat(higher, 2, axis=1)
    if len(path):
        pixels = frame_pixels(path, frame, 2.0)
        draw_path(picture, fixed_point(pixels), _ESTIMATE, thickness=1)
    return picture


def draw_agreement(free: BoolArray, truth: BoolArray) -> ByteArray:
    """The agreement of two masks: white free in both, red only in the map, blue only in the CAD map.

    Args:
        free: (H, W), placed on the truth.
        truth: (H, W).

    Returns:
        RGB, shape (H, W, 3).
    """
    picture = blank(truth.shape, (0, 0, 0))
    picture[free & truth] = WHITE
    picture[truth & ~free] = TRUE_COLOUR
    picture[free & ~truth] = BELIEVED_COLOUR
    return picture


def error_colour(distance: FloatArray) -> ByteArray:
    """The colour of a wall error, shape (N, 3), for distances [m], shape (N,)."""
    count = len(_ERROR_COLOURS)
    share = np.clip(distance / ERROR_SCALE, 0.0, 1.0)
    place = share * (count - 1)
    steps = np.arange(count)
    channels = [np.interp(place, steps, channel) for channel in _ERROR_COLOURS.T]
    colours = np.stack(channels, axis=-1)
    return colours.astype(np.uint8)
