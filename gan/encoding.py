"""Maps as the networks see them, and back.

Cells are 0 occupied, 205 unknown, 254 free; a CAD map has only 0 (walls and outside) and 254 (inside). Encoded
values lie in [-1, 1].

* ``grey``: one channel, the cell's grey.
* ``rgb``: three times that, as the paper's images.
* ``free_occupied``: two channels, "free" and "occupied", each 1 or -1; unknown is -1 in both. No grey between
  the wall's black and the floor's white then means "unknown", so borders stay clean.
"""

from typing import assert_never

import numpy as np
import torch
from torch import Tensor

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, Encoding

HALF_FREE = 127.0
"""Grey that is encoded as 0."""
MIN_FREE_GREY, MAX_OCCUPIED_GREY = 230, 102
"""Greys from here on up are free, up to here occupied; between them lies the unknown (205)."""


def encode(cells: Tensor, encoding: Encoding) -> Tensor:
    """Encode maps.

    Args:
        cells: (B, H, W) uint8; a CAD map may hold greys between 0 and 254 for borders within a pixel.
        encoding: See above.

    Returns:
        (B, C, H, W) float32 in [-1, 1].
    """
    match encoding:
        case "grey" | "rgb":
            grey = (cells.float() / HALF_FREE - 1.0).clamp(-1.0, 1.0).unsqueeze(1)
            return grey.expand(-1, CHANNELS[encoding], -1, -1)
        case "free_occupied":
            parts = torch.stack([cells >= MIN_FREE_GREY, cells <= MAX_OCCUPIED_GREY], dim=1)
            return parts.float() * 2.0 - 1.0
        case _ as unreachable:
            assert_never(unreachable)


def free_probability(image: Float32Array, encoding: Encoding) -> Float32Array:
    """Of being free, per pixel, of a drawn CAD map.

    Args:
        image: (C, H, W) in [-1, 1].
        encoding: How it is encoded.

    Returns:
        (H, W) in [0, 1].
    """
    free = image[0] if encoding == "free_occupied" else image.mean(axis=0)
    return np.clip(0.5 * (free + 1.0), 0.0, 1.0).astype(np.float32)


def decode_slam(image: Float32Array, encoding: Encoding) -> ByteArray:
    """Cells of a drawn SLAM map: the three values 0, 205 and 254.

    Args:
        image: (C, H, W) in [-1, 1].
        encoding: How it is encoded.
    """
    if encoding == "free_occupied":
        free, occupied = image[0], image[1]
        cells = np.where(free > 0.0, FREE, UNKNOWN)
        return np.where((occupied > 0.0) & (occupied > free), OCCUPIED, cells).astype(np.uint8)
    grey = (image.mean(axis=0) + 1.0) * HALF_FREE
    cells = np.where(grey >= MIN_FREE_GREY, FREE, UNKNOWN)
    return np.where(grey <= MAX_OCCUPIED_GREY, OCCUPIED, cells).astype(np.uint8)
