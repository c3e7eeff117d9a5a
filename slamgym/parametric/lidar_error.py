"""Exteroceptive model: what the LIDAR measures of a wall cell, and the displacement that follows.

Systematic terms after Mader, Westfeld and Maas 2014; the beam mixture after Thrun, Burgard and Fox
(*Probabilistic Robotics*, ch. 6.3). Equation numbers are the seed paper's, corrected (docs/parametric.md).

Convention: range D [m] and bearing a [rad, counter-clockwise] are in the sensor frame. A cell at
D [cos a, sin a] is measured at z [cos(a - da), sin(a - da)].
"""

import math
from dataclasses import dataclass

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
from slamgym.parametric.visibility import Visibility
from slamgym.sim.lidar import LidarConfig

_RANGE_NOISE = 0.01
"""Standard deviation of a range [m]."""
_BEARING_NOISE = math.radians(0.2)
"""Standard deviation of a bearing [rad]."""
_SHORT = 0.03
"""Share of the beams that meet something in front of the wall."""
_MAX = 0.01
"""Share of the beams that have no return."""
_RAND = 0.01
"""Share of the beams that have any range."""
_MEDIAN_PX = 5
"""Window of the median filter over the hits."""


@dataclass(frozen=True)
class LidarErrors:
    """Systematic coefficients of one scanner, drawn once."""

    a0: float = 0.0  # [m]
    a1: float = 0.0  # [-]
    b1: float = 0.0  # [-]
    b2: float = 0.0  # [rad]
    b3: float = 0.0  # [rad]
    b4: float = 0.0  # [rad]
    b5: float = 0.0  # [rad]
    b6: float = 0.0  # [rad m]

    @classmethod
    def draw(cls, rng: np.random.Generator, severity: float = 1.0) -> "LidarErrors":
        """Draw one scanner."""
        unit = rng.standard_normal(8).tolist()
        return cls(
            a0=severity * _SPREAD.a0 * unit[0],
            a1=severity * _SPREAD.a1 * unit[1],
            b1=severity * _SPREAD.b1 * unit[2],
            b2=severity * _SPREAD.b2 * unit[3],
            b3=severity * _SPREAD.b3 * unit[4],
            b4=severity * _SPREAD.b4 * unit[5],
            b5=severity * _SPREAD.b5 * unit[6],
            b6=severity * _SPREAD.b6 * unit[7],
        )

    def range_error(self, distance: FloatArray) -> FloatArray:
        """Systematic part of D minus the measured range [m]."""
        return self.a0 + self.a1 * distance

    def bearing_error(self, distance: FloatArray, bearing: FloatArray) -> FloatArray:
        """Systematic part of a minus the measured bearing [rad]; the paper prints b4 twice for b4, b5."""
        return (
            self.b1 * bearing
            + self.b2 * np.sin(bearing)
            + self.b3 * np.cos(bearing)
            + self.b4 * np.sin(2.0 * bearing)
            + self.b5 * np.cos(2.0 * bearing)
            + self.b6 / np.maximum(distance, LidarConfig.range_min)
        )


_SPREAD = LidarErrors(
    a0=0.005,
    a1=0.002,
    b1=0.0003,
    b2=math.radians(0.1),
    b3=math.radians(0.1),
    b4=math.radians(0.05),
    b5=math.radians(0.05),
    b6=math.radians(0.01),
)
"""Standard deviations over scanners: Mader's table was not available, and these keep within the 0.2 % of range and
0.2 deg that its abstract reports."""


@dataclass(frozen=True)
class WallBeams:
    """The beam that measured each seen wall cell (from the pose that saw it best)."""

    field: Float32Array  # (2, H, W) [m] displacement d_L, world frame, 0 where no beam hit
    hit: BoolArray  # (H, W) walls whose beam measured them
    lost: BoolArray  # (H, W) walls whose beam met something else
    stray_points: FloatArray
    """(N, 2) [m] where beams of any range set a cell, true placement, world frame."""


def wall_beams(
    visibility: Visibility,
    errors: LidarErrors,
    range_max: float,
    severity: float,
    rng: np.random.Generator,
) -> WallBeams:
    """The exteroceptive displacement of every seen wall cell: eqs. (11), (12) corrected.

    Convention: world frame, component 0 = x, 1 = y, true minus measured [m]; lies on *true* cells.

    Args:
        visibility: Which pose saw the cell best.
        errors: Systematic coefficients.
        range_max: Longest range that a stray beam can have [m].
        severity: Multiplies the noise, and the shares of stray beams until none hits.
        rng: Source of randomness.
    """
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    sensors = visibility.sensors[visibility.cells.best[rows, cols]]
    x, y = visibility.frame.to_point(rows, cols)
    dx = x - sensors[:, 0]
    dy = y - sensors[:, 1]
    distance = np.hypot(dx, dy)
    bearing = np.asarray(wrap_angle(np.arctan2(dy, dx) - sensors[:, 2]))
    range_noise, bearing_noise = rng.standard_normal((2, *distance.shape))
    range_error = errors.range_error(distance)
    bearing_error = errors.bearing_error(distance, bearing)
    measured_distance = distance - range_error - severity * _RANGE_NOISE * range_noise
    measured_bearing = bearing - bearing_error - severity * _BEARING_NOISE * bearing_noise
    is_hit, is_stray = _fates(severity, rng.random(distance.shape))
    any_range = rng.uniform(0.0, range_max, distance.shape)
    to_wall = unit_vectors(sensors[:, 2] + bearing)
    to_measured = unit_vectors(sensors[:, 2] + measured_bearing)

    shape = visibility.frame.shape
    shift = distance[:, None] * to_wall - measured_distance[:, None] * to_measured
    field = np.zeros((2, *shape), dtype=np.float32)
    field[:, rows[is_hit], cols[is_hit]] = shift[is_hit].T
    hit = np.zeros(shape, dtype=np.bool_)
    hit[rows, cols] = is_hit
    lost = np.zeros(shape, dtype=np.bool_)
    lost[rows, cols] = ~is_hit
    length = np.minimum(any_range, distance)[is_stray, None]
    return WallBeams(
        field=_median_over_hits(field, rows[is_hit], cols[is_hit]),
        hit=hit,
        lost=lost,
        stray_points=sensors[is_stray, :2] + length * to_wall[is_stray],
    )


def _fates(severity: float, dice: FloatArray) -> tuple[BoolArray, BoolArray]:
    """For each beam, True if it hits the wall, and True if its range is random; by uniform draws."""
    factor = min(severity, 1.0 / (_SHORT + _MAX + _RAND))
    short = _SHORT * factor
    long = _MAX * factor
    rand = _RAND * factor
    edges = np.cumsum([1.0 - short - long - rand, short, long])
    return dice < edges[0], dice >= edges[2]


def _median_over_hits(field: Float32Array, rows: IntArray, cols: IntArray) -> Float32Array:
    """Median of the hits in the window round each hit; cells without a hit don't count."""
    half = _MEDIAN_PX // 2
    height, width = field.shape[1:]
    hits = np.full((2, height + 2 * half, width + 2 * half), np.nan, np.float32)
    hits[:, rows + half, cols + half] = field[:, rows, cols]
    windows = sliding_window_view(hits, (_MEDIAN_PX, _MEDIAN_PX), axis=(1, 2))
    neighbours = windows[:, rows, cols].reshape(2, len(rows), _MEDIAN_PX**2)
    ordered = np.sort(neighbours)  # what is no number goes last
    count = np.isfinite(ordered).sum(axis=2, keepdims=True)
    median = np.take_along_axis(ordered, (count - 1) // 2, axis=2)
    filtered = np.zeros_like(field)
    filtered[:, rows, cols] = median[:, :, 0]
    return filtered


def observed_cad(occupied: BoolArray, visibility: Visibility, beams: WallBeams) -> ByteArray:
    """The part of the CAD map that the scans show, still in its true place: the picture that is then warped.

    Walls whose beam met something else are lost; a stray beam may set a cell elsewhere.

    Returns:
        (H, W) on true cells: 0 occupied, 205 unknown, 254 free.
    """
    true = np.where(occupied, OCCUPIED, FREE).astype(np.uint8)
    true[~visibility.seen | beams.lost] = UNKNOWN
    stray_x, stray_y = beams.stray_points.T
    true[visibility.frame.to_cell(stray_x, stray_y)] = OCCUPIED
    return true
