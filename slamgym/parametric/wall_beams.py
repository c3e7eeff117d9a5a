"""What becomes of each wall cell that the robot saw: the exteroceptive model applied to a map.

Convention: world frame, component 0 = x, 1 = y, true minus measured [m]; fields lie on *true* cells.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from slamgym.core.geometry import unit_vectors, wrap_angle
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    IntArray,
)
from slamgym.parametric.lidar_error import (
    LidarErrors,
    displacement_x,
    displacement_y,
    max_ranges,
    rand_ranges,
    short_ranges,
)
from slamgym.parametric.visibility import Visibility
from slamgym.planning.costmap import cells_inside
from slamgym.sim.lidar import LidarConfig

_RANGE_NOISE = 0.01
"""Standard deviation of a range [m]."""
_BEARING_NOISE = math.radians(0.2)
"""Standard deviation of a bearing [rad]."""
_MEDIAN_PX = 5
"""Window of the median filters."""
_REVISIT = 0.05
"""Standard deviation, in x and y, of a wall in its last scan from the same wall in its best one [m]: two scans of a
mapper draw most walls of 5 cm cells twice as thick as one."""


class Shares(NamedTuple):
    """Of all beams: those that measure the wall, that meet something before it, without return, of any range."""

    hit: float
    short: float
    max: float
    rand: float


BEAMS = Shares(hit=0.95, short=0.03, max=0.01, rand=0.01)
"""A LIDAR's, as localisation programs assume them."""
PRINTED_WEIGHTS = Shares(hit=0.4, short=0.3, max=0.2, rand=0.1)
"""The paper's."""


@dataclass(frozen=True)
class WallBeams:
    """The beam that measured each seen wall cell (from the pose that saw it best)."""

    field: Float32Array  # (2, H, W) [m] displacement d_L, 0 where no beam hit
    hit: BoolArray  # (H, W) walls whose beam measured them
    lost: BoolArray  # (H, W) walls whose beam met something else
    set_points: FloatArray  # (N, 2) [m] where other sights set cells, true placement


class _Sights(NamedTuple):
    """The seen wall cells, each from the pose that saw it best."""

    rows: IntArray  # (N,)
    cols: IntArray  # (N,)
    sensors: FloatArray  # (N, 3) poses
    distance: FloatArray  # (N,) [m]
    bearing: FloatArray  # (N,) [rad], sensor frame


def _sights(visibility: Visibility) -> _Sights:
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    sensors = visibility.sensors[visibility.cells.best[rows, cols]]
    x, y = visibility.frame.to_point(rows, cols)
    dx = x - sensors[:, 0]
    dy = y - sensors[:, 1]
    bearing = np.asarray(wrap_angle(np.arctan2(dy, dx) - sensors[:, 2]))
    return _Sights(rows, cols, sensors, np.hypot(dx, dy), bearing)


def corrected_beams(
    visibility: Visibility,
    errors: LidarErrors,
    range_max: float,
    severity: float,
    rng: np.random.Generator,
) -> WallBeams:
    """Each beam is one kind of the mixture: only a hit shows its wall, displaced by (11) and (12).

    A short (7) and a random beam (9) set a cell where they end, the latter beyond the wall, too; one without return (8)
    sets none. Walls that were seen again are drawn a second time, which the paper leaves out.

    Args:
        visibility: Which pose saw the cell best.
        errors: Systematic coefficients.
        range_max: Longest range [m].
        severity: Multiplies the noise, and the shares of other beams until none hits.
        rng: Source of randomness.
    """
    sights = _sights(visibility)
    count = len(sights.rows)
    range_noise, bearing_noise = severity * rng.standard_normal((2, count))
    range_error = errors.range_error(sights.distance) + _RANGE_NOISE * range_noise
    bearing_error = errors.bearing_error(sights.distance, sights.bearing)
    bearing_error += _BEARING_NOISE * bearing_noise
    kind = _kinds(severity, rng.random(count))
    # A beam without return measures (8), which is no place on the map.
    measured = np.select(
        [kind == "hit", kind == "short", kind == "max"],
        [
            sights.distance - range_error,
            short_ranges(sights.distance, rng),
            max_ranges(count, range_max),
        ],
        rand_ranges(count, range_max, rng),
    )
    direction = sights.sensors[:, 2] + sights.bearing
    shift_x = displacement_x(sights.distance, direction, measured, bearing_error)
    shift_y = displacement_y(sights.distance, direction, measured, bearing_error)

    is_hit = kind == "hit"
    rows = sights.rows[is_hit]
    cols = sights.cols[is_hit]
    field = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    field[0, rows, cols] = shift_x[is_hit]
    field[1, rows, cols] = shift_y[is_hit]
    hit = np.zeros(visibility.frame.shape, dtype=np.bool_)
    hit[rows, cols] = True
    is_stray = (kind == "short") | (kind == "rand")
    along = measured[is_stray, None] * unit_vectors(direction[is_stray])
    strays = sights.sensors[is_stray, :2] + along
    return WallBeams(
        field=_median_of_known(field, rows, cols),
        hit=hit,
        lost=(visibility.cells.best >= 0) & ~hit,
        set_points=np.concatenate([strays, _seen_again(visibility, hit, severity, rng)]),
    )


def _seen_again(
    visibility: Visibility, hit: BoolArray, severity: float, rng: np.random.Generator
) -> FloatArray:
    """Where the last scan that saw a wall draws it, points (N, 2) [m] without the drift that both scans have.

    What a scan draws lies wrong as one piece, so walls become thick in pieces, as those of a mapper do.
    """
    wrong = severity * _REVISIT * rng.standard_normal((len(visibility.sensors), 2))
    rows, cols = np.nonzero(hit & (visibility.cells.last != visibility.cells.best))
    return visibility.frame.to_points(rows, cols) + wrong[visibility.cells.last[rows, cols]]


def _kinds(severity: float, dice: FloatArray) -> "np.ndarray[tuple[int, ...], np.dtype[np.str_]]":
    """The kind of each beam by a uniform draw (N,): a name of :class:`Shares`."""
    factor = min(severity, 1.0 / (1.0 - BEAMS.hit))
    others = factor * np.array(BEAMS[1:])
    edges = np.cumsum([1.0 - others.sum(), *others[:-1]])
    return np.array(Shares._fields)[np.searchsorted(edges, dice, side="right")]


def printed_beams(
    visibility: Visibility,
    errors: LidarErrors,
    range_max: float,
    severity: float,
    rng: np.random.Generator,
) -> WallBeams:
    """The model as printed: the weighted sum of the four displacements of each wall, of random D and alpha.

    As the paper has it: every pixel's range and bearing are random, then median filtered; b4 stands twice; (11) and
    (12) take the error D - z of short, max and random beams for the range. Its errors of max and random beams, which
    came from experiments, are not given: those of (8) and (9) stand for them. (10) is computed in its own range, see
    :func:`short_ranges`.

    Args:
        visibility: Which walls were seen.
        errors: Systematic coefficients.
        range_max: Longest range [m].
        severity: Multiplies the displacement.
        rng: Source of randomness.
    """
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    count = len(rows)
    picture = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    picture[0, rows, cols] = rng.uniform(LidarConfig.range_min, range_max, count)
    picture[1, rows, cols] = rng.uniform(-math.pi, math.pi, count)
    filtered = _median_of_known(picture, rows, cols)
    distance, alpha = filtered[:, rows, cols].astype(np.float64)
    errors = errors.as_printed()
    bearing_error = errors.bearing_error(distance, alpha)
    brackets = [
        distance - errors.range_error(distance),
        distance - short_ranges(distance, rng),
        distance - max_ranges(count, range_max),
        distance - rand_ranges(count, range_max, rng),
    ]
    field = np.zeros_like(picture)
    for weight, bracket in zip(PRINTED_WEIGHTS, brackets, strict=True):
        scale = severity * weight
        field[0, rows, cols] += scale * displacement_x(distance, alpha, bracket, bearing_error)
        field[1, rows, cols] += scale * displacement_y(distance, alpha, bracket, bearing_error)
    return WallBeams(
        field=field,
        hit=visibility.cells.best >= 0,
        lost=np.zeros(visibility.frame.shape, dtype=np.bool_),
        set_points=np.empty((0, 2)),
    )


def _median_of_known(field: Float32Array, rows: IntArray, cols: IntArray) -> Float32Array:
    """Median of the given cells in the window round each of them; other cells don't count and are 0."""
    half = _MEDIAN_PX // 2
    height, width = field.shape[1:]
    known = np.full((2, height + 2 * half, width + 2 * half), np.nan, np.float32)
    known[:, rows + half, cols + half] = field[:, rows, cols]
    windows = sliding_window_view(known, (_MEDIAN_PX, _MEDIAN_PX), axis=(1, 2))
    neighbours = windows[:, rows, cols].reshape(2, len(rows), _MEDIAN_PX**2)
    ordered = np.sort(neighbours)  # what is no number goes last
    count = np.isfinite(ordered).sum(axis=2, keepdims=True)
    median = np.take_along_axis(ordered, (count - 1) // 2, axis=2)
    filtered = np.zeros_like(field)
    filtered[:, rows, cols] = median[:, :, 0]
    return filtered


def observed_cad(occupied: BoolArray, visibility: Visibility, beams: WallBeams) -> ByteArray:
    """The part of the CAD map that the scans show, still in its true place: the picture that is then warped.

    Walls whose beam met something else are lost; other sights set cells elsewhere, unless they end beyond the map.

    Returns:
        (H, W) on true cells: 0 occupied, 205 unknown, 254 free.
    """
    true = np.where(occupied, OCCUPIED, FREE).astype(np.uint8)
    true[~visibility.seen | beams.lost] = UNKNOWN
    rows, cols, _ = cells_inside(visibility.frame, beams.set_points)
    true[rows, cols] = OCCUPIED
    return true
