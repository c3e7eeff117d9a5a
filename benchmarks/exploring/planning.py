"""Planning: time per frontier search, costmap, path and control step against the size of the building.

Buildings are squares of rooms of 4 m with doors of 0.8 m on a canvas of 64 m at 5 cm; half of the rooms are
known. Run: ``python benchmarks/exploring/planning.py``.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning import (
    ExplorerContext,
    Goal,
    Navigator,
    crop_known,
    find_frontiers,
    make_costmap,
    plan_path,
    reachable_space,
)

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/planning",)
"""What is measured."""

RESOLUTION = 0.05  # [m]
CANVAS = 1280  # [cells]
ROOM = 80  # [cells]
DOOR = 16  # [cells]
CONTEXT = ExplorerContext(
    frame=GridFrame(RESOLUTION, -32.0, -32.0, CANVAS, CANVAS),
    geometry=LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5),
)


def half_explored(rooms_per_side: int) -> tuple[OccupancyGrid, Pose2D]:
    """A building of which the robot, in the middle of its first room, knows the left half."""
    size = rooms_per_side * ROOM
    cells = np.full((size + 2, size + 2), FREE, dtype=np.uint8)
    for line in range(0, size + 1, ROOM):
        cells[line : line + 2] = cells[:, line : line + 2] = OCCUPIED
    for line in range(ROOM, size, ROOM):
        for middle in range(ROOM // 2, size, ROOM):
            cells[line : line + 2, middle - DOOR // 2 : middle + DOOR // 2] = FREE
            cells[middle - DOOR // 2 : middle + DOOR // 2, line : line + 2] = FREE
    cells[:, size // 2 :] = UNKNOWN
    canvas = np.full((CANVAS, CANVAS), UNKNOWN, dtype=np.uint8)
    first = (CANVAS - size) // 2
    canvas[first : first + size + 2, first : first + size + 2] = cells
    x, y = CONTEXT.frame.to_point(first + ROOM // 2, first + ROOM // 4)
    return OccupancyGrid(canvas, CONTEXT.frame), Pose2D(float(x), float(y), 0.0)


def milliseconds(task: Callable[[], object], repeats: int = 20) -> float:
    """CPU time of one call, the best of three rounds, after a first call that may compile."""
    task()
    best = math.inf
    for _ in range(3):
        begin = time.process_time()
        for _ in range(repeats):
            task()
        best = min(best, (time.process_time() - begin) / repeats)
    return 1e3 * best


def control_step(grid: OccupancyGrid, pose: Pose2D) -> Callable[[], object]:
    """One step of the navigation stack between two maps, on the path to the far end."""
    navigator = Navigator(CONTEXT)
    navigator.update_map(grid, pose, 0.0)
    navigator.set_goal(Goal(pose.x + 0.5, pose.y - 1.0), pose, 0.0)
    ranges = np.full(180, 1.5, dtype=np.float32)
    return lambda: navigator.step(pose, ranges, 0.0)


def decision(name: str, grid: OccupancyGrid, pose: Pose2D) -> Callable[[], object]:
    """One step of an explorer that gets a new map: take it over, choose a frontier, plan, drive."""
    observation = {
        "map": grid.cells[np.newaxis],
        "scan": np.full(180, 1.5, dtype=np.float32),
        "pose": np.array(pose, dtype=np.float32),
        "velocity": np.zeros(2, dtype=np.float32),
        "time": np.zeros(1, dtype=np.float32),
    }
    return lambda: make_explorer(name, CONTEXT).predict(observation)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    rows = []
    for rooms_per_side in (2, 4, 6, 8):
        grid, pose = half_explored(rooms_per_side)
        cropped = crop_known(grid, pose)
        costmap = make_costmap(cropped)
        reachable = reachable_space(costmap, pose)
        if reachable is None:
            raise RuntimeError("the robot must be able to move")
        span = (rooms_per_side - 1) * ROOM * RESOLUTION
        far = (pose.x, pose.y - span)
        rows.append(
            (
                (rooms_per_side * ROOM * RESOLUTION) ** 2,
                milliseconds(lambda: crop_known(grid, pose)),  # noqa: B023 - called at once
                milliseconds(lambda: make_costmap(cropped)),  # noqa: B023
                milliseconds(lambda: find_frontiers(costmap, pose)),  # noqa: B023
                milliseconds(lambda: plan_path(costmap, pose, far, reachable=reachable)),  # noqa: B023
                milliseconds(control_step(grid, pose), 200),
                milliseconds(decision("explore_lite", grid, pose)),
                milliseconds(decision("nearest", grid, pose)),
                milliseconds(decision("cost_utility", grid, pose)),
            )
        )
    columns = [
        "area [m2]",
        "crop [ms]",
        "costmap [ms]",
        "frontiers [ms]",
        "far path [ms]",
        "control step [ms]",
        "explore_lite decision [ms]",
        "nearest decision [ms]",
        "cost_utility decision [ms]",
    ]
    rounded = [[row[0], *(round(value, 3) for value in row[1:])] for row in rows]
    times = [column for column in columns if "[ms]" in column]
    title = "CPU time per call; half of the area is known"
    print_and_save("exploring/planning", title, rounded, columns, MODULES, times)


if __name__ == "__main__":
    main()
