"""Pictures from outside, decoded only after their header has said how large they are.

A PNG of 4 MB can hold 900 million pixels. OpenCV has a limit of its own, but it counts no less than 2^30 pixels and
stands for the whole process.
"""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.limits import PIXELS

PICTURE_SUFFIXES = (".png", ".pgm", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""What pictures of maps and plans are called."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG's frame headers (ITU T.81, table B.1)."""
_STANDALONE = frozenset({0x01, *range(0xD0, 0xD9)})
"""Markers of a JPEG without a length."""
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
_TIFF_KINDS = {1: "B", 3: "H", 4: "I", 16: "Q"}


def decode_picture(
    where: object, encoded: bytes, flags: int, error: type[InputFileError] = InputFileError
) -> Any:
    """Decode a PNG, JPEG, BMP, PGM or TIFF picture.

    Args:
        where: The file, for errors.
        encoded: Its content.
        flags: OpenCV's ``IMREAD_...``.
        error: What to raise.

    Returns:
        The pixels, shape (rows, cols) or (rows, cols, channels).

    Raises:
        InputFileError: If it is none of these, damaged, or has more pixels than allowed.
    """
    import cv2

    size = picture_size(encoded)
    unreadable = error(where, "is not a picture that OpenCV can read (PNG, JPEG, BMP, PGM or TIFF)")
    if size is None:
        raise unreadable
    PIXELS.check(where, size[0] * size[1], error)
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # the error below says it in one sentence
    try:
        image = cv2.imdecode(np.frombuffer(encoded, np.uint8), flags)
    except cv2.error:
        image = None
    finally:
        logging.setLogLevel(level)
    if image is None or image.size == 0:
        raise unreadable
    return image


def picture_size(encoded: bytes) -> tuple[int, int] | None:
    """Width and height that a picture's header declares, the larger where it does so twice; None if it has none."""
    try:
        if encoded.startswith(b"\x89PNG\r\n\x1a\n"):
            width, height = struct.unpack_from(">II", encoded, 16)
        elif encoded.startswith(b"\xff\xd8"):
            width, height = _largest(_jpeg_frames(encoded))
        elif encoded.startswith(b"BM"):
            width, height = _bmp_size(encoded)
        elif encoded[:1] == b"P" and encoded[1:2] in b"1234567" and len(encoded) > 2:
            width, height = _netpbm_size(encoded)
        elif encoded[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            width, height = _tiff_size(encoded)
        else:
            return None
    except (struct.error, ValueError, OverflowError):
        return None
    return abs(width), abs(height)


def _bmp_size(encoded: bytes) -> tuple[int, int]:
    (header,) = struct.unpack_from("<I", encoded, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", encoded, 18)
    return width, height


def _netpbm_size(encoded: bytes) -> tuple[int, int]:
    """Of ``P5 width height ...`` with comments from # to the line's end, or of a PAM's ``WIDTH n``, ``HEIGHT n``."""
    head = encoded[2:65536]
    lines = [line.split(b"#")[0] for line in head.split(b"\n")]
    if encoded[1:2] == b"7":
        words = b" ".join(lines).split()
        width, height = (int(words[words.index(name) + 1][:20]) for name in (b"WIDTH", b"HEIGHT"))
    else:
        width, height = (int(word[:20]) for word in b" ".join(lines).split(maxsplit=2)[:2])
    return width, height


def _jpeg_frames(encoded: bytes) -> Iterator[tuple[int, int]]:
    """Width and height of every frame header before the first scan."""
    place = 2
    while place + 4 <= len(encoded):
        if encoded[place] != 0xFF:
            raise ValueError("no marker")
        marker = encoded[place + 1]
        if marker == 0xFF or marker in _STANDALONE:
            place += 1 if marker == 0xFF else 2
            continue
        if marker == 0xDA:
            return
        (length,) = struct.unpack_from(">H", encoded, place + 2)
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", encoded, place + 5)
            yield width, height
        place += 2 + max(length, 2)


def _tiff_size(encoded: bytes) -> tuple[int, int]:
    """Of the first directory, which is the one that OpenCV decodes."""
    order = "<" if encoded[:1] == b"I" else ">"
    big = encoded[2:4] in (b"+\0", b"\0+")
    (place,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", encoded, 8 if big else 4)
    (count,) = struct.unpack_from(f"{order}{'Q' if big else 'H'}", encoded, place)
    entries, step, value = place + (8 if big else 2), 20 if big else 12, 12 if big else 8
    found: dict[int, int] = {}
    for start in range(entries, min(entries + step * count, len(encoded)), step):
        tag, kind = struct.unpack_from(f"{order}HH", encoded, start)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            (number,) = struct.unpack_from(f"{order}{_TIFF_KINDS.get(kind, 'I')}", encoded, start + value)
            found[tag] = max(number, found.get(tag, 0))
    return _largest(iter([(found.get(_TIFF_WIDTH, 0), found.get(_TIFF_HEIGHT, 0))]))


def _largest(sizes: Iterator[tuple[int, int]]) -> tuple[int, int]:
    found = list(sizes)
    if not found or min(map(min, found)) < 1:
        raise ValueError("no size")
    return max(width for width, _ in found), max(height for _, height in found)
