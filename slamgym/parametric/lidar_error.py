"""Exteroceptive model: what the LIDAR measures of a wall cell, and the displacement that follows.

Systematic terms after Mader, Westfeld and Maas 2014; the beam mixture after Thrun, Burgard and Fox
(*Probabilistic Robotics*, ch. 6.3). Equation numbers are the seed paper's, corrected (docs/parametric.md).

Convention: range D [m] and bearing a [rad, counter-clockwise] are in the sensor frame. A cell at
D [cos a, sin a] is measured at z [cos(a - da), sin(a - da)].
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import ByteArray, Float32Array, FloatArray, IntArray
from slamgym.parametric.config import LidarErrorConfig, ScannerConfig
from slamgym.parametric.visibility import Visibility

HIT, SHORT, MAX, RAND = 0, 1, 2, 3
"""Components of the beam mixture."""
NO_BEAM = 255
"""Component of a cell that is no seen wall."""


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
            + self.b6 / np.maximum(distance, ScannerConfig.range_min)
        )


def draw_lidar_errors(config: LidarErrorConfig, rng: np.random.Generator) -> LidarErrors:
    """Draw one scanner."""
    sigmas = (config.a0, config.a1, config.b1, config.b2, config.b3, config.b4, config.b5, config.b6)
    return LidarErrors(*(float(v) for v in np.array(sigmas) * rng.standard_normal(8)))


def draw_components(shape: tuple[int, ...], config: LidarErrorConfig, rng: np.random.Generator) -> ByteArray:
    """One component of the mixture per beam, ~ Cat(hit, short, max, rand)."""
    edges = np.cumsum([config.weight_hit, config.weight_short, config.weight_max])
    return np.searchsorted(edges, rng.random(shape), side="right").astype(np.uint8)


def measure(
    distance: FloatArray,
    bearing: FloatArray,
    errors: LidarErrors,
    config: LidarErrorConfig,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Measured range [m] and bearing [rad] of beams that hit, with systematic errors and noise."""
    noise = rng.standard_normal((2, *distance.shape))
    measured = distance - errors.range_error(distance) - config.sigma_range * noise[0]
    return measured, bearing - errors.bearing_error(distance, bearing) - config.sigma_bearing * noise[1]


@dataclass(frozen=True)
class WallBeams:
    """The beam that measured each seen wall cell (from the pose that saw it best)."""

    field: Float32Array  # (2, H, W) [m] displacement d_L, world frame, 0 where no beam hit
    component: ByteArray  # (H, W) HIT, SHORT, MAX, RAND or NO_BEAM
    stray_points: FloatArray  # (N, 2) [m] where rand beams set a cell, true placement, world frame


def wall_beams(
    visibility: Visibility,
    errors: LidarErrors,
    config: LidarErrorConfig,
    scanner: ScannerConfig,
    rng: np.random.Generator,
) -> WallBeams:
    """The exteroceptive displacement of every seen wall cell.

    Convention: world frame, component 0 = x, 1 = y, true minus measured [m]; lies on *true* cells.

    Args:
        visibility: Which pose saw the cell best.
        errors: Systematic coefficients.
        config: Noise and mixture.
        scanner: Limits of the range.
        rng: Source of randomness.
    """
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    sensors = visibility.sensors[visibility.cells.best[rows, cols]]
    x, y = visibility.frame.to_point(rows, cols)
    dx, dy = x - sensors[:, 0], y - sensors[:, 1]
    distance = np.hypot(dx, dy)
    bearing = np.asarray(wrap_angle(np.arctan2(dy, dx) - sensors[:, 2]))
    measured, at = measure(distance, bearing, errors, config, rng)
    component = draw_components(distance.shape, config, rng)
    rng.random(distance.shape)  # once the ranges of short beams: seeds keep their maps
    anywhere = rng.uniform(0.0, scanner.range_max, distance.shape)
    shift = _shift(distance, bearing, measured, at, sensors[:, 2])
    hit = component == HIT
    field = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    field[:, rows[hit], cols[hit]] = shift[:, hit]
    if config.median_px > 1:
        field = _median_over_hits(field, rows[hit], cols[hit], config.median_px)
    per_cell = np.full(visibility.frame.shape, NO_BEAM, dtype=np.uint8)
    per_cell[rows, cols] = component
    stray = component == RAND
    direction = bearing[stray] + sensors[stray, 2]
    length = np.minimum(anywhere[stray], distance[stray])
    points = sensors[stray, :2] + length[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    return WallBeams(field, per_cell, points)


def _shift(
    distance: FloatArray, bearing: FloatArray, measured: FloatArray, at: FloatArray, heading: FloatArray
) -> FloatArray:
    """d_L = R(theta) (D [cos a, sin a] - z [cos(a - da), sin(a - da)]), eqs. (11), (12) corrected; (2, N)."""
    true_direction, measured_direction = heading + bearing, heading + at
    return np.stack(
        [
            distance * np.cos(true_direction) - measured * np.cos(measured_direction),
            distance * np.sin(true_direction) - measured * np.sin(measured_direction),
        ]
    )


def _median_over_hits(field: Float32Array, rows: IntArray, cols: IntArray, window_px: int) -> Float32Array:
    """Median of the hits in the window round each hit; cells without a hit don't count."""
    half = window_px // 2
    hit = np.zeros(field.shape[1:], dtype=np.bool_)
    hit[rows, cols] = True
    padded_hit = np.pad(hit, half)
    offsets = [(i, j) for i in range(2 * half + 1) for j in range(2 * half + 1)]
    valid = np.stack([padded_hit[rows + i, cols + j] for i, j in offsets])  # (window, N)
    filtered = np.zeros_like(field)
    for c in range(len(field)):
        padded = np.pad(field[c], half)
        stack = np.stack([padded[rows + i, cols + j] for i, j in offsets])
        stack[~valid] = np.inf
        stack.sort(axis=0)
        middle = (valid.sum(axis=0) - 1) // 2
        filtered[c, rows, cols] = stack[middle, np.arange(len(rows))]
    return filtered
