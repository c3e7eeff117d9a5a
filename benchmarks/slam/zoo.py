"""Mappers on many robots in many places, worst cells first: it tells progress from tuning.

    python benchmarks/slam/zoo.py [--drives 2] [--robots ...] [--places ...] [--modes ...] [--logs FOLDER]

A cell is a robot in a kind of place (``zoo_robots.py``): ten lasers by homes, furnished homes, offices, corridors,
halls and a lab full of clutter, in buildings that no constant was chosen on. The robot explores with a known pose, so
every mode is fed the same drives; they are simulated once and kept in a cache, whatever interrupts it. ``--sweep off``
takes all beams of a scan at once. ``--logs`` names a folder of recorded logs, which are mapped as they are and with a
shorter laser, fewer beams and turns of the odometry that are wrong by a tenth; ``--noises 3`` maps each once as it is
and twice with a millimetre of noise in its ranges, as a laser of few beams is a matter of chance; but drives of more
than a kilometre once.

*start*: RMSE of the final path at all scans against the truth, from the true start [m]; *aligned*: the same after rigid
alignment. The worst of a cell's drives counts. *says*: what the mapper says of its map, the worst of them. *ms*: median
CPU time per processed scan. Of logs *error* is the mean error of their relations [m]; or the RMSE after alignment to
their reference path, or, where they have none, to the mode's own path on the whole log; the median of the noises, with
the *worst* beside it. *walls*: largest difference of
the main direction of the walls, modulo 90 degrees, among six equal parts of a log.

``--modes karto`` needs ``pip install yag-slam``. A run of some modes leaves the columns of the others in the results
file as they are, so that a change of one mapper doesn't take the hours of the slow ones. ``--pictures FOLDER`` draws
every map beside that of the true path.
"""

import argparse
import json
import statistics
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.config import config_hash, to_dict
from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D, Trajectory
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.interop import Log
from slamgym.metrics import absolute_trajectory_error
from slamgym.metrics.wall_direction import find_wall_direction
from slamgym.sim import odometry_level
from slamgym.slam import SlamConfig
from slamgym.slam.config import RANGE_MARGIN
from slamgym.slam.mapper import SlamStats
from slamgym.slam.modes import MODES
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.replay import replay
from slamgym.viz.canvas import write_picture
from slamgym.viz.map_pictures import draw_map

sys.path.insert(0, str(Path(__file__).parents[1]))
from drives import Drive, kept_drive
from karto import karto_path
from map_log import map_log
from recorded_logs import JudgedLog, read_judged_log, variants, with_noise
from report import RESULTS, print_and_save, print_table
from zoo_robots import FIRST_SEED, PLACES, ROBOTS

KARTO = "karto"
"""The rival's mode."""
VERDICTS = ("", "sure", "doubtful", "broken")
"""What a mapper says of its map, the worst last; Karto says nothing."""
CELL = ("robot", "place", "driven [m]")
"""Columns that tell a cell and its drives from others."""
VARIANT = ("log", "variant", "against")
"""Columns that tell a variant of a log from others."""
LONG_DRIVE = 1000.0
"""A longer drive is mapped as it is alone [m]."""
WALL_PARTS = 6
"""A log is cut into so many parts, whose walls run the same way."""
MODULES = ("slamgym/slam", "slamgym/sim")
"""What is measured."""

Rows = list[dict[str, Any]]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=int, default=2, help="drives a cell, each in its building")
    parser.add_argument(
        "--robots", nargs="*", choices=ROBOTS, default=list(ROBOTS), help="none: only the logs"
    )
    parser.add_argument("--places", nargs="*", choices=PLACES, default=list(PLACES))
    modes = [*(mode for mode in MODES if mode != "ground_truth"), KARTO]
    parser.add_argument("--modes", nargs="+", choices=modes, default=["pose_graph", "rbpf"])
    parser.add_argument("--sweep", choices=["on", "off"], default="on")
    parser.add_argument("--minutes", type=float, default=7.0, help="longest drive")
    parser.add_argument("--logs", type=Path, help="folder of NAME.log.gz, with .relations or .corr")
    parser.add_argument("--noises", type=int, default=1, help="runs of each variant of a log")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of every map")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--cache", type=Path, default=Path("build/zoo"), help="folder of drives")
    arguments = parser.parse_args()
    if arguments.drives < 1:
        parser.error("--drives must be at least 1")
    if arguments.noises < 1:
        parser.error("--noises must be at least 1")
    if arguments.logs is not None and not any(arguments.logs.glob("*.log.gz")):
        parser.error(f"--logs {arguments.logs}: there is no NAME.log.gz in it")
    with ProcessPoolExecutor(arguments.workers) as pool:
        # One process needs no pool, and is easier to look into.
        spread = pool.map if arguments.workers > 1 else map
        show_cells(arguments, spread)
        if arguments.logs is not None:
            show_logs(arguments, spread)


Spread = Callable[..., Iterable[Any]]
"""``map``, or that of a pool of processes."""


class Task(NamedTuple):
    """A drive through a cell, and how to map it."""

    robot: str
    place: str
    number: int
    arguments: argparse.Namespace

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.robot}-{self.place}-{self.number}"

    def episode(self) -> EpisodeConfig:
        """Settings of the exploration with a known pose."""
        robot = ROBOTS[self.robot]
        lidar = robot.lidar
        if self.arguments.sweep == "off":
            lidar = replace(lidar, sweep=0.0)
        usable = lidar.range_max - RANGE_MARGIN
        env = ExploreConfig(
            robot=robot.body,
            lidar=lidar,
            odometry=odometry_level(robot.odometry),
            clutter=PLACES[self.place].clutter,
            slam=SlamConfig(mode="ground_truth", max_usable_range=usable),
        )
        return EpisodeConfig("nearest", self.arguments.minutes, env=env)

    def drive(self) -> Drive:
        """The drive, from the cache if it is there."""
        config = self.episode()
        env = config.env
        parts = [env.robot, env.lidar, env.odometry, env.clutter]
        settings = {"parts": [to_dict(part) for part in parts], "minutes": config.minutes}
        seed = FIRST_SEED + self.number
        path = self.arguments.cache / f"{self.name}-{config_hash(settings)}.npz"
        return kept_drive(path, PLACES[self.place].make(seed), seed, config)


class Mapped(NamedTuple):
    """What a mode makes of a log."""

    scans: Trajectory  # a pose for every scan
    moments: Trajectory  # a pose for every moment of which the log holds the odometry
    verdict: str
    milliseconds: float  # CPU time per processed scan


def mapped(log: Log, mode: str) -> Mapped:
    """Map a log, by a mode of ours or with Karto."""
    if mode == KARTO:
        path = karto_path(check_odometry(log))
        return Mapped(path.scans, path.moments, VERDICTS[0], path.milliseconds)
    result = map_log(log, mode)
    each = result.stats.cpu_ms_per_processed_scan
    return Mapped(result.trajectory, result.moments, verdict_of(result.stats), each)


def verdict_of(stats: SlamStats) -> str:
    """What a mapper says of its map."""
    if stats.broken:
        return "broken"
    return "doubtful" if stats.doubtful else "sure"


class Figures(NamedTuple):
    """Errors of one drive by one mode."""

    start: float  # RMSE from the true start [m]
    aligned: float  # RMSE after rigid alignment [m]
    verdict: str
    milliseconds: float


def measure(task: Task) -> tuple[float, list[Figures]]:
    """Length of a drive [m], and the figures of each mode."""
    one = task.drive()
    figures = []
    for mode in task.arguments.modes:
        result = mapped(one.log, mode)
        start = absolute_trajectory_error(result.scans, one.truth, align=False)
        aligned = absolute_trajectory_error(result.scans, one.truth)
        both = (start.translation.rmse, aligned.translation.rmse)
        figures.append(Figures(*both, result.verdict, result.milliseconds))
        say(f"{task.name} {mode}: {figures[-1]}")
        if task.arguments.pictures is not None:
            draw(task.arguments.pictures / f"{task.name}-{mode}.png", one.log, result.scans)
    if task.arguments.pictures is not None:
        draw(task.arguments.pictures / f"{task.name}-truth.png", one.log, one.truth)
    return one.truth.length, figures


def show_cells(arguments: argparse.Namespace, spread: Spread) -> None:
    """The table of robots and places; it is written to a file if nothing is left out."""
    cells = [(robot, place) for robot in arguments.robots for place in arguments.places]
    tasks = [Task(*cell, number, arguments) for cell in cells for number in range(arguments.drives)]
    results = list(spread(measure, tasks))
    rows: Rows = []
    for index, (robot, place) in enumerate(cells):
        drives = results[index * arguments.drives : (index + 1) * arguments.drives]
        rows.append({"robot": robot, "place": place} | cell_figures(drives, arguments.modes))
    if not rows:
        return
    title = f"robot in a place, {arguments.drives} drives each, sweep {arguments.sweep}"
    name = f"slam/zoo_sweep_{arguments.sweep}"
    is_whole = len(cells) == len(ROBOTS) * len(PLACES)
    if is_whole:
        rows = with_other_modes(RESULTS / f"{name}.json", rows, CELL)
    columns = list(rows[0])
    errors = [column for column in columns if column.endswith("start [m]")]
    rows.sort(key=lambda row: row[errors[0]], reverse=True)
    if is_whole:
        print_and_save(name, title, rows, columns, MODULES)
    else:
        print_table(title, rows, columns)


def with_other_modes(path: Path, rows: Rows, key: tuple[str, ...]) -> Rows:
    """Rows with the columns of the modes that weren't run now, of those subjects that are the same in the last run.

    Args:
        path: Results of the last run.
        rows: Those of this run.
        key: Columns that tell one subject from another.
    """
    if not path.exists():
        return rows

    def subject(row: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(row.get(column) for column in key)

    before = {subject(row): row for row in json.loads(path.read_text())["rows"]}
    return [{**before.get(subject(row), {}), **row} for row in rows]


def cell_figures(drives: list[tuple[float, list[Figures]]], modes: list[str]) -> dict[str, Any]:
    """The worst of a cell's drives by each mode."""
    row: dict[str, Any] = {"driven [m]": round(statistics.fmean(length for length, _ in drives))}
    for index, mode in enumerate(modes):
        figures = [some[index] for _, some in drives]
        each = statistics.median(one.milliseconds for one in figures)
        row[f"{mode} start [m]"] = round(max(one.start for one in figures), 3)
        row[f"{mode} aligned [m]"] = round(max(one.aligned for one in figures), 3)
        if mode != KARTO:
            row[f"{mode} says"] = max((one.verdict for one in figures), key=VERDICTS.index)
        row[f"{mode} [ms]"] = round(each, 2)
    return row


def show_logs(arguments: argparse.Namespace, spread: Spread) -> None:
    """The table of recorded logs."""
    tasks = [(arguments, path) for path in sorted(arguments.logs.glob("*.log.gz"))]
    rows = [row for some in spread(log_rows, tasks) for row in some]
    name = "slam/zoo_logs"
    rows = with_other_modes(RESULTS / f"{name}.json", rows, VARIANT)
    error = next(column for column in rows[0] if column.endswith("error [m]"))
    rows.sort(key=lambda row: row[error] or 0.0, reverse=True)
    print_and_save(name, "recorded log", rows, list(rows[0]), MODULES)


def log_rows(task: tuple[argparse.Namespace, Path]) -> Rows:
    """A row for each variant of a log."""
    arguments, path = task
    judged = read_judged_log(path)
    name = path.name.removesuffix(".log.gz")
    is_long = Trajectory(*judged.log.track[:2]).length > LONG_DRIVE
    noises = 1 if is_long else arguments.noises
    own: dict[str, Trajectory] = {}
    rows: Rows = []
    for variant, log in variants(judged.log):
        row: dict[str, Any] = {"log": name, "variant": variant, "against": judged.kind}
        for mode in arguments.modes:
            results = [mapped(with_noise(log, seed), mode) for seed in range(noises)]
            whole = own.get(mode)
            own.setdefault(mode, results[0].scans)
            row |= log_figures(judged, log, mode, results, whole)
            if arguments.pictures is not None:
                file = f"{name}-{variant.replace(' ', '_')}-{mode}.png"
                draw(arguments.pictures / file, log, results[0].scans)
        say(str(row))
        rows.append(row)
    return rows


def log_figures(
    judged: JudgedLog, log: Log, mode: str, results: list[Mapped], whole: Trajectory | None
) -> dict[str, Any]:
    """Median, worst error and worst verdict of a mode's results on a variant of a log."""
    found = [judged.error(result.scans, result.moments, whole) for result in results]
    errors = [error for error in found if error is not None]
    walls = statistics.median(walls_turn(log, result.scans) for result in results)
    each = statistics.median(result.milliseconds for result in results)
    row: dict[str, Any] = {
        f"{mode} error [m]": round(statistics.median(errors), 3) if errors else None,
        f"{mode} walls [deg]": round(walls, 1),
        f"{mode} worst [m]": round(max(errors), 3) if len(errors) > 1 else None,
        f"{mode} [ms]": round(each, 2),
    }
    if mode != KARTO:
        verdicts = [result.verdict for result in results]
        row[f"{mode} says"] = max(verdicts, key=VERDICTS.index)
    return row


def walls_turn(log: Log, scans: Trajectory) -> float:
    """Largest difference of the main direction of the walls, modulo 90 degrees, among equal parts of a drive [deg]."""
    angles = []
    for part in np.array_split(np.arange(len(log)), WALL_PARTS):
        first, last = int(part[0]), int(part[-1]) + 1
        some = replace(log, records=log.records[first:last], recorded_track=None)
        grid = map_on_path(some, scans.poses[first:last])
        angles.append(find_wall_direction(grid.cells).angle_deg)
    difference = np.subtract.outer(angles, angles)
    return float(np.abs((difference + 45.0) % 90.0 - 45.0).max())


def map_on_path(log: Log, poses: FloatArray) -> OccupancyGrid:
    """The map that the scans make on a path (N, 3)."""
    records = [
        record._replace(odometry=Pose2D(*pose))
        for record, pose in zip(log, poses.tolist(), strict=True)
    ]
    suited = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    config = replace(suited, mode="ground_truth")
    on_path = replace(log, records=records, recorded_track=None)
    return replay(on_path, config, np.random.default_rng(0)).grid


def draw(path: Path, log: Log, scans: Trajectory) -> None:
    """Write a picture of the map that the scans make on a path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    grid = map_on_path(log, scans.poses)
    write_picture(path, draw_map(grid, [scans.poses], path.stem))


def say(line: str) -> None:
    """Report progress beside the table."""
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
