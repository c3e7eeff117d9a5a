"""PNG pictures in memory and on the disk."""

from pathlib import Path

from slamgym.core.files import read_bytes
from slamgym.core.pictures import decode_picture
from slamgym.core.types import ByteArray


def encode_png(image: ByteArray) -> bytes:
    """The content of a PNG file, of shape (rows, cols) or (rows, cols, 3) in OpenCV's order of channels."""
    import cv2

    return bytes(cv2.imencode(".png", image)[1])


def read_png(path: Path) -> ByteArray:
    """Read a picture as :func:`~slamgym.core.pictures.decode_picture` does.

    Raises:
        InputFileError: If it is missing, no picture, or larger than allowed.
    """
    image: ByteArray = decode_picture(path, read_bytes(path))
    return image
