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
_SUB = 4
"""A value of a print is the mean of so many by so many cells."""
RADIUS = 0.12
"""Distance of unit prints up to which plans count as the same."""
_REACH = 0.1
"""Distances from walls are looked at up to here, as a share of the longer side."""
_SHIFT = 6
"""Fractional bits of OpenCV's drawing coordinates."""
_FREQUENCIES = 6
"""The hash takes the frequencies with u + v below this."""
_CHUNK = 4096
"""Pairs of prints that are compared at once."""
_SMOOTHING = 0.005
"""Walls are smoothed by this share of the longer side: HouseExpo draws slanted ones as staircases of 1 cm."""


def plan_print(plan: FloorPlan) -> Float32Array:
    """The print of a plan, shape (SIDE, SIDE), of unit norm.

    The longer side of the turned plan's bounding box fills the picture; the shorter one is centred.
    """
    points = _upright_points(plan)
    frame = _centred_frame(points)
    inside = fill_segments(points.reshape(-1, 4), frame)[::-1]
    free = np.ascontiguousarray(inside, dtype=np.uint8)
    # Faces are drawn, too, because cells may miss thin walls. Row 0 is at the bottom.
    pixels = (points - [frame.origin_x, frame.origin_y]) / frame.resolution - 0.5
    fixed_point = np.rint(pixels * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(
        free,
        list(fixed_point.reshape(-1, 2, 2)),
        isClosed=False,
        color=0,
        thickness=1,
        lineType=cv2.LINE_8,
        shift=_SHIFT,
    )
    away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5)
    near = np.minimum(away, _REACH * SIDE * _SUB)
    picture = cv2.resize(near, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    norm = float(np.linalg.norm(picture))
    return np.asarray(picture / max(norm, 1e-9), dtype=np.float32)


def _upright_points(plan: FloorPlan) -> FloatArray:
    """Ends of all edges, (2 S, 2) [m], turned so that most of the walls run along the axes."""
    direction = _wall_direction(plan)
    cos = math.cos(direction)
    sin = math.sin(direction)
    turn_back = np.array([[cos, -sin], [sin, cos]])
    return plan.segments().reshape(-1, 2) @ turn_back


def _centred_frame(points: FloatArray) -> GridFrame:
    """A square frame with the points in its middle, filled by the longer side of their bounding box.

    The box ends in the middle of the outer cells, so that drawing it is the same for a mirror image.
    """
    min_x, min_y = points.min(axis=0).tolist()
    max_x, max_y = points.max(axis=0).tolist()
    cells = SIDE * _SUB
    resolution = max(max_x - min_x, max_y - min_y) / (cells - 1)
    return GridFrame(
        resolution=resolution,
        origin_x=0.5 * (min_x + max_x - cells * resolution),
        origin_y=0.5 * (min_y + max_y - cells * resolution),
        height_px=cells,
        width_px=cells,
    )


def _wall_direction(plan: FloorPlan) -> float:
    """The direction of most of the walls, up to quarter turns [rad]; it turns with the plan."""
    min_x, min_y, max_x, max_y = plan.bounds
    tolerance = _SMOOTHING * max(max_x - min_x, max_y - min_y)
    faces = plan.free_space.boundary.simplify(tolerance, preserve_topology=False)
    segments = ring_segments(shapely.get_parts(faces))
    walls = segments[:, 2:] - segments[:, :2]
    return math.radians(main_direction(walls, 0.0).angle_deg)


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
    num_chunks = max(1, math.ceil(len(pairs) / _CHUNK))
    same = []
    for chunk in np.array_split(pairs, num_chunks):
        first, second = chunk.T
        same.append(chunk[distances(prints[first], prints[second]) <= radius])
    rows, cols = np.concatenate(same).T
    edges = np.ones(len(rows), dtype=np.int8)
    graph = coo_array((edges, (rows, cols)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    lowest = np.full(labels.max(initial=-1) + 1, count, dtype=np.int64)
    np.minimum.at(lowest, labels, np.arange(count))
    return lowest[labels]


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
    count = len(prints)
    best = np.full(count, np.inf, dtype=np.float32)
    for turned in (others, others.transpose(0, 2, 1)):
        for flipped in (turned, turned[:, ::-1], turned[:, :, ::-1], turned[:, ::-1, ::-1]):
            difference = (prints - flipped).reshape(count, SIDE * SIDE)
            np.minimum(best, np.linalg.norm(difference, axis=1), out=best)
    return best


def _hash(picture: Float32Array) -> FloatArray:
    """Numbers that are the same for all eight orientations of a print, and near for prints that are near."""
    cosines = dctn(picture.astype(np.float64), norm="ortho")
    low = np.abs(cosines[:_FREQUENCIES, :_FREQUENCIES])
    above = [(u, v) for u in range(_FREQUENCIES) for v in range(u + 1, _FREQUENCIES - u)]
    rows, cols = np.array(above).T
    upper = low[rows, cols]
    lower = low[cols, rows]
    diagonal = low.diagonal()[: (_FREQUENCIES + 1) // 2]
    sums = (upper + lower) / np.sqrt(2.0)
    differences = np.abs(upper - lower) / np.sqrt(2.0)
    return np.concatenate([diagonal, sums, differences])
