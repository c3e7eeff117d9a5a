"""How long a log's scans took, by the log itself: turns skew the scans of a laser that takes its time.

Pairs of scans with a turn between them are laid on each other, with each beam where the odometry has the robot then, if
a scan took so long. Skewed scans fit badly; where some time makes them fit clearly better all over the log, that is it.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, IntArray
from slamgym.interop.records import Log
from slamgym.interop.scan_times import BEAM_TIMES, stamped_earlier, usual_gap, with_scan_time
from slamgym.slam.laser_odometry import PairMotions

LONGEST_SCAN_TIME = 0.25
"""No usual laser takes longer for a scan [s]."""
PAIR_TURN = 1.0
"""The robot turns about so far between the scans of a pair [rad]."""
LONGEST_TURN = 3.0
"""Within this time [s]."""
MOST_TURNS = 100
"""So many of the fastest turns are looked at."""
FEWEST_TURNS = 20
"""Fewer say nothing."""
COARSE_SHARES = (0.5, 1.0)
"""Shares of the longest possible time that are tried first."""
FINE_SHARES = (0.2, 0.4, 0.6, 0.8)
"""Shares that are tried, too, where one of those helps."""
HELPFUL_SHARE = 0.99
"""A time helps that brings the number of points that don't fit below this share of what it is without; on seven public
logs, whose lasers are faster, none does."""
CLEARER_SHARE = 0.9
"""It is believed if it does so to below this share in each quarter of the turns: to 0.86 or less on two logs of another
simulator that sweeps for 0.2 s."""
TRUER_SHARE = 0.5
"""Or if the squares of how far turns by laser and odometry differ fall to below this share in each quarter: to 0.2 with
our own laser that sweeps for 0.1 s."""
FITTING_SHARE = 1.005
"""The time of a laser that turns steadily, once a scan, is believed if the points that don't fit rise at most to this
share: to 1.002 or less by eight kinds of lasers that do so, to 1.017 or more where scans are made at once ..."""
AGREEING_SHARE = 0.8
"""... and the squares of how far turns differ fall below this one: to 0.73 or less for those kinds and a lab's log. In
the homes they grow fourfold, in Freiburg 079 to 3.5; four other public logs lack so many scans that none may take so
long."""
LAST_BEAM_SHARE = 0.5
"""Stamps are those of the last beams if that brings the squared errors of the turns below this share."""
TURN_OUTLIER = 0.3
"""The difference of a turn by laser and by odometry counts as this at most [rad]."""


class ScanTimeTrial(NamedTuple):
    """How the pairs fit if scans take some time."""

    seconds: float
    is_last: bool
    """Whether the stamps are those of the last beams."""
    misses: FloatArray
    """Share of the points of each pair that don't fit, (N,)."""
    scale: float
    """Turns by the laser, as a multiple of those by odometry."""
    turn_errors: FloatArray
    """Squares of how far turns differ apart from that, (N,) [rad^2]."""


def with_estimated_scan_time(log: Log) -> Log:
    """The log with the time that its scans took, where it has none and turns show it, and a finding that says so."""
    longest = min(usual_gap(log), LONGEST_SCAN_TIME)
    if not log.has_odometry or log.geometry.scan_time > 0.0 or not longest > 0.0:
        return log
    pairs = _turns(log)
    if len(pairs) < FEWEST_TURNS:
        return log
    at_once = _try(log, pairs, 0.0)
    steady = _steady_scan_time(log)
    if steady < longest:
        trial = _try(log, pairs, steady)
        fits = _misses(trial) < FITTING_SHARE * _misses(at_once)
        if fits and trial.turn_errors.sum() < AGREEING_SHARE * at_once.turn_errors.sum():
            return _taking(log, trial, longest)
    trials = [_try(log, pairs, share * longest) for share in COARSE_SHARES]
    if min(map(_misses, trials)) > HELPFUL_SHARE * _misses(at_once):
        return log
    trials += [_try(log, pairs, share * longest) for share in FINE_SHARES]
    by_last = [_try(log, pairs, trial.seconds, is_last=True) for trial in trials]

    def cost(trial: ScanTimeTrial) -> float:
        """Points that don't fit and differences of turns, each as a multiple of what it is with scans made at once."""
        of_turns = trial.turn_errors.sum() / max(at_once.turn_errors.sum(), 1e-9)
        return float(of_turns) + _misses(trial) / _misses(at_once)

    best = min(trials, key=cost)
    last = min(by_last, key=cost)
    if last.turn_errors.sum() < LAST_BEAM_SHARE * best.turn_errors.sum():
        best = last
    is_clearer = falls(best.misses, at_once.misses, CLEARER_SHARE)
    is_truer = falls(best.turn_errors, at_once.turn_errors, TRUER_SHARE)
    helps = _misses(best) < HELPFUL_SHARE * _misses(at_once)
    return _taking(log, best, longest) if helps and (is_clearer or is_truer) else log


def _steady_scan_time(log: Log) -> float:
    """Time that a laser takes for its field of view if it turns steadily, once for each scan of the log [s]."""
    return usual_gap(log) * abs(log.geometry.field_of_view) / (2.0 * math.pi)


def falls(found: FloatArray, before: FloatArray, share: float) -> bool:
    """Whether the sum of values (N,) falls below a share in each quarter of them."""
    quarters = zip(np.array_split(found, 4), np.array_split(before, 4), strict=True)
    return all(after.sum() < share * once.sum() for after, once in quarters)


def _taking(log: Log, best: ScanTimeTrial, longest: float) -> Log:
    """The log with the time that was found."""
    # What was found is how far the robot turned meanwhile, by odometry that makes too much or too little of turns.
    seconds = min(best.seconds / best.scale, longest)
    ending = ""
    if best.is_last:
        log = stamped_earlier(log, seconds)
        ending = ", and has the stamp of its last: stamps are set back"
    sentence = (
        f"a scan takes {seconds:.2f} s from its first beam to its last, as turns show{ending} (--scan-time 0 takes "
        "scans as made at once)"
    )
    return with_scan_time(log, seconds).noting(BEAM_TIMES, sentence)


def _misses(trial: ScanTimeTrial) -> float:
    return float(trial.misses.sum())


def _turns(log: Log) -> IntArray:
    """First and second scan (N, 2) of the pairs with the fastest turns between them, in the order of time."""
    stamps = np.array([record.stamp for record in log])
    headings = np.unwrap([record.odometry.theta for record in log])
    found = []
    for first in range(len(stamps) - 1):
        end = np.searchsorted(stamps, stamps[first] + LONGEST_TURN)
        turned = np.abs(headings[first + 1 : end] - headings[first])
        far = np.flatnonzero(turned >= 0.75 * PAIR_TURN)
        if len(far) and turned[far[0]] < 1.5 * PAIR_TURN:
            found.append((first, first + 1 + int(far[0])))
    pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
    waits = np.diff(stamps[pairs])[:, 0]
    fastest = np.argsort(waits, kind="stable")[:MOST_TURNS]
    return pairs[np.sort(fastest)]


def _try(log: Log, pairs: IntArray, seconds: float, is_last: bool = False) -> ScanTimeTrial:
    """Lay the scans of pairs (N, 2) on each other, if they take some time [s]."""
    if is_last:
        log = stamped_earlier(log, seconds)
    motions = PairMotions.between(with_scan_time(log, seconds), pairs)
    odometry = motions.odometry[:, 2]
    laser = motions.laser[:, 2]
    scale = float(np.median(laser / odometry))
    errors = np.minimum(np.abs(wrap_angle(laser - scale * odometry)), TURN_OUTLIER)
    return ScanTimeTrial(seconds, is_last, 1.0 - motions.fits, scale, errors**2)
