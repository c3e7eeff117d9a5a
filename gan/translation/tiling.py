"""Translate maps of any size tile by tile: overlapping tiles, blended so that no border of a tile shows."""

from collections.abc import Callable

import numpy as np

from slamgym.core.types import ByteArray, Float32Array
from slamgym.gan.config import TRANSLATION_BATCH

OVERLAP = 0.25
"""Least share of a tile that its neighbour sees too."""


def tile_starts(length: int, tile: int) -> list[int]:
    """Where tiles begin along one axis so that they cover it evenly, the last one ending at its end."""
    if length <= tile:
        return [0]
    step = tile * (1.0 - OVERLAP)
    count = int(np.ceil((length - tile * OVERLAP) / step))
    return [round(start) for start in np.linspace(0, length - tile, count)]


def translate_tiled(
    cells: ByteArray, tile: int, fill: int, run: Callable[[ByteArray], Float32Array]
) -> Float32Array:
    """Translate tile by tile.

    Args:
        cells: (H, W), any size; smaller sides are padded in the middle.
        tile: Side of a tile.
        fill: Value of the padding.
        run: Turns tiles (N, tile, tile) into (N, C, tile, tile).

    Returns:
        (C, H, W): the mean of the tiles, weighted less towards their borders; -1 where a tile would be empty.
    """
    rows, cols = cells.shape
    above, below = _padding(rows, tile)
    left, right = _padding(cols, tile)
    padded = np.pad(cells, ((above, below), (left, right)), constant_values=fill)
    blended = _blend_tiles(padded, _known_tiles(padded, tile, fill), _window(tile), run)
    return blended[:, above : above + rows, left : left + cols]


def _blend_tiles(
    cells: ByteArray,
    tiles: list[tuple[slice, slice]],
    window: Float32Array,
    run: Callable[[ByteArray], Float32Array],
) -> Float32Array:
    """Translate the tiles at these rows and columns, and weigh each pixel by its place in its tile."""
    # So small that they count only where there is no tile, where the ratio becomes -1.
    total = np.full((1, *cells.shape), -1e-9, np.float32)
    weight = np.full(cells.shape, 1e-9, np.float32)
    # Some at a time, so that only the result grows with the map.
    for first in range(0, len(tiles), TRANSLATION_BATCH):
        some = tiles[first : first + TRANSLATION_BATCH]
        images = run(np.stack([cells[place] for place in some]))
        if first == 0:
            total = np.repeat(total, images.shape[1], axis=0)
        for place, image in zip(some, images, strict=True):
            total[(slice(None), *place)] += image * window
            weight[place] += window
    return np.asarray(total / weight, dtype=np.float32)


def _padding(length: int, tile: int) -> tuple[int, int]:
    """Cells to be added before and behind so that a side is as long as a tile."""
    missing = max(0, tile - length)
    before = missing // 2
    return before, missing - before


def _known_tiles(cells: ByteArray, tile: int, fill: int) -> list[tuple[slice, slice]]:
    """Rows and columns of the tiles that show anything."""
    known = []
    rows, cols = cells.shape
    for top in tile_starts(rows, tile):
        for left in tile_starts(cols, tile):
            place = slice(top, top + tile), slice(left, left + tile)
            if (cells[place] != fill).any():
                known.append(place)
    return known


def _window(tile: int) -> Float32Array:
    """Weights that fall towards the borders but stay positive."""
    pixels = np.arange(tile)
    to_border = np.minimum(pixels, pixels[::-1]) + 1.0
    ramp = np.minimum(1.0, to_border / (OVERLAP * tile))
    return np.asarray(np.outer(ramp, ramp), dtype=np.float32)
