"""A log's odometry against its scans, before mapping: late stamps, wheels that don't count, and stretches that lie.

The motion between some pairs of neighbouring scans is found by the laser: a scan is aligned with the one before from
where the odometry expects it, and where that fits poorly, from the best place in a window. So odometry is contradicted
only by scans that fit elsewhere and not where it says.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.portable import inverted, product
from slamgym.core.types import FloatArray, IntArray
from slamgym.interop.odometry import retimed, without_odometry
from slamgym.interop.records import Log
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.laser_odometry import LaserTracker, with_steps

MOST_PAIRS, PAIR_SECONDS = 2000, 0.3
"""Number of pairs, and the least time between their scans: a robot at 0.3 m/s drives 0.1 m meanwhile [s]."""
LEAST_FIT = 0.5
"""A pair that fits worse says nothing."""
MOVED, FEWEST_MOVING = (0.05, 0.08), 20
"""Motion of a pair that says something about wheels [m, rad], and how many pairs must have moved so far."""
STILL, FAR_OFF, ASKEW = 0.1, 1.25, 0.5
"""Wheels that measure less than the first share of a motion don't count it; a scale that is off by more than the second
is wrong (those of public logs are off by up to 1.07), and so is a direction by more than the third [rad]."""
OFFSETS, OUTLIER_TURN, EXPLAINED = np.arange(-100, 101) / 100.0, 0.15, 0.75
"""Lateness of the odometry's clock that is tried [s]. By the right one the squared differences of turns, each at most
the second [rad], fall below this share in each quarter of the turns (0.8 to 1 where the clocks agree)."""
WHEEL_ERRORS, MATCH_ERRORS, CONTRADICTION = (0.025, 0.17), 10.0, 3.0
"""Standard deviation of wheels [m or rad], and its share of what they measure; the factor by which that of matches is
underestimated; and the deviations by which most of some pairs in a row contradict the odometry; with half as many a
pair agrees. By these no stretch of five good logs is contradicted, and six of one whose wheels lost their sign."""
OTHERWISE = (
    "(--odometry-topic or --odometry-frame names another, --odometry-topic none leaves it out)"
)


class PairMotions(NamedTuple):
    """Motions between pairs of scans, in the frame of the robot at the first."""

    scans: IntArray  # (2, N) indices
    stamps: FloatArray  # (2, N) [s]
    laser: FloatArray  # (N, 3)
    information: FloatArray  # (N, 3, 3) of the laser's motions
    odometry: FloatArray  # (N, 3)


def check_odometry(log: Log, estimate_offset: bool = True) -> Log:
    """The log with what its odometry got wrong put right, or left out, and said.

    Args:
        log: Any log; one without odometry comes back as it is.
        estimate_offset: True if stamps of the odometry that are late or early shall be found.
    """
    if not log.has_odometry or len(log) < 2:
        return log
    pairs = measure_pairs(log)
    checked = log
    late = _lateness(log, pairs) if estimate_offset else 0.0
    if late != 0.0:
        which = f"{abs(late):.2f} s {'late' if late > 0.0 else 'early'}"
        sentence = f"the odometry is {which}: its stamps are set right (--time-offset 0 doesn't)"
        checked = retimed(log, late).noting("clock", sentence)
        pairs = pairs._replace(odometry=_odometry_of(checked, pairs.scans))
    lie = _lie(pairs)
    if lie:
        sentence = f"the odometry {lie}: the laser alone is used {OTHERWISE}"
        return without_odometry(log).noting("odometry", sentence)
    checked = _rescaled(checked, pairs)
    return _distrusted(checked, pairs._replace(odometry=_odometry_of(checked, pairs.scans)))


def measure_pairs(log: Log) -> PairMotions:
    """Motions of a sample of pairs, by the scans and by the odometry; pairs that say nothing are left out."""
    stamps = np.array([record.stamp for record in log])
    every = np.arange(len(log) - 1)
    after = np.maximum(
        np.searchsorted(stamps, stamps[:-1] + PAIR_SECONDS).clip(max=len(every)), every + 1
    )
    first = every[:: max(int(np.median(after - every)), 1 + len(every) // MOST_PAIRS)]
    scans = np.array([first, after[first]])
    odometry = _odometry_of(log, scans)
    moves = [
        LaserTracker(log.records[i].scan).move(log.records[j].scan, expected)
        for (i, j), expected in zip(scans.T.tolist(), odometry, strict=True)
    ]
    seen = np.flatnonzero([move.fit >= LEAST_FIT for move in moves])
    laser = np.array([moves[k].step for k in seen]).reshape(-1, 3)
    information = np.array([moves[k].information for k in seen]).reshape(-1, 3, 3)
    return PairMotions(scans[:, seen], stamps[scans[:, seen]], laser, information, odometry[seen])


def _odometry_of(log: Log, scans: IntArray) -> FloatArray:
    poses = np.array([record.odometry for record in log], dtype=np.float64)
    return relative_poses(*poses[scans])


def _lateness(log: Log, pairs: PairMotions) -> float:
    """Lateness of the odometry's clock by the turns [s]; 0 where it isn't sure."""
    order = np.argsort(log.track.stamps, kind="stable")
    stamps = log.track.stamps[order]
    headings = np.unwrap(log.track.poses[order, 2])
    turning = np.abs(pairs.laser[:, 2]) > MOVED[1]
    begin, end = (
        np.interp(times[turning] + OFFSETS[:, None], stamps, headings) for times in pairs.stamps
    )
    error = np.abs(wrap_angle(pairs.laser[turning, 2] - (end - begin)))
    costs = np.minimum(error, OUTLIER_TURN) ** 2
    best = int(np.argmin(costs.sum(axis=1)))
    now = costs[len(OFFSETS) // 2]
    quarters = zip(*(np.array_split(part, 4) for part in (costs[best], now)), strict=True)
    is_sure = len(now) >= FEWEST_MOVING and 0 < best < len(OFFSETS) - 1
    for found, before in quarters:
        is_sure = is_sure and found.sum() < EXPLAINED * before.sum()
    return float(OFFSETS[best]) if is_sure else 0.0


def odometry_shares(pairs: PairMotions) -> tuple[float, float, float]:
    """The odometry's share of the laser's turns and of its distances, and its direction [rad]; nan if unknown."""
    turning = np.abs(pairs.laser[:, 2]) > MOVED[1]
    laser, odometry = (part[:, 0] + 1j * part[:, 1] for part in (pairs.laser, pairs.odometry))
    driving = np.abs(laser) > MOVED[0]
    ratios = odometry[driving] / laser[driving]
    angle = math.atan2(_middle(ratios.imag), _middle(ratios.real))
    return (
        _middle(pairs.odometry[turning, 2] / pairs.laser[turning, 2]),
        _middle(np.abs(ratios)),
        angle,
    )


def _middle(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) >= FEWEST_MOVING else math.nan


def _lie(pairs: PairMotions) -> str:
    """What the odometry gets wrong throughout; nothing if it is of use."""
    turns, ways, angle = odometry_shares(pairs)
    missed = [what for what, share in (("turns", turns), ("distances", ways)) if abs(share) < STILL]
    if missed:
        return f"measures no {' and no '.join(missed)}"
    if turns < 0.0:
        return (
            "turns left where the laser turns right (one upside down needs its mount in tf_static)"
        )
    degrees = round(abs(math.degrees(angle))) if abs(angle) > ASKEW else 0
    return (
        f"goes {degrees} degrees beside the laser (is its mount in tf_static right?)"
        if degrees
        else ""
    )


def _rescaled(log: Log, pairs: PairMotions) -> Log:
    """The log with turns and distances divided by what the odometry makes of each, where that is far off."""
    turns, ways, _ = odometry_shares(pairs)
    shares = ("distances", ways, slice(2)), ("turns", turns, slice(2, 3))
    off = [one for one in shares if one[1] > FAR_OFF or one[1] < 1.0 / FAR_OFF]
    if not off:
        return log
    steps = relative_poses(log.track.poses[:-1], log.track.poses[1:])
    for what, share, columns in off:
        steps[:, columns] /= share
        sentence = f"the odometry makes {share:.2f} of the laser's {what}: they are divided by that {OTHERWISE}"
        log = log.noting("scale", sentence)
    return with_steps(log, steps)


def _distrusted(log: Log, pairs: PairMotions) -> Log:
    """The log with the stretches in which the scans contradict its odometry."""
    error = pairs.laser - pairs.odometry
    error[:, 2] = wrap_angle(error[:, 2])
    laser, wheels = (
        np.column_stack([np.hypot(*part.T[:2]), np.abs(part[:, 2])]) for part in pairs[2::2]
    )
    spread = WHEEL_ERRORS[0] + WHEEL_ERRORS[1] * wheels[:, [0, 0, 1]]
    information = pairs.information / MATCH_ERRORS**2
    deviations = np.array(
        [_deviation(*each) for each in zip(error, information, spread**-2, strict=True)]
    )
    # What lies between the two says nothing.
    agrees = deviations < 0.5 * CONTRADICTION
    contradicts = deviations > CONTRADICTION
    telling = (np.maximum(laser, wheels) > MOVED).any(axis=1) & (agrees | contradicts)
    padded = np.pad(contradicts[telling], 2).astype(np.int64)
    most = padded[:-2] + padded[1:-1] + padded[2:] >= 2
    edges = np.flatnonzero(np.diff(most)).reshape(-1, 2)
    begins, ends = pairs.stamps[:, telling]
    stretches = [(float(begins[a]), float(ends[b - 1])) for a, b in edges.tolist() if b - a >= 3]
    if not stretches:
        return log
    seconds = sum(end - begin for begin, end in stretches)
    start = log.records[0].stamp
    sentence = (
        f"the scans contradict the odometry for {seconds:.0f} s in {len(stretches)} stretches, first from "
        f"{stretches[0][0] - start:.0f} to {stretches[0][1] - start:.0f} s after the start: it isn't trusted there "
        f"{OTHERWISE}"
    )
    return replace(log.noting("contradicted", sentence), distrusted=stretches)


def _deviation(error: FloatArray, laser: FloatArray, wheels: FloatArray) -> float:
    """Deviations of an error (3,) by the information of a match (3, 3), perhaps singular, and of wheels (3,)."""
    pulled = product(laser, error[:, None])
    rest = product(laser, product(inverted(laser + np.diag(wheels)), pulled))
    return math.sqrt(max(0.0, float((error * (pulled - rest)[:, 0]).sum())))
