"""Time of the parametric model per method and map size, compared with the paper's Table II.

Run: ``python benchmarks/parametric/parametric_speed.py``. CPU seconds of one thread,
kernels warm, best of several runs.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import dataclasses
import itertools
import time

import cv2
import numpy as np
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.types import GridFrame, Trajectory
from slamgym.parametric import ParametricConfig, Waypoints, deform, drive
from slamgym.parametric.config import ConversionMethod, EkfConfig, MotionConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

ROOM = 6.4  # [m]
MARGIN = 0.5  # [m] of wall round the building
PAPER = {("two_phase", 256): "2.6-3.6 (Matlab)", ("ekf_schur", 64): "15-94 (Matlab)"}
GOALS = {("two_phase", 256): 0.15, ("ekf_schur", 256): 0.3, ("two_phase", 1600): 3.0}
COLUMNS = (
    "method",
    "map px",
    "building m",
    "path m",
    "scans",
    "landmarks per scan",
    "CPU [s]",
    "goal",
    "paper s",
)


def grid_building(rooms_per_side: int) -> FloorPlan:
    """Square rooms of 6.4 m with a door of 1 m to every neighbour."""
    side = rooms_per_side * ROOM
    walls = []
    for i in range(1, rooms_per_side):
        for j in range(rooms_per_side):
            door = (j + 0.35) * ROOM
            for start, stop in ((j * ROOM, door), (door + 1.0, (j + 1) * ROOM)):
                walls.append(shapely.box(i * ROOM - 0.15, start, i * ROOM + 0.15, stop))
                walls.append(shapely.box(start, i * ROOM - 0.15, stop, i * ROOM + 0.15))
    floor = shapely.box(0.0, 0.0, side, side).difference(shapely.union_all(walls))
    assert isinstance(floor, shapely.Polygon)
    return FloorPlan(f"{rooms_per_side} x {rooms_per_side} rooms", floor)


def tour_of(rooms_per_side: int) -> Trajectory:
    """Through every room, row by row, and back again."""
    order = [
        (i if j % 2 == 0 else rooms_per_side - 1 - i, j)
        for j in range(rooms_per_side)
        for i in range(rooms_per_side)
    ]
    points = [((order[0][0] + 0.5) * ROOM, (order[0][1] + 0.5) * ROOM)]
    for (i, j), (k, m) in itertools.pairwise(order):
        if j == m:
            points.append((max(i, k) * ROOM, (j + 0.35) * ROOM + 0.5))
        else:
            points.append(((i + 0.35) * ROOM + 0.5, m * ROOM))
        points.append(((k + 0.5) * ROOM, (m + 0.5) * ROOM))
    return drive(Waypoints(np.array(points + points[-2::-1])))


def seconds(
    plan: FloorPlan, path: Trajectory, config: ParametricConfig, repeats: int
) -> tuple[float, int]:
    """Least CPU time of a run, and its number of scans."""
    frame = GridFrame.covering(plan.bounds, config.resolution, margin=MARGIN)
    times = []
    for _ in range(repeats + 1):  # the first warms up
        begun = time.process_time()
        result = deform(plan, path, config, np.random.default_rng(1), frame)
        times.append(time.process_time() - begun)
    return min(times[1:]), len(result.true)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    home, block, tower = grid_building(2), grid_building(4), grid_building(12)
    motion = MotionConfig(scan_spacing=0.25, scan_angle=0.35)
    home_path = tour_of(2)
    block_path = tour_of(4)
    tower_path = tour_of(12)
    cases: list[tuple[ConversionMethod, FloorPlan, Trajectory, int, int]] = [
        ("two_phase", home, home_path, 64, 0),
        ("two_phase", home, home_path, 256, 0),
        ("ekf_schur", home, home_path, 64, 0),
        ("ekf_schur", home, home_path, 256, 10),
        ("ekf_schur", home, home_path, 256, 0),
        ("two_phase", tower, tower_path, 1600, 0),
        ("ekf_schur", block, block_path, 512, 10),
    ]
    rows = []
    for method, plan, path, pixels, landmarks in cases:
        side = plan.bounds[2]
        config = ParametricConfig(
            method=method,
            resolution=(side + 2.0 * MARGIN) / pixels,
            motion=motion,
            ekf=dataclasses.replace(EkfConfig(), landmarks_per_scan=landmarks),
        )
        took, scans = seconds(plan, path, config, arguments.repeats if pixels < 500 else 2)
        length = round(path.length, 1)
        per_scan = "-" if method == "two_phase" else str(landmarks or "all")
        goal = GOALS.get((method, pixels))
        row = (method, pixels, round(side, 1), length, scans, per_scan, round(took, 3), goal)
        rows.append((*row, PAPER.get((method, pixels), "-")))
    title = "One map by the parametric model, one thread"
    print_and_save("parametric/parametric_speed", title, rows, COLUMNS, times=("CPU [s]",))


if __name__ == "__main__":
    main()
