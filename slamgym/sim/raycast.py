"""Exact ray casting against wall segments.

Instead of testing every beam against every wall, each wall is asked which beams can meet it: its two end
points span an interval of bearings, and a scanner's beams are evenly spaced, so the beams inside come from
one division. A beam is then tested against a handful of walls for any number of walls, and each test is
one exact ray/line intersection. Walls beyond the sensor's range are dropped before their bearings are
computed.
"""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray

# Share of a beam spacing by which a wall's interval of beams is widened, so that rounding never lets a beam
# slip through the corner that two walls share. At 3.5 m and 1 degree it widens a wall by less than 0.1 nm.
_WIDENING = 1e-9

# Sine of the angle between beam and wall below which the wall counts as seen edge-on.
_EDGE_ON = 1e-12


@kernel
def cast_rays(
    x: float,
    y: float,
    theta: float,
    angle_min: float,
    angle_increment: float,
    segments: FloatArray,
    range_max: float,
    out: FloatArray,
) -> None:
    """Write the distance to the nearest segment along each beam: :func:`cast_hits` without the segments."""
    hits = np.empty(len(out), dtype=np.int64)
    cast_hits(x, y, theta, angle_min, angle_increment, segments, range_max, out, hits)


@kernel
def cast_hits(
    x: float,
    y: float,
    theta: float,
    angle_min: float,
    angle_increment: float,
    segments: FloatArray,
    range_max: float,
    out: FloatArray,
    hits: IntArray,
) -> None:
    """Write the distance to the nearest segment along each beam, and which segment that is.

    Convention: ``x, y, theta`` is the pose of the *sensor* in the frame of the segments; beam ``i`` points to
    ``theta + angle_min + i * angle_increment``, counter-clockwise.

    Args:
        x: Sensor position [m].
        y: Sensor position [m].
        theta: Sensor heading [rad].
        angle_min: Direction of beam 0 in the sensor frame [rad].
        angle_increment: Angle between neighbouring beams, positive [rad].
        segments: Walls, shape (S, 4) as x0, y0, x1, y1 [m].
        range_max: Longest distance that is reported [m].
        out: Receives the ranges, shape (num_beams,) [m]; ``inf`` where nothing is met within ``range_max``. Its
            beams together span at most one turn.
        hits: Receives the indices of the segments met, shape (num_beams,); -1 where nothing is.
    """
    num_beams = len(out)
    turn = 2.0 * math.pi
    beams_per_turn = turn / angle_increment
    directions = beam_directions(num_beams, angle_min, angle_increment)
    for i in range(num_beams):
        out[i] = np.inf
        hits[i] = -1
    cos = math.cos(theta)
    sin = math.sin(theta)

    for s in range(segments.shape[0]):
        # End points in the sensor frame.
        gx = segments[s, 0] - x
        gy = segments[s, 1] - y
        ax = cos * gx + sin * gy
        ay = cos * gy - sin * gx
        gx = segments[s, 2] - x
        gy = segments[s, 3] - y
        bx = cos * gx + sin * gy
        by = cos * gy - sin * gx
        ex = bx - ax
        ey = by - ay
        nearest = _distance_to_origin(ax, ay, ex, ey)
        if nearest > range_max:
            continue
        if nearest == 0.0:
            # The sensor stands on the wall: it blocks every beam at once.
            for i in range(num_beams):
                out[i] = 0.0
                hits[i] = s
            return

        first = math.atan2(ay, ax)
        width = math.atan2(by, bx) - first
        if width > math.pi:
            width -= turn
        elif width < -math.pi:
            width += turn
        if width < 0.0:
            first += width
            width = -width

        # The interval in beam numbers; it may start before beam 0 and reappear a whole turn later.
        low = (first - angle_min) / angle_increment
        low -= math.floor(low / beams_per_turn) * beams_per_turn
        high = low + width / angle_increment
        offset = ax * ey - ay * ex
        edge_on = _EDGE_ON * math.sqrt(ex * ex + ey * ey)
        for _ in range(2):
            start = max(0, math.ceil(low - _WIDENING))
            stop = min(num_beams - 1, math.floor(high + _WIDENING))
            for i in range(start, stop + 1):
                slant = directions[i, 0] * ey - directions[i, 1] * ex
                distance = offset / slant if abs(slant) > edge_on else nearest
                if nearest <= distance < out[i] and distance <= range_max:
                    out[i] = distance
                    hits[i] = s
                elif distance < nearest < out[i]:
                    # A wall seen nearly edge-on, where the quotient loses its digits.
                    out[i] = nearest
                    hits[i] = s
            low -= beams_per_turn
            high -= beams_per_turn


@kernel
def cast_sweep(
    sensors: FloatArray,
    angle_min: float,
    angle_increment: float,
    segments: FloatArray,
    range_max: float,
    out: FloatArray,
    hits: IntArray,
) -> None:
    """:func:`cast_hits` of a scanner that moves: each pose casts its part of the beams, one after the other.

    Args:
        sensors: Poses, shape (K, 3); beam ``i`` of N is cast from pose ``i * K // N``.
        angle_min: As for :func:`cast_hits`.
        angle_increment: The same.
        segments: The same.
        range_max: The same.
        out: The same.
        hits: The same.
    """
    count = len(sensors)
    num_beams = len(out)
    for k in range(count):
        begin = -(-k * num_beams // count)
        end = -(-(k + 1) * num_beams // count)
        first = angle_min + begin * angle_increment if begin else angle_min
        x = sensors[k, 0]
        y = sensors[k, 1]
        theta = sensors[k, 2]
        cast_hits(
            x,
            y,
            theta,
            first,
            angle_increment,
            segments,
            range_max,
            out[begin:end],
            hits[begin:end],
        )


@kernel
def meet_on_time(
    sensors: FloatArray,
    angle_min: float,
    angle_increment: float,
    segments: FloatArray,
    range_max: float,
    out: FloatArray,
    hits: IntArray,
) -> None:
    """Write the distance to the segment that each beam meets, from where the scanner was at that very beam.

    A beam that misses the segment from there keeps what :func:`cast_sweep` says.

    Args:
        sensors: Poses at even times from the first beam to the last, shape (K, 3), K at least 2.
        angle_min: As for :func:`cast_hits`.
        angle_increment: The same.
        segments: The same.
        range_max: The same.
        out: Ranges of :func:`cast_sweep`, changed in place, shape (num_beams,) [m].
        hits: The segments that it found.
    """
    spans = len(sensors) - 1
    last = max(len(out) - 1, 1)
    for i in range(len(out)):
        s = hits[i]
        if s < 0:
            continue
        place = i * spans / last
        before = min(int(place), spans - 1)
        share = place - before
        x, y, theta = (1.0 - share) * sensors[before] + share * sensors[before + 1]
        angle = theta + angle_min + i * angle_increment
        ux = math.cos(angle)
        uy = math.sin(angle)
        ax = segments[s, 0] - x
        ay = segments[s, 1] - y
        ex = segments[s, 2] - segments[s, 0]
        ey = segments[s, 3] - segments[s, 1]
        slant = ux * ey - uy * ex
        if slant == 0.0:
            continue
        distance = (ax * ey - ay * ex) / slant
        along = (uy * ax - ux * ay) / slant
        if 0.0 <= along <= 1.0 and 0.0 < distance <= range_max:
            out[i] = distance


@kernel
def next_hit(
    x: float, y: float, ux: float, uy: float, beyond: float, segments: FloatArray, range_max: float
) -> tuple[float, int]:
    """Distance and index of the first segment that one ray meets further away than ``beyond``.

    Args:
        x: Start of the ray [m].
        y: Start of the ray [m].
        ux: Direction, a unit vector.
        uy: Direction, a unit vector.
        beyond: Nearer segments don't count [m].
        segments: Shape (S, 4) as x0, y0, x1, y1 [m].
        range_max: Longest distance [m].

    Returns:
        ``inf`` and -1 where nothing is met within ``range_max``.
    """
    nearest = np.inf
    index = -1
    for s in range(segments.shape[0]):
        ax = segments[s, 0] - x
        ay = segments[s, 1] - y
        # The ends lie on either side of the ray's line.
        across_a = ux * ay - uy * ax
        across_b = ux * (segments[s, 3] - y) - uy * (segments[s, 2] - x)
        if across_a * across_b > 0.0 or across_a == across_b:
            continue
        share = across_a / (across_a - across_b)
        along_a = ux * ax + uy * ay
        along_b = ux * (segments[s, 2] - x) + uy * (segments[s, 3] - y)
        distance = along_a + share * (along_b - along_a)
        if beyond < distance < nearest and distance <= range_max:
            nearest = distance
            index = s
    return nearest, index


@kernel
def beam_directions(num_beams: int, angle_min: float, angle_increment: float) -> FloatArray:
    """Unit vectors of the beams, shape (num_beams, 2), by repeated rotation: no sine for each.

    The rounding grows by about 1e-16 a beam, a thousandth of a nanometre over a thousand beams at 3.5 m.
    """
    directions = np.empty((num_beams, 2))
    ux = math.cos(angle_min)
    uy = math.sin(angle_min)
    cos = math.cos(angle_increment)
    sin = math.sin(angle_increment)
    for i in range(num_beams):
        directions[i, 0] = ux
        directions[i, 1] = uy
        ux, uy = cos * ux - sin * uy, sin * ux + cos * uy
    return directions


@kernel
def _distance_to_origin(ax: float, ay: float, ex: float, ey: float) -> float:
    """Distance of the origin from the segment that starts at a and runs along e."""
    squared = ex * ex + ey * ey
    along = 0.0
    if squared > 0.0:
        along = min(1.0, max(0.0, -(ax * ex + ay * ey) / squared))
    px = ax + along * ex
    py = ay + along * ey
    return math.sqrt(px * px + py * py)
