"""Elements that all pictures share: colours, text, scale bars, paths, the fit into a panel, the file.

Pictures are RGB, shape (rows, cols, 3), until they are written.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import write_bytes
from slamgym.core.text import printable
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame, Int32Array

Colour = tuple[int, int, int]

WHITE: Colour = (255, 255, 255)
PAPER: Colour = (241, 243, 245)
INK: Colour = (52, 58, 64)
FAINT: Colour = (134, 142, 150)
OUTLINE: Colour = (225, 228, 232)
WALL_TINT: Colour = (33, 37, 41)
UNKNOWN_TINT: Colour = (206, 212, 218)
UNSEEN_TINT: Colour = (203, 218, 240)
TRUE_COLOUR: Colour = (25, 113, 194)
BELIEVED_COLOUR: Colour = (224, 49, 49)
SURE_COLOUR: Colour = (47, 158, 68)

FRAME_WIDTH = 1280
"""Width of the pictures of a film [px]; even, as video encoders want it."""
FRAME_HEIGHT = 720
"""Height of the pictures of a film [px]; even, as video encoders want it."""

SHIFT = 4
"""Fractional bits of drawing coordinates."""
_FONT = cv2.FONT_HERSHEY_DUPLEX
"""OpenCV's font of all words."""
_SMALLEST = 0.3
"""Size below which words can't be read."""


def blank(shape: tuple[int, ...], colour: Colour = WHITE) -> ByteArray:
    """An empty picture of so many rows and columns."""
    return np.full((*shape, 3), colour, dtype=np.uint8)


def draw_text(
    picture: ByteArray, text: str, left: int, baseline: int, size: float, colour: Colour = INK
) -> None:
    """Write a line into a picture."""
    words = printable(text)
    place = (left, baseline)
    cv2.putText(picture, words, place, _FONT, size, colour, 1, cv2.LINE_AA)


def text_width(text: str, size: float) -> int:
    """Width of a line [px]."""
    (width, _), _ = cv2.getTextSize(printable(text), _FONT, size, 1)
    return int(width)


def fitting_size(text: str, size: float, width: int) -> float:
    """The size, or a smaller one at which the line is no wider than so many pixels, as far as it can be read."""
    while size > _SMALLEST and text_width(text, size) > width:
        size -= 0.02
    return size


def with_heading(picture: ByteArray, heading: str, height: int = 40) -> ByteArray:
    """A picture below a line of text."""
    width = picture.shape[1]
    strip = blank((height, width))
    size = fitting_size(heading, 0.8, width - 24)
    draw_text(strip, heading, 12, height - 12, size)
    return np.vstack([strip, picture])


def draw_scale_bar(
    picture: ByteArray,
    place: tuple[int, int],
    metres_per_px: float,
    most_px: float,
    backed: bool = False,
) -> int:
    """Draw a bar of a round length with its length next to it.

    Args:
        picture: Changed in place.
        place: Left end of the bar (column, row).
        metres_per_px: Scale of the picture.
        most_px: Longest bar.
        backed: Whether to lighten what lies behind.

    Returns:
        The column where the text ends.
    """
    left, bottom = place
    length = round_length(metres_per_px * most_px)
    width = round(length / metres_per_px)
    label = f"{length:g} m"
    bar_end = left + width
    label_left = bar_end + 8
    right = label_left + text_width(label, 0.45)
    if backed:
        box = picture[bottom - 12 : bottom + 10, left - 6 : right + 6]
        white = np.full_like(box, 255)
        cv2.addWeighted(box, 0.2, white, 0.8, 0.0, dst=box)
    cv2.line(picture, (left, bottom), (bar_end, bottom), INK, 2)
    for end in (left, bar_end):
        cv2.line(picture, (end, bottom - 5), (end, bottom + 5), INK, 2)
    draw_text(picture, label, label_left, bottom + 5, 0.45)
    return right


def round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    positive = max(metres, 1e-6)
    power = 10.0 ** math.floor(math.log10(positive))
    most = metres * (1 + 1e-9)
    if 5.0 * power <= most:
        return 5.0 * power
    if 2.0 * power <= most:
        return 2.0 * power
    return power


def fixed_point(pixels: FloatArray) -> Int32Array:
    """Pixels (column, row), shape (N, 2), as OpenCV's drawing takes them with ``shift=SHIFT``."""
    drawable = np.clip(pixels, -1e6, 1e6)
    fixed = np.rint(drawable * (1 << SHIFT))
    return fixed.astype(np.int32)


def frame_pixels(points: FloatArray, frame: GridFrame, scale: float) -> FloatArray:
    """Points or poses (N, 2 or more) [m] as pixels of a picture in which a cell of the frame has ``scale`` pixels."""
    left, _, _, top = frame.bounds
    right = points[:, 0] - left
    down = top - points[:, 1]
    pixels_per_metre = scale / frame.resolution
    metres = np.column_stack([right, down])
    return metres * pixels_per_metre


def draw_lines(
    picture: ByteArray, lines: Sequence[np.ndarray], colour: Colour, thickness: int
) -> None:
    """Draw open lines of fixed-point pixels, each of shape (N, 2)."""
    cv2.polylines(picture, lines, False, colour, thickness, cv2.LINE_AA, SHIFT)


def draw_path(picture: ByteArray, pixels: np.ndarray, colour: Colour, thickness: int = 2) -> None:
    """Draw a path of fixed-point pixels, shape (N, 2), with a dot at its start."""
    draw_lines(picture, [pixels], colour, thickness)
    draw_dot(picture, pixels[0], 4, colour)


def draw_dot(picture: ByteArray, pixel: np.ndarray, radius_px: int, colour: Colour) -> None:
    """Draw a disc of a radius about a fixed-point pixel, shape (2,)."""
    centre = pixel.tolist()
    radius = radius_px << SHIFT
    cv2.circle(picture, centre, radius, colour, -1, cv2.LINE_AA, SHIFT)


def colour_cells(cells: ByteArray) -> ByteArray:
    """A map's cells as a picture of the same size."""
    picture = blank(cells.shape, UNKNOWN_TINT)
    picture[cells == FREE] = WHITE
    picture[cells == OCCUPIED] = WALL_TINT
    return picture


def rescaled(picture: ByteArray, factor: float) -> ByteArray:
    """A grey or RGB picture, sharp when it grows, averaged when it shrinks."""
    rows, cols = picture.shape[:2]
    width = round(cols * factor)
    height = round(rows * factor)
    size = (max(1, width), max(1, height))
    method = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_NEAREST
    scaled = cv2.resize(picture, size, interpolation=method)
    return np.asarray(scaled, dtype=np.uint8)


def fitted(picture: ByteArray, side: int) -> ByteArray:
    """A grey or RGB picture, scaled to fit a square of so many pixels; RGB."""
    if picture.ndim == 2:
        picture = np.dstack([picture] * 3)
    longer = max(picture.shape[:2])
    return rescaled(picture, side / longer)


def write_picture(path: Path, picture: ByteArray) -> None:
    """Write a grey or RGB picture whole or not at all, as JPEG where the file's name says so, else as PNG.

    Raises:
        InputFileError: If it can't be encoded or written.
    """
    is_jpeg = path.suffix.lower() in (".jpg", ".jpeg")
    suffix = ".jpg" if is_jpeg else ".png"
    is_grey = picture.ndim == 2
    as_opencv_has_it = picture if is_grey else picture[:, :, ::-1]
    encoded, data = cv2.imencode(suffix, as_opencv_has_it)
    if not encoded:
        raise InputFileError(path, "the picture can't be encoded; draw less on it, or smaller")
    write_bytes(path, data.tobytes())
