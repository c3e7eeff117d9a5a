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

from slamgym.core.geometry import wrap_angle
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

_SYSTEMATIC = (0.005, 0.002, 0.0003, *(math.radians(deg) for deg in (0.1, 0.1, 0.05, 0.05, 0.01)))
"""Standard deviations of a0, a1, b1 to b6 over scanners: Mader's table was not available, and these keep within the
0.2 % of range and 0.2 deg that its abstract reports."""
_NOISE = (0.01, math.radians(0.2))
"""Standard deviations of a range [m] and of a bearing [rad]."""
_SHORT, _MAX, _RAND = 0.03, 0.01, 0.01
"""Shares of the beams that meet something in front of the wall, that have no return, and that have any range."""
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
        return cls(*(severity * np.array(_SYSTEMATIC) * rng.standard_normal(8)).tolist())

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


@dataclass(frozen=True)
class WallBeams:
    """The beam that measured each seen wall cell (from the pose that saw it best)."""

    field: Float32Array  # (2, H, W) [m] displacement d_L, world frame, 0 where no beam hit
    hit: BoolArray  # (H, W) walls whose beam measured them
    lost: BoolArray  # (H, W) walls whose beam met something else
    stray_points: (
        FloatArray  # (N, 2) [m] where beams of any range set a cell, true placement, world frame
    )


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
    dx, dy = x - sensors[:, 0], y - sensors[:, 1]
    distance = np.hypot(dx, dy)
    bearing = np.asarray(wrap_angle(np.arctan2(dy, dx) - sensors[:, 2]))
    noise = rng.standard_normal((2, *distance.shape))
    measured = distance - errors.range_error(distance) - severity * _NOISE[0] * noise[0]
    at = bearing - errors.bearing_error(distance, bearing) - severity * _NOISE[1] * noise[1]
    hit, stray = _fates(severity, rng.random(distance.shape))
    anywhere = rng.uniform(0.0, range_max, distance.shape)
    direction, measured_direction = sensors[:, 2] + bearing, sensors[:, 2] + at
    field = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    shift = (
        distance * np.cos(direction) - measured * np.cos(measured_direction),
        distance * np.sin(direction) - measured * np.sin(measured_direction),
    )
    field[:, rows[hit], cols[hit]] = np.stack(shift)[:, hit]
    field = _median_over_hits(field, rows[hit], cols[hit])
    is_hit, is_lost = np.zeros((2, *visibility.frame.shape), dtype=np.bool_)
    is_hit[rows, cols], is_lost[rows, cols] = hit, ~hit
    length = np.minimum(anywhere, distance)[stray, None]
    away = np.column_stack([np.cos(direction), np.sin(direction)])[stray]
    return WallBeams(field, is_hit, is_lost, sensors[stray, :2] + length * away)


def _fates(severity: float, dice: FloatArray) -> tuple[BoolArray, BoolArray]:
    """For each beam, True if it hits the wall, and True if its range is random; by uniform draws."""
    factor = min(severity, 1.0 / (_SHORT + _MAX + _RAND))
    short, long, rand = (share * factor for share in (_SHORT, _MAX, _RAND))
    edges = np.cumsum([1.0 - short - long - rand, short, long])
    return dice < edges[0], dice >= edges[2]


def _median_over_hits(field: Float32Array, rows: IntArray, cols: IntArray) -> Float32Array:
    """Median of the hits in the window round each hit; cells without a hit don't count."""
    half = _MEDIAN_PX // 2
    hits = np.full((len(field), *(size + 2 * half for size in field.shape[1:])), np.nan, np.float32)
    hits[:, rows + half, cols + half] = field[:, rows, cols]
    windows = sliding_window_view(hits, (_MEDIAN_PX, _MEDIAN_PX), axis=(1, 2))[:, rows, cols]
    ordered = np.sort(
        windows.reshape(len(field), len(rows), _MEDIAN_PX**2)
    )  # what is no number goes last
    middle = (np.isfinite(ordered).sum(axis=2, keepdims=True) - 1) // 2
    filtered = np.zeros_like(field)
    filtered[:, rows, cols] = np.take_along_axis(ordered, middle, axis=2)[:, :, 0]
    return filtered


def observed_cad(occupied: BoolArray, visibility: Visibility, beams: WallBeams) -> ByteArray:
    """The part of the CAD map that the scans show, still in its true place: the picture that is then warped.

    Walls whose beam met something else are lost; a stray beam may set a cell elsewhere.

    Returns:
        (H, W) on true cells: 0 occupied, 205 unknown, 254 free.
    """
    true = np.where(occupied, OCCUPIED, FREE).astype(np.uint8)
    true[~visibility.seen | beams.lost] = UNKNOWN
    true[visibility.frame.to_cell(beams.stray_points[:, 0], beams.stray_points[:, 1])] = OCCUPIED
    return true
