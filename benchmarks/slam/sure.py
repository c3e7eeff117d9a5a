"""Is a map that is called sure right? Sixty drives of the zoo, each with a fault, and the same sixty without one.

    python benchmarks/slam/sure.py [--drive 0] [--workers 2]

Each cell of the zoo (``zoo.py``: ten robots in six kinds of places, in buildings that no constant was chosen on) gets
one of six faults, in turn: the robot is carried to another place, the times of the beams are left out, the laser sees
a third as far, the wheels slip, the laser is mounted otherwise than is said, the odometry is late. A fault that has a
moment begins in the middle of the drive.

A map is *wrong* if the RMSE of its path after alignment exceeds that of the drive without the fault by 0.25 m, and
*right* if it is below that without a fault. A wrong one is *found* if a scan is doubtful or broken, within 10 s of the
fault if that has a moment. The drives are those of the zoo's cache.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.geometry import between, compose
from slamgym.core.types import AT_REST, Pose2D, Trajectory
from slamgym.interop import Log
from slamgym.metrics import absolute_trajectory_error

sys.path.insert(0, str(Path(__file__).parents[1]))
from drives import Drive
from faults import FOUND_SECONDS, WRONG_METRES, Span, doubtful_spans, jumped, late, overlap, stretch
from map_log import map_log
from recorded_logs import with_range, with_scans
from report import print_and_save, print_table
from zoo import Task
from zoo_robots import PLACES, ROBOTS

CARRIED_METRES = 4.0
"""A robot is carried so far at least [m], if its drive leads so far away."""
SHORTER = 1.0 / 3.0
"""The laser sees so much of its range."""
SLIP = Pose2D(1.0, 0.0, math.radians(30.0))
"""The wheels turn so far and the robot stands."""
WRONG_MOUNT = Pose2D(0.15, 0.1, math.radians(15.0))
"""The laser is mounted so far from where it is said to be."""
LATE_SECONDS = 0.5
"""The odometry is so late [s]: more than the search for its delay looks for at 40 Hz."""
MODULES = ("slamgym/slam", "slamgym/sim")
"""What is measured."""

Fault = Callable[[Drive, Span], Drive]


def carried(drive: Drive, span: Span) -> Drive:
    """A drive whose robot is taken, when a span begins, to where it is ``CARRIED_METRES`` further on; its wheels stand.

    Where it never is so far away, it is taken to the farthest place.
    """
    log = drive.log
    first = next(k for k, record in enumerate(log) if record.stamp > span.begin)
    away = np.hypot(*(drive.truth.poses[first:, :2] - drive.truth.poses[first, :2]).T)
    far = np.flatnonzero(away > min(CARRIED_METRES, float(away.max()) - 1e-9))
    then = first + int(far[0])
    pause = log.records[then].stamp - log.records[first].stamp
    gap = log.records[first + 1].stamp - log.records[first].stamp
    before, after = log.records[first].odometry, log.records[then].odometry
    records = list(log.records[: first + 1])
    for record in log.records[then:]:
        stamp = record.stamp - pause + gap
        odometry = compose(before, between(after, record.odometry))
        scan = replace(record.scan, stamp=stamp)
        records.append(record._replace(stamp=stamp, odometry=odometry, scan=scan))
    stamps = np.array([record.stamp for record in records])
    poses = np.concatenate([drive.truth.poses[: first + 1], drive.truth.poses[then:]])
    shorter = replace(log, records=records, recorded_track=None)
    return replace(drive, log=shorter, truth=Trajectory(stamps, poses))


def without_times(log: Log) -> Log:
    """A log whose beams have no times: each scan is taken for that of a moment."""
    geometry = log.geometry._replace(time_increment=0.0)
    still = with_scans(log, [record.scan.ranges for record in log], geometry)
    records = [record._replace(scan=replace(record.scan, motion=AT_REST)) for record in still]
    return replace(still, records=records)


def wrongly_mounted(log: Log) -> Log:
    """A log whose laser isn't where it is said to be."""
    geometry = log.geometry._replace(mount=compose(log.geometry.mount, WRONG_MOUNT))
    return with_scans(log, [record.scan.ranges for record in log], geometry)


def of_log(change: Callable[[Log, Span], Log]) -> Fault:
    """A fault that leaves the true path as it is."""
    return lambda drive, span: replace(drive, log=change(drive.log, span))


class Kind(NamedTuple):
    """A kind of fault."""

    put_in: Fault
    has_moment: bool


KINDS = {
    "carried away": Kind(carried, True),
    "no times of beams": Kind(of_log(lambda log, _: without_times(log)), False),
    "laser sees a third as far": Kind(
        of_log(lambda log, _: with_range(log, SHORTER * log.geometry.range_max)), False
    ),
    "wheels slip": Kind(of_log(lambda log, span: jumped(log, span, SLIP)), True),
    "wrong mount": Kind(of_log(lambda log, _: wrongly_mounted(log)), False),
    "odometry late": Kind(of_log(lambda log, _: late(log, LATE_SECONDS)), False),
}
"""Faults by name; each cell of the zoo has the next one."""


class Judged(NamedTuple):
    """A drive without its fault and with it."""

    kind: str
    usual: float  # RMSE after alignment without the fault [m]
    is_doubted: bool  # without the fault
    error: float  # RMSE after alignment with it [m]
    is_found: bool

    @property
    def is_wrong(self) -> bool:
        """True if the fault made the map wrong."""
        return self.error > self.usual + WRONG_METRES


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drive", type=int, default=0, help="number of the drive of each cell")
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--places", nargs="+", choices=PLACES, default=list(PLACES))
    parser.add_argument("--minutes", type=float, default=7.0, help="longest drive")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--cache", type=Path, default=Path("build/zoo"), help="folder of drives")
    arguments = parser.parse_args()
    zoo = argparse.Namespace(sweep="on", minutes=arguments.minutes, cache=arguments.cache)
    names = list(KINDS)
    tasks = []
    # Robots and kinds shift against each other, so that each place meets all faults.
    for i, robot in enumerate(arguments.robots):
        for j, place in enumerate(arguments.places):
            task = Task(robot, place, arguments.drive, zoo)
            tasks.append((task, names[(i + j) % len(names)]))
    with ProcessPoolExecutor(arguments.workers) as pool:
        spread: Callable[..., Iterable[Judged]] = pool.map if arguments.workers > 1 else map
        results = list(spread(judged, tasks))
    rows = [row_of(name, [one for one in results if one.kind == name]) for name in KINDS]
    rows.append(row_of("all", results))
    title = f"faults in {len(results)} drives of the zoo"
    if len(tasks) == len(ROBOTS) * len(PLACES):
        print_and_save("slam/sure", title, rows, list(rows[0]), MODULES)
    else:
        print_table(title, rows, list(rows[0]))


def judged(task: tuple[Task, str]) -> Judged:
    """One drive with its fault, and without."""
    cell, name = task
    kind = KINDS[name]
    drive = cell.drive()
    where = stretch(drive.log)
    usual, doubts = mapped(drive)
    error, spans = mapped(kind.put_in(drive, where))
    near = Span(where.begin - FOUND_SECONDS, where.begin + FOUND_SECONDS)
    found = [span for span in spans if not kind.has_moment or overlap(span, near)]
    result = Judged(name, usual, bool(doubts), error, bool(found))
    print(f"{cell.name} {result} {spans}", file=sys.stderr, flush=True)
    return result


def mapped(drive: Drive) -> tuple[float, list[Span]]:
    """RMSE after alignment [m], and what is in doubt, of a drive by the default mapper."""
    result = map_log(drive.log)
    error = absolute_trajectory_error(result.trajectory, drive.truth).translation.rmse
    return error, doubtful_spans(result.stats)


def row_of(name: str, results: list[Judged]) -> dict[str, Any]:
    """One kind of fault over its drives."""
    wrong = [one for one in results if one.is_wrong]
    right = [one for one in results if one.usual < WRONG_METRES]
    return {
        "fault": name,
        "drives": len(results),
        "wrong by it": len(wrong),
        "found": sum(one.is_found for one in wrong),
        "right without it": len(right),
        "doubted though right": sum(one.is_doubted for one in right),
    }


if __name__ == "__main__":
    main()
