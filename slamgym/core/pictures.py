"""Pictures from outside, decoded only after their header has said how large they are.

A PNG of 4 MB can hold 900 million pixels. Pillow reads headers and pixels apart; its own limit stands for the whole
process, so its readers are called directly, and each only for what begins as its format does.
"""

import importlib
import io
import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.limits import PIXELS
from slamgym.core.picture_parts import check_parts
from slamgym.core.types import BoolArray, ByteArray

PICTURE_SUFFIXES = (".png", ".pgm", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""Suffixes of pictures of maps and plans."""
_READERS = {
    b"\x89PNG\r\n\x1a\n": "Png", b"\xff\xd8": "Jpeg", b"BM": "Bmp", b"II*\0": "Tiff", b"MM\0*": "Tiff",
    **dict.fromkeys((b"P1", b"P2", b"P3", b"P4", b"P5", b"P6"), "Ppm"),
}  # fmt: skip
"""Pillow's names of the formats, by how files begin."""
_ORIENTATION = 274
_DAMAGED = (
    OSError, SyntaxError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, struct.error,
    zlib.error, RuntimeError, MemoryError, AssertionError,
)  # fmt: skip
"""Errors that Pillow raises over damaged pictures."""


def decode_picture(
    where: object,
    encoded: bytes,
    error: type[InputFileError] = InputFileError,
    *,
    upright: bool = False,
) -> Any:
    """Decode a PNG, JPEG, BMP, PGM or TIFF picture.

    Args:
        where: The file, for errors.
        encoded: Its content.
        error: What to raise.
        upright: Turn it as its camera asks; map_server doesn't.

    Returns:
        The pixels, shape (rows, cols) or (rows, cols, channels), of 8 or 16 bits from black to white. Channels are red,
        green and blue where there are more than two, and the last of two or four is the opacity.

    Raises:
        InputFileError: If it is none of these, damaged, several pictures, or has more pixels than allowed.
    """
    from PIL import Image

    unreadable = error(
        where, "is not a picture that can be read (PNG, JPEG, BMP, PGM or TIFF), or is damaged"
    )
    reader = next((_READERS[magic] for magic in _READERS if encoded.startswith(magic)), None)
    if reader is None:
        raise unreadable
    module = importlib.import_module(f"PIL.{reader}ImagePlugin")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the error says it in one sentence
        pixels = None
        try:
            check_parts(where, encoded, reader, error)
            image = getattr(module, f"{reader}ImageFile")(io.BytesIO(encoded))
            PIXELS.check(where, image.width * image.height, error)
            if image.mode in ("I", "F") and reader != "Ppm":
                raise error(
                    where, "has numbers of 32 bits for pixels; save it with 8 bits per channel"
                )
            if reader == "Ppm" and _is_binary(image):
                return _netpbm_pixels(image, encoded)
            image.load()
            pixels = _pixels(_turned(image) if upright else image)
            image.seek(1)
        except EOFError:  # as it should be: there is no second one
            if pixels is None:
                raise unreadable from None
            return pixels
        except (*_DAMAGED, Image.DecompressionBombError):
            raise unreadable from None
    raise error(where, "holds several pictures; save one alone")


def grey_picture(pixels: Any) -> tuple[ByteArray, BoolArray]:
    """The pixels of :func:`decode_picture` as greys, which are the mean of the colours, and where it is transparent."""
    if pixels.dtype == np.uint16:
        pixels = np.rint(pixels / 257.0).astype(np.uint8)
    transparent = np.zeros(pixels.shape[:2], np.bool_)
    if pixels.ndim == 3:
        if pixels.shape[2] in (2, 4):
            transparent = pixels[:, :, -1] < 128
            pixels = pixels[:, :, :-1]
        pixels = np.rint(pixels.mean(axis=2)).astype(np.uint8)
    return pixels, transparent


def _is_binary(image: Any) -> bool:
    """True for a PGM or PPM whose pixels are stored as bytes."""
    return image.mode != "1" and bool(image.tile) and image.tile[0][0] in ("raw", "ppm")


def _turned(image: Any) -> Any:
    """The picture as its camera asks (Exif, tag 274), without reading the rest of what the camera says."""
    from PIL.Image import Exif, Transpose

    description = Exif()
    description.load(image.info.get("exif", b""))
    asked = getattr(image, "tag_v2", description).get(_ORIENTATION)
    turns = {
        2: Transpose.FLIP_LEFT_RIGHT,
        3: Transpose.ROTATE_180,
        4: Transpose.FLIP_TOP_BOTTOM,
        5: Transpose.TRANSPOSE,
        6: Transpose.ROTATE_270,
        7: Transpose.TRANSVERSE,
        8: Transpose.ROTATE_90,
    }
    return image.transpose(turns[asked]) if asked in turns else image


def _pixels(image: Any) -> Any:
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PPM"):
        return np.asarray(image).astype(np.uint16)
    mode = "L" if image.mode in ("1", "L", "LA") else "RGB"
    return np.asarray(image.convert(mode + "A" * image.has_transparency_data))


def _netpbm_pixels(image: Any, encoded: bytes) -> Any:
    """Pixels of a binary PGM or PPM with any number for white: Pillow takes a microsecond a pixel for most.

    Raises:
        ValueError: If it has too few bytes, or more than pixels: they would be shifted.
    """
    codec, _, start, arguments = image.tile[0]
    white = 65535 if image.mode == "I" else 255
    if codec == "ppm":
        white = arguments[1]
    is_small = white < 256
    full = 255 if is_small else 65535
    shape = (image.height, image.width, len(image.getbands()))
    stored = np.frombuffer(encoded, "u1" if is_small else ">u2", math.prod(shape), start)
    if encoded[start + stored.nbytes :].strip():
        raise ValueError("bytes after the last pixel")
    pixels: Any = stored.reshape(shape if shape[2] > 1 else shape[:2])
    if white != full:
        pixels = np.rint(np.minimum(pixels, white) * (full / white))
    return pixels.astype(np.uint8 if is_small else np.uint16)


def encode_png(image: ByteArray) -> bytes:
    """The content of a PNG file, of shape (rows, cols) or (rows, cols, 3) in OpenCV's order of channels."""
    import cv2

    return bytes(cv2.imencode(".png", image)[1])


def read_png(path: Path) -> ByteArray:
    """Read a picture as :func:`decode_picture` does.

    Raises:
        InputFileError: If it is missing, no picture, or larger than allowed.
    """
    return decode_picture(path, read_bytes(path))
