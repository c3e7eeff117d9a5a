"""Ray casting: beams per second against the number of walls and of beams.

Three methods on the same walls in the same process: the kernel of the LIDAR, a compiled test of every beam
against every wall, and pymunk's own ray queries. Run: ``python benchmarks/simulation/raycast.py``.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymunk

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray
from slamgym.sim import cast_rays

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim",)
"""What is measured."""

RANGE_MAX = 3.5  # [m]
ROOM = 4.0  # [m]
DOOR = 0.9  # [m]


def building(num_rooms: int) -> FloatArray:
    """Walls of a square of rooms with doors between them, 0.1 m thick, shape (S, 4)."""
    side = math.ceil(math.sqrt(num_rooms))
    gap, half = 0.5 * DOOR, 0.05
    low, high, middle = half, ROOM - half, 0.5 * ROOM
    room = []
    for start, end in ((low, middle - gap), (middle + gap, high)):
        room += [(start, low, end, low), (start, high, end, high)]
        room += [(low, start, low, end), (high, start, high, end)]
    corners = [(ROOM * (i % side), ROOM * (i // side)) for i in range(num_rooms)]
    return np.vstack([np.array(room) + np.array((x, y, x, y)) for x, y in corners])


@kernel
def every_beam_every_wall(
    x: float,
    y: float,
    angle_min: float,
    increment: float,
    segments: FloatArray,
    range_max: float,
    out: FloatArray,
) -> None:
    """The reference: no beam omits any wall."""
    for i in range(out.shape[0]):
        ux, uy = math.cos(angle_min + i * increment), math.sin(angle_min + i * increment)
        nearest = np.inf
        for s in range(segments.shape[0]):
            ax, ay = segments[s, 0] - x, segments[s, 1] - y
            ex, ey = segments[s, 2] - segments[s, 0], segments[s, 3] - segments[s, 1]
            slant = ux * ey - uy * ex
            if slant != 0.0:
                distance = (ax * ey - ay * ex) / slant
                along = (ax * uy - ay * ux) / slant
                if 0.0 <= along <= 1.0 and 0.0 <= distance < nearest:
                    nearest = distance
        out[i] = nearest if nearest <= range_max else np.inf


def pymunk_scanner(segments: FloatArray) -> Callable[[float, float, FloatArray], FloatArray]:
    """Scan with one ``segment_query_first`` a beam."""
    space = pymunk.Space()
    space.add(
        *[
            pymunk.Segment(space.static_body, (a, b), (c, d), 0.0)
            for a, b, c, d in segments.tolist()
        ]
    )
    everything = pymunk.ShapeFilter()

    def scan(x: float, y: float, angles: FloatArray) -> FloatArray:
        ranges = np.full(len(angles), np.inf)
        for i, angle in enumerate(angles.tolist()):
            end = x + RANGE_MAX * math.cos(angle), y + RANGE_MAX * math.sin(angle)
            hit = space.segment_query_first((x, y), end, 0.0, everything)
            if hit is not None:
                ranges[i] = hit.alpha * RANGE_MAX
        return ranges

    return scan


def cpu_microseconds(function: Callable[[], object], budget: float = 0.15) -> float:
    """CPU time of one call, the best of five rounds [us]."""
    function()
    rounds: list[float] = []
    calls = 1
    while True:
        start = time.process_time()
        for _ in range(calls):
            function()
        spent = time.process_time() - start
        if spent < budget / 5 and not rounds:
            calls *= 2
            continue
        rounds.append(spent / calls * 1e6)
        if len(rounds) == 5:
            return min(rounds)


def measure(num_rooms: int, num_beams: int, view_deg: float) -> dict[str, object]:
    """One row: the three methods must agree before they are timed."""
    segments = building(num_rooms)
    x, y, theta = float(segments[:, 0].mean()) + 0.3, float(segments[:, 1].mean()) + 0.2, 0.3
    view = math.radians(view_deg)
    increment = view / num_beams
    ours, brute = np.empty(num_beams), np.empty(num_beams)
    angles = theta - 0.5 * view + increment * np.arange(num_beams, dtype=np.float64)
    scan = pymunk_scanner(segments)

    def cast() -> None:
        cast_rays(x, y, theta, -0.5 * view, increment, segments, RANGE_MAX, ours)

    def cast_all() -> None:
        every_beam_every_wall(x, y, float(angles[0]), increment, segments, RANGE_MAX, brute)

    cast()
    cast_all()
    np.testing.assert_allclose(ours, brute, atol=1e-9)
    np.testing.assert_allclose(ours, scan(x, y, angles), atol=1e-6)
    times = [cpu_microseconds(f) for f in (cast, cast_all, lambda: scan(x, y, angles))]
    return {
        "walls": len(segments),
        "beams": num_beams,
        "view [deg]": view_deg,
        "us/scan": times[0],
        "million beams/s": num_beams / times[0],
        "every wall [us]": times[1],
        "pymunk [us]": times[2],
        "times faster than pymunk": times[2] / times[0],
    }


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    rows = [measure(rooms, 180, 180.0) for rooms in (2, 7, 25, 188)]
    rows += [measure(7, beams, 360.0) for beams in (180, 360, 1080)]
    times = ("us/scan", "million beams/s", "every wall [us]", "pymunk [us]")
    print_and_save(
        "simulation/raycast", "Ray casting, one core, CPU time", rows, list(rows[0]), MODULES, times
    )


if __name__ == "__main__":
    main()
