"""A log's odometry against its scans, before mapping: late stamps, wheels that don't count, and stretches that lie.

The motion between some pairs of neighbouring scans is found by the laser: a scan is aligned with the one before from
where the odometry expects it, and where that fits poorly, from the best place in a window. So odometry is contradicted
only by scans that fit elsewhere and not where it says.
"""

import math
from dataclasses import replace

import numpy as np

from slamgym.core.geometry import runs_of, wrap_angle
from slamgym.core.portable import inverted, product
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.interop.odometry import retimed, without_odometry
from slamgym.interop.records import Log
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.laser_changes import noting_changes
from slamgym.slam.laser_check import noting_gaps, without_repeats
from slamgym.slam.laser_odometry import PairMotions, odometry_between, with_steps
from slamgym.slam.scan_time_check import falls, with_estimated_scan_time

MOST_PAIRS = 2000
"""About so many pairs are looked at."""
PAIR_SECONDS = 0.3
"""Least time between the scans of a pair [s]: a robot at 0.3 m/s drives 0.1 m meanwhile."""
LEAST_FIT = 0.5
"""A pair that fits worse says nothing."""
MOVED_METRES = 0.05
"""Distance of a pair that says something about wheels [m]."""
MOVED_RADIANS = 0.08
"""Turn of a pair that says something about wheels [rad]."""
FEWEST_MOVING = 20
"""So many pairs must have moved before the wheels are judged."""
STILL = 0.1
"""Wheels that measure less than this share of a motion don't count it."""
FAR_OFF = 1.25
"""A scale of the odometry that is off by more than this factor is wrong: those of public logs are by up to 1.07."""
ASKEW = 0.5
"""A direction of the odometry that is off by more than this is wrong [rad]."""
OFFSETS = np.arange(-100, 101) / 100.0
"""Lateness of the odometry's clock that is tried [s]."""
OUTLIER_TURN = 0.15
"""The difference of a turn by laser and by odometry counts as this at most [rad]."""
EXPLAINED_SHARE = 0.75
"""By the right clock the squared differences of turns fall below this share in each quarter of the turns; they fall to
0.8 to 1 where the clocks agree."""
WHEEL_ERROR = 0.025
"""Standard deviation of what wheels measure of no motion [m or rad]."""
WHEEL_ERROR_SHARE = 0.17
"""Standard deviation of what wheels measure as a share of it."""
MATCH_ERRORS = 7.0
"""Factor by which the standard deviations of matches are underestimated."""
CONTRADICTION = 3.0
"""A pair that deviates by more than this contradicts the odometry, by less than half of it agrees [deviations]: no
stretch of five good logs is contradicted, and six of one whose wheels lost their sign."""
LEAST_STRETCH = 3
"""A stretch that is contradicted has so many telling pairs at least."""
OTHERWISE = (
    "(--odometry-topic or --odometry-frame names another, --odometry-topic none leaves it out)"
)


def check_odometry(log: Log, estimate_offset: bool = True, estimate_scan_time: bool = True) -> Log:
    """The log with what its odometry got wrong put right, or left out, and said; its laser's faults, too.

    Args:
        log: Any log; one without odometry comes back as it is.
        estimate_offset: True if stamps of the odometry that are late or early shall be found.
        estimate_scan_time: True if the time that scans take shall be found, where the log doesn't say it.
    """
    if not log.has_odometry or len(log) < 2:
        return log
    log = noting_gaps(without_repeats(log))
    if estimate_scan_time:
        log = with_estimated_scan_time(log)
    checked = noting_changes(log)
    pairs = measure_pairs(checked)
    late = _lateness(checked, pairs) if estimate_offset else 0.0
    if late != 0.0:
        side = "late" if late > 0.0 else "early"
        in_time = retimed(log, late)
        if estimate_scan_time:
            # By a wrong clock, turns don't show how long scans take.
            in_time = with_estimated_scan_time(in_time)
        in_time = in_time.noting(
            "clock",
            f"the odometry is {abs(late):.2f} s {side}: its stamps are set right "
            "(--time-offset 0 doesn't)",
        )
        checked = noting_changes(in_time)
        pairs = pairs._replace(odometry=odometry_between(checked, pairs.scans))
    lie = _lie(pairs)
    if lie:
        sentence = f"the odometry {lie}: the laser alone is used {OTHERWISE}"
        return without_odometry(checked).noting("odometry", sentence)
    checked = _rescaled(checked, pairs)
    pairs = pairs._replace(odometry=odometry_between(checked, pairs.scans))
    return _distrusted(checked, pairs)


def measure_pairs(log: Log) -> PairMotions:
    """Motions of a sample of pairs, by the scans and by the odometry.

    Left out are pairs that say nothing, and those where the laser itself is in doubt.
    """
    stamps = np.array([record.stamp for record in log])
    scans = _sampled_pairs(stamps)
    for begin, end in log.doubted:
        first, second = stamps[scans].T
        scans = scans[(second < begin) | (first >= end)]
    pairs = PairMotions.between(log, scans)
    return pairs.at(pairs.fits >= LEAST_FIT)


def _sampled_pairs(stamps: FloatArray) -> IntArray:
    """First and second scan (N, 2) of pairs, spread over a log whose stamps are given."""
    every = np.arange(len(stamps) - 1)
    later = np.searchsorted(stamps, stamps[:-1] + PAIR_SECONDS).clip(max=len(every))
    after = np.maximum(later, every + 1)
    usual = int(np.median(after - every))
    stride = max(usual, 1 + len(every) // MOST_PAIRS)
    first = every[::stride]
    return np.column_stack([first, after[first]])


def _lateness(log: Log, pairs: PairMotions) -> float:
    """Lateness of the odometry's clock by the turns [s]; 0 where it isn't sure."""
    order = np.argsort(log.track.stamps, kind="stable")
    stamps = log.track.stamps[order]
    headings = np.unwrap(log.track.poses[order, 2])
    turning = np.abs(pairs.laser[:, 2]) > MOVED_RADIANS
    first, second = pairs.stamps[turning].T
    begin = np.interp(first + OFFSETS[:, None], stamps, headings)
    end = np.interp(second + OFFSETS[:, None], stamps, headings)
    turned = end - begin
    error = np.abs(wrap_angle(pairs.laser[turning, 2] - turned))
    costs = np.minimum(error, OUTLIER_TURN) ** 2
    best = np.argmin(costs.sum(axis=1))
    now = costs[len(OFFSETS) // 2]
    is_outermost = best in {0, len(OFFSETS) - 1}
    is_enough = len(now) >= FEWEST_MOVING and not is_outermost
    is_sure = is_enough and falls(costs[best], now, EXPLAINED_SHARE)
    return float(OFFSETS[best]) if is_sure else 0.0


def odometry_shares(pairs: PairMotions) -> tuple[float, float, float]:
    """The odometry's share of the laser's turns and of its distances, and its direction [rad]; nan if unknown."""
    x, y, turn = pairs.laser.T
    wheel_x, wheel_y, wheel_turn = pairs.odometry.T
    turning = np.abs(turn) > MOVED_RADIANS
    turns = wheel_turn[turning] / turn[turning]
    # As complex numbers, a quotient of two motions is their scale and the angle between them.
    laser = x + 1j * y
    odometry = wheel_x + 1j * wheel_y
    driving = (np.abs(laser) > MOVED_METRES) & _shows_distance(pairs)
    ways = odometry[driving] / laser[driving]
    along = _middle(ways.real)
    across = _middle(ways.imag)
    angle = math.atan2(across, along)
    return _middle(turns), _middle(np.abs(ways)), angle


def _shows_distance(pairs: PairMotions) -> BoolArray:
    """Whether each distance by laser (N,) is larger than its standard deviation.

    In a bare corridor each scan fits the one before best where it was: by such pairs the wheels of ACES, with every
    other beam, measure 2.8 times the distance.
    """
    steps = pairs.laser[:, :2]
    squared = np.square(steps).sum(axis=1)
    information = pairs.information / MATCH_ERRORS**2 + np.eye(3)
    covariance = np.array([inverted(one)[:2, :2] for one in information]).reshape(-1, 2, 2)
    # The variance along a step, times its squared length.
    spread = (steps[:, :, None] * covariance * steps[:, None, :]).sum(axis=(1, 2))
    return np.square(squared) > spread


def _middle(values: FloatArray) -> float:
    """Median of what pairs that moved say; nan if too few did."""
    return float(np.median(values)) if len(values) >= FEWEST_MOVING else math.nan


def _lie(pairs: PairMotions) -> str:
    """What the odometry gets wrong throughout; nothing if it is of use."""
    turns, ways, angle = odometry_shares(pairs)
    missed = []
    if abs(turns) < STILL:
        missed.append("turns")
    if abs(ways) < STILL:
        missed.append("distances")
    if missed:
        return f"measures no {' and no '.join(missed)}"
    if turns < 0.0:
        return (
            "turns left where the laser turns right (one upside down needs its mount in tf_static)"
        )
    if abs(angle) > ASKEW:
        degrees = round(abs(math.degrees(angle)))
        return f"goes {degrees} degrees beside the laser (is its mount in tf_static right?)"
    return ""


def _rescaled(log: Log, pairs: PairMotions) -> Log:
    """The log with turns and distances divided by what the odometry makes of each, where that is far off."""
    turns, ways, _ = odometry_shares(pairs)
    rescaled = log
    steps = relative_poses(log.track.poses[:-1], log.track.poses[1:])
    for what, share, columns in (("distances", ways, slice(2)), ("turns", turns, slice(2, 3))):
        if share > FAR_OFF or share < 1.0 / FAR_OFF:
            steps[:, columns] /= share
            rescaled = rescaled.noting(
                "scale",
                f"the odometry makes {share:.2f} of the laser's {what}: "
                f"they are divided by that {OTHERWISE}",
            )
    return log if rescaled is log else with_steps(rescaled, steps)


def _distrusted(log: Log, pairs: PairMotions) -> Log:
    """The log with the stretches in which the scans contradict its odometry."""
    stretches = _contradicted(pairs)
    if not stretches:
        return log
    seconds = sum(end - begin for begin, end in stretches)
    first_begin, first_end = stretches[0]
    sentence = (
        f"the scans contradict the odometry for {seconds:.0f} s in {len(stretches)} stretches, "
        f"first from {first_begin - log.start:.0f} to {first_end - log.start:.0f} s after the start: "
        f"it isn't trusted there, unless the laser is wrong {OTHERWISE}"
    )
    return replace(log.noting("contradicted", sentence), distrusted=stretches)


def _contradicted(pairs: PairMotions) -> list[tuple[float, float]]:
    """Begin and end of the stretches of time in which most pairs contradict the odometry [s]."""
    laser = _sizes(pairs.laser)
    wheels = _sizes(pairs.odometry)
    larger = np.maximum(laser, wheels)
    has_moved = (larger[:, 0] > MOVED_METRES) | (larger[:, 1] > MOVED_RADIANS)
    deviations = _deviations(pairs, wheels)
    # What lies between the two says nothing.
    agrees = deviations < 0.5 * CONTRADICTION
    contradicts = deviations > CONTRADICTION
    telling = has_moved & (agrees | contradicts)
    padded = np.pad(contradicts[telling], 1).astype(np.int64)
    most = padded[:-2] + padded[1:-1] + padded[2:] >= 2
    stamps = pairs.stamps[telling]
    return [
        (float(stamps[first, 0]), float(stamps[end - 1, 1]))
        for first, end in runs_of(most).tolist()
        if end - first >= LEAST_STRETCH
    ]


def _sizes(motions: FloatArray) -> FloatArray:
    """Distances and turns (N, 2) of motions (N, 3) [m], [rad]."""
    distances = np.hypot(motions[:, 0], motions[:, 1])
    return np.column_stack([distances, np.abs(motions[:, 2])])


def _deviations(pairs: PairMotions, wheels: FloatArray) -> FloatArray:
    """How far each pair's motions differ (N,), given the wheels' distances and turns (N, 2) [standard deviations]."""
    errors = pairs.laser - pairs.odometry
    errors[:, 2] = wrap_angle(errors[:, 2])
    spread = WHEEL_ERROR + WHEEL_ERROR_SHARE * wheels[:, [0, 0, 1]]
    by_wheels = spread**-2
    by_laser = pairs.information / MATCH_ERRORS**2
    each = zip(errors, by_laser, by_wheels, strict=True)
    deviations = [_deviation(error, laser, wheel) for error, laser, wheel in each]
    return np.array(deviations)


def _deviation(error: FloatArray, laser: FloatArray, wheels: FloatArray) -> float:
    """Deviations of an error (3,) by the information of a match (3, 3), perhaps singular, and of wheels (3,)."""
    pulled = product(laser, error[:, None])
    covariance = inverted(laser + np.diag(wheels))
    rest = product(laser, product(covariance, pulled))
    weighted = (pulled - rest)[:, 0]
    return math.sqrt(max(0.0, (error * weighted).sum()))
