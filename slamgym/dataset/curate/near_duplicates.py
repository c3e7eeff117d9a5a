"""Find floor plans that look the same: copies, mirror images, turned ones, and the same home with a wall moved.

The print of a plan is a picture of 32 x 32 values of unit norm: for each place of its floor the distance to the
nearest wall, up to a tenth of the longer side; so a thin wall weighs as much as a thick one, and one that is moved
a little changes a little. The plan is first turned so that most of its walls run along the sides of the picture,
and then scaled to its bounding box: a copy that lies askew has the same print, and so has a larger or smaller one.
Two plans are near-duplicates if their prints are within :data:`RADIUS` of each other in one of the eight ways to
turn and flip one of them, and, where images tell large plans from small ones, if their sizes agree, too.

Comparing all pairs of 35,000 plans is too much, so a k-d tree proposes them by a perceptual hash: the
magnitudes of the lowest frequencies of the print's cosine transform, as in pHash (Zauner, Implementation and
benchmarking of perceptual image hash functions, 2010, section 3.2.1), made blind to flips and quarter turns.
Flips change only the signs of the coefficients and a transposition swaps ``(u, v)`` with ``(v, u)``; taking
magnitudes, and the sum and the difference of each swapped pair, moves no two points apart. Hence prints within
the radius have hashes within it: no pair is missed.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from scipy.fft import dctn
from scipy.ndimage import uniform_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slamgym.cad import FloorPlan
from slamgym.cad.floorplan import fill_segments, ring_segments
from slamgym.core.types import Float32Array, FloatArray, GridFrame, IntArray

SIDE = 32
"""Rows and columns of a print."""
_SUB = 4  # each is the mean of so many by so many cells
RADIUS = 0.12
"""Distance of unit prints up to which plans count as the same."""
SIZE_TOLERANCE = 0.03
"""Difference of the logarithms of the longer sides up to which plans count as equally large."""
_REACH = 0.1  # of the longer side: distances from walls are looked at up to here
_SHIFT = 6  # fractional bits of OpenCV's drawing coordinates
_FREQUENCIES = 6  # of the hash: those with u + v below
_CHUNK = 4096

_QUARTER = 0.5 * math.pi
_DIRECTIONS = 180  # in a quarter turn
_SPREAD = math.radians(2.0)  # walls within this of a direction count for it
_SMOOTHING = 0.005  # of the longer side: HouseExpo draws slanted walls as staircases of 1 cm


class PlanPrint(NamedTuple):
    """Fingerprint of a plan's appearance."""

    picture: Float32Array
    """Shape (SIDE, SIDE), of unit norm."""
    side: float
    """Longer side of what the picture shows [m]."""


def plan_print(plan: FloorPlan) -> PlanPrint:
    """The print of a plan.

    The longer side of the turned plan's bounding box fills the picture; the shorter one is centred.
    """
    direction = _wall_direction(plan)
    cos, sin = math.cos(direction), math.sin(direction)
    points = plan.segments().reshape(-1, 2) @ np.array([[cos, -sin], [sin, cos]])  # turned by -direction
    (min_x, min_y), (max_x, max_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    side = max(max_x - min_x, max_y - min_y)
    cells = SIDE * _SUB
    # The box ends in the middle of the outer cells, so that drawing it is the same for a mirror image.
    resolution = side / (cells - 1)
    low_x, low_y = (0.5 * (low + high - cells * resolution) for low, high in ((min_x, max_x), (min_y, max_y)))
    frame = GridFrame(resolution, low_x, low_y, cells, cells)
    free = np.ascontiguousarray(fill_segments(points.reshape(-1, 4), frame)[::-1], dtype=np.uint8)
    # Faces are drawn, too, because cells may miss thin walls. Row 0 is at the bottom.
    pixels = (points - [low_x, low_y]) / resolution - 0.5
    faces = list(np.rint(pixels * (1 << _SHIFT)).astype(np.int32).reshape(-1, 2, 2))
    cv2.polylines(free, faces, isClosed=False, color=0, thickness=1, lineType=cv2.LINE_8, shift=_SHIFT)
    away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5)
    picture = cv2.resize(np.minimum(away, _REACH * cells), (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    return PlanPrint((picture / max(float(np.linalg.norm(picture)), 1e-9)).astype(np.float32), side)


def _wall_direction(plan: FloorPlan) -> float:
    """The direction of most of the walls, up to quarter turns [rad]; it turns with the plan."""
    min_x, min_y, max_x, max_y = plan.bounds
    tolerance = _SMOOTHING * max(max_x - min_x, max_y - min_y)
    faces = plan.free_space.boundary.simplify(tolerance, preserve_topology=False)
    segments = ring_segments(shapely.get_parts(faces))
    along, across = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    lengths = np.hypot(along, across)
    angles = np.arctan2(across, along) % _QUARTER
    bins = (angles * (_DIRECTIONS / _QUARTER)).astype(np.int64) % _DIRECTIONS
    histogram = np.bincount(bins, weights=lengths, minlength=_DIRECTIONS)
    size = 2 * round(0.5 * _SPREAD * _DIRECTIONS / _QUARTER) + 1
    smooth = uniform_filter1d(uniform_filter1d(histogram, size, mode="wrap"), size, mode="wrap")  # triangular
    peak = int(np.argmax(smooth))
    direction = (peak + 0.5) * _QUARTER / _DIRECTIONS
    for _ in range(2):  # from the middle of the bins to the walls' own direction
        direction += _median_offset(angles, lengths, direction)
    return direction


def _median_offset(angles: FloatArray, lengths: FloatArray, direction: float) -> float:
    """Median, by length, of how far the walls near a direction are turned from it [rad]; 0 if there are none."""
    offsets = (angles - direction + 0.5 * _QUARTER) % _QUARTER - 0.5 * _QUARTER
    near = np.flatnonzero(np.abs(offsets) <= _SPREAD)
    near = near[np.argsort(offsets[near])]
    total = np.cumsum(lengths[near])
    return float(offsets[near[np.searchsorted(total, 0.5 * total[-1])]]) if len(near) else 0.0


def near_duplicates(
    prints: Float32Array, sides: FloatArray | None = None, radius: float = RADIUS
) -> IntArray:
    """Group plans of which each looks like another one of its group.

    Args:
        prints: Pictures, shape (N, SIDE, SIDE).
        sides: Longer sides of what the pictures show, shape (N,) [m]; None where images are scaled to the plan,
            so that the size can't be seen.
        radius: Largest distance of two pictures that count as the same.

    Returns:
        For each plan the lowest index in its group, shape (N,).
    """
    count = len(prints)
    pairs = _candidates(prints, radius)
    if sides is not None:
        pairs = pairs[np.abs(np.log(sides[pairs[:, 0]] / sides[pairs[:, 1]])) <= SIZE_TOLERANCE]
    same = [
        chunk[distances(prints[chunk[:, 0]], prints[chunk[:, 1]]) <= radius]
        for chunk in np.array_split(pairs, max(1, -(-len(pairs) // _CHUNK)))
    ]
    edges = np.concatenate(same)
    graph = coo_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    first = np.full(labels.max(initial=-1) + 1, count, dtype=np.int64)
    np.minimum.at(first, labels, np.arange(count))
    return first[labels]


def _candidates(prints: Float32Array, radius: float) -> IntArray:
    """Pairs of indices, shape (P, 2), that hold all near-duplicates and some more."""
    if len(prints) < 2:
        return np.empty((0, 2), dtype=np.int64)
    hashes = np.stack([_hash(picture) for picture in prints])
    return cKDTree(hashes).query_pairs(radius, output_type="ndarray")


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
