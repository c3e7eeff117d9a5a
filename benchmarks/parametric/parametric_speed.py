"""Table II: time of the parametric model by conversion and map size, all in one run, beside the paper's.

Run: ``python benchmarks/parametric/parametric_speed.py``. CPU seconds of one thread,
kernels warm, best of several runs.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import itertools
import time
from typing import NamedTuple

import cv2
import numpy as np
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.types import GridFrame, Trajectory
from slamgym.parametric import ParametricConfig, Waypoints, deform, drive
from slamgym.parametric.config import ConversionMethod, EkfConfig, MotionConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/parametric",)
"""What is measured."""

ROOM = 6.4  # [m]
MARGIN = 0.5  # [m] of wall round the building
COLUMNS = (
    "Table II",
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


class Case(NamedTuple):
    """A row of the table."""

    name: str
    method: ConversionMethod
    rooms_per_side: int
    pixels: int
    resize: int = 0
    landmarks: int = 10  # of a scan, 0 all
    goal: float | None = None  # [s]
    paper: str = "-"


CASES = (
    Case("EKF (a)", "ekf", 2, 64, goal=2.0, paper="15-94 (Matlab)"),
    Case("EKF (a), all wall cells", "ekf", 2, 64, landmarks=0, goal=2.0, paper="15-94 (Matlab)"),
    Case("EKF (b)", "ekf", 2, 64, resize=256, goal=2.0),
    Case("[26]", "two_phase", 2, 256, goal=0.15, paper="2.6-3.6 (Matlab)"),
    Case("ours", "ekf_schur", 2, 64),
    Case("ours", "ekf_schur", 2, 256, goal=0.05),
    Case("ours, all wall cells", "ekf_schur", 2, 256, landmarks=0),
    Case("EKF, largest", "ekf", 2, 128),
    Case("[26], largest", "two_phase", 12, 1600, goal=5.0),
    Case("ours, larger", "ekf_schur", 4, 512),
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
    plan: FloorPlan, path: Trajectory, case: Case, config: ParametricConfig, repeats: int
) -> tuple[float, int]:
    """Least CPU time of a run, and its number of scans."""
    frame = GridFrame.covering(plan.bounds, config.resolution, margin=MARGIN)
    finer = None
    if case.resize:
        step = config.resolution * case.pixels / case.resize
        finer = GridFrame.covering(plan.bounds, step, margin=MARGIN)
    times = []
    for _ in range(repeats + 1):  # the first warms up
        begun = time.process_time()
        result = deform(plan, path, config, np.random.default_rng(1), frame, finer)
        times.append(time.process_time() - begun)
    return min(times[1:]), len(result.true)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    motion = MotionConfig(scan_spacing=0.25, scan_angle=0.35)
    rows = []
    for case in CASES:
        plan = grid_building(case.rooms_per_side)
        path = tour_of(case.rooms_per_side)
        side = plan.bounds[2]
        config = ParametricConfig(
            method=case.method,
            resolution=(side + 2.0 * MARGIN) / case.pixels,
            motion=motion,
            ekf=EkfConfig(landmarks_per_scan=case.landmarks),
        )
        repeats = arguments.repeats if case.pixels < 500 else 2
        took, scans = seconds(plan, path, case, config, repeats)
        pixels = f"{case.pixels} to {case.resize}" if case.resize else str(case.pixels)
        landmarks = "-" if case.method == "two_phase" else str(case.landmarks or "all")
        rows.append(
            (case.name, case.method, pixels, round(side, 1), round(path.length, 1), scans,
             landmarks, round(took, 3), case.goal, case.paper)
        )  # fmt: skip
    title = "Table II: one map by the parametric model, one thread"
    print_and_save("parametric/parametric_speed", title, rows, COLUMNS, MODULES, times=("CPU [s]",))


if __name__ == "__main__":
    main()
