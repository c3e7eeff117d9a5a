"""Accuracy, honesty and time of the mappers on simulated homes and recorded logs: the table of docs/slam.md.

    python benchmarks/slam/mapping.py [--parts exact medium logs] [--modes ...] [--logs LOGS] [--homes 20] [--seeds 3]

Parts: ``exact``: exact laser, true odometry. ``medium``: the default laser and odometry. ``levels``: other odometries,
a laser of 12 m, and one whose beams of a scan take 0.1 s. ``large``: buildings of 850 to 4,300 m2 (``large_maps.py``),
which take long to simulate, so this part must be asked for. The other buildings are generated homes and the bundled
plans of ``make demo``; every mode is fed the same drives, which are simulated once and kept in a cache. ``demo``: the
maps of ``make demo`` themselves. ``logs``: recorded logs, as ``slamgym slam`` maps them. ``faults``: good drives and
logs with faults put in (``faults.py``). ``laser_only``: drives without odometry (``laser_only.py``). A run of some
modes leaves the rows of the others in the results file as they are.

*RMSE*: position of the final path against the truth, without alignment, with a 95 % bootstrap interval of the mean.
*walls*: mean distance of the map's occupied cells from the true walls; cells alone cost a quarter of their size.
*points*: the same of the end points of scans on the final path, after rigid alignment. Both include the laser's errors:
the row ``ground_truth`` shows the least that is possible. *NEES*: 3 for a consistent covariance. *revisit*: mean
distance between what several passes saw. *from reference*: RMSE against the path of the last mode after alignment,
which shows what is broken where a log has no relations.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.geometry import transform_poses
from slamgym.core.intervals import mean_interval
from slamgym.core.types import FloatArray, Pose2D, Trajectory
from slamgym.interop import Log, LogRecord, open_log
from slamgym.metrics import (
    ObstacleDistance,
    absolute_trajectory_error,
    align_se2,
    normalised_estimation_error_squared,
    poses_at,
)
from slamgym.slam import SlamConfig
from slamgym.slam.mapper import Mapper
from slamgym.slam.modes import MODES
from slamgym.slam.replay import ReplayResult, replay

sys.path.insert(0, str(Path(__file__).parents[1]))
import demo_maps
import recorded_logs
from drives import Conditions, Drive, demo_plans, drive, generated_homes
from faults import COLUMNS as FAULT_COLUMNS
from faults import doubtful_spans, fault_rows
from large_maps import COLUMNS as LARGE_COLUMNS
from large_maps import large_rows
from laser_only import COLUMNS as LASER_COLUMNS
from laser_only import laser_rows
from recorded_logs import end_points
from report import RESULTS, print_and_save

MODULES = ("slamgym/slam",)
"""What is measured."""

INSTANTS = 10
"""Number of instants of a drive at which NEES is taken."""
EVERY = 10
"""Of so many scans the end points of one are measured."""
GMAPPING = "rbpf"
"""The mode that times are compared with."""
LONG_RANGE = 12.0
"""Range of a laser that sees across rooms [m]."""
SWEEP = 0.1
"""Time that a scan over half a turn takes [s]: that of an LDS-01."""
FAULTY_HOMES = 4
"""Number of homes into whose drives faults are put."""
KNOWN_FAULT = "freiburg-079"
"""Recorded log that has a fault of its own."""
BY_ODOMETRY = ("dead_reckoning", "ground_truth")
RATIO = "/ GMapping's"
DRIVE_COLUMNS = (
    "drives", "mode", "RMSE [m]", "95 %", "median [m]", "worst [m]", "walls [m]", "points [m]", "NEES", "doubts",
    "ms per scan", RATIO,
)  # fmt: skip

Rows = list[dict[str, Any]]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--parts", nargs="+", choices=PARTS, default=[part for part in PARTS if part != "large"]
    )
    parser.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES))
    parser.add_argument("--logs", type=Path, help="folder of NAME.log.gz, some with NAME.relations")
    parser.add_argument("--homes", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each log")
    parser.add_argument(
        "--cache", type=Path, default=Path("build/drives"), help="folder of simulated drives"
    )
    arguments = parser.parse_args()
    for part in arguments.parts:
        make_rows, columns = PARTS[part]
        rows = make_rows(arguments)
        if rows:
            name = f"slam/mapping_{part}"
            rows = with_other_modes(RESULTS / f"{name}.json", rows)
            if RATIO in columns:
                rows = with_ratios(rows)
            print_and_save(name, part, rows, columns, MODULES)


def with_other_modes(path: Path, rows: Rows) -> Rows:
    """Rows, and those of modes that weren't run now: a change of one mapper doesn't take the hours of the slow ones."""
    if not path.exists():
        return rows
    modes = {row.get("mode") for row in rows}
    before = json.loads(path.read_text())["rows"]
    kept = [row for row in before if row.get("mode") not in modes | {None}]
    subjects = [_subject(row) for row in rows]
    kept = [row for row in kept if _subject(row) in subjects]
    return sorted([*rows, *kept], key=lambda row: subjects.index(_subject(row)))


def _subject(row: dict[str, Any]) -> Any:
    """What a row's mode was run on."""
    return row.get("drives", row.get("log", row.get("building")))


def exact(arguments: argparse.Namespace) -> Rows:
    """Drives without any error but that of the mapper."""
    case = Conditions("ideal", "exact")
    return homes_and_demo_plans(arguments, case)


def medium(arguments: argparse.Namespace) -> Rows:
    """Drives with the default errors."""
    return homes_and_demo_plans(arguments, Conditions())


def homes_and_demo_plans(arguments: argparse.Namespace, case: Conditions) -> Rows:
    """Drives through generated homes, and through the bundled plans of ``make demo``."""
    homes = drive_rows(arguments, case, "homes", generated_homes(arguments.homes))
    return [*homes, *drive_rows(arguments, case, "demo plans", demo_plans())]


def levels(arguments: argparse.Namespace) -> Rows:
    """Drives with other odometries, and with a laser that sees across rooms."""
    cases = [
        *(Conditions(level) for level in ("ideal", "low", "high")),
        Conditions(range_max=LONG_RANGE),
        Conditions(sweep=SWEEP),
    ]
    homes = list(generated_homes(arguments.homes))
    return [row for case in cases for row in drive_rows(arguments, case, "homes", homes)]


def logs(arguments: argparse.Namespace) -> Rows:
    """Recorded logs; without ``--logs`` there are none."""
    if arguments.logs is None:
        return []
    modes = [mode for mode in arguments.modes if mode not in BY_ODOMETRY]
    return recorded_logs.log_rows(arguments.logs, modes, arguments.seeds)


def demo(arguments: argparse.Namespace) -> Rows:
    """Explorations of the bundled plans that drive by the mapper's own pose."""
    return [
        {"mode": mode} | demo_maps.demo_figures(Conditions().mapper(mode), arguments.seeds)
        for mode in arguments.modes
        if mode != "dead_reckoning"
    ]


def large(arguments: argparse.Namespace) -> Rows:
    """Drives of an hour through large buildings."""
    return large_rows(arguments.modes, arguments.cache)


def faults(arguments: argparse.Namespace) -> Rows:
    """Faults in simulated drives, with a laser of either range, and in recorded logs."""
    good: dict[str, tuple[Log, Trajectory | None]] = {}
    for case in (Conditions(), Conditions(range_max=LONG_RANGE)):
        for plan, seed in itertools.islice(generated_homes(arguments.homes), FAULTY_HOMES):
            one = drive(plan, seed, case, arguments.cache)
            good[f"{plan.id}, {case.range_max:g} m"] = one.log, one.truth
    for path in sorted(arguments.logs.glob("*.log.gz")) if arguments.logs else ():
        if not path.name.startswith(KNOWN_FAULT):
            good[path.name] = open_log(path), None
    modes = [mode for mode in arguments.modes if mode not in (*BY_ODOMETRY, GMAPPING)]
    return fault_rows(good, modes)


def laser_only(arguments: argparse.Namespace) -> Rows:
    """Drives without odometry."""
    return laser_rows(arguments.cache)


def drive_rows(
    arguments: argparse.Namespace,
    case: Conditions,
    kind: str,
    buildings: Iterable[tuple[FloorPlan, int]],
) -> Rows:
    """A row for each mode on the same drives through some buildings, each with the seed of its drive."""
    drives = [drive(plan, seed, case, arguments.cache) for plan, seed in buildings]
    sweep = f", sweep {case.sweep:g} s" if case.sweep else ""
    laser = f"{case.laser} {case.range_max:g} m{sweep}"
    name = {"drives": f"{len(drives)} {kind}: {case.odometry}, {laser}"}
    return [name | drive_row(drives, case, mode) for mode in arguments.modes]


def with_ratios(rows: Rows) -> Rows:
    """The rows, those of drives and logs with their times divided by that of GMapping's filter on the same ones."""
    whole = {_subject(row): row["ms per scan"] for row in rows if row.get("mode") == GMAPPING}
    found = []
    for row in rows:
        each = whole.get(_subject(row))
        found.append(row | {RATIO: each and round(row["ms per scan"] / each, 3)})
    return found


def drive_row(drives: Sequence[Drive], case: Conditions, mode: str) -> dict[str, Any]:
    """One mode on all drives of a case."""
    config = case.mapper(mode)
    results = [measure(one, config, seed) for seed, one in enumerate(drives)]
    errors = np.array([result.error for result in results])
    interval, nees = mean_interval(errors), np.concatenate([result.nees for result in results])
    return {
        "mode": mode,
        "RMSE [m]": round(interval.value, 3),
        "95 %": f"{interval.low:.3f}-{interval.high:.3f}",
        "median [m]": round(float(np.median(errors)), 3),
        "worst [m]": round(float(errors.max()), 3),
        "walls [m]": round(float(np.mean([result.walls for result in results])), 4),
        "points [m]": round(float(np.mean([result.points for result in results])), 4),
        "NEES": None if mode in BY_ODOMETRY else round(float(nees.mean()), 1),
        "doubts": round(float(np.mean([result.spans for result in results])), 1),
        "ms per scan": round(float(np.median([result.milliseconds for result in results])), 2),
    }


@dataclass(frozen=True)
class Measured:
    """Figures of one drive."""

    error: float  # RMSE of the path [m]
    walls: float  # of the map's occupied cells from the true walls [m]
    points: float  # of the end points, aligned [m]
    nees: FloatArray  # (INSTANTS,)
    spans: int  # doubtful ones
    milliseconds: float  # per processed scan


def measure(one: Drive, config: SlamConfig, seed: int) -> Measured:
    """Map a drive and compare path, map and covariance with the truth."""
    log = one.log
    if config.mode == "ground_truth":
        poses = one.truth.poses.tolist()
        records = [
            LogRecord(r.stamp, Pose2D(*pose), r.scan) for r, pose in zip(log, poses, strict=True)
        ]
        log = Log(log.source, records, log.geometry)
    instants = set(np.linspace(0, len(log) - 1, INSTANTS + 1).astype(int)[1:].tolist())
    stamps, believed, covariances = [], [], []

    def on_scan(index: int, mapper: Mapper, is_processed: bool) -> None:
        del is_processed
        if index in instants:
            stamps.append(log.records[index].stamp)
            believed.append(mapper.pose)
            covariances.append(mapper.covariance)

    result = replay(log, config, np.random.default_rng(seed), on_scan)
    true, _ = poses_at(one.truth, np.array(stamps))
    return Measured(
        absolute_trajectory_error(result.processed, one.truth, align=False).translation.rmse,
        ObstacleDistance(one.walls).mean_error(result.grid, Pose2D(0.0, 0.0, 0.0)),
        points_to_walls(one, result, config.max_usable_range),
        normalised_estimation_error_squared(np.array(believed), true, np.array(covariances)),
        len(doubtful_spans(result.stats)),
        result.stats.cpu_ms_per_processed_scan,
    )


def points_to_walls(one: Drive, result: ReplayResult, range_max: float) -> float:
    """Mean distance of end points from the true walls, once the path is aligned with the true one [m]."""
    poses, (true, _) = result.trajectory.poses, poses_at(one.truth, result.trajectory.stamps)
    aligned = transform_poses(align_se2(poses[:, :2], true[:, :2]), poses)
    points, _ = end_points(one.log.records[::EVERY], aligned[::EVERY], range_max)
    walls = shapely.MultiLineString(list(one.walls.reshape(-1, 2, 2)))
    shapely.prepare(walls)
    return float(shapely.distance(shapely.points(points), walls).mean())


PARTS = {
    "exact": (exact, DRIVE_COLUMNS),
    "medium": (medium, DRIVE_COLUMNS),
    "levels": (levels, DRIVE_COLUMNS),
    "logs": (logs, (*recorded_logs.COLUMNS, RATIO)),
    "demo": (demo, demo_maps.COLUMNS),
    "faults": (faults, FAULT_COLUMNS),
    "laser_only": (laser_only, LASER_COLUMNS),
    "large": (large, LARGE_COLUMNS),
}
"""Tables and their columns."""


if __name__ == "__main__":
    main()
