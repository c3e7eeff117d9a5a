"""Elements that all pictures share: colours, text, scale bars, paths, the fit into a panel, the file.

Pictures are RGB, shape (rows, cols, 3), until they are written.
"""

import math
from pathlib import Path

import cv2
import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import write_bytes
from slamgym.core.text import printable
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame

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

FRAME_WIDTH, FRAME_HEIGHT = 1280, 720
"""Size of the pictures of a film [px]; even, as video encoders want it."""

SHIFT = 4
"""Fractional bits of drawing coordinates."""
_FONT = cv2.FONT_HERSHEY_DUPLEX
_SMALLEST = 0.3


def blank(shape: tuple[int, ...], colour: Colour = WHITE) -> ByteArray:
    """An empty picture of so many rows and columns."""
    return np.full((*shape, 3), colour, dtype=np.uint8)


def draw_text(
    picture: ByteArray, text: str, left: int, baseline: int, size: float, colour: Colour = INK
) -> None:
    """Write a line into a picture."""
    cv2.putText(picture, printable(text), (left, baseline), _FONT, size, colour, 1, cv2.LINE_AA)


def text_width(text: str, size: float) -> int:
    """Width of a line [px]."""
    return int(cv2.getTextSize(printable(text), _FONT, size, 1)[0][0])


def fitting_size(text: str, size: float, width: int) -> float:
    """The size, or a smaller one at which the line is no wider than so many pixels, as far as it can be read."""
    while size > _SMALLEST and text_width(text, size) > width:
        size -= 0.02
    return size


def with_heading(picture: ByteArray, heading: str, height: int = 40) -> ByteArray:
    """A picture below a line of text."""
    strip = blank((height, picture.shape[1]))
    draw_text(strip, heading, 12, height - 12, fitting_size(heading, 0.8, picture.shape[1] - 24))
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
    right = left + width + 8 + text_width(label, 0.45)
    if backed:
        box = picture[bottom - 12 : bottom + 10, left - 6 : right + 6]
        cv2.addWeighted(box, 0.2, np.full_like(box, 255), 0.8, 0.0, dst=box)
    cv2.line(picture, (left, bottom), (left + width, bottom), INK, 2)
    for end in (left, left + width):
        cv2.line(picture, (end, bottom - 5), (end, bottom + 5), INK, 2)
    draw_text(picture, label, left + width + 8, bottom + 5, 0.45)
    return right


def round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    power = 10.0 ** math.floor(math.log10(max(metres, 1e-6)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= metres * (1 + 1e-9))


def fixed_point(pixels: FloatArray) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
    """Pixels (column, row), shape (N, 2), as OpenCV's drawing takes them with ``shift=SHIFT``."""
    return np.rint(np.clip(pixels, -1e6, 1e6) * (1 << SHIFT)).astype(np.int32)


def frame_pixels(points: FloatArray, frame: GridFrame, scale: float) -> FloatArray:
    """Points or poses (N, 2 or more) [m] as pixels of a picture in which a cell of the frame has ``scale`` pixels."""
    left, _, _, top = frame.bounds
    return np.column_stack([points[:, 0] - left, top - points[:, 1]]) * (scale / frame.resolution)


def draw_path(picture: ByteArray, pixels: np.ndarray, colour: Colour, thickness: int = 2) -> None:
    """Draw a path of fixed-point pixels, shape (N, 2), with a dot at its start."""
    cv2.polylines(picture, [pixels], False, colour, thickness, cv2.LINE_AA, SHIFT)
    start = int(pixels[0, 0]), int(pixels[0, 1])
    cv2.circle(picture, start, 4 << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)


def colour_cells(cells: ByteArray) -> ByteArray:
    """A map's cells as a picture of the same size."""
    picture = blank(cells.shape, UNKNOWN_TINT)
    picture[cells == FREE] = WHITE
    picture[cells == OCCUPIED] = WALL_TINT
    return picture


def rescaled(picture: ByteArray, factor: float) -> ByteArray:
    """A grey or RGB picture, sharp when it grows, averaged when it shrinks."""
    rows, cols = picture.shape[:2]
    size = (max(1, round(cols * factor)), max(1, round(rows * factor)))
    method = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, size, interpolation=method), dtype=np.uint8)


def fitted(picture: ByteArray, side: int) -> ByteArray:
    """A grey or RGB picture, scaled to fit a square of so many pixels; RGB."""
    rgb = np.repeat(picture[:, :, None], 3, axis=2) if picture.ndim == 2 else picture
    return rescaled(rgb, side / max(rgb.shape[:2]))


def write_picture(path: Path, picture: ByteArray) -> None:
    """Write a grey or RGB picture whole or not at all, as JPEG where the file's name says so, else as PNG.

    Raises:
        InputFileError: If it can't be encoded or written.
    """
    suffix = ".jpg" if path.suffix.lower() in (".jpg", ".jpeg") else ".png"
    encoded, data = cv2.imencode(suffix, picture if picture.ndim == 2 else picture[:, :, ::-1])
    if not encoded:
        raise InputFileError(path, "the picture can't be encoded; draw less on it, or smaller")
    write_bytes(path, data.tobytes())
