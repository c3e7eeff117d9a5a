"""When a log's scans were taken, and how long each took."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.types import AT_REST, BoolArray, FloatArray, Pose2D, Trajectory
from slamgym.interop.odometry import merged_track, with_track
from slamgym.interop.records import Log, LogFinding, LogRecord

ASSUMED_RATE = 1.0
"""Scans of a clock that stands still are taken to be so frequent [Hz]."""
BEAM_TIMES = "beam times"
"""Kind of the finding about times of beams that can't be."""
LONGEST_SCAN = 1.1
"""No scan takes so many times as long as it is until the next one."""
SLOWEST_SCAN = 10.0
"""Nor longer than this [s]: some drivers write nanoseconds."""


class StampedMessages(NamedTuple):
    """Messages with their stamps [s]."""

    scans: list[tuple[float, Any]]
    odometry: list[tuple[float, Pose2D]]
    findings: tuple[LogFinding, ...] = ()


def by_rate(
    messages: StampedMessages, is_scan: Sequence[bool], wanted: float | None
) -> StampedMessages:
    """Messages with times by their order, where the user wants a rate of scans [Hz] or the clock stands still.

    Args:
        messages: With their own stamps.
        is_scan: Of scans and odometry as they are mixed.
        wanted: The rate [Hz], or None.
    """
    scans, odometry, _ = messages
    rate, findings = rate_without_clock([stamp for stamp, _ in scans], wanted)
    if rate is None:
        return messages
    stamps = even_stamps(np.array(is_scan), rate)
    of_scans = stamps[np.array(is_scan)].tolist()
    of_odometry = stamps[~np.array(is_scan)].tolist()
    return StampedMessages(
        scans=[(stamp, one) for stamp, (_, one) in zip(of_scans, scans, strict=True)],
        odometry=[(stamp, one) for stamp, (_, one) in zip(of_odometry, odometry, strict=True)],
        findings=findings,
    )


def even_stamps(is_scan: BoolArray, rate: float) -> FloatArray:
    """Stamps (N,) of messages in the order of a file, whose scans come at a rate [Hz] [s]."""
    scans = np.flatnonzero(is_scan)
    times = np.arange(len(scans)) / rate
    order = np.arange(len(is_scan))
    return np.interp(order, scans, times)


def rate_without_clock(
    stamps: Sequence[float], wanted: float | None
) -> tuple[float | None, tuple[LogFinding, ...]]:
    """The rate of scans whose own stamps aren't used [Hz], None where they are, and what is wrong with them.

    Args:
        stamps: Of the scans, in the order of the file [s].
        wanted: The rate that the user gives [Hz].
    """
    standing = int(np.count_nonzero(np.diff(stamps) == 0.0))
    if wanted is not None or 2 * standing <= len(stamps):
        return wanted, ()
    sentence = (
        f"the clock stands still: {standing + 1:,} of {len(stamps):,} stamps are equal, and the scans are taken as "
        "1 s apart in the order of the file (--scan-rate HZ gives their times)"
    )
    return ASSUMED_RATE, (LogFinding("clock", sentence),)


def believed_scan_time(
    increments: Sequence[float], beams: int, gap: float
) -> tuple[float, tuple[LogFinding, ...]]:
    """The time from the first beam of a scan to its last that a laser tells [s], and what is wrong with it.

    One that can't be is taken for none: the scans are mapped as if they were taken at once.

    Args:
        increments: Time from a beam to the next by each scan [s].
        beams: Of a scan.
        gap: Usual time from a scan to the next [s]; nan if it isn't known.
    """
    numbers = [increment for increment in increments if math.isfinite(increment)]
    is_told = 2 * len(numbers) > len(increments)
    told = float(np.median(numbers)) * (beams - 1) if is_told else math.nan
    fault = ""
    if not math.isfinite(told):
        fault = "aren't numbers"
    elif told < 0.0:
        fault = "run backwards"
    elif told > SLOWEST_SCAN or told > LONGEST_SCAN * gap:
        fault = (
            f"are {told:.3g} s from the first to the last, which is longer than until the next scan"
        )
    if not fault:
        return told, ()
    sentence = (
        f"the beams' times {fault}: the scans are taken as made at once (--scan-time SECONDS gives the time from the "
        "first beam to the last)"
    )
    return 0.0, (LogFinding(BEAM_TIMES, sentence),)


def with_told_scan_time(log: Log, increments: Sequence[float]) -> Log:
    """The log with the time of a scan that its laser tells, by the times from a beam to the next [s]."""
    beams = log.geometry.num_beams
    seconds, faults = believed_scan_time(increments, beams, usual_gap(log))
    log = replace(log, findings=(*log.findings, *faults))
    return with_scan_time(log, seconds) if seconds else log


def with_scan_time(log: Log, seconds: float) -> Log:
    """The log with another time from the first beam of its scans to the last [s]; 0: they are made at once."""
    geometry = log.geometry.taking(seconds)
    records = []
    for record in log.records:
        scan = replace(record.scan, geometry=geometry, motion=AT_REST)
        records.append(record._replace(scan=scan))
    return with_track(replace(log, records=records, geometry=geometry), log.track)


def stamped_earlier(log: Log, seconds: float) -> Log:
    """The log with its scans taken so much earlier than they say [s]; the odometry's stamps stay."""
    track = log.track
    in_time = np.argsort(track.stamps, kind="stable")
    odometry = Trajectory(track.stamps[in_time], track.poses[in_time])
    records = []
    for record in log.records:
        stamp = record.stamp - seconds
        records.append(LogRecord(stamp, record.odometry, replace(record.scan, stamp=stamp)))
    stamps = np.array([record.stamp for record in records])
    return with_track(replace(log, records=records), merged_track(odometry, stamps))


def usual_gap(log: Log) -> float:
    """Usual time from a scan to the next [s]; nan where there is no next."""
    stamps = [record.stamp for record in log.records]
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else math.nan


def seconds_apart(times: FloatArray, stamps: FloatArray) -> FloatArray:
    """How far each stamp lies from the nearest of some ordered times."""
    after = np.searchsorted(times, stamps)
    around = np.clip([after - 1, after], 0, len(times) - 1)
    neighbours = times[around]
    return np.asarray(np.abs(neighbours - stamps).min(axis=0), dtype=np.float64)
