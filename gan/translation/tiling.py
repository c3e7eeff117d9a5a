"""Translate images of any size with a network of one size: overlapping tiles, blended where they meet."""

from collections.abc import Callable

import numpy as np

from slamgym.core.types import ByteArray, Float32Array

OVERLAP = 0.25
"""Least share of a tile that its neighbour sees too."""


def tile_starts(length: int, tile: int) -> list[int]:
    """Where tiles begin along one axis so that they cover it evenly, the last one ending at its end."""
    if length <= tile:
        return [0]
    count = int(np.ceil((length - tile * OVERLAP) / (tile * (1.0 - OVERLAP))))
    return [round(start) for start in np.linspace(0, length - tile, count)]


def translate_tiled(
    cells: ByteArray, tile: int, fill: int, draw: Callable[[ByteArray], Float32Array]
) -> Float32Array:
    """Translate tile by tile.

    Args:
        cells: (H, W), any size; smaller sides are padded in the middle.
        tile: Side of a tile.
        fill: Value of the padding.
        draw: Turns tiles (N, tile, tile) into (N, C, tile, tile).

    Returns:
        (C, H, W): the mean of the tiles, weighted less towards their borders.
    """
    rows, cols = cells.shape
    above, beside = max(0, tile - rows) // 2, max(0, tile - cols) // 2
    below, behind = max(0, tile - rows) - above, max(0, tile - cols) - beside
    padded = np.pad(cells, ((above, below), (beside, behind)), constant_values=fill)
    corners = [(r, c) for r in tile_starts(padded.shape[0], tile) for c in tile_starts(padded.shape[1], tile)]
    drawn = draw(np.stack([padded[r : r + tile, c : c + tile] for r, c in corners]))
    window = _window(tile)
    total = np.zeros((drawn.shape[1], *padded.shape), np.float32)
    weight = np.zeros(padded.shape, np.float32)
    for (r, c), part in zip(corners, drawn, strict=True):
        total[:, r : r + tile, c : c + tile] += part * window
        weight[r : r + tile, c : c + tile] += window
    blended: Float32Array = (total / weight).astype(np.float32)
    return blended[:, above : above + rows, beside : beside + cols]


def _window(tile: int) -> Float32Array:
    """Weights that fall towards the borders but stay positive."""
    ramp = np.minimum(np.arange(tile), np.arange(tile)[::-1]) + 1.0
    ramp = np.minimum(1.0, ramp / (OVERLAP * tile))
    return np.asarray(np.outer(ramp, ramp), dtype=np.float32)
