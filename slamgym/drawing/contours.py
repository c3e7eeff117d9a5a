"""Outlines of a picture of probabilities, finer than its cells: marching squares with linear interpolation.

Convention: pictures are ``[row, col]`` with row 0 at the top; outlines are closed and run counter-clockwise (x right,
y up) round what is above the level, clockwise round its holes.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LinearRing

from slamgym.core.types import Float32Array, FloatArray, GridFrame, IntArray

_LINKS: tuple[tuple[tuple[int, int], ...], ...] = (
    (),
    ((2, 3),),
    ((1, 2),),
    ((1, 3),),
    ((0, 1),),
    ((0, 1), (2, 3)),
    ((0, 2),),
    ((0, 3),),
    ((3, 0),),
    ((2, 0),),
    ((3, 0), (1, 2)),
    ((1, 0),),
    ((3, 1),),
    ((2, 1),),
    ((3, 2),),
    (),
)
"""For each of the 16 kinds of squares (bits: top left 8, top right 4, bottom right 2, bottom left 1) from which of its
sides (0 top, 1 right, 2 bottom, 3 left) to which an outline runs."""
LEVEL = 0.5
"""Values above are floor."""


def trace_outlines(
    image: Float32Array, frame: GridFrame, smallest: float, smallest_hole: float
) -> list[LinearRing]:
    """The outlines of what lies above a half, each followed by its holes.

    Args:
        image: Shape (rows, cols); what is beyond its border counts as 0.
        frame: Where the cells lie; ``image`` is a map of this frame.
        smallest: Least area of an outline, holes included [m2].
        smallest_hole: Least area of a hole [m2].
    """
    padded = np.pad(np.asarray(image, dtype=np.float64), 1)
    lines = _lines(padded)
    left, _, _, top = frame.bounds
    # The padding moved all by one cell; a cell's centre lies half a cell from its border.
    on_grid = lines + np.array([-0.5, 0.5])
    on_map = on_grid * frame.resolution + np.array([left, top])
    if not len(lines):
        return []
    floor = shapely.build_area(shapely.multilinestrings(_chained(on_map)))
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(floor)))
    least = np.where(shapely.is_ccw(rings), smallest, smallest_hole)
    return list(rings[shapely.area(shapely.polygons(rings)) >= least])


def _chained(lines: FloatArray) -> NDArray[np.object_]:
    """Straight pieces (N, 2, 2) as lines: one for each ring that touches none, for few lines are joined sooner."""
    start, end = np.ascontiguousarray(lines).view(np.complex128)[..., 0].T
    by_start = np.argsort(start, kind="stable")
    following = np.empty_like(by_start)
    following[np.argsort(end, kind="stable")] = by_start
    shared = np.flatnonzero(np.diff(start[by_start]) == 0.0)
    touching = {*by_start[shared].tolist(), *by_start[shared + 1].tolist()}
    chains = list[list[int]]()
    for ring in _cycles(following.tolist()):
        is_alone = touching.isdisjoint(ring)
        chains += [ring] if is_alone else [[piece] for piece in ring]
    chains.sort()
    sizes = np.array([len(chain) for chain in chains])
    # Where GEOS would begin a ring of pieces: at the end of the first.
    pieces = np.concatenate([[*chain[1:], chain[0]] for chain in chains])
    firsts = np.cumsum(sizes) - sizes
    points = np.insert(lines[pieces, 1], firsts, lines[pieces[firsts], 0], axis=0)
    return shapely.linestrings(points, indices=np.repeat(np.arange(len(sizes)), sizes + 1))


def _cycles(following: list[int]) -> Iterator[list[int]]:
    """The cycles of a permutation, each from its lowest number on."""
    is_left = [True] * len(following)
    for first in range(len(following)):
        cycle = []
        at = first
        while is_left[at]:
            is_left[at] = False
            cycle.append(at)
            at = following[at]
        if cycle:
            yield cycle


def _lines(padded: FloatArray) -> FloatArray:
    """The straight pieces of all outlines, (N, 2, 2) in cells: column and minus row."""
    above = padded >= LEVEL
    top_left = above[:-1, :-1]
    top_right = above[:-1, 1:]
    bottom_right = above[1:, 1:]
    bottom_left = above[1:, :-1]
    kind = 8 * top_left + 4 * top_right + 2 * bottom_right + bottom_left
    rows, cols = np.nonzero((kind > 0) & (kind < 15))
    sides = [
        _crossings(padded, rows, cols, 0, 1),
        _crossings(padded, rows, cols + 1, 1, 0),
        _crossings(padded, rows + 1, cols, 0, 1),
        _crossings(padded, rows, cols, 1, 0),
    ]
    pieces = [np.empty((0, 2, 2))]
    for which, links in enumerate(_LINKS):
        is_this = kind[rows, cols] == which
        for first, second in links:
            start = sides[first][is_this]
            end = sides[second][is_this]
            pieces.append(np.stack([start, end], axis=1))
    lines = np.concatenate(pieces)
    has_length = (lines[:, 0] != lines[:, 1]).any(axis=1)
    return lines[has_length]


def _crossings(
    padded: FloatArray, rows: IntArray, cols: IntArray, down: int, right: int
) -> FloatArray:
    """Where outlines cross the sides from cells to their neighbours, (N, 2) in cells: column and minus row."""
    first = padded[rows, cols]
    second = padded[rows + down, cols + right]
    difference = np.where(first == second, 1.0, second - first)
    share = (LEVEL - first) / difference
    x = cols + share * right
    y = -(rows + share * down)
    return np.column_stack([x, y])
