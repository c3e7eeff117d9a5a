"""What a scanner meets while it sweeps over its beams and the robot drives: numba kernels."""

import math
from typing import Any

import numpy as np

from slamgym.core import geometry
from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.sim.motion import chord
from slamgym.sim.raycast import cast_hits, cast_sweep, meet_on_time

_PART_DISTANCE = 0.02
"""While a scan is taken the scanner sees what is to be seen from one pose for this far at most [m]."""
_PART_TURN = 0.03
"""The same for a turn [rad]."""
_MOST_PARTS = 16
"""So many poses of the scanner there are in a scan at most."""

_compose: Any = kernel(geometry.compose)
KernelPose = tuple[float, float, float]
"""A pose as kernels take it [m, m, rad]."""


@kernel
def look_along(
    base: KernelPose,
    mount: KernelPose,
    way: tuple[float, float],
    angle_min: float,
    angle_increment: float,
    segments: FloatArray,
    range_max: float,
    ranges: FloatArray,
    hits: IntArray,
) -> FloatArray:
    """Find the surface that each beam meets first.

    Convention: ``base`` is the robot's when the last beam is measured, in the frame of the segments.

    Args:
        base: Where the robot is.
        mount: The scanner in the robot's frame.
        way: Distance [m] and turn [rad] between the first beam and the last.
        angle_min: As for :func:`slamgym.sim.raycast.cast_hits`.
        angle_increment: The same.
        segments: The same.
        range_max: The same.
        ranges: Receives the ranges, shape (num_beams,) [m].
        hits: Receives the indices of the segments met, shape (num_beams,).

    Returns:
        Poses of the scanner, shape (K, 3), each of which has measured its part of the beams.
    """
    distance, turn = way
    wanted = max(abs(distance) / _PART_DISTANCE, abs(turn) / _PART_TURN)
    parts = min(_MOST_PARTS, math.ceil(wanted))
    sensors = np.empty((max(1, parts), 3))
    if parts == 0:
        _put(sensors, 0, _compose(base, mount))
        x, y, theta = sensors[0]
        cast_hits(x, y, theta, angle_min, angle_increment, segments, range_max, ranges, hits)
        return sensors
    for k in range(parts):
        _put(sensors, k, _sensor(base, mount, way, 1.0 - (k + 0.5) / parts))
    first = 1.0 - 0.5 / parts
    for k in range(1, parts):
        # No jump at half a turn, so that poses between these can be interpolated.
        sensors[k, 2] = sensors[0, 2] + turn * (first - (1.0 - (k + 0.5) / parts))
    cast_sweep(sensors, angle_min, angle_increment, segments, range_max, ranges, hits)
    on_way = np.empty((3, 3))
    for k in range(3):
        _put(on_way, k, _sensor(base, mount, way, 1.0 - 0.5 * k))
        on_way[k, 2] = on_way[0, 2] + turn * 0.5 * k
    meet_on_time(on_way, angle_min, angle_increment, segments, range_max, ranges, hits)
    return sensors


@kernel
def _sensor(
    base: KernelPose, mount: KernelPose, way: tuple[float, float], left: float
) -> KernelPose:
    """Pose of the sensor when a share of the sweep is left."""
    x, y, theta = base
    if left > 0.0:
        distance, turn = way
        dx, dy = chord(theta, -left * distance, -left * turn)
        x += dx
        y += dy
        theta -= left * turn
    pose = _compose((x, y, theta), mount)
    return pose[0], pose[1], pose[2]


@kernel
def _put(rows: FloatArray, index: int, pose: KernelPose) -> None:
    rows[index, 0] = pose[0]
    rows[index, 1] = pose[1]
    rows[index, 2] = pose[2]
