"""PNG pictures in memory and on the disk."""

from pathlib import Path

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.types import ByteArray


def encode_png(image: ByteArray) -> bytes:
    """The content of a PNG file, of shape (rows, cols) or (rows, cols, 3) in OpenCV's order of channels."""
    import cv2

    return bytes(cv2.imencode(".png", image)[1])


def read_png(path: Path) -> ByteArray:
    """Read a picture as it is, shape (rows, cols) or (rows, cols, channels).

    Raises:
        InputFileError: If it is missing or no picture.
    """
    import cv2

    data = np.frombuffer(read_bytes(path), dtype=np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise InputFileError(path, "is not a PNG picture")
    return image
