"""``slamgym doctor LOG``: facts of a recorded log as a table, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slamgym.commands.frame import show_table
from slamgym.commands.log_input import LogReading, checked_log
from slamgym.core.progress import counted

if TYPE_CHECKING:
    from slamgym.interop.records import Log


def show_facts(path: Path, reading: LogReading) -> int:
    """Show a log's facts and findings; returns the exit code: 1 if there is a finding."""
    log = checked_log(path, reading, is_said=False)
    show_table(
        ["", str(path)],
        facts_of(log),
        None,
        *(list(map(str, log.findings)) or ["nothing is wrong"]),
    )
    return 1 if log.findings else 0


def facts_of(log: Log) -> Iterator[tuple[str, str]]:
    """Names and values, in the order of the table."""
    from slamgym.slam.odometry_check import measure_pairs, odometry_shares

    stamps = np.array([record.stamp for record in log])
    waits = np.diff(stamps) if len(log) > 1 else np.zeros(1)
    rate = f"{1.0 / max(float(np.median(waits)), 1e-9):.1f} Hz, longest gap {waits.max():.2f} s"
    yield "scans", f"{counted(len(log), 'scan')} in {log.duration:.1f} s, {rate}"
    yield from log.sources.items()
    laser = log.geometry
    first, last = np.degrees(laser.angles[[0, -1]])
    taken = f"in {laser.scan_time:.3f} s" if laser.scan_time else "at once"
    yield "beams", f"{laser.num_beams}, from {first:.1f} to {last:.1f} degrees, {taken}"
    yield "ranges", f"{laser.range_min:g} to {laser.range_max:g} m"
    x, y, theta = laser.mount
    yield "mount", f"{x:.3f} m ahead, {y:.3f} m left, turned by {np.degrees(theta):.1f} degrees"
    ranges = np.concatenate(
        [record.scan.ranges for record in log.records[:: max(1, len(log) // 500)]]
    )
    measured = np.isfinite(ranges).mean()
    invalid = np.isnan(ranges).mean()
    missing = f"{1.0 - measured - invalid:.1%} without return, {invalid:.1%} invalid"
    yield "readings", f"{measured:.1%} measured, {missing}"
    if not log.has_odometry:
        return
    yield "driven", f"{np.hypot(*np.diff(log.track.poses[:, :2], axis=0).T).sum():.1f} m"
    turns, ways, _ = odometry_shares(measure_pairs(log))
    yield "odometry / laser", f"turns {turns:.2f}, distances {ways:.2f}".replace("nan", "unknown")
