"""End points of a scan, and the normal of the surface at each: numba kernels."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray
from slamgym.slam.hit_count_kernels import BeamTable

NORMAL_POINTS = 3
"""A surface normal comes from up to so many points on either side."""
NORMAL_GAP = 0.2
"""Points of one surface are each nearer to the next than this [m], or than ``OBLIQUE_GAP``."""
OBLIQUE_GAP = 2.0
"""Points of one surface are at most so many times as far apart as the beams are at their distance: the surface is seen
at up to 60 degrees."""
NORMAL_THICKNESS = 0.03
"""A surface has a normal if the standard deviation of its points from a line is no more than this [m]."""
NEXT_BEAM = 1.5
"""Beams so many times as far apart as neighbours, or less, are neighbours: a beam between them would make it 2."""
GRAZING = 4.0
"""A surface goes on to a point at most so many times as far away as the beams are apart at its distance: it is seen at
up to 75 degrees. Without, a right map of 120 of the zoo is called broken: seen from far aside, one beam meets the wall
before a door and the next one the wall behind it."""
BENT_SINE = 0.2
"""A surface goes on to the next beam's point if the way there leaves the surface at neither by more (a sine)."""


@kernel
def beam_at(angle: float, step: float) -> int:
    """The beam that looks nearest to a direction, if the laser's beams go on all round: it may lie behind the last one.

    Args:
        angle: From the first beam to the direction [rad].
        step: From each beam to the next [rad].
    """
    turns = angle * math.copysign(1.0, step) / (2.0 * math.pi)
    return round((turns - math.floor(turns)) * 2.0 * math.pi / abs(step))


@kernel
def usable_end_points(ranges: Float32Array, beams: BeamTable, longest: float) -> FloatArray:
    """End points (n, 2) of the beams that can be matched, in the robot frame [m].

    Args:
        ranges: (num_beams,) [m]; infinite and nan beams are left out.
        beams: The scanner.
        longest: Largest range taken, if it is usable [m].
    """
    beams = BeamTable(*beams)
    points = np.empty((len(ranges), 2))
    n = 0
    for i in range(len(ranges)):
        r = ranges[i]
        # A beam of the scanner's whole range met nothing.
        if r >= beams.range_min and r <= min(longest, beams.usable) and r < beams.range_max:
            points[n, 0] = beams.mount[0] + r * beams.directions[i, 0]
            points[n, 1] = beams.mount[1] + r * beams.directions[i, 1]
            n += 1
    return points[:n]


@kernel
def surface_normals(points: FloatArray, limits: FloatArray) -> FloatArray:
    """Unit normals (n, 2) of the surface at end points in the order of the beams, from the points next to each.

    They are zero where the surface isn't straight.

    Args:
        points: (n, 2) [m].
        limits: (n,) how far the points of one surface are from the next at most, where each point is [m].
    """
    normals = np.zeros(points.shape)
    for i in range(len(points)):
        first = i
        last = i
        for _ in range(NORMAL_POINTS):
            if first > 0 and _gap(points, first - 1) < limits[i]:
                first -= 1
            if last < len(points) - 1 and _gap(points, last) < limits[i]:
                last += 1
        count = last - first + 1
        if count < 3:
            continue
        xx, xy, yy = _scatter(points, first, last + 1)
        half_trace = 0.5 * (xx + yy)
        half_gap = math.hypot(0.5 * (xx - yy), xy)
        variance_across = half_trace - half_gap
        variance_along = half_trace + half_gap
        if variance_across <= NORMAL_THICKNESS**2 and variance_along >= 4.0 * variance_across:
            angle = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
            normals[i, 0] = math.cos(angle)
            normals[i, 1] = math.sin(angle)
    return normals


@kernel
def surfaces_going_on(
    points: FloatArray,
    normals: FloatArray,
    to_laser: FloatArray,
    spacings: FloatArray,
    spacing: float,
) -> BoolArray:
    """Whether the straight surface at each point (n,) goes on to the point of the next beam.

    Args:
        points: (n, 2) in the order of the beams [m].
        normals: (n, 2), zero where no surface is known.
        to_laser: (n, 2) unit vectors.
        spacings: (n,) how far the beams are apart at each point [m].
        spacing: How far they are apart at a distance of 1 m [m].
    """
    surface_goes_on = np.zeros(len(points), dtype=np.bool_)
    for i in range(len(points) - 1):
        is_straight = normals[i].any() and normals[i + 1].any()
        gap = _gap(points, i)
        if not is_straight or gap > GRAZING * spacings[i]:
            continue
        if _gap(to_laser, i) >= NEXT_BEAM * spacing:
            continue
        x, y = points[i + 1] - points[i]
        here = abs(x * normals[i, 0] + y * normals[i, 1])
        there = abs(x * normals[i + 1, 0] + y * normals[i + 1, 1])
        surface_goes_on[i] = max(here, there) < BENT_SINE * gap
    return surface_goes_on


@kernel
def _gap(points: FloatArray, i: int) -> float:
    """Distance from a point to the next."""
    return math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])


@kernel
def _scatter(points: FloatArray, first: int, end: int) -> tuple[float, float, float]:
    """Covariance (xx, xy, yy) of points ``first`` to ``end - 1``."""
    count = end - first
    mean_x = mean_y = xx = xy = yy = 0.0
    for j in range(first, end):
        mean_x += points[j, 0] / count
        mean_y += points[j, 1] / count
    for j in range(first, end):
        dx = points[j, 0] - mean_x
        dy = points[j, 1] - mean_y
        xx += dx * dx / count
        xy += dx * dy / count
        yy += dy * dy / count
    return xx, xy, yy
