"""Outlines of a picture of probabilities, finer than its cells: marching squares with linear interpolation.

Convention: pictures are ``[row, col]`` with row 0 at the top; outlines are closed and run counter-clockwise (x right,
y up) round what is above the level.
"""

from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, GridFrame, IntArray

_LINKS: tuple[tuple[tuple[int, int], ...], ...] = (
    (), ((2, 3),), ((1, 2),), ((1, 3),), ((0, 1),), ((0, 1), (2, 3)), ((0, 2),), ((0, 3),),
    ((3, 0),), ((2, 0),), ((3, 0), (1, 2)), ((1, 0),), ((3, 1),), ((2, 1),), ((3, 2),), (),
)  # fmt: skip
"""For each of the 16 kinds of squares (bits: top left 8, top right 4, bottom right 2, bottom left 1) from which of its
sides (0 top, 1 right, 2 bottom, 3 left) to which an outline runs, what is above the level on its left."""


LEVEL = 0.5
"""Values above are floor."""


class Outline(NamedTuple):
    """A closed outline."""

    points: FloatArray  # (N, 2), the first not repeated
    area: float  # positive round what is above the level, negative round a hole


def trace_outlines(image: Float32Array, frame: GridFrame) -> list[Outline]:
    """The outlines of what lies above a half.

    Args:
        image: Shape (rows, cols); what is beyond its border counts as 0.
        frame: Where the cells lie; ``image`` is a map of this frame.

    Returns:
        In the frame's coordinates [m], in the order in which they are met from the top.
    """
    padded = np.pad(np.asarray(image, dtype=np.float64), 1)
    above = padded >= LEVEL
    kind = 8 * above[:-1, :-1] + 4 * above[:-1, 1:] + 2 * above[1:, 1:] + above[1:, :-1]
    rows, cols = np.nonzero((kind > 0) & (kind < 15))
    kinds = kind[rows, cols]
    starts, ends = [], []
    height, width = padded.shape
    # A side by its number: first all horizontal ones (between two columns), then all vertical ones.
    sides = np.stack(
        [
            rows * width + cols,
            height * width + rows * width + cols + 1,
            (rows + 1) * width + cols,
            height * width + rows * width + cols,
        ]
    )
    for which, links in enumerate(_LINKS):
        at = np.flatnonzero(kinds == which)
        for first, second in links:
            starts.append(sides[first, at])
            ends.append(sides[second, at])
    if not starts:
        return []
    start, end = np.concatenate(starts), np.concatenate(ends)
    order = np.argsort(start, kind="stable")
    start, end = start[order], end[order]
    chains, lengths = _chains(np.searchsorted(start, end).astype(np.int64))
    points = _crossings(padded, start[chains])
    left, _, _, top = frame.bounds
    # The padding moved all by one cell; a cell's centre lies half a cell from its border.
    points = (points + np.array([-0.5, 0.5])) * frame.resolution + np.array([left, top])
    outlines = []
    for ring in np.split(points, np.cumsum(lengths)[:-1]):
        if len(ring) >= 4:
            x, y = ring.T - ring[0][:, None]
            area = 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))
            outlines.append(Outline(ring, area))
    return outlines


def _crossings(padded: FloatArray, sides: IntArray) -> FloatArray:
    """Where outlines cross sides, (N, 2) in cells: column and minus row."""
    height, width = padded.shape
    is_vertical = sides >= height * width
    row, col = np.divmod(sides - is_vertical * height * width, width)
    first, second = padded[row, col], padded[row + is_vertical, col + ~is_vertical]
    share = (LEVEL - first) / (second - first)
    return np.column_stack([col + share * ~is_vertical, -(row + share * is_vertical)])


@kernel
def _chains(following: IntArray) -> tuple[IntArray, IntArray]:
    """Follow a permutation round its cycles: all indices in that order, and the cycles' lengths."""
    count = len(following)
    order = np.empty(count, np.int64)
    lengths = np.empty(count, np.int64)
    seen = np.zeros(count, np.bool_)
    filled = 0
    cycles = 0
    for first in range(count):
        at = first
        begin = filled
        while not seen[at]:
            seen[at] = True
            order[filled] = at
            filled += 1
            at = following[at]
        if filled > begin:
            lengths[cycles] = filled - begin
            cycles += 1
    return order, lengths[:cycles]
