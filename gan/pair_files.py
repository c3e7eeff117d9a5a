"""The images of pairs: which files of a folder they are, and what their greys mean.

A CAD map has two greys, 0 for walls and outside and 254 or 255 for floor, and others only along faces, where a pixel is
partly floor. A SLAM map is a grey map as ROS saves it: walls dark, free space white, the unknown a grey between.
"""

from pathlib import Path

import cv2
import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.pictures import PICTURE_SUFFIXES, decode_picture, grey_picture
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray
from slamgym.interop.ros_map import classify_greys

MAX_COLOUR = 8
"""A picture is grey if the channels of no pixel differ by more."""
LIGHT = 128
"""Floor is lighter than this."""
NEARLY = 25
"""Greys no farther from those of walls or floor are theirs: JPEG spreads greys by so much."""
DARKEST_UNKNOWN = 90
"""Darker greys are walls (:func:`slamgym.interop.ros_map.classify_greys`)."""
LARGEST_AREA = 0.01
"""A grey that means nothing may cover this share of an image, its borders left out: a scratch, a letter."""


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name; hidden files, which a Mac leaves beside each, are none."""
    found = []
    for path in sorted(folder.iterdir()):
        is_hidden = path.name.startswith(".")
        if path.suffix.lower() in PICTURE_SUFFIXES and not is_hidden:
            found.append(path)
    return found


def image_side(root: Path | str, split: str) -> int:
    """Side of the images of a folder [px]; 256 where there is none to ask, whose error comes with the pairs.

    Raises:
        InputFileError: If the first image can't be read.
    """
    folder = Path(root) / split / "A"
    if not folder.is_dir():
        folder = Path(root) / "A"
    images = pictures_in(folder) if folder.is_dir() else []
    return len(read_grey(images[0])) if images else 256


def read_grey(path: Path) -> ByteArray:
    """Read an image of one channel, or of several equal ones, 8 bits each.

    Raises:
        InputFileError: If it can't be read or is coloured.
    """
    image = decode_picture(path, read_bytes(path))
    if image.dtype != np.uint8:
        raise InputFileError(
            path, f"has pixels of type {image.dtype}; save it with 8 bits per channel"
        )
    if image.ndim == 3 and image.shape[2] > 2 and _colourfulness(image) > MAX_COLOUR:
        raise InputFileError(path, f"is coloured ({image.shape[2]} channels); maps are grey images")
    return grey_picture(image)[0]


def _colourfulness(image: ByteArray) -> int:
    """Largest difference between red, green and blue of a pixel; a fourth channel is alpha."""
    return int(np.ptp(image[:, :, :3], axis=2).max())


def cad_shares(path: Path, grey: ByteArray) -> ByteArray:
    """The share of floor in each pixel of a CAD map, 0 to 254.

    Args:
        path: The image, for errors.
        grey: Its greys, (H, W).

    Raises:
        InputFileError: If it has no floor, or areas that are neither wall nor floor.
    """
    lightest = int(grey.max())
    if lightest < LIGHT:
        raise InputFileError(
            path,
            f"is no CAD map: its lightest value is {lightest}, but floor has 254 or 255 and walls 0",
        )
    stray = _commonest_area(grey, NEARLY, FREE - NEARLY)
    if stray is not None:
        raise InputFileError(
            path,
            f"is no CAD map: it has areas of the value {stray}, but floor has 254 or 255, walls and outside 0",
        )
    return np.minimum(grey, FREE)


def slam_cells(path: Path, grey: ByteArray) -> ByteArray:
    """The cells of a SLAM map: 0 occupied, 205 unknown, 254 free.

    Args:
        path: The image, for errors.
        grey: Its greys, (H, W).

    Raises:
        InputFileError: If nothing in it is free, or dark areas are neither wall nor unknown.
    """
    if np.isin(grey, (OCCUPIED, UNKNOWN, FREE)).all():
        return grey
    lightest = int(grey.max())
    if lightest < LIGHT:
        raise InputFileError(
            path,
            f"is no grey map: its lightest value is {lightest}, but free space has 254, the unknown 205, walls 0",
        )
    stray = _commonest_area(grey, NEARLY, DARKEST_UNKNOWN)
    if stray is not None:
        raise InputFileError(
            path,
            f"is no grey map: it has areas of the value {stray}, but free space has 254, the unknown 205, walls 0",
        )
    return classify_greys(grey)


def _commonest_area(grey: ByteArray, above: int, below: int) -> int | None:
    """The commonest grey of areas between two greys; None if they are no larger than borders and scratches are."""
    between = (grey > above) & (grey < below)
    inner = cv2.erode(between.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    if inner.mean() <= LARGEST_AREA:
        return None
    return int(np.bincount(grey[inner]).argmax())
