"""One picture of many pairs: CAD map, SLAM map, and where the SLAM map's walls are wrong."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, FloatArray, GridFrame
from slamgym.metrics.map_error import wall_faces
from slamgym.metrics.maps import distance_to

PANEL_PX = 340
GAP_PX = 14
CAPTION_PX = 52
HEADER_PX = 92
ERROR_SCALE = 0.3
"""Distance to the nearest CAD wall that is drawn in full red [m]."""

_PAPER = (255, 255, 255)
_INK = (38, 43, 51)
_QUIET = (110, 118, 129)
_OUTSIDE = (238, 240, 243)
_UNSEEN = (205, 221, 242)
_BEYOND = (250, 226, 222)
_WALL_LINE = (150, 156, 164)
_PATH = (74, 124, 190)
# Green - yellow - red in equal steps of lightness, readable on white.
_ERROR_COLOURS = np.array(
    [(0, 128, 70), (166, 190, 40), (244, 165, 30), (225, 87, 40), (190, 18, 38)], dtype=np.float64
)


@dataclass(frozen=True)
class SheetEntry:
    """One pair on the sheet."""

    title: str
    details: str
    cad: ByteArray  # (rows, cols)
    slam: ByteArray  # (rows, cols)
    frame: GridFrame
    path: FloatArray  # (N, 2) estimated path [m], the frame's coordinates


def draw_contact_sheet(heading: str, entries: Sequence[SheetEntry], columns: int = 2) -> ByteArray:
    """Draw the pairs as cards of three panels: CAD map, SLAM map, both on top of each other.

    In the third panel the SLAM map's occupied cells are coloured by their distance to the nearest CAD wall,
    space that the robot never saw is blue, and free space seen beyond the walls is pink.

    Args:
        heading: The sheet's title.
        entries: The pairs, drawn row by row.
        columns: Cards beside each other.

    Returns:
        The picture, shape (rows, cols, 3), RGB.
    """
    columns = max(1, min(columns, len(entries)))
    rows = -(-len(entries) // columns)
    card_width = 3 * PANEL_PX + 2 * GAP_PX
    card_height = PANEL_PX + CAPTION_PX
    width = columns * card_width + (columns + 1) * 2 * GAP_PX
    height = HEADER_PX + rows * (card_height + 2 * GAP_PX)
    sheet = Image.new("RGB", (width, height), _PAPER)
    pen = ImageDraw.Draw(sheet)
    _draw_header(pen, heading, width)
    for number, entry in enumerate(entries):
        row, column = divmod(number, columns)
        left = 2 * GAP_PX + column * (card_width + 2 * GAP_PX)
        top = HEADER_PX + row * (card_height + 2 * GAP_PX)
        _draw_card(sheet, pen, entry, left, top)
    return np.asarray(sheet, dtype=np.uint8).copy()


def _draw_header(pen: ImageDraw.ImageDraw, heading: str, width: int) -> None:
    left = 2 * GAP_PX
    pen.text((left, 18), heading, fill=_INK, font=_font(26))
    pen.text(
        (left, 56),
        "CAD map   |   SLAM map   |   SLAM walls over CAD walls, coloured by their distance",
        fill=_QUIET,
        font=_font(16),
    )
    bar_width = 180
    bar_left = width - left - bar_width - 60
    if bar_left < 760:
        return
    for x in range(bar_width):
        colour = tuple(int(c) for c in error_colour(np.array([x / bar_width * ERROR_SCALE]))[0])
        pen.line([(bar_left + x, 58), (bar_left + x, 72)], fill=colour)
    pen.text((bar_left - 12, 56), "0", fill=_QUIET, font=_font(16), anchor="ra")
    pen.text((bar_left + bar_width + 8, 56), f"{ERROR_SCALE:g} m", fill=_QUIET, font=_font(16))


def _draw_card(sheet: Image.Image, pen: ImageDraw.ImageDraw, entry: SheetEntry, left: int, top: int) -> None:
    panels = (_grey(entry.cad), _grey(entry.slam), draw_overlay(entry))
    for number, panel in enumerate(panels):
        x = left + number * (PANEL_PX + GAP_PX)
        fitted = _fit(panel, PANEL_PX)
        offset_y, offset_x = (PANEL_PX - fitted.shape[0]) // 2, (PANEL_PX - fitted.shape[1]) // 2
        corner = panel[0, 0]
        pen.rectangle([x, top, x + PANEL_PX - 1, top + PANEL_PX - 1], fill=tuple(int(c) for c in corner))
        sheet.paste(Image.fromarray(fitted), (x + offset_x, top + offset_y))
    pen.text((left, top + PANEL_PX + 6), entry.title, fill=_INK, font=_font(17))
    pen.text((left, top + PANEL_PX + 29), entry.details, fill=_QUIET, font=_font(15))


def draw_overlay(entry: SheetEntry) -> ByteArray:
    """Draw the SLAM map over the CAD map, shape (2 rows, 2 cols, 3), RGB, at twice the maps' size."""
    inside = entry.cad == FREE
    colours = np.full((*entry.cad.shape, 3), _OUTSIDE, dtype=np.uint8)
    colours[inside] = _PAPER
    colours[inside & (entry.slam == UNKNOWN)] = _UNSEEN
    colours[~inside & (entry.slam == FREE)] = _BEYOND
    faces = wall_faces(inside)
    colours[faces] = _WALL_LINE
    occupied = entry.slam == OCCUPIED
    distance = distance_to(faces) * entry.frame.resolution
    colours[occupied] = error_colour(distance[occupied])
    large = np.repeat(np.repeat(colours, 2, axis=0), 2, axis=1)
    _draw_path(large, entry)
    return large


def _draw_path(picture: ByteArray, entry: SheetEntry) -> None:
    """Draw the estimated path, antialiased, in place."""
    frame = entry.frame
    x = (entry.path[:, 0] - frame.origin_x) / frame.resolution
    y = frame.height_px - (entry.path[:, 1] - frame.origin_y) / frame.resolution
    points = np.round(np.column_stack([x, y]) * 2.0 * 16.0).astype(np.int32)  # 4 bits of fraction
    cv2.polylines(
        picture,
        [points.reshape(-1, 1, 2)],
        isClosed=False,
        color=_PATH,
        thickness=1,
        lineType=cv2.LINE_AA,
        shift=4,
    )


def error_colour(distance: FloatArray) -> ByteArray:
    """The colour of a wall error, shape (N, 3), for distances [m], shape (N,)."""
    place = np.clip(distance / ERROR_SCALE, 0.0, 1.0) * (len(_ERROR_COLOURS) - 1)
    steps = np.arange(len(_ERROR_COLOURS))
    return np.stack([np.interp(place, steps, channel) for channel in _ERROR_COLOURS.T], axis=-1).astype(
        np.uint8
    )


def _grey(image: ByteArray) -> ByteArray:
    return np.repeat(image[:, :, None], 3, axis=2)


def _fit(picture: ByteArray, side: int) -> ByteArray:
    """Scale a picture to fit a square: sharp when it grows, averaged when it shrinks."""
    rows, cols = picture.shape[:2]
    scale = side / max(rows, cols)
    size = (max(1, round(cols * scale)), max(1, round(rows * scale)))
    fitted: ByteArray = cv2.resize(
        picture, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    )
    return fitted


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
