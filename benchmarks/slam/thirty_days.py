"""Thirty days in one home that is furnished anew each night: what the map, the graph and localisation come to.

    python benchmarks/slam/thirty_days.py CACHE [--homes 2] [--days 30] [--pictures FOLDER]

Each day the robot starts elsewhere and explores for four minutes at most, with medium odometry and a laser of 3.5 m.
First it must find itself on yesterday's map, and on that of the first day, once knowing where it starts and once not;
*localised* are scans within 0.5 m and 17 degrees of the truth, *wrong* those that are believed elsewhere. Then
its log continues the map: *in hindsight* are the scans that this places as near to the truth on yesterday's map, none
if it is refused. *Stale* is the share of occupied cells more than 15 cm from all that stands there that day
or the day before; *walls kept* the share of the walls on the first day's map that are on this one, to within 15 cm;
the wall error is the mean distance of the occupied cells within 15 cm of walls from these. What was found of a day is
kept in the cache.
"""

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1]))
from drives import Conditions, Drive, kept_drive
from report import print_and_save

from slamgym.cad import FloorPlan, PlanGeneratorConfig, generate_plan
from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import inverse, transform_points, transform_poses, wrap_angle
from slamgym.core.types import OCCUPIED, BoolArray, FloatArray, OccupancyGrid, Pose2D, Trajectory
from slamgym.envs import ExploreEnv
from slamgym.envs.episode import EpisodeConfig
from slamgym.interop import Log, LogRecord
from slamgym.metrics import poses_at
from slamgym.metrics.trajectory import align_se2
from slamgym.sim import ClutterConfig
from slamgym.slam import SlamConfig
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.graph.graph_files import read_graph, write_graph
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.localization.logs import localize_log
from slamgym.slam.merge.continuing import continue_map
from slamgym.slam.merge.days import draw_days
from slamgym.slam.merge.merging import Part
from slamgym.slam.replay import replay
from slamgym.viz.canvas import write_picture
from slamgym.viz.map_pictures import draw_map

MODULES = ("slamgym/slam",)
"""What is measured."""
FIRST_HOME = 40_002
"""The two homes before chose the constants of localisation."""
FURNITURE = 0.3
"""Share of the usual furniture."""
DAY = 86_400.0
"""Seconds by which the stamps of a day's log follow those of the day before."""
NEAR = 0.15
"""A cell so near to what stands there shows it [m]."""
RIGHT_METRES, RIGHT_RADIANS = 0.5, 0.3
SHOWN = (2, 3, 4, 5, 6, 7, 10, 20, 30)
"""Days of the table."""
PICTURED = (1, 10, 30)
HERE = Pose2D(0.0, 0.0, 0.0)
COLUMNS = (
    "day", "homes", "continued", "localised [%]", "wrong [%]", "start unknown [%]",
    "start unknown, wrong [%]", "in hindsight [%]", "on the first map [%]", "first map, start unknown [%]",
    "nodes / day 3", "stale [%]", "walls kept [%]",
    "wall error / first day", "CPU s",
)  # fmt: skip


class Day(NamedTuple):
    """One day's drive, in the frame of the plan."""

    log: Log
    truth: Trajectory
    standing: FloatArray  # (n, 2) points on walls and furniture [m]


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cache", type=Path)
    parser.add_argument("--homes", type=int, default=2)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    found = []
    for home in range(FIRST_HOME, FIRST_HOME + arguments.homes):
        days = [one_day(home, day, arguments.cache) for day in range(1, arguments.days + 1)]
        found.append(days)
        if arguments.pictures is not None:
            for day in PICTURED:
                graph = read_graph(folder_of(home, day, arguments.cache))
                picture = draw_map(draw_days(graph), [], f"day {day}")
                write_picture(arguments.pictures / f"{home}_{day}.png", picture)
    shown = [day for day in SHOWN if day <= arguments.days]
    rows = [row(str(day), [days[day - 1 : day] for days in found], found) for day in shown]
    rows.append(row("2 to the last", [days[1:] for days in found], found))
    title = f"{arguments.days} days in {arguments.homes} homes furnished anew each day"
    print_and_save("slam/thirty_days", title, rows, COLUMNS, MODULES, times=("CPU s",))


def folder_of(home: int, day: int, cache: Path) -> Path:
    """Where a day's map lies."""
    return cache / "days" / str(home) / str(day)


def one_day(home: int, day: int, cache: Path) -> dict[str, float]:
    """What a day came to, from the cache, or measured and put there."""
    folder = folder_of(home, day, cache)
    path = folder / "day.json"
    if path.exists():
        return dict(json.loads(path.read_text()))
    plan = generate_plan(home, PlanGeneratorConfig(kind="home"))
    today = drive_of(plan, home, day, cache)
    older = None
    found: dict[str, float] = {}
    if day > 1:
        older = read_graph(folder_of(home, day - 1, cache))
        found |= localised(today, older, plan, home, cache, "")
        first = read_graph(folder_of(home, 1, cache))
        found |= localised(today, first, plan, home, cache, "first map: ")
    config = SlamConfig.for_log(today.log.geometry.range_max, today.log.geometry.num_beams)
    result = replay(today.log, config, np.random.default_rng(0))
    graph = result.graph
    begin = time.process_time()
    found["continued"] = 1.0
    if older is not None:
        try:
            joint = continue_map(Part.of_graph("older", older), result, "today")
            graph = joint.graph
            truth = moved_truth(today, older, plan, home, cache)
            found["in hindsight"] = float(are_right(joint.processed, truth).mean())
        except SlamgymError as error:
            print(error, file=sys.stderr)
            found["continued"] = found["in hindsight"] = 0.0
            graph = older
    found["CPU s"] = time.process_time() - begin
    assert graph is not None
    folder.mkdir(parents=True, exist_ok=True)
    write_graph(folder, graph)
    found |= judged(graph, today, plan, home, day, cache)
    path.write_text(json.dumps(found))
    print(home, day, {name: round(value, 3) for name, value in found.items()}, file=sys.stderr)
    return found


def drive_of(plan: FloorPlan, home: int, day: int, cache: Path) -> Day:
    """A day's drive."""
    episode = Conditions(minutes=4.0, view_deg=360).episode()
    env = dataclasses.replace(episode.env, clutter=ClutterConfig(furniture=FURNITURE))
    config: EpisodeConfig = dataclasses.replace(episode, env=env)
    seed = home + 1000 * day
    made: Drive = kept_drive(cache / "drives" / f"days-{home}-{day}.npz", plan, seed, config)
    room = ExploreEnv(plan, config.env)
    room.reset(seed=seed, options={"plan": plan})
    start = np.append(plan.segments()[0, :2] - made.walls[0, :2], 0.0)
    late = [
        LogRecord(
            record.stamp + DAY * day,
            record.odometry,
            dataclasses.replace(record.scan, stamp=record.stamp + DAY * day),
        )
        for record in made.log
    ]
    standing = np.vstack([plan.segments(), room.clutter.segments()])
    return Day(
        Log(f"day {day}", late, made.log.geometry),
        Trajectory(made.truth.stamps + DAY * day, made.truth.poses + start),
        along(standing),
    )


def along(segments: FloatArray) -> FloatArray:
    """Points (n, 2) every few centimetres of segments (S, 4)."""
    points = []
    for x0, y0, x1, y1 in segments.tolist():
        count = 2 + int(np.hypot(x1 - x0, y1 - y0) / 0.02)
        points.append(np.column_stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)]))
    return np.concatenate(points)


def frame_of(graph: MapGraph, plan: FloorPlan, home: int, cache: Path) -> Pose2D:
    """Pose of a map's frame in the plan's that fits its whole paths best."""
    truths = []
    for drive in graph.drives:
        day = int(drive.stamps[0] / DAY)
        truth = drive_of(plan, home, day, cache).truth
        truths.append(truth.poses[np.searchsorted(truth.stamps, drive.stamps - 1e-6)])
    return align_se2(graph.poses[:, :2], np.concatenate(truths)[:, :2])


def localised(
    today: Day, graph: MapGraph, plan: FloorPlan, home: int, cache: Path, name: str
) -> dict[str, float]:
    """Shares of the scans of a drive that find themselves on a map, and that do so at a wrong place."""
    truth = moved_truth(today, graph, plan, home, cache)
    found = {}
    for start, manner in ((Pose2D(*truth.poses[0].tolist()), ""), (None, "start unknown: ")):
        result = localize_log(today.log, draw_days(graph), HERE, LocalizationConfig(), start)
        stamps = np.array([belief.stamp for belief in result.beliefs])
        poses = np.array([belief.pose for belief in result.beliefs])
        is_right = are_right(Trajectory(stamps, poses), truth)
        is_sure = np.array([belief.state == "localised" for belief in result.beliefs])
        found[f"{name}{manner}localised"] = float((is_sure & is_right).mean())
        found[f"{name}{manner}wrong"] = float((is_sure & ~is_right).mean())
    return found


def moved_truth(today: Day, graph: MapGraph, plan: FloorPlan, home: int, cache: Path) -> Trajectory:
    """The true path of a drive in the frame of a map."""
    frame = frame_of(graph, plan, home, cache)
    return Trajectory(today.truth.stamps, transform_poses(inverse(frame), today.truth.poses))


def are_right(path: Trajectory, truth: Trajectory) -> BoolArray:
    """Which poses (n,) of a path are near to the truth."""
    there, _ = poses_at(truth, path.stamps)
    error = path.poses - there
    is_near = np.hypot(error[:, 0], error[:, 1]) < RIGHT_METRES
    return np.asarray(is_near & (np.abs(wrap_angle(error[:, 2])) < RIGHT_RADIANS))


def judged(
    graph: MapGraph, today: Day, plan: FloorPlan, home: int, day: int, cache: Path
) -> dict[str, float]:
    """What a map shows of the home."""
    cells = occupied(draw_days(graph), frame_of(graph, plan, home, cache))
    walls = along(plan.segments())
    to_walls = away_from(walls, cells)
    standing = today.standing
    if day > 1:
        standing = np.vstack([standing, drive_of(plan, home, day - 1, cache).standing])
    to_any = away_from(standing, cells)
    first = read_graph(folder_of(home, 1, cache))
    former = occupied(draw_days(first), frame_of(first, plan, home, cache))
    kept = away_from(cells, former[away_from(walls, former) < NEAR])
    return {
        "nodes": len(graph.poses),
        "drives": len(graph.drives),
        "stale": float((to_any > NEAR).mean()),
        "walls kept": float((kept < NEAR).mean()),
        "wall error": float(to_walls[to_walls < NEAR].mean()),
    }


def away_from(points: FloatArray, places: FloatArray) -> FloatArray:
    """Distances (n,) of places (n, 2) from the nearest of some points [m]."""
    return np.asarray(cKDTree(points).query(places)[0])


def occupied(grid: OccupancyGrid, frame: Pose2D) -> FloatArray:
    """Middles (n, 2) of occupied cells in the frame of the plan."""
    points = np.column_stack(grid.frame.to_point(*np.nonzero(grid.cells == OCCUPIED)))
    return transform_points(frame, points)


def row(
    name: str, chosen: list[list[dict[str, float]]], every: list[list[dict[str, float]]]
) -> dict[str, Any]:
    """Some days of all homes."""

    def mean(key: str, scale: float = 1.0) -> float:
        values = [day[key] for days in chosen for day in days if key in day]
        return round(scale * float(np.mean(values)), 3)

    def ratio(key: str, base: int) -> float:
        values = [
            float(np.mean([day[key] for day in days])) / all_days[base - 1][key]
            for days, all_days in zip(chosen, every, strict=True)
        ]
        return round(float(np.mean(values)), 3)

    return {
        "day": name,
        "homes": len(every),
        "continued": mean("continued"),
        "localised [%]": mean("localised", 100.0),
        "wrong [%]": mean("wrong", 100.0),
        "start unknown [%]": mean("start unknown: localised", 100.0),
        "start unknown, wrong [%]": mean("start unknown: wrong", 100.0),
        "in hindsight [%]": mean("in hindsight", 100.0),
        "on the first map [%]": mean("first map: localised", 100.0),
        "first map, start unknown [%]": mean("first map: start unknown: localised", 100.0),
        "nodes / day 3": ratio("nodes", 3),
        "stale [%]": mean("stale", 100.0),
        "walls kept [%]": mean("walls kept", 100.0),
        "wall error / first day": ratio("wall error", 1),
        "CPU s": mean("CPU s"),
    }


if __name__ == "__main__":
    main()
