"""A log's scans as a whole: a laser that repeats one reading, or says nothing for a while."""

from dataclasses import replace

import numpy as np

from slamgym.core.geometry import between, runs_of
from slamgym.core.types import BoolArray, Float32Array, Pose2D
from slamgym.interop.records import Log
from slamgym.metrics.trajectory import relative_poses

LEAST_SECONDS = 0.5
"""Shorter repetitions are those of a driver that publishes faster than its laser turns [s]."""
LEAST_REPEATS = 3
"""So many scans must be the same as one before: some logs hold each scan twice."""
OTHER_VIEW_METRES = 0.1
"""A robot that drives so far meanwhile sees something else [m]: the readings of a good laser have noise at rest, too,
but those of a simulated one may have none."""
OTHER_VIEW_RADIANS = 0.1
"""The same of a turn [rad]."""
LONG_GAP = 10.0
"""A gap between scans is so many times as long as in half of the log."""
FAR = 3.0
"""And the robot moves so many times as far there."""
GAP_METRES = 0.5
"""It drives so far, at least [m]."""
GAP_RADIANS = 1.0
"""Or it turns so far [rad]."""
FEWEST_READINGS = 10
"""A scan with fewer readings, as in an open hall, may well be the same again."""


def _has_other_view(step: Pose2D) -> bool:
    """True if a laser that works sees something else after such a step."""
    return bool(
        np.hypot(step.x, step.y) > OTHER_VIEW_METRES or abs(step.theta) > OTHER_VIEW_RADIANS
    )


class Repetition:
    """Notices, scan by scan, that a laser is stuck."""

    def __init__(self) -> None:
        self._ranges: Float32Array | None = None
        self._stamp = 0.0  # of the first scan that was so [s]
        self._odometry = Pose2D(0.0, 0.0, 0.0)  # then
        self.count = 0
        """Scans in a row until now that are the same as one before."""

    def is_stuck(self, stamp: float, ranges: Float32Array, odometry: Pose2D) -> bool:
        """True if a scan is the same as those before, and the robot has moved meanwhile.

        Args:
            stamp: [s].
            ranges: Shape (N,) [m].
            odometry: The robot's pose.
        """
        before = self._ranges
        if before is None or not np.array_equal(before, ranges, equal_nan=True):
            self._ranges = ranges
            self._stamp = stamp
            self._odometry = odometry
            self.count = 0
            return False
        self.count += 1
        step = between(self._odometry, odometry)
        has_moved = _has_other_view(step)
        is_long = self.count >= LEAST_REPEATS and stamp - self._stamp >= LEAST_SECONDS
        is_seeing = np.count_nonzero(np.isfinite(ranges)) >= FEWEST_READINGS
        return bool(has_moved and is_long and is_seeing)


def without_repeats(log: Log) -> Log:
    """The log without the readings that a stuck laser repeats, and what to say; the odometry alone leads there."""
    if not log.has_odometry:
        return log
    repeats = _stuck_scans(log)
    if not repeats:
        return log
    records = list(log.records)
    for index in repeats:
        record = records[index]
        nothing = np.full_like(record.scan.ranges, np.nan)
        records[index] = record._replace(scan=replace(record.scan, ranges=nothing))
    first = log.records[repeats[0]].stamp - log.start
    sentence = (
        f"the laser repeats one reading while the robot moves, in {len(repeats)} of {len(log)} scans, first "
        f"{first:.0f} s after the start: they are left out, and the path is in doubt there; restart its driver"
    )
    return replace(log, records=records).noting("stuck laser", sentence)


def noting_gaps(log: Log) -> Log:
    """The log with a finding where scans are missing while the robot moves: only the odometry leads there."""
    if not log.has_odometry or len(log) < 3:
        return log
    stamps = np.array([record.stamp for record in log])
    poses = np.array([record.odometry for record in log], dtype=np.float64)
    waits = np.diff(stamps)
    usual = np.median(waits)
    if usual <= 0.0:  # its stamps say nothing
        return log
    steps = relative_poses(poses[:-1], poses[1:])
    drives = np.hypot(steps[:, 0], steps[:, 1])
    turns = np.abs(steps[:, 2])
    far = drives > max(GAP_METRES, FAR * np.median(drives))
    round_about = turns > max(GAP_RADIANS, FAR * np.median(turns))
    gaps = np.flatnonzero((waits > LONG_GAP * usual) & (far | round_about))
    if not len(gaps):
        return log
    longest = gaps[np.argmax(waits[gaps])]
    sentence = (
        f"the laser sends no scan for {waits[longest]:.1f} s from {stamps[longest] - log.start:.0f} s after the start "
        f"on, while the robot drives {drives[longest]:.1f} m ({len(gaps)} such gaps): the odometry alone leads there"
    )
    doubted = zip(stamps[gaps].tolist(), stamps[gaps + 1].tolist(), strict=True)
    return replace(log.noting("gap", sentence), doubted=(*log.doubted, *doubted))


def median_change(old: Float32Array, new: Float32Array) -> float:
    """Median of what the readings of two scans (num_beams,) differ by [m]; 0 if there are few."""
    both = np.isfinite(old) & np.isfinite(new)
    if np.count_nonzero(both) < FEWEST_READINGS:
        return 0.0
    return float(np.median(np.abs(new[both] - old[both])))


def _stuck_scans(log: Log) -> list[int]:
    """Indices of the scans that are the same as one before, wherever the robot moves meanwhile."""
    repetition = Repetition()
    stuck: list[int] = []
    for index, record in enumerate(log):
        if repetition.is_stuck(record.stamp, record.scan.ranges, record.odometry):
            noted = stuck[-1] + 1 if stuck else 0
            stuck.extend(range(max(noted, index + 1 - repetition.count), index + 1))
    return stuck


def blind_scans(log: Log) -> BoolArray:
    """True for each scan without any valid reading in a stretch of such scans over which the robot moved, shape (N,).

    Nothing tells where the robot went there but its odometry; without odometry each longer stretch counts.
    """
    blind = np.array([np.isnan(record.scan.ranges).all() for record in log])
    for begin, end in runs_of(blind).tolist():
        before = log.records[max(begin - 1, 0)]
        last = log.records[end - 1]
        step = between(before.odometry, last.odometry)
        has_moved = _has_other_view(step)
        is_long = last.stamp - before.stamp > LEAST_SECONDS
        blind[begin:end] = is_long and (has_moved or not log.has_odometry)
    return blind
