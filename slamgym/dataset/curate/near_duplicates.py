"""Find floor plans that look the same: copies, mirror images, and the same home with a wall moved.

The print of a plan is its free space as a picture of 32 x 32 grey values, scaled to its bounding box and of
unit norm. Two plans are near-duplicates if their sizes agree and their prints are within :data:`RADIUS` of
each other in one of the eight ways to turn and flip one of them.

Comparing all pairs of 35,000 plans is too much, so a k-d tree proposes them by a perceptual hash: the
magnitudes of the lowest frequencies of the print's cosine transform, as in pHash (Zauner, Implementation and
benchmarking of perceptual image hash functions, 2010, section 3.2.1), made blind to flips and quarter turns.
Flips change only the signs of the coefficients and a transposition swaps ``(u, v)`` with ``(v, u)``; taking
magnitudes, and the sum and the difference of each swapped pair, moves no two points apart. Hence prints within
the radius have hashes within it: no pair is missed.
"""

import numpy as np
from scipy.fft import dctn
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slamgym.cad import FloorPlan
from slamgym.core.types import Float32Array, FloatArray, GridFrame, IntArray

SIDE = 32
"""Rows and columns of a print."""
_SUB = 4  # each is the mean of so many by so many cells
RADIUS = 0.08
"""Distance of unit prints up to which plans count as the same."""
SIZE_TOLERANCE = 0.03
"""Difference of the logarithms of the longer sides up to which plans count as equally large."""
_FREQUENCIES = 6  # of the hash: those with u + v below
_CHUNK = 4096


def plan_print(plan: FloorPlan) -> Float32Array:
    """The print of a plan, shape (SIDE, SIDE), of unit norm.

    The longer side of the plan's bounding box fills the picture; the shorter one is centred.
    """
    min_x, min_y, max_x, max_y = plan.bounds
    side = max(max_x - min_x, max_y - min_y)
    cells = SIDE * _SUB
    frame = GridFrame(side / cells, 0.5 * (min_x + max_x - side), 0.5 * (min_y + max_y - side), cells, cells)
    free = (plan.raster(frame.resolution, frame=frame).cells > 0).astype(np.float32)
    shares = free.reshape(SIDE, _SUB, SIDE, _SUB).mean(axis=(1, 3))
    unit: Float32Array = shares / max(float(np.linalg.norm(shares)), 1e-9)
    return unit


def near_duplicates(prints: Float32Array, sides: FloatArray, radius: float = RADIUS) -> IntArray:
    """Group plans of which each looks like another one of its group.

    Args:
        prints: Shape (N, SIDE, SIDE).
        sides: Longer sides of the plans' bounding boxes, shape (N,) [m].
        radius: Largest distance of two prints that count as the same.

    Returns:
        For each plan the lowest index in its group, shape (N,).
    """
    count = len(prints)
    sizes = np.log(sides)
    pairs = _candidates(prints, sizes, radius)
    pairs = pairs[np.abs(sizes[pairs[:, 0]] - sizes[pairs[:, 1]]) <= SIZE_TOLERANCE]
    same = [
        chunk[distances(prints[chunk[:, 0]], prints[chunk[:, 1]]) <= radius]
        for chunk in np.array_split(pairs, max(1, -(-len(pairs) // _CHUNK)))
    ]
    edges = np.concatenate(same)
    graph = coo_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    first = np.full(labels.max(initial=-1) + 1, count, dtype=np.int64)
    np.minimum.at(first, labels, np.arange(count))
    groups: IntArray = first[labels]
    return groups


def _candidates(prints: Float32Array, sizes: FloatArray, radius: float) -> IntArray:
    """Pairs of indices, shape (P, 2), that hold all near-duplicates and some more."""
    if len(prints) < 2:
        return np.empty((0, 2), dtype=np.int64)
    hashes = np.stack([_hash(picture) for picture in prints])
    # With the size as one more coordinate, scaled so that its tolerance weighs as much as the radius.
    points = np.column_stack([hashes, sizes * (radius / SIZE_TOLERANCE)])
    pairs: IntArray = cKDTree(points).query_pairs(np.sqrt(2.0) * radius, output_type="ndarray")
    return pairs


def distances(prints: Float32Array, others: Float32Array) -> Float32Array:
    """Distance of prints to others, in the best of the eight ways to lay one on the other.

    Args:
        prints: Shape (N, SIDE, SIDE).
        others: Shape (N, SIDE, SIDE).

    Returns:
        Shape (N,).
    """
    best = np.full(len(prints), np.inf, dtype=np.float32)
    for turned in (others, others.transpose(0, 2, 1)):
        for flipped in (turned, turned[:, ::-1], turned[:, :, ::-1], turned[:, ::-1, ::-1]):
            np.minimum(
                best, np.linalg.norm((prints - flipped).reshape(len(prints), SIDE * SIDE), axis=1), out=best
            )
    return best


def _hash(picture: Float32Array) -> FloatArray:
    """Numbers that are the same for all eight orientations of a print, and near for prints that are near."""
    low = np.abs(dctn(picture.astype(np.float64), norm="ortho"))[:_FREQUENCIES, :_FREQUENCIES]
    above = [(u, v) for u in range(_FREQUENCIES) for v in range(u + 1, _FREQUENCIES - u)]
    rows, cols = np.array(above).T
    upper, lower = low[rows, cols], low[cols, rows]
    diagonal = low.diagonal()[: (_FREQUENCIES + 1) // 2]
    return np.concatenate([diagonal, (upper + lower) / np.sqrt(2.0), np.abs(upper - lower) / np.sqrt(2.0)])
