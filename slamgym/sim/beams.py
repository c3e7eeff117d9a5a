"""Measurements of the surfaces that beams meet: numba kernels.

Whatever is random about a *place* comes from :mod:`slamgym.sim.place_noise`, so that it is the same in every scan and
for neighbouring beams; only the noise of a measurement is drawn again.

One law decides whether an echo is heard: what comes
back from a matt surface falls with the square of the distance and with the cosine of the angle of incidence, so that
far, oblique and dark surfaces are lost together.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, IntArray
from slamgym.sim.place_noise import TO_DEVIATION, no_corners, place_hash, smooth_noise
from slamgym.sim.raycast import beam_directions, next_hit
from slamgym.sim.surfaces import GLASS, MIRROR, PLAIN, Surfaces

_SPECULAR_COS = math.cos(math.radians(4.0))
"""Glass returns a beam from straight ahead: where the cosine of its incidence is more than this."""
_DIRTY_SHARE = 0.08
"""Share of glass that returns beams from any side: it is dirty or has something stuck to it."""
_DIRT_SIZE = 0.08
"""Size of a dirty place [m]."""
_THROUGH_GLASS = 0.6
"""Share of the echo that is left after a pane was passed twice."""
_MOST_PANES = 3
"""A beam passes so many panes at most."""
_THICKEST_WALL = 0.6
"""The thickest wall that holds a pane [m]."""

_BLENDING = 0.8
"""Two surfaces in one footprint blend into a range in between where they are less than this apart [m]; of others the
larger part counts. In the logs the share of jumps with a beam in between falls by half at 0.6 to 1.2 m and again
beyond."""
_JUMP = 0.05
"""Neighbours' ranges that differ by less are one surface, with :data:`_JUMP_RELATIVE` [m]."""
_JUMP_RELATIVE = 0.05
"""Neighbours' ranges that differ by less are one surface, with :data:`_JUMP` [share of the range]."""

_UNEVENNESS = 0.25
"""Cell of the lattice over which a wall's evenness varies [m]."""
_BIAS_SIZE = 0.5
"""Cell of the lattice over which the constant part of the error varies [m]."""
_ECHO_SIZE = 0.1
"""Cell of the lattice over which echoes scatter [m]."""
_ECHO_BY_PLACE = 0.4
"""Scatter of the logarithm of an echo over places."""
_ECHO_BY_SCAN = 0.15
"""Scatter of the logarithm of an echo over scans."""
_FLATTEST = 0.2
"""Flattest incidence at which a wall's unevenness is stretched along the beam (cosine)."""

_LEAST_NORMAL = -6.0
"""Draws below so many standard deviations are rare."""
_WEAKEST_SCATTER = 0.99 * math.exp(-_ECHO_BY_PLACE * TO_DEVIATION + _ECHO_BY_SCAN * _LEAST_NORMAL)
"""The weakest echo that scatter produces, except for draws below :data:`_LEAST_NORMAL`."""


Ray = tuple[float, float, float, float]
"""Start x, y [m] and direction x, y, a unit vector."""


class BeamModel(NamedTuple):
    """A scanner's properties, as the kernels take them; see :class:`slamgym.sim.lidar.LidarConfig`."""

    angle_min: float  # [rad]
    angle_increment: float  # [rad]
    range_max: float  # [m]
    sigma: float  # [m]
    sigma_relative: float
    bias: float
    beam_width: float  # [rad]
    attenuation: float


@kernel
def measure_beams(
    sensors: FloatArray,
    segments: FloatArray,
    true: FloatArray,
    hits: IntArray,
    surfaces: Surfaces,
    model: BeamModel,
    normal: FloatArray,
    out: FloatArray,
) -> None:
    """Write what each beam measures; ``inf`` where no echo is heard.

    Args:
        sensors: Its poses in the frame of the segments, shape (K, 3), as :func:`slamgym.sim.raycast.cast_sweep` has
            them.
        segments: What can be seen, shape (S, 4) [m].
        true: Distances along the beams, shape (N,) [m].
        hits: The segments met, shape (N,).
        surfaces: Their materials.
        model: The scanner.
        normal: Standard normal draws, shape (2, N): of the range, and of the echo's strength.
        out: Receives the ranges, shape (N,) [m].
    """
    surfaces = Surfaces(*surfaces)
    model = BeamModel(*model)
    rough = no_corners()
    biased = no_corners()
    echoing = no_corners()
    directions = beam_directions(len(true), model.angle_min, model.angle_increment)
    last = -1
    x = 0.0
    y = 0.0
    cos = 1.0
    sin = 0.0
    for i in range(len(true)):
        sensor = i * len(sensors) // len(true)
        if sensor != last:
            last = sensor
            x = sensors[sensor, 0]
            y = sensors[sensor, 1]
            cos = math.cos(sensors[sensor, 2])
            sin = math.sin(sensors[sensor, 2])
        ux = cos * directions[i, 0] - sin * directions[i, 1]
        uy = sin * directions[i, 0] + cos * directions[i, 1]
        distance = true[i]
        cosine = 1.0
        echo = 1.0
        depth = 0.0
        if hits[i] >= 0:
            kind = PLAIN
            cosine = _cosine(ux, uy, segments, hits[i])
            if _has_patches(surfaces, hits[i]):
                along = _along(x, y, ux, uy, true[i], segments, hits[i])
                kind, echo, depth = _patch(surfaces, hits[i], along)
            if kind != PLAIN:
                ray = (x, y, ux, uy)
                distance, cosine, echo, depth = _trace_beam(
                    ray, true[i], hits[i], segments, surfaces, model
                )
        is_edge = _is_jump(true, i, i - 1) or _is_jump(true, i, i + 1)
        if is_edge and distance == true[i] <= model.range_max and model.beam_width > 0.0:
            distance = _blend((x, y, ux, uy), i, distance, true, hits, segments, model)
        if distance > model.range_max:
            out[i] = np.inf
            continue
        px = x + distance * ux
        py = y + distance * uy
        if model.attenuation > 0.0:
            loss = model.attenuation * (distance / model.range_max) ** 2
            strength = max(cosine, 1e-9) * echo
            # Most echoes are heard however they scatter.
            if loss > _WEAKEST_SCATTER * strength or normal[1, i] < _LEAST_NORMAL:
                uneven = smooth_noise(surfaces.seed, px / _ECHO_SIZE, py / _ECHO_SIZE, echoing)
                scatter = _ECHO_BY_PLACE * uneven + _ECHO_BY_SCAN * normal[1, i]
                if loss > strength * math.exp(scatter):
                    out[i] = np.inf
                    continue
        if surfaces.roughness > 0.0:
            uneven = smooth_noise(surfaces.seed + 1, px / _UNEVENNESS, py / _UNEVENNESS, rough)
            depth += surfaces.roughness * uneven
        sigma = max(model.sigma, model.sigma_relative * distance)
        error = normal[0, i]
        if model.bias > 0.0:
            error += model.bias * smooth_noise(
                surfaces.seed + 2, px / _BIAS_SIZE, py / _BIAS_SIZE, biased
            )
        out[i] = max(0.0, distance - depth / max(cosine, _FLATTEST) + sigma * error)


@kernel
def fail_beams(
    ranges: FloatArray, fate: FloatArray, lost: float, stray: float, range_max: float
) -> None:
    """Let some beams hear nothing, and some read anything up to what they would have.

    Args:
        ranges: Shape (N,) [m]; changed in place.
        fate: Even draws, shape (2, N or more): whether a beam fails and how, and what a stray one reads.
        lost: Share of the beams without a return.
        stray: Share of the stray ones.
        range_max: Longest distance that a stray one reads [m].
    """
    for i in range(len(ranges)):
        if fate[0, i] < lost:
            ranges[i] = np.inf
        elif fate[0, i] < lost + stray:
            ranges[i] = fate[1, i] * min(ranges[i], range_max)


@kernel
def write_rep117(ranges: FloatArray, range_min: float, range_max: float, out: Float32Array) -> None:
    """Write ranges as REP 117 has them: too near to measure is -inf, nothing in range is +inf."""
    for i in range(len(ranges)):
        if ranges[i] > range_max:
            out[i] = np.inf
        elif ranges[i] < range_min:
            out[i] = -np.inf
        else:
            out[i] = ranges[i]


@kernel
def _trace_beam(
    ray: Ray, distance: float, hit: int, segments: FloatArray, surfaces: Surfaces, model: BeamModel
) -> tuple[float, float, float, float]:
    """The surface whose echo a beam hears, through glass and by mirrors.

    Returns:
        Length of its way [m], ``inf`` if it meets nothing; the cosine of its incidence; the echo's strength; how far
        the surface stands out [m].
    """
    x, y, ux, uy = ray
    passed = 0.0  # what lies before the last mirror
    echo = 1.0
    length = distance
    outdoors = False
    pane = -1.0  # where the last pane was passed
    for _ in range(_MOST_PANES + 2):
        scene = surfaces.outside if outdoors else segments
        cosine = _cosine(ux, uy, scene, hit)
        kind = PLAIN
        own_echo = 1.0
        depth = 0.0
        if not outdoors and _has_patches(surfaces, hit):
            along = _along(x, y, ux, uy, length, segments, hit)
            kind, own_echo, depth = _patch(surfaces, hit, along)
        if kind == GLASS:
            returns = cosine > _SPECULAR_COS
            if returns or _is_dirty(surfaces, x + length * ux, y + length * uy):
                kind = PLAIN
        is_near_pane = pane >= 0.0 and length - pane < _THICKEST_WALL
        is_back = is_near_pane and hit < surfaces.num_walls and not outdoors
        if kind == MIRROR and cosine < _SPECULAR_COS:
            passed += length
            x = x + length * ux
            y = y + length * uy
            ux, uy = _mirrored(ux, uy, segments, hit)
            length, hit = next_hit(x, y, ux, uy, 1e-6, segments, model.range_max - passed)
            pane = -1.0
        elif kind == GLASS or is_back:
            # On through the pane, and through the other face of the wall that it is in.
            pane = -1.0 if is_back else length
            if kind == GLASS and not is_back:
                echo *= _THROUGH_GLASS
            beyond = length + 1e-6
            reach = model.range_max - passed
            length, hit = next_hit(x, y, ux, uy, beyond, segments, reach)
            far, thing = next_hit(x, y, ux, uy, beyond, surfaces.outside, reach)
            if far < length:
                outdoors = True
                length = far
                hit = thing
        else:
            return passed + length, cosine, echo * own_echo, depth
        if hit < 0:
            break
    return np.inf, 1.0, 1.0, 0.0


@kernel
def _cosine(ux: float, uy: float, segments: FloatArray, s: int) -> float:
    """Cosine of the angle between a beam and the normal of a segment."""
    x0, y0, x1, y1 = segments[s]
    ex = x1 - x0
    ey = y1 - y0
    return abs(ux * ey - uy * ex) / math.sqrt(ex * ex + ey * ey)


@kernel
def _along(
    x: float, y: float, ux: float, uy: float, length: float, segments: FloatArray, s: int
) -> float:
    """Distance along a segment at which a beam meets it [m]."""
    x0, y0, x1, y1 = segments[s]
    ex = x1 - x0
    ey = y1 - y0
    dx = x + length * ux - x0
    dy = y + length * uy - y0
    return (dx * ex + dy * ey) / math.sqrt(ex * ex + ey * ey)


@kernel
def _mirrored(ux: float, uy: float, segments: FloatArray, s: int) -> tuple[float, float]:
    """A direction after a reflection in a segment."""
    x0, y0, x1, y1 = segments[s]
    ex = x1 - x0
    ey = y1 - y0
    squared = ex * ex + ey * ey
    twice = 2.0 * (ux * ex + uy * ey) / squared
    return twice * ex - ux, twice * ey - uy


@kernel
def _has_patches(surfaces: Surfaces, s: int) -> bool:
    """True if the table holds patches of a segment."""
    return s + 1 < len(surfaces.first) and surfaces.first[s] < surfaces.first[s + 1]


@kernel
def _patch(surfaces: Surfaces, s: int, along: float) -> tuple[float, float, float]:
    """Kind, echo and depth of a place on a segment that the table holds."""
    for k in range(surfaces.first[s], surfaces.first[s + 1]):
        begin, end, kind, echo, depth = surfaces.patches[k]
        if begin <= along < end:
            return kind, echo, depth
    return PLAIN, 1.0, 0.0


@kernel
def _is_dirty(surfaces: Surfaces, x: float, y: float) -> bool:
    """True if glass returns a beam at a place from any side."""
    col = math.floor(x / _DIRT_SIZE)
    row = math.floor(y / _DIRT_SIZE)
    return place_hash(surfaces.seed + 3, col, row) < _DIRTY_SHARE


@kernel
def _is_jump(true: FloatArray, i: int, j: int) -> bool:
    """True if beams i and j, where there is such a one, meet different surfaces."""
    if j < 0 or j >= len(true):
        return False
    return abs(true[j] - true[i]) > _JUMP + _JUMP_RELATIVE * true[i]


@kernel
def _blend(
    ray: Ray,
    i: int,
    distance: float,
    true: FloatArray,
    hits: IntArray,
    segments: FloatArray,
    model: BeamModel,
) -> float:
    """The range of a beam whose footprint lies over an edge: in between, by the parts of it on either side."""
    x, y, ux, uy = ray
    for j in (i - 1, i + 1):
        if not _is_jump(true, i, j):
            continue
        is_near = true[i] < true[j]
        s = hits[i] if is_near else hits[j]
        # The edge is the end of the nearer segment that lies between the two beams.
        off = np.inf
        for end in (0, 2):
            ex = segments[s, end] - x
            ey = segments[s, end + 1] - y
            angle = math.atan2(ux * ey - uy * ex, ux * ex + uy * ey) * (j - i)
            if -1e-9 <= angle <= model.angle_increment:
                off = min(off, max(0.0, angle))
        if off >= 0.5 * model.beam_width:
            continue
        major = 0.5 + off / model.beam_width
        if is_near and true[j] > model.range_max:
            continue
        gap = abs(true[j] - true[i])
        if gap < _BLENDING:
            return distance + (1.0 - major) * (true[j] - true[i])
    return distance
