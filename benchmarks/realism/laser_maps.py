"""Effect of the laser's errors on maps: the same explorations with each error level, and real robots' maps.

    python benchmarks/realism/laser_maps.py json.tar.gz [--count 10] [--furniture 0] [--real FOLDER ...] [--sheet FILE]

Statistics are taken over the map cut to its largest connected free part, at 5 cm a cell: *open border* is the share
of the cells next to free space that are unknown, *fragments* are connected parts of free space except the largest,
*blobs* connected parts of occupied space, the last two per 100 m2 of free space. Maps of other
resolutions are left out.
"""

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import read_ros_map
from slamgym.metrics.map_statistics import open_border
from slamgym.sim import ClutterConfig, LidarConfig, lidar_level

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim", "slamgym/slam")
"""What is measured."""

COLUMNS = (
    "maps", "number", "explored", "open border", "fragments", "blobs", "unknown", "occupied", "blob [px]",
    "runs of 1, 2, 3, 4 cells",
)  # fmt: skip
LEVELS = ("gazebo", "lds01", "default", "real")
RESOLUTION = 0.05
AREAS = (50.0, 220.0)  # [m2] of the plans
TILE = 380  # [px] of the sheet


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plans")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--furniture", type=float, default=0.0)
    parser.add_argument("--levels", nargs="+", default=LEVELS)
    parser.add_argument("--real", type=Path, nargs="*", default=[])
    parser.add_argument("--sheet", type=Path)
    arguments = parser.parse_args()
    plans = list(suitable_plans(arguments.plans, arguments.count))
    rows, pictures = [], []
    for level in arguments.levels:
        lidar = LidarConfig() if level == "default" else lidar_level(level)
        env = ExploreConfig().for_explorer()
        env = dataclasses.replace(
            env, lidar=lidar, clutter=ClutterConfig(furniture=arguments.furniture)
        )
        episodes = [
            run_episode(plan, 1, EpisodeConfig("nearest", 7.0, env=env), make_explorer)
            for plan in plans
        ]
        maps = [episode.slam_map.cells for episode in episodes]
        finished = [episode.finished == "explored" for episode in episodes]
        rows.append(row(level, maps) | {"explored": sum(finished)})
        pictures.append(np.hstack([tile(cells) for cells in maps[:4]]))
        print(rows[-1], flush=True)
    rows += [
        row(folder.name, [read_ros_map(path).cells for path in real_maps(folder)])
        for folder in arguments.real
    ]
    title = (
        f"medians over explorations of {arguments.count} plans, furniture {arguments.furniture:g}"
    )
    print_and_save("realism/laser_maps", title, rows, COLUMNS, MODULES)
    if arguments.sheet is not None:
        cv2.imwrite(str(arguments.sheet), np.vstack(pictures))


def suitable_plans(source: str, count: int) -> Iterator[FloorPlan]:
    """The first plans of a shuffled source that a robot can explore."""
    plans = open_plans(source)
    ids = sorted(plans.ids)
    for index in np.random.default_rng(5).permutation(len(ids)):
        if count == 0:
            return
        try:
            plan = plans.load(ids[index])
            check_plan(plan)
        except SlamgymError:
            continue
        if AREAS[0] < plan.area < AREAS[1]:
            count -= 1
            yield plan


def real_maps(folder: Path) -> Iterator[Path]:
    """Maps of a folder whose cells have the simulator's size."""
    for path in sorted(folder.rglob("*.yaml")):
        try:
            if abs(read_ros_map(path).frame.resolution - RESOLUTION) < 0.015:
                yield path
        except SlamgymError:
            continue


def row(name: str, maps: list[ByteArray]) -> dict[str, Any]:
    """Medians of a set."""
    medians = np.median([statistics(cells) for cells in maps], axis=0)
    numbers = [float(f"{value:.3g}") for value in medians]
    return {
        "maps": name,
        "number": len(maps),
        "explored": None,
        **dict(zip(COLUMNS[3:9], numbers[:6], strict=True)),
        COLUMNS[9]: ", ".join(f"{value:.2f}" for value in numbers[6:]),
    }


def statistics(cells: ByteArray) -> list[float]:
    """Statistics of one map, in the order of the columns."""
    _, _, parts, _ = cv2.connectedComponentsWithStats(
        (cells == FREE).astype(np.uint8), connectivity=4
    )
    left, top, width, height = parts[1 + parts[1:, cv2.CC_STAT_AREA].argmax(), :4]
    cells = np.pad(cells, 1, constant_values=UNKNOWN)[
        top : top + height + 2, left : left + width + 2
    ]
    free, unknown, occupied = cells == FREE, cells == UNKNOWN, cells == OCCUPIED
    area = free.sum() * RESOLUTION**2 / 100.0
    fragments = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[0] - 2
    number, _, blobs, _ = cv2.connectedComponentsWithStats(
        occupied.astype(np.uint8), connectivity=8
    )
    lengths = []
    for picture in (occupied, occupied.T):
        edges = np.diff(np.pad(picture, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        lengths.append(np.nonzero(edges == -1)[1] - np.nonzero(edges == 1)[1])
    run = np.concatenate(lengths)
    return [
        open_border(free, unknown),
        fragments / area,
        (number - 1) / area,
        float(unknown.mean()),
        float(occupied.mean()),
        float(np.median(blobs[1:, cv2.CC_STAT_AREA])) if number > 1 else 0.0,
        *[float((run == length).mean()) for length in (1, 2, 3, 4)],
    ]


def tile(cells: ByteArray) -> ByteArray:
    """A map in a square of the sheet, cut to size from its middle."""
    out = np.full((TILE, TILE), UNKNOWN, dtype=np.uint8)
    top, left = (max(0, (size - TILE) // 2) for size in cells.shape)
    part = cells[top : top + TILE, left : left + TILE]
    row_px, col_px = (TILE - part.shape[0]) // 2, (TILE - part.shape[1]) // 2
    out[row_px : row_px + part.shape[0], col_px : col_px + part.shape[1]] = part
    out[[0, -1]] = out[:, [0, -1]] = 150
    return out


if __name__ == "__main__":
    main()
