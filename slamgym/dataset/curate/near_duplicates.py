"""Find floor plans that look the same: copies, mirror images, turned ones, and the same home with a wall moved.

The print of a plan is a picture of 32 x 32 values of unit norm: for each place of its floor the distance to the
nearest wall, up to a tenth of the longer side; so a thin wall weighs as much as a thick one, and one that is moved
a little changes a little. The plan is first turned so that most of its walls run along the sides of the picture,
and then scaled to its bounding box: a copy that lies askew has the same print, and so has a larger or smaller one.
Two plans are near-duplicates if their prints are within :data:`RADIUS` of each other in one of the eight ways to
turn and flip one of them.

Comparing all pairs of 35,000 plans is too much, so a k-d tree proposes them by a perceptual hash: the
magnitudes of the lowest frequencies of the print's cosine transform, as in pHash (Zauner, Implementation and
benchmarking of perceptual image hash functions, 2010, section 3.2.1), made blind to flips and quarter turns.
Flips change only the signs of the coefficients and a transposition swaps ``(u, v)`` with ``(v, u)``; taking
magnitudes, and the sum and the difference of each swapped pair, moves no two points apart. Hence prints within
the radius have hashes within it: no pair is missed.
"""

import math

import cv2
import numpy as np
import shapely
from scipy.fft import dctn
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slamgym.cad import FloorPlan
from slamgym.cad.floorplan import fill_segments, ring_segments
from slamgym.core.types import Float32Array, FloatArray, GridFrame, IntArray
from slamgym.metrics.wall_direction import main_direction

SIDE = 32
"""Rows and columns of a print."""
_SUB = 4  # each is the mean of so many by so many cells
RADIUS = 0.12
"""Distance of unit prints up to which plans count as the same."""
_REACH = 0.1  # of the longer side: distances from walls are looked at up to here
_SHIFT = 6  # fractional bits of OpenCV's drawing coordinates
_FREQUENCIES = 6  # of the hash: those with u + v below
_CHUNK = 4096

_SMOOTHING = 0.005  # of the longer side: HouseExpo draws slanted walls as staircases of 1 cm


def plan_print(plan: FloorPlan) -> Float32Array:
    """The print of a plan, shape (SIDE, SIDE), of unit norm.

    The longer side of the turned plan's bounding box fills the picture; the shorter one is centred.
    """
    direction = _wall_direction(plan)
    cos, sin = math.cos(direction), math.sin(direction)
    points = plan.segments().reshape(-1, 2) @ np.array(
        [[cos, -sin], [sin, cos]]
    )  # turned by -direction
    (min_x, min_y), (max_x, max_y) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    side = max(max_x - min_x, max_y - min_y)
    cells = SIDE * _SUB
    # The box ends in the middle of the outer cells, so that drawing it is the same for a mirror image.
    resolution = side / (cells - 1)
    low_x, low_y = (
        0.5 * (low + high - cells * resolution) for low, high in ((min_x, max_x), (min_y, max_y))
    )
    frame = GridFrame(resolution, low_x, low_y, cells, cells)
    free = np.ascontiguousarray(fill_segments(points.reshape(-1, 4), frame)[::-1], dtype=np.uint8)
    # Faces are drawn, too, because cells may miss thin walls. Row 0 is at the bottom.
    pixels = (points - [low_x, low_y]) / resolution - 0.5
    faces = list(np.rint(pixels * (1 << _SHIFT)).astype(np.int32).reshape(-1, 2, 2))
    cv2.polylines(
        free, faces, isClosed=False, color=0, thickness=1, lineType=cv2.LINE_8, shift=_SHIFT
    )
    away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5)
    picture = cv2.resize(
        np.minimum(away, _REACH * cells), (SIDE, SIDE), interpolation=cv2.INTER_AREA
    )
    return np.asarray(picture / max(float(np.linalg.norm(picture)), 1e-9), dtype=np.float32)


def _wall_direction(plan: FloorPlan) -> float:
    """The direction of most of the walls, up to quarter turns [rad]; it turns with the plan."""
    min_x, min_y, max_x, max_y = plan.bounds
    tolerance = _SMOOTHING * max(max_x - min_x, max_y - min_y)
    faces = plan.free_space.boundary.simplify(tolerance, preserve_topology=False)
    segments = ring_segments(shapely.get_parts(faces))
    return math.radians(main_direction(segments[:, 2:] - segments[:, :2], 0.0).angle_deg)


def near_duplicates(prints: Float32Array, radius: float = RADIUS) -> IntArray:
    """Group plans of which each looks like another one of its group.

    Args:
        prints: Shape (N, SIDE, SIDE).
        radius: Largest distance of two prints that count as the same.

    Returns:
        For each plan the lowest index in its group, shape (N,).
    """
    count = len(prints)
    pairs = _candidates(prints, radius)
    same = [
        chunk[distances(prints[chunk[:, 0]], prints[chunk[:, 1]]) <= radius]
        for chunk in np.array_split(pairs, max(1, -(-len(pairs) // _CHUNK)))
    ]
    edges = np.concatenate(same)
    graph = coo_array(
        (np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count)
    )
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
                best,
                np.linalg.norm((prints - flipped).reshape(len(prints), SIDE * SIDE), axis=1),
                out=best,
            )
    return best


def _hash(picture: Float32Array) -> FloatArray:
    """Numbers that are the same for all eight orientations of a print, and near for prints that are near."""
    low = np.abs(dctn(picture.astype(np.float64), norm="ortho"))[:_FREQUENCIES, :_FREQUENCIES]
    above = [(u, v) for u in range(_FREQUENCIES) for v in range(u + 1, _FREQUENCIES - u)]
    rows, cols = np.array(above).T
    upper, lower = low[rows, cols], low[cols, rows]
    diagonal = low.diagonal()[: (_FREQUENCIES + 1) // 2]
    return np.concatenate(
        [diagonal, (upper + lower) / np.sqrt(2.0), np.abs(upper - lower) / np.sqrt(2.0)]
    )
