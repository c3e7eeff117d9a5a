"""Paths to 90 %, to 99 % and to the end in the dungeons of others: the 100 test maps of DARE.

    python benchmarks/exploring/dungeons.py [--explorers nearest,tour] [--maps 100] [--workers 2]

There a robot of no size has a scanner of 360 degrees and 20 m, knows its pose, and a pixel is 0.4 m. Explorers here are
made for cells of 0.05 m and a robot of 0.22 m. So the maps are explored at an eighth: a pixel is a cell, the scanner
reaches 2.5 m, corridors are 1.25 m wide. Paths are told in metres of the whole size. Explorers promise nothing, so they
end when nothing is left to try. Explorations that are in ``--out`` already are not done again.
"""

import argparse
import json
import multiprocessing
import sys
import tarfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely

from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.geometry import runs_of
from slamgym.core.intervals import mean_interval, ratio_of_means
from slamgym.core.types import Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.config import resolve_config
from slamgym.envs.episode import episode_steps, explored_env, fitted_env
from slamgym.sim import LidarConfig, lidar_level

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents", "slamgym/planning")
"""What is measured."""
MAPS = Path(__file__).parent / "dungeons" / "maps.tar.xz"
"""The maps, with their licence beside them."""
PIXEL = 0.05
"""Side of a pixel as explored [m]."""
WHOLE = 8.0
"""Metres of the dungeon for each metre as explored."""
WALL, START = 127, 208
"""Values of pixels; others are free."""
LEVELS = (0.9, 0.99)
REFERENCE = "nearest"
EXPLORERS = (REFERENCE, "tour", "tour_wide", "rl", "frontier_policy")


def read_dungeon(name: str) -> tuple[FloorPlan, Pose2D]:
    """A map as a floor plan, and the middle of its start."""
    with tarfile.open(MAPS) as archive:
        file = archive.extractfile(name)
        assert file is not None
        content = file.read()
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    pixels = pixels[::-1]  # row 0 at the bottom
    boxes = []
    for row, is_free in enumerate(pixels != WALL):
        for left, right in runs_of(is_free).tolist():
            sides = PIXEL * np.array([left, row, right, row + 1])
            boxes.append(shapely.box(*sides.tolist()))
    space = shapely.union_all(boxes).simplify(1e-9)
    assert isinstance(space, shapely.Polygon)
    y, x = PIXEL * (np.argwhere(pixels == START).mean(axis=0) + 0.5)
    return FloorPlan(Path(name).stem, space), Pose2D(float(x), float(y), 0.0)


def settings() -> ExploreConfig:
    """True poses, a scanner without errors all around, and the robot as it is."""
    laser: LidarConfig = lidar_level("exact")
    laser = replace(laser, num_beams=720, field_of_view_deg=360.0, range_max=20.0 / WHOLE)
    config = resolve_config(
        None,
        {
            "localization": "ground_truth",
            "lidar": laser,
            "odometry": "ideal",
            "slam": {"resolution": PIXEL, "max_usable_range": laser.range_max},
        },
    )
    return explored_env(config)


def explore(task: tuple[str, str]) -> dict[str, Any]:
    """One exploration of a map by an explorer; the path to a level is the longest possible where it wasn't reached."""
    name, explorer = task
    plan, start = read_dungeon(name)
    env = ExploreEnv(plan, fitted_env(plan, settings(), "auto"))
    began = time.process_time()
    reset = env.reset(seed=0, options={"plan": plan, "start": start})
    chosen = make_explorer(explorer, env.explorer_context())
    steps = [
        (info["path_length"], info["coverage"], info["collisions"])
        for info in episode_steps(env, chosen, reset)
    ]
    path, seen, contacts = np.array(steps).T
    assert env.config.time_limit is not None
    longest = env.config.time_limit * env.config.robot.max_linear
    paths = {
        f"{level:.0%}": float(path[seen >= level][0]) if seen[-1] >= level else longest
        for level in LEVELS
    }
    ends = bool(chosen.finished and seen[-1] >= LEVELS[-1])
    paths["end"] = float(path[-1]) if ends else longest
    return {
        "map": name,
        "explorer": explorer,
        "paths": {level: WHOLE * metres for level, metres in paths.items()},
        "success": ends,
        "contacts": int(contacts[-1]),
        "cpu": time.process_time() - began,
    }


def explorations(tasks: list[tuple[str, str]], out: Path, workers: int) -> Iterator[dict[str, Any]]:
    """All explorations; those in a file of JSON lines are read, the others are done and written there."""
    lines = out.read_text().splitlines() if out.exists() else []
    done = {(one["map"], one["explorer"]): one for one in map(json.loads, lines)}
    out.parent.mkdir(parents=True, exist_ok=True)
    yield from (done[task] for task in tasks if task in done)
    left = [task for task in tasks if task not in done]
    with multiprocessing.get_context("spawn").Pool(workers) as pool, out.open("a") as file:
        for one in pool.imap_unordered(explore, left):
            file.write(json.dumps(one) + "\n")
            file.flush()
            yield one


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--explorers", default=",".join(EXPLORERS))
    parser.add_argument("--maps", type=int, default=100, help="the first so many")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/dungeons.jsonl"))
    arguments = parser.parse_args()
    explorers = arguments.explorers.split(",")
    names = [f"{number}.png" for number in range(1, arguments.maps + 1)]
    tasks = [(name, explorer) for name in names for explorer in explorers]
    found = list(explorations(tasks, arguments.out, arguments.workers))
    by_explorer = {
        explorer: sorted(
            (one for one in found if one["explorer"] == explorer), key=lambda one: one["map"]
        )
        for explorer in explorers
    }
    levels = list(found[0]["paths"])
    rows = []
    for explorer, own in by_explorer.items():
        row: list[Any] = [explorer, len(own), sum(one["success"] for one in own)]
        for level in levels:
            paths = np.array([one["paths"][level] for one in own])
            row.append(with_bounds(mean_interval(paths), 0))
            theirs = np.array([one["paths"][level] for one in by_explorer.get(REFERENCE, [])])
            is_rival = explorer != REFERENCE and theirs.size
            row.append(with_bounds(ratio_of_means(paths, theirs)) if is_rival else None)
        row += [float(np.mean([one[name] for one in own])) for name in ("contacts", "cpu")]
        rows.append(row)
    columns = ["explorer", "maps", "ended"]
    for level in levels:
        columns += [f"{level} [m]", f"{level} / {REFERENCE}"]
    print_and_save(
        "exploring/dungeons",
        f"Paths in the {len(names)} dungeons of DARE; what was not reached counts as the longest possible path",
        rows,
        [*columns, "contacts", "CPU [s]"],
        MODULES,
        times=("CPU [s]",),
    )


if __name__ == "__main__":
    main()
