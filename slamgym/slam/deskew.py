"""Scans that take their time, as if they were taken at once.

A return lies where its beam met a surface, seen from where the robot was then. What a laser at rest would have measured
in each direction follows from the surfaces between neighbouring returns. Between the first beam and the last the robot
is taken to drive at constant speeds.
"""

import math
from dataclasses import replace

import numpy as np

from slamgym.core.geometry import compose, inverse, transform_points
from slamgym.core.jit import kernel, plain
from slamgym.core.types import AT_REST, Float32Array, FloatArray, LaserGeometry, LaserScan, Pose2D

STEEPEST_SLOPE = math.tan(math.radians(80.0))
"""Two neighbouring returns lie on one surface if it is seen less steeply: within 10 degrees of the beam it is taken for
the veil behind an edge (``min_angle`` in the example of laser_filters' ScanShadowsFilter)."""
WIDEST_BEAMS = 2.0
"""And if they lie less far apart than so many beams: a gap that opens between near and far was seen by nobody."""
DIRECTION_ROUNDING = 1e-6
"""A direction belongs to a beam although it misses it by so little [beams]."""


def deskewed(scan: LaserScan, motion: Pose2D | None = None) -> LaserScan:
    """The scan as a laser would have taken it at once, at its stamp.

    Directions that no beam has met are nan; where several fall on one, the nearest return counts. Beams without return
    stay so in their turned direction.

    Args:
        scan: Any scan; one that was taken at once or at rest comes back as it is.
        motion: Of the base from the first beam to the last; by default the scan's own.
    """
    geometry = scan.geometry
    moved = scan.motion if motion is None else motion
    if moved == AT_REST or geometry.time_increment == 0.0 or geometry.num_beams < 2:
        return scan
    ranges = np.full(geometry.num_beams, np.nan, dtype=np.float32)
    take_at_once(scan.ranges, *_sweep(geometry, moved), ranges)
    return replace(
        scan, ranges=ranges, geometry=geometry._replace(time_increment=0.0), motion=AT_REST
    )


def deskewed_at_last_beam(scan: LaserScan) -> LaserScan:
    """The scan as a laser would have taken it at once where the robot is at its last beam; see :func:`deskewed`."""
    geometry = scan.geometry
    if scan.motion == AT_REST:
        return scan
    backwards = replace(
        scan,
        stamp=scan.stamp + geometry.scan_time,
        geometry=geometry._replace(time_increment=-geometry.time_increment),
    )
    return deskewed(backwards, inverse(scan.motion))


def placed_returns(scan: LaserScan, motion: Pose2D) -> FloatArray:
    """Where the returns of a scan lie, (num_beams, 2) in the robot's frame at the stamp [m]; nan where there is none.

    Unlike :func:`deskewed` it averages no noise away, and has no even directions.

    Args:
        scan: Any scan.
        motion: Of the base from the first beam to the last.
    """
    geometry = scan.geometry
    points, _ = place_returns(scan.ranges, *_sweep(geometry, motion))
    return transform_points(geometry.mount, points)


def _sweep(geometry: LaserGeometry, motion: Pose2D) -> tuple[float, float, float, Pose2D, bool]:
    """The arguments of :func:`take_at_once` by a motion of the base from the first beam to the last."""
    mount = geometry.mount
    of_sensor = compose(compose(inverse(mount), motion), mount)
    return (
        float(geometry.angle_min),
        float(geometry.angle_increment),
        float(geometry.range_max),
        plain(of_sensor),
        geometry.time_increment < 0.0,
    )


@kernel
def take_at_once(
    ranges: Float32Array,
    angle_min: float,
    step: float,
    range_max: float,
    motion: tuple[float, float, float],
    is_backwards: bool,
    out: Float32Array,
) -> None:
    """Write what the beams say of the directions in which they would have pointed without the motion.

    Args:
        ranges: (num_beams,) [m].
        angle_min: Direction of beam 0 [rad].
        step: From a beam to the next [rad].
        range_max: A range of this or more is no return [m].
        motion: Of the sensor from the first beam to the last, in its own frame at the first [m, m, rad].
        is_backwards: Whether the last beam is the first that is measured.
        out: (num_beams,) of nan; receives the ranges [m].
    """
    count = len(ranges)
    points, seen = place_returns(ranges, angle_min, step, range_max, motion, is_backwards)
    turned = motion[2] / (step * (count - 1))
    width = abs(1.0 - turned if is_backwards else 1.0 + turned)
    is_joined = False
    for i in range(count):
        was_joined = is_joined
        is_joined = i + 1 < count and _is_one_surface(points, seen, step, width, i)
        if is_joined:
            low = min(seen[i], seen[i + 1])
            high = max(seen[i], seen[i + 1])
            _cover(low, high, points[i], points[i + 1], angle_min, step, out)
        if not math.isnan(ranges[i]):
            low = seen[i] if was_joined else seen[i] - 0.5 * width
            high = seen[i] if is_joined else seen[i] + 0.5 * width
            distance = math.hypot(points[i, 0], points[i, 1])
            if math.isnan(distance):
                distance = ranges[i]
            _keep(low, high, distance, step, out)


@kernel
def place_returns(
    ranges: Float32Array,
    angle_min: float,
    step: float,
    range_max: float,
    motion: tuple[float, float, float],
    is_backwards: bool,
) -> tuple[FloatArray, FloatArray]:
    """Where the returns lie, and in which direction.

    Args:
        ranges: As for :func:`take_at_once`.
        angle_min: The same.
        step: The same.
        range_max: The same.
        motion: The same.
        is_backwards: The same.

    Returns:
        Places (num_beams, 2) in the sensor's frame at the first beam [m], nan for what is no return; and the directions
        (num_beams,) from there, in beams from the first, of the beam itself where there is none.
    """
    x, y, turn = motion
    count = len(ranges)
    points = np.full((count, 2), np.nan)
    seen = np.empty(count)
    half = 0.5 * turn
    is_turning = abs(half) > 1e-8
    whole = math.sin(half)
    for i in range(count):
        share = i / (count - 1)
        if is_backwards:
            share = 1.0 - share
        angle = angle_min + i * step
        seen[i] = i + share * turn / step
        r = ranges[i]
        if not 0.0 < r < range_max:
            continue
        # As slamgym.core.geometry.part_of.
        shortening = math.sin(share * half) / whole if is_turning else share
        back = (share - 1.0) * half
        cos = shortening * math.cos(back)
        sin = shortening * math.sin(back)
        dx = cos * x - sin * y
        dy = sin * x + cos * y
        ux = math.cos(angle + share * turn)
        uy = math.sin(angle + share * turn)
        points[i, 0] = dx + r * ux
        points[i, 1] = dy + r * uy
        across = ux * dy - uy * dx
        along = r + ux * dx + uy * dy
        seen[i] += math.atan2(across, along) / step
    return points, seen


@kernel
def _is_one_surface(
    points: FloatArray, seen: FloatArray, step: float, width: float, i: int
) -> bool:
    """Whether two neighbouring returns lie on one surface; False where one is none."""
    apart = abs(seen[i + 1] - seen[i])
    if math.isnan(points[i, 0]) or math.isnan(points[i + 1, 0]) or apart > WIDEST_BEAMS * width:
        return False
    near = math.hypot(points[i, 0], points[i, 1])
    far = math.hypot(points[i + 1, 0], points[i + 1, 1])
    return abs(far - near) < STEEPEST_SLOPE * min(near, far) * apart * step


@kernel
def _cover(
    low: float,
    high: float,
    a: FloatArray,
    b: FloatArray,
    angle_min: float,
    step: float,
    out: Float32Array,
) -> None:
    """Write the ranges to the line through two points in the directions between ``low`` and ``high`` [beams]."""
    ex = b[0] - a[0]
    ey = b[1] - a[1]
    offset = a[0] * ey - a[1] * ex
    turn = 2.0 * math.pi / step
    for shift in (0.0, turn, -turn):
        first = max(0, math.ceil(low + shift - DIRECTION_ROUNDING))
        last = min(len(out) - 1, math.floor(high + shift + DIRECTION_ROUNDING))
        for k in range(first, last + 1):
            angle = angle_min + k * step
            slant = math.cos(angle) * ey - math.sin(angle) * ex
            if slant != 0.0:
                distance = offset / slant
                if not out[k] <= distance:
                    out[k] = distance


@kernel
def _keep(low: float, high: float, distance: float, step: float, out: Float32Array) -> None:
    """Write one range in the directions between ``low`` and ``high`` [beams] that nothing nearer is in."""
    turn = 2.0 * math.pi / step
    for shift in (0.0, turn, -turn):
        first = max(0, math.ceil(low + shift - DIRECTION_ROUNDING))
        last = min(len(out) - 1, math.floor(high + shift + DIRECTION_ROUNDING))
        for k in range(first, last + 1):
            if not out[k] <= distance:
                out[k] = distance
