"""Walls that are thinner than the cells of an image: they stay closed."""

from slamgym.core.types import BoolArray, Float32Array

SHARE_STEPS = 5
"""Shares of cells are counted, and walls looked for, on a raster so many times finer."""
CLOSED_SHARE = 0.45
"""Most floor that a cell shows through which a wall passes that is thinner than a cell: less than half, so it stays
closed."""


def close_thin_walls(share: Float32Array, line: BoolArray) -> None:
    """Close the cells along each row that a wall separates; changes ``share`` in place.

    Of two neighbouring cells that are floor by their shares but have a wall between their centres, the one with less
    floor gets :data:`CLOSED_SHARE`.

    Args:
        share: Share of floor of each cell, shape (rows, cols).
        line: Floor along the rows, from the centre of the first cell to that of the last, :data:`SHARE_STEPS` places a
            cell: shape (rows, SHARE_STEPS * (cols - 1) + 1).
    """
    left = share[:, :-1]
    right = share[:, 1:]
    between = line[:, :-1].reshape(*left.shape, SHARE_STEPS)
    is_free = between.all(axis=2) & line[:, SHARE_STEPS::SHARE_STEPS]
    separated = ~is_free & (left >= 0.5) & (right >= 0.5)
    left[separated & (left <= right)] = CLOSED_SHARE
    right[separated & (left > right)] = CLOSED_SHARE
