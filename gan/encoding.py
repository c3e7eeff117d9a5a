"""Maps as the networks see them, and back.

Cells are 0 occupied, 205 unknown, 254 free; a CAD map has only 0 (walls and outside) and 254 (inside). Encoded
values lie in [-1, 1].

* ``grey``: one channel, the cell's grey.
* ``rgb``: three times that, as the paper's images.
* ``layers``: four channels, the shares of floor, wall, door and unseen in each pixel (:mod:`slamgym.metrics.layers`).
* ``free_occupied``: two channels, "free" and "occupied", each 1 or -1; unknown is -1 in both. No grey between
  the wall's black and the floor's white then means "unknown", so borders stay clean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, Encoding

if TYPE_CHECKING:
    from torch import Tensor

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
        correction = cv2.resize(missing, shape[::-1], interpolation=cv2.INTER_CUBIC)
        large = np.clip(large + correction, 0.0, 1.0)
        means = cv2.resize(large, (cols, rows), interpolation=cv2.INTER_AREA)
        missing = image - means
    return np.asarray(large, dtype=np.float32)


def _resize(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    rows, cols = shape
    shrinks = rows < image.shape[0] or cols < image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = cv2.resize(image, (cols, rows), interpolation=method)
    return np.asarray(resized)


HALF_FREE = 127.0
"""Grey that is encoded as 0."""
MIN_FREE_GREY = 230
"""Cells of this grey and lighter ones are free."""
MAX_OCCUPIED_GREY = 102
"""Cells of this grey and darker ones are occupied; between the two lies the unknown (205)."""


def encode(cells: Tensor, encoding: Encoding) -> Tensor:
    """Encode maps.

    Args:
        cells: (B, H, W) uint8; a CAD map may hold greys between 0 and 254 for borders within a pixel. Layers are
            (B, 4, H, W).
        encoding: See above.

    Returns:
        (B, C, H, W) float32 in [-1, 1].
    """
    import torch

    if encoding == "free_occupied":
        is_free = cells >= MIN_FREE_GREY
        is_occupied = cells <= MAX_OCCUPIED_GREY
        parts = torch.stack([is_free, is_occupied], dim=1)
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
        floor = image[0]
        doors = image[2]
        free = floor + doors + 1.0
    elif encoding == "free_occupied":
        free = image[0]
    else:
        free = image.mean(axis=0)
    probability = 0.5 * (free + 1.0)
    return np.clip(probability, 0.0, 1.0).astype(np.float32)


def decode_slam(image: Float32Array, encoding: Encoding) -> ByteArray:
    """Cells of a drawn SLAM map: the three values 0, 205 and 254.

    Args:
        image: (C, H, W) in [-1, 1].
        encoding: How it is encoded.
    """
    if encoding == "free_occupied":
        free, occupied = image
        is_free = free > 0.0
        is_occupied = (occupied > 0.0) & (occupied > free)
    else:
        grey = (image.mean(axis=0) + 1.0) * HALF_FREE
        is_free = grey >= MIN_FREE_GREY
        is_occupied = grey <= MAX_OCCUPIED_GREY
    cells = np.full(is_free.shape, UNKNOWN, np.uint8)
    cells[is_free] = FREE
    cells[is_occupied] = OCCUPIED
    return cells
