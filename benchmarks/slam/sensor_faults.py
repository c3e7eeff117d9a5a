"""Faults of sensors in good logs, and what `doctor`, `slam` and the node `ros2 map` say of them.

    python benchmarks/slam/sensor_faults.py LOGS [--scans 800] [--homes 4]

Each fault is put into the scans from 40 to 60 % of a log, or into all of it. *Named*: the right part is, by a finding
or warning that the unbroken log hasn't. *Flagged*: at least half of the scans of a stretch are in doubt, by the checks
(`doctor`), on the path (`slam`), or when they come (the node). *Elsewhere*: share of the other scans in doubt that
aren't without the fault, mean over the logs. *Unbroken* counts logs of which something is said that is wrong with the
laser or a clock.
"""

import argparse
import dataclasses
import itertools
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.types import Float32Array
from slamgym.interop import Log, LogRecord, open_log, write_carmen
from slamgym.interop.odometry import retimed
from slamgym.interop.records import BrokenMessageError
from slamgym.interop.ros_messages import header_fields, scan_fields
from slamgym.ros2.frames import RobotFrames
from slamgym.ros2.map_run import MapRun
from slamgym.ros2.parameters import MapParameters
from slamgym.ros2.stamps import StampGate
from slamgym.slam.odometry_check import check_odometry

sys.path.insert(0, str(Path(__file__).parents[1]))
from map_log import map_checked
from report import print_and_save

MODULES = ("slamgym/slam", "slamgym/ros2", "slamgym/interop")
"""What is measured."""
LATE = 0.3
"""Lateness of the odometry [s]."""
SCALE = 1.4
"""Factor of the readings."""
JUMP = 3600.0
"""A jumped stamp is so far ahead [s]."""
LEFT_OUT = "scan left out because time goes backwards"
"""What a reader of logs says of a jumped stamp."""
COLUMNS = ("fault", "by", "logs", "named", "flagged", "elsewhere")

Change = Callable[[Float32Array], Float32Array]


def rescanned(log: Log, begin: int, end: int, change: Change) -> Log:
    """The log with other ranges in some of its scans."""
    records = list(log.records)
    for index in range(begin, end):
        scan = records[index].scan
        changed = dataclasses.replace(scan, ranges=change(scan.ranges))
        records[index] = records[index]._replace(scan=changed)
    return dataclasses.replace(log, records=records)


def frozen(log: Log, begin: int, end: int) -> Log:
    """The laser repeats one reading."""
    ranges = log.records[begin].scan.ranges
    return rescanned(log, begin, end, lambda _: ranges.copy())


def mirrored(log: Log, begin: int, end: int) -> Log:
    """Left and right of the laser are exchanged."""
    return rescanned(log, begin, end, lambda ranges: ranges[::-1].copy())


def scaled(log: Log, begin: int, end: int) -> Log:
    """All readings are too long."""
    return rescanned(log, begin, end, lambda ranges: np.float32(SCALE) * ranges)


def gap(log: Log, begin: int, end: int) -> Log:
    """No scan comes."""
    kept = [*log.records[:begin], *log.records[end:]]
    return dataclasses.replace(log, records=kept, recorded_track=None)


def late(log: Log, begin: int, end: int) -> Log:
    """All odometry is stamped too late, wherever the stretch is."""
    del begin, end
    return retimed(log, -LATE)


def jumped(log: Log, begin: int, end: int) -> Log:
    """One scan is stamped an hour ahead."""
    del end
    records = list(log.records)
    odd = records[begin]
    scan = dataclasses.replace(odd.scan, stamp=odd.stamp + JUMP)
    records[begin] = LogRecord(scan.stamp, odd.odometry, scan)
    return dataclasses.replace(log, records=records, recorded_track=None)


class SensorFault(NamedTuple):
    """A fault, and who names it how."""

    put_in: Callable[[Log, int, int], Log]
    kinds: frozenset[str]
    """Kinds of findings and warnings that name the right part."""
    lasts: bool
    """True if it lasts for a stretch."""


STUCK, CHANGED = frozenset({"stuck laser", "scan"}), frozenset({"laser changed"})
SENSOR_FAULTS = {
    "frozen": SensorFault(frozen, STUCK, True),
    "mirrored": SensorFault(mirrored, CHANGED, True),
    "scaled": SensorFault(scaled, CHANGED, True),
    "gap": SensorFault(gap, frozenset({"gap"}), True),
    "late": SensorFault(late, frozenset({"clock", "contradicted"}), False),
    "jumped stamp": SensorFault(jumped, frozenset({LEFT_OUT, "odd stamps of scan"}), False),
}
"""All faults by name."""
WRONG = frozenset().union(*(fault.kinds for fault in SENSOR_FAULTS.values())) - {"contradicted"}
"""What is said of no good log."""


class Said(NamedTuple):
    """What one reader says of a log."""

    kinds: set[str]
    doubtful: dict[float, bool]
    """Whether the pose is in doubt, by the stamps of the scans [s]."""


def stretch(log: Log) -> tuple[int, int]:
    """The scans in which a fault is put."""
    return int(0.4 * len(log)), int(0.6 * len(log))


def as_read(log: Log) -> Log:
    """The log as it is read from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "broken.log"
        write_carmen(path, log.records, log.geometry)
        return open_log(path)


def by_doctor(log: Log) -> Said:
    """The findings, and the stretches that they name."""
    read = as_read(log) if _is_disordered(log) else log
    checked = check_odometry(read, estimate_scan_time=False)
    kinds = {finding.kind for finding in checked.findings} | set(read.warnings.counts)
    stuck = [record.stamp for record in checked if np.isnan(record.scan.ranges).all()]
    doubted = [*checked.doubted, *((stamp, stamp) for stamp in stuck)]
    stamps = [record.stamp for record in checked]
    return Said(kinds, {one: any(a <= one <= b for a, b in doubted) for one in stamps})


def by_slam(log: Log) -> Said:
    """The findings, and the path that the mapper doubts."""
    read = as_read(log) if _is_disordered(log) else log
    checked = check_odometry(read, estimate_scan_time=False)
    result = map_checked(checked)
    kinds = {finding.kind for finding in checked.findings} | set(read.warnings.counts)
    stamps = [record.stamp for record in checked]
    return Said(kinds, dict(zip(stamps, result.doubtful.tolist(), strict=True)))


def by_node(log: Log) -> Said:
    """What the node warns of, and when its diagnostics say that the pose is in doubt."""
    kinds: set[str] = set()

    def warn(kind: str, sentence: str) -> None:
        del sentence
        kinds.add(kind)

    doubtful: dict[float, bool] = {}
    with tempfile.TemporaryDirectory() as folder:
        x, y, yaw = log.geometry.mount
        parameters = MapParameters(out=Path(folder), laser_mount=(x, y, yaw))
        run = MapRun(parameters, lambda config: config, None, RobotFrames(parameters, warn), warn)
        gate: StampGate[LogRecord] = StampGate("scan", warn)
        for one in log:
            for usable in gate.take(one.stamp, one):
                stamp = usable.stamp
                record = usable.item
                try:
                    run.add(message_of(record), stamp, record.odometry)
                except BrokenMessageError:
                    warn("scan", "")
                doubtful[stamp] = bool(run.doubt)
        run.close()
    return Said(kinds, doubtful)


READERS: Mapping[str, Callable[[Log], Said]] = {
    "doctor": by_doctor,
    "slam": by_slam,
    "ros2 map": by_node,
}


def message_of(record: LogRecord) -> Any:
    """A scan as a LaserScan."""
    header = header_fields(round(record.stamp * 1e9), "base_scan")
    fields = scan_fields(header, record.scan.ranges, record.scan.geometry, 0.0)
    return SimpleNamespace(**{**fields, "header": SimpleNamespace(**header)})


def _is_disordered(log: Log) -> bool:
    """Whether stamps run backwards, which no reader of files hands on."""
    return bool(np.any(np.diff([record.stamp for record in log]) < 0.0))


class Trial(NamedTuple):
    """What one reader makes of one fault in one log."""

    is_named: bool
    is_flagged: bool
    elsewhere: float


def judged(log: Log, fault: SensorFault, said: Said, usual: Said) -> Trial:
    """Compare what is said of a broken log and of the unbroken one."""
    begin, end = stretch(log)
    first, last = log.records[begin].stamp, log.records[end].stamp
    inside = [doubted for one, doubted in said.doubtful.items() if first < one < last]
    beside = [
        doubted and not usual.doubtful.get(one, False)
        for one, doubted in said.doubtful.items()
        if not first <= one <= last
    ]
    if fault.put_in is gap:  # only the scan after it is left
        inside = [said.doubtful.get(last, False)]
    is_named = bool(fault.kinds & (said.kinds - usual.kinds)) or _other(fault, said, usual)
    share = statistics.mean(inside) if inside else 0.0
    return Trial(is_named, share >= 0.5, statistics.mean(beside) if beside else 0.0)


def _other(fault: SensorFault, said: Said, usual: Said) -> bool:
    """Whether a clock that is off anyway is found."""
    return fault.put_in is late and "clock" in said.kinds & usual.kinds


def rows_of(logs: Mapping[str, Log]) -> Iterator[dict[str, Any]]:
    """A row for each fault and reader."""
    usual = {by: {name: READERS[by](log) for name, log in logs.items()} for by in READERS}
    for by, ones in usual.items():
        wrong = sum(bool(said.kinds & WRONG) for said in ones.values())
        yield {
            "fault": "unbroken",
            "by": by,
            "logs": len(logs),
            "named": wrong,
            "flagged": None,
            "elsewhere": None,
        }
    for (name, fault), by in itertools.product(SENSOR_FAULTS.items(), READERS):
        trials = []
        for log_name, log in logs.items():
            said = READERS[by](fault.put_in(log, *stretch(log)))
            trials.append(judged(log, fault, said, usual[by][log_name]))
            print(
                f"{name}, {by}, {log_name}: {trials[-1]} {said.kinds}", file=sys.stderr, flush=True
            )
        yield {
            "fault": name,
            "by": by,
            "logs": len(trials),
            "named": sum(trial.is_named for trial in trials),
            "flagged": sum(trial.is_flagged for trial in trials) if fault.lasts else None,
            "elsewhere": round(statistics.mean(trial.elsewhere for trial in trials), 3),
        }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", type=Path, help="folder of NAME.log.gz")
    parser.add_argument("--scans", type=int, default=800, help="of each log, at most")
    parser.add_argument("--homes", type=int, default=4, help="drives through generated homes")
    parser.add_argument("--cache", type=Path, default=Path("build/drives"))
    arguments = parser.parse_args()
    from drives import Conditions, drive, generated_homes  # tests take the faults alone

    logs = {}
    for plan, seed in itertools.islice(generated_homes(20), arguments.homes):
        logs[plan.id] = drive(plan, seed, Conditions(), arguments.cache).log
    for path in sorted(arguments.logs.glob("*.log.gz")):
        log = open_log(path)
        if not log.findings:  # a clock that stands still
            logs[path.name] = log
    for name, log in logs.items():
        first = log.records[: arguments.scans]
        logs[name] = dataclasses.replace(log, records=first, recorded_track=None)
    rows = list(rows_of(logs))
    print_and_save("slam/sensor_faults", "sensor faults", rows, COLUMNS, MODULES)


if __name__ == "__main__":
    main()
