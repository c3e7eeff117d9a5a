"""A laser that changes on the way: from one scan to the next all readings are scaled or mirrored.

What the scan before shows is moved by the odometry to where the next was taken. A fault explains a scan that fits there
badly as it is and well once the fault is taken back.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from slamgym.core.geometry import between, compose, inverse, transform_points
from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, LaserScan, Pose2D
from slamgym.interop.records import Log, LogRecord
from slamgym.slam.deskew import placed_returns
from slamgym.slam.end_points import beam_at
from slamgym.slam.laser_check import FEWEST_READINGS, median_change

CHANGED_METRES = 0.1
"""Half of the readings of a changed scan are off by so much [m]."""
OTHER_SCALE = 1.15
"""They are so many times as long or short where a laser's unit changes."""
FEWEST_SHARE = 0.3
"""Readings are scaled if such a share of the beams says so: a wall alone, of 45 beams and fewer out of 180, looks
scaled where a robot turns, in three of five good drives with a range of 3.5 m."""
UNEXPLAINED_SHARE = 0.2
"""With the fault taken back they are off by less than this share of that. Of 9,721 pairs of scans of seven public logs
none is named; where one of the two is mirrored 54 to 96 % of a log's are, where it is scaled by 1.4 58 to 100 %, fewest
where the robot drives a metre from scan to scan."""


def noting_changes(log: Log) -> Log:
    """The log with a finding where all readings are scaled or mirrored from one scan to the next."""
    waits = np.diff([record.stamp for record in log])
    if not log.has_odometry or not len(waits) or np.median(waits) <= 0.0:  # its stamps say nothing
        return log
    places: list[float] = []  # [s]
    first = ""
    for before, after in pairwise(log.records):
        change = change_between(before, after)
        if change:
            places.append(after.stamp)
            first = first or change
    if not places:
        return log
    start = log.start
    sentence = (
        f"from one scan to the next {first}, {places[0] - start:.0f} s after the start (in {len(places)} places, the "
        f"last at {places[-1] - start:.0f} s): the map is wrong before or behind; cut the log there"
    )
    doubted = _unlike_part(places, log.records[0].stamp, log.records[-1].stamp)
    return replace(log.noting("laser changed", sentence), doubted=(*log.doubted, *doubted))


def change_between(before: LogRecord, after: LogRecord) -> str:
    """What happened to all readings from a scan to the next; nothing where nothing did."""
    step = between(before.odometry, after.odometry)
    old, new = before.scan.ranges, after.scan.ranges
    expected = seen_after(before.scan, step)
    geometry = after.scan.geometry

    def off(ranges: Float32Array, moved: Float32Array) -> float:
        """Median of what readings differ by from what is expected [m]; where nothing comes back, a wall is missing."""
        known = np.where(np.isfinite(ranges), ranges, np.float32(geometry.range_max))
        return median_change(moved, known)

    changed = off(new, expected)
    both = np.isfinite(expected) & np.isfinite(new)
    if changed < CHANGED_METRES:
        return ""
    limit = UNEXPLAINED_SHARE * changed
    # The fault begins or ends: it is taken back in the new scan, or put into the old one before that is moved.
    mirrored = seen_after(replace(before.scan, ranges=old[::-1]), step)
    for ranges, moved in ((new[::-1], expected), (new, mirrored)):
        is_known = np.count_nonzero(np.isfinite(ranges) & np.isfinite(moved)) >= FEWEST_READINGS
        if is_known and off(ranges, moved) < limit:
            return "left and right change places"
    if np.count_nonzero(both) < FEWEST_SHARE * geometry.num_beams:
        return ""
    factor = np.median(new[both] / expected[both])
    if 1.0 / OTHER_SCALE < factor < OTHER_SCALE:
        return ""
    scaled = seen_after(replace(before.scan, ranges=factor * old), step)
    if min(median_change(expected, new / factor), median_change(scaled, new)) < limit:
        return f"all readings become {factor:.1f} times as long"
    return ""


def seen_after(scan: LaserScan, step: Pose2D) -> Float32Array:
    """Readings (num_beams,) after a step of the robot, by what the scan saw alone; inf where it saw nothing [m]."""
    geometry = scan.geometry
    returns = placed_returns(scan, scan.motion)
    new_from_robot = compose(inverse(geometry.mount), inverse(step))
    places = transform_points(new_from_robot, returns[np.isfinite(returns[:, 0])])
    first = float(geometry.angle_min)
    each = float(geometry.angle_increment)
    expected: Float32Array = nearest_by_beam(places, first, each, geometry.num_beams)
    return expected


@kernel
def nearest_by_beam(
    places: FloatArray, angle_min: float, step: float, num_beams: int
) -> Float32Array:
    """How far away each beam (num_beams,) would meet some places; inf where it meets none [m].

    Args:
        places: (N, 2) in the frame of the laser [m].
        angle_min: Direction of the first beam [rad].
        step: Angle from each beam to the next [rad].
        num_beams: Of the laser.
    """
    met = np.full(num_beams, np.inf, dtype=np.float32)
    for i in range(len(places)):
        x = places[i, 0]
        y = places[i, 1]
        beam = beam_at(math.atan2(y, x) - angle_min, step)
        if beam < num_beams:
            met[beam] = min(met[beam], math.hypot(x, y))
    return met


def _unlike_part(places: Sequence[float], begin: float, end: float) -> list[tuple[float, float]]:
    """The part of a log's time in which its laser is unlike the rest, by the places at which it changed [s].

    What lies between the first and the last place, if that lasts shorter than the rest; behind a single one all.
    """
    first, last = places[0], places[-1]
    if len(places) == 1:
        return [(first, end)]
    if last - first <= 0.5 * (end - begin):
        return [(first, last)]
    return [(begin, first), (last, end)]
