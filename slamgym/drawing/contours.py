"""Outlines of a picture of probabilities, finer than its cells: marching squares with linear interpolation.

Convention: pictures are ``[row, col]`` with row 0 at the top; outlines are closed and run counter-clockwise (x right,
y up) round what is above the level, clockwise round its holes.
"""

import itertools
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LinearRing

from slamgym.core.types import BoolArray, Float32Array, FloatArray, GridFrame, IntArray

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
    points, line_of = _chained(_on_map(image, frame))
    lines = np.asarray(shapely.linestrings(points, indices=line_of))
    floor = shapely.build_area(shapely.multilinestrings(lines))
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(floor)))
    least = np.where(shapely.is_ccw(rings), smallest, smallest_hole)
    return list(rings[shapely.area(shapely.polygons(rings)) >= least])


def trace_patches(cells: BoolArray, frame: GridFrame, smallest: float) -> NDArray[np.object_]:
    """Patches of cells of at least an area [m2], without holes that are smaller.

    No two outlines touch, so it suffices to find which hole lies where: GEOS takes long over thousands.
    """
    points, ring_of = _chained(_on_map(cells.astype(np.float32), frame))
    rings = np.asarray(shapely.linearrings(points, indices=ring_of))
    shapes = np.asarray(shapely.polygons(rings))
    area = np.asarray(shapely.area(shapes))
    # Outlines before holes, the smallest first.
    order = np.lexsort([area, ~shapely.is_ccw(rings)])
    order = order[area[order] >= smallest]
    holes = np.flatnonzero(~shapely.is_ccw(rings[order]))
    outlines = shapely.STRtree(np.delete(shapes[order], holes))
    hole, around = outlines.query(shapes[order[holes]], predicate="within")
    patch_of = np.arange(len(order))
    np.minimum.at(patch_of, holes[hole], around)
    by_patch = np.argsort(patch_of, kind="stable")
    return np.asarray(shapely.polygons(rings[order[by_patch]], indices=patch_of[by_patch]))


def _on_map(image: Float32Array, frame: GridFrame) -> FloatArray:
    """The straight pieces of the outlines of a map, (N, 2, 2) [m]."""
    lines = _lines(np.pad(np.asarray(image, dtype=np.float64), 1))
    left, _, _, top = frame.bounds
    # The padding moved all by one cell; a cell's centre lies half a cell from its border.
    on_grid = lines + np.array([-0.5, 0.5])
    return on_grid * frame.resolution + np.array([left, top])


def _chained(lines: FloatArray) -> tuple[FloatArray, IntArray]:
    """Points (M, 2) of lines made of straight pieces (N, 2, 2), and which line each is of.

    A ring is one line, or, where it touches others, one from each such point to the next.
    """
    if not len(lines):
        return np.empty((0, 2)), np.empty(0, np.int64)
    following, touching = _successors(lines)
    chains = []
    for ring in _cycles(following.tolist()):
        cuts = [0, *(k for k in range(1, len(ring)) if ring[k] in touching), len(ring)]
        chains += [ring[begin:end] for begin, end in itertools.pairwise(cuts)]
    sizes = np.array([len(chain) for chain in chains])
    pieces = np.concatenate(chains)
    firsts = np.cumsum(sizes) - sizes
    points = np.insert(lines[pieces, 1], firsts, lines[pieces[firsts], 0], axis=0)
    return points, np.repeat(np.arange(len(sizes)), sizes + 1)


def _successors(lines: FloatArray) -> tuple[IntArray, set[int]]:
    """For each piece (N, 2, 2) one that begins where it ends, and the pieces that begin where others do, too."""
    start, end = np.ascontiguousarray(lines).view(np.complex128)[..., 0].T
    by_start = np.argsort(start, kind="stable")
    following = np.empty_like(by_start)
    following[np.argsort(end, kind="stable")] = by_start
    shared = np.flatnonzero(np.diff(start[by_start]) == 0.0)
    touching = {*by_start[shared].tolist(), *by_start[shared + 1].tolist()}
    return following, touching


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
