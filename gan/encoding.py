"""Maps as the networks see them, and back.

Cells are 0 occupied, 205 unknown, 254 free; a CAD map has only 0 (walls and outside) and 254 (inside). Encoded
values lie in [-1, 1].

* ``grey``: one channel, the cell's grey.
* ``rgb``: three times that, as the paper's images.
* ``layers``: four channels, the shares of floor, wall, door and unseen in each pixel (:mod:`slamgym.metrics.layers`).
* ``free_occupied``: two channels, "free" and "occupied", each 1 or -1; unknown is -1 in both. No grey between
  the wall's black and the floor's white then means "unknown", so borders stay clean.
"""

import cv2
import numpy as np
import torch
from torch import Tensor

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, Encoding

_BACK_PROJECTIONS = 10
"""After these the means are right to a few thousandths."""


def resample_grey(image: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    """Resample a CAD map to (rows, cols), borders in shades of grey."""
    if image.shape == shape:
        return image
    return np.asarray(_resize(image, shape), dtype=np.uint8)


def resample_probability(image: Float32Array, shape: tuple[int, ...]) -> Float32Array:
    """Resample values in [0, 1] to (rows, cols)."""
    if image.shape == shape:
        return image
    return np.clip(_resize(image, shape), 0.0, 1.0).astype(np.float32)


def enlarge_means(image: Float32Array, shape: tuple[int, ...]) -> Float32Array:
    """Enlarge values in [0, 1] that are means over their pixels, so that they stay the means.

    A generator that draws 32 x 32 pixels learns the share of floor in each. Plain interpolation would blur that share
    once more and lose thin walls; what it takes away is put back (iterative back projection, Irani and Peleg 1991).

    Args:
        image: (h, w).
        shape: (rows, cols), no smaller.
    """
    if image.shape == shape:
        return image
    rows, cols = image.shape
    large = np.zeros(shape, np.float32)
    missing = image
    for _ in range(_BACK_PROJECTIONS):
        large = np.clip(
            large + cv2.resize(missing, shape[::-1], interpolation=cv2.INTER_CUBIC), 0.0, 1.0
        )
        missing = image - cv2.resize(large, (cols, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(large, dtype=np.float32)


def _resize(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    shrinks = shape[0] < image.shape[0] or shape[1] < image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (shape[1], shape[0]), interpolation=method))


HALF_FREE = 127.0
"""Grey that is encoded as 0."""
MIN_FREE_GREY, MAX_OCCUPIED_GREY = 230, 102
"""Greys from here on up are free, up to here occupied; between them lies the unknown (205)."""


def encode(cells: Tensor, encoding: Encoding) -> Tensor:
    """Encode maps.

    Args:
        cells: (B, H, W) uint8; a CAD map may hold greys between 0 and 254 for borders within a pixel. Layers are
            (B, 4, H, W).
        encoding: See above.

    Returns:
        (B, C, H, W) float32 in [-1, 1].
    """
    if encoding == "free_occupied":
        parts = torch.stack([cells >= MIN_FREE_GREY, cells <= MAX_OCCUPIED_GREY], dim=1)
        return parts.float() * 2.0 - 1.0
    grey = (cells.float() / HALF_FREE - 1.0).clamp(-1.0, 1.0)
    if encoding == "layers":
        return grey
    return grey.unsqueeze(1).expand(-1, CHANNELS[encoding], -1, -1)


def free_probability(image: Float32Array, encoding: Encoding) -> Float32Array:
    """Probability of being free, for each pixel of a drawn CAD map.

    Args:
        image: (C, H, W) in [-1, 1].
        encoding: How it is encoded.

    Returns:
        (H, W) in [0, 1].
    """
    if encoding == "layers":
        free = image[0] + image[2] + 1.0
    else:
        free = image[0] if encoding == "free_occupied" else image.mean(axis=0)
    return np.clip(0.5 * (free + 1.0), 0.0, 1.0).astype(np.float32)


def decode_slam(image: Float32Array, encoding: Encoding) -> ByteArray:
    """Cells of a drawn SLAM map: the three values 0, 205 and 254.

    Args:
        image: (C, H, W) in [-1, 1].
        encoding: How it is encoded.
    """
    if encoding == "free_occupied":
        is_free, is_occupied = image[0] > 0.0, (image[1] > 0.0) & (image[1] > image[0])
    else:
        grey = (image.mean(axis=0) + 1.0) * HALF_FREE
        is_free, is_occupied = grey >= MIN_FREE_GREY, grey <= MAX_OCCUPIED_GREY
    return np.where(is_occupied, OCCUPIED, np.where(is_free, FREE, UNKNOWN)).astype(np.uint8)
