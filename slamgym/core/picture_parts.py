"""What the parts of a picture stand for, told before Pillow reads them: it would go over them again and again.

A JPEG can have a pass of all pixels in a few bytes; the fields of a TIFF, and of the description in a photograph, can
all be the same bytes; a PNG can have any number of colour profiles.
"""

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.limits import ENTRIES, PIXELS

MOST_SCANS = 100
"""Passes in which a JPEG draws its pixels; progressive ones have a dozen, and each costs as much as a plain picture."""
_SCAN = b"\xff\xda"
"""Begins a pass; pixels hold no such bytes."""
_EXIF = b"Exif\0\0"
_APP1 = 0xE1
_START_OF_SCAN = 0xDA
_FIELD = [("tag", "u2"), ("kind", "u2"), ("count", "u4"), ("value", "u4")]
"""Of the directory of a TIFF (revision 6.0, section 2)."""
_FIELD_BYTES = np.array([0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8])
"""Bytes of one value, by the kind of a field."""
_SHORT = 3
_TILE_SIDES = (322, 323)
_COMPRESSION = 259
_JPEG_COMPRESSIONS = (6, 7)


class _Directory(NamedTuple):
    """What the first directory of a TIFF claims."""

    bytes: int
    """Of all fields together."""
    tile: int
    """Pixels that are decoded at once."""
    is_jpeg: bool
    is_last: bool


def check_parts(
    where: object, encoded: bytes, reader: str, error: type[InputFileError] = InputFileError
) -> None:
    """Refuse a picture whose parts stand for more than its size.

    Args:
        where: The file, for errors.
        encoded: Its content.
        reader: Pillow's name of its format.
        error: What to raise.

    Raises:
        InputFileError: If it has too many passes, profiles or descriptions, or fields larger than itself.
    """
    descriptions: list[bytes] = []
    profiles = 0
    if reader == "Png":
        for number, (kind, content) in enumerate(_chunks(encoded)):
            ENTRIES.check(where, number, error)
            profiles += kind == b"iCCP"
            if kind == b"eXIf":
                descriptions.append(content)
    elif reader == "Jpeg":
        descriptions = list(_descriptions(encoded))
    if profiles > 1 or len(descriptions) > 1:
        raise error(where, "has several colour profiles or descriptions; save it without them")
    is_jpeg = reader == "Jpeg"
    if reader == "Tiff":
        directory = _directory(encoded)
        if not directory.is_last:
            raise error(where, "holds several pictures; save one alone")
        PIXELS.check(where, directory.tile, error)
        is_jpeg = directory.is_jpeg
        descriptions = [encoded]
    if is_jpeg and encoded.count(_SCAN) > MOST_SCANS:
        raise error(where, f"is a JPEG in more than {MOST_SCANS} passes; save it again")
    for description in descriptions:
        if len(description) > 8 and _directory(description).bytes > len(encoded):
            raise error(where, "has fields that are larger than the file; save it without them")


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the chunks, as far as they are whole."""
    place = 8
    while place + 8 <= len(png):
        length = int.from_bytes(png[place : place + 4], "big")
        kind = png[place + 4 : place + 8]
        is_pixels = kind == b"IDAT"
        yield kind, b"" if is_pixels else png[place + 8 : place + 8 + length]
        place += 12 + length


def _descriptions(jpeg: bytes) -> Iterator[bytes]:
    """The Exif data before the pixels."""
    place = jpeg.find(b"\xff", 2)
    while 0 <= place < len(jpeg) - 4:
        marker = jpeg[place + 1]
        if marker == _START_OF_SCAN:
            return
        if marker in (0x00, 0x01, 0xFF) or 0xD0 <= marker <= 0xD9:  # no segment: padding, a restart
            place = jpeg.find(b"\xff", place + 1 + (marker != 0xFF))
            continue
        length = int.from_bytes(jpeg[place + 2 : place + 4], "big")
        segment = jpeg[place + 4 : place + 2 + length]
        if marker == _APP1 and segment.startswith(_EXIF):
            yield segment[len(_EXIF) :]
        place = jpeg.find(b"\xff", place + 2 + length)


def _directory(tiff: bytes) -> _Directory:
    """The claims of the first directory, as far as it is whole."""
    is_big = tiff.startswith(b"MM")
    order: Literal["big", "little"] = "big" if is_big else "little"
    start = int.from_bytes(tiff[4:8], order)
    if start + 2 > len(tiff):
        return _Directory(0, 0, is_jpeg=False, is_last=True)
    count = int.from_bytes(tiff[start : start + 2], order)
    whole = min(count, (len(tiff) - start - 2) // 12)
    layout = np.dtype(_FIELD).newbyteorder(order)
    fields = np.frombuffer(tiff, layout, whole, start + 2)
    kinds = np.minimum(fields["kind"], len(_FIELD_BYTES) - 1)
    claimed = fields["count"].astype(np.int64) * _FIELD_BYTES[kinds]
    values = fields["value"].astype(np.int64)
    if is_big:
        values = np.where(fields["kind"] == _SHORT, values >> 16, values)
    width, height = (int(values[fields["tag"] == side].max(initial=0)) for side in _TILE_SIDES)
    compressions = values[fields["tag"] == _COMPRESSION]
    after = tiff[start + 2 + 12 * count : start + 6 + 12 * count]
    return _Directory(
        bytes=int(claimed.sum()),
        tile=width * height,
        is_jpeg=bool(np.isin(compressions, _JPEG_COMPRESSIONS).any()),
        is_last=not any(after),
    )
