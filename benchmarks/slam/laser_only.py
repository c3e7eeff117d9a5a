"""Motion by the laser alone in simulated homes: how far it is off, whether a wrong map is called sure, and a rival.

The homes are fixed: constants were chosen on the first of them, and the others show what they are worth.
"""

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from drives import Conditions, Drive, drive
from map_log import map_log

from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.core.intervals import mean_interval
from slamgym.core.types import Trajectory
from slamgym.interop import Log
from slamgym.interop.odometry import without_odometry
from slamgym.metrics import absolute_trajectory_error
from slamgym.slam.laser_odometry import motion_between, with_laser_odometry, with_steps

RANGES = (12.0, 8.0, 3.5)
"""Ranges of the laser [m]; it sees 180 degrees five times a second."""
FIRST_HOME = 5_000
"""Seed of the first home."""
HOMES = {"chosen on": range(12), "others": range(12, 18)}
"""Numbers of the homes."""
WRONG_METRES = 0.25
"""A path whose RMSE is more is wrong [m]."""
COLUMNS = (
    "range [m]", "homes", "method", "RMSE [m]", "95 %", "median [m]", "worst [m]", "wrong", "wrong and sure",
    "right and in doubt", "ms per scan",
)  # fmt: skip


class Followed(NamedTuple):
    """A path by the laser alone."""

    path: Trajectory
    is_sure: bool
    milliseconds: float  # CPU time per scan


def scan_to_scan(log: Log) -> Followed:
    """The rival: each scan is aligned with the one before, point to line, from where the last motion leads."""
    begin = time.process_time()
    motion = np.zeros(3)
    steps = []
    for before, after in itertools.pairwise(log):
        motion = motion_between(before.scan, after.scan, motion).pose
        steps.append(motion)
    return _followed(with_steps(log, np.array(steps)), begin)


def odometry(log: Log) -> Followed:
    """The laser odometry alone."""
    begin = time.process_time()
    return _followed(with_laser_odometry(log), begin)


def _followed(log: Log, begin: float) -> Followed:
    seconds = time.process_time() - begin
    poses = np.array([record.odometry for record in log])
    path = Trajectory(log.track.stamps, poses)
    return Followed(path, not log.doubted, 1e3 * seconds / len(log))


def mapped(log: Log) -> Followed:
    """The map of ``slamgym slam``; its time includes that of the odometry."""
    begin = time.process_time()
    result = map_log(log)
    seconds = time.process_time() - begin
    return Followed(result.trajectory, not result.stats.spans(), 1e3 * seconds / len(log))


METHODS: dict[str, Callable[[Log], Followed]] = {
    "scan to scan": scan_to_scan,
    "laser odometry": odometry,
    "mapped": mapped,
}
"""What is compared."""


def laser_rows(cache: Path) -> list[dict[str, Any]]:
    """A row for each range, some of the homes, and method."""
    rows = []
    for range_max in RANGES:
        for homes, numbers in HOMES.items():
            drives = list(drives_of(range_max, numbers, cache))
            for method in METHODS:
                row = {"range [m]": range_max, "homes": f"{len(drives)} {homes}", "method": method}
                rows.append(row | method_row(drives, METHODS[method]))
                print(rows[-1], flush=True)
    return rows


def drives_of(range_max: float, numbers: range, cache: Path) -> Iterator[Drive]:
    """Drives through some of the homes."""
    for number in numbers:
        plan = generate_plan(FIRST_HOME + number, PlanGeneratorConfig(kind="home"))
        yield drive(plan, number, Conditions(range_max=range_max), cache)


def method_row(drives: list[Drive], method: Callable[[Log], Followed]) -> dict[str, Any]:
    """Figures of a method on some drives."""
    found = [method(without_odometry(one.log)) for one in drives]
    errors = np.array(
        [
            absolute_trajectory_error(one.path, drive.truth, align=True).translation.rmse
            for one, drive in zip(found, drives, strict=True)
        ]
    )
    interval = mean_interval(errors)
    is_wrong = errors > WRONG_METRES
    is_sure = np.array([one.is_sure for one in found])
    return {
        "RMSE [m]": round(interval.value, 3),
        "95 %": f"{interval.low:.3f}-{interval.high:.3f}",
        "median [m]": round(float(np.median(errors)), 3),
        "worst [m]": round(float(errors.max()), 3),
        "wrong": int(is_wrong.sum()),
        "wrong and sure": int((is_wrong & is_sure).sum()),
        "right and in doubt": int((~is_wrong & ~is_sure).sum()),
        "ms per scan": round(float(np.mean([one.milliseconds for one in found])), 2),
    }
