"""Explorations on maps as other mappers write them: floor seen, time, and whether the robot said that it is done.

    python benchmarks/exploring/foreign_maps.py [--homes 20] [--mode ground_truth] [--workers 2]

The environment's map is rewritten as grey values that settle slowly (Cartographer), on cells that move as the map
grows (slam_toolbox), as an inflated costmap (nav2), or drawn with other cells, and explored by
:class:`slamgym.ros2.exploration.Exploration`. ``ours`` is the same explorer in the environment. Trials that are in
``--out`` already are not done again.
"""

import argparse
import json
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, open_plans
from slamgym.core.names import exploration_seed
from slamgym.core.types import FREE, OCCUPIED, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import fitted_env, time_limit
from slamgym.ros2.exploration import Exploration, ExplorationState
from slamgym.ros2.foreign_maps import ForeignMap
from slamgym.ros2.parameters import ExploreParameters
from slamgym.slam import SlamConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents/rules.py", "slamgym/planning")
"""What is measured."""

PLANS = "procedural:home:44"
ENOUGH = 0.95
"""Share of the reachable floor that an exploration has to see."""
Message = tuple[Any, int, int, float, Pose2D]
"""Arguments of :meth:`ForeignMap.take`."""


def values_of(grid: OccupancyGrid) -> np.ndarray:
    """-1, 0 and 100, row 0 at the bottom."""
    cells = grid.cells[::-1]
    return np.where(cells == OCCUPIED, 100, np.where(cells == FREE, 0, -1)).astype(np.int8)


def message(values: np.ndarray, resolution: float, x: float, y: float) -> Message:
    height, width = values.shape
    return np.ascontiguousarray(values).reshape(-1), width, height, resolution, Pose2D(x, y, 0.0)


def trinary(grid: OccupancyGrid) -> Message:
    """As GMapping and map_server publish."""
    return message(values_of(grid), *grid.frame[:3])


class Grey:
    """Probabilities that settle from map to map, each cell in a range of its own."""

    def __init__(self) -> None:
        self._belief: dict[str, Any] = {"at": np.zeros(0), "low": (0.0, 0.0)}

    def __call__(self, grid: OccupancyGrid) -> Message:
        """The next map."""
        values = values_of(grid)
        frame = grid.frame
        belief = np.full(values.shape, 50.0)
        before = self._belief["at"]
        row, col = (
            round((there - here) / frame.resolution)
            for there, here in zip(
                self._belief["low"], (frame.origin_y, frame.origin_x), strict=True
            )
        )
        if before.size:
            own, theirs = overlap(belief.shape, before.shape, row, col)
            belief[own] = before[theirs]
        y, x = np.indices(values.shape)
        place = (x + round(frame.origin_x / frame.resolution)) * 7 + (
            y + round(frame.origin_y / frame.resolution)
        ) * 13
        low = 2.0 + place % 23
        high = 75.0 + place % 25
        belief += np.where(values < 0, 0.0, 0.15 * (np.where(values == 100, high, low) - belief))
        self._belief = {"at": belief, "low": (frame.origin_y, frame.origin_x)}
        return message(np.where(values < 0, -1, np.rint(belief)).astype(np.int8), *frame[:3])


def overlap(shape: tuple[int, ...], other: tuple[int, ...], row: int, col: int) -> tuple[Any, Any]:
    """Slices of two arrays for what both hold, the second beginning at (row, col) of the first."""
    own = []
    theirs = []
    for size, there, begin in zip(shape, other, (row, col), strict=True):
        first = max(0, begin)
        end = max(0, min(size, begin + there))
        own.append(slice(first, max(first, end)))
        theirs.append(slice(first - begin, max(first, end) - begin))
    return tuple(own), tuple(theirs)


def cropped(grid: OccupancyGrid) -> Message:
    """The known part alone."""
    values = values_of(grid)
    size, x, y, _, _ = grid.frame
    rows, cols = (np.flatnonzero((values >= 0).any(axis=axis)) for axis in (1, 0))
    values = values[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return message(values, size, x + cols[0] * size, y + rows[0] * size)


def moving(grid: OccupancyGrid) -> Message:
    """The known part alone on cells twice as large that begin where it does, as slam_toolbox draws all scans anew."""
    values, width, height, size, origin = cropped(grid)
    whole = np.full((height + height % 2, width + width % 2), -1, np.int8)
    whole[:height, :width] = values.reshape(height, width)
    joined = np.maximum.reduce([whole[row::2, col::2] for row in (0, 1) for col in (0, 1)])
    return message(joined, 2.0 * size, origin.x, origin.y)


def costmap(grid: OccupancyGrid) -> Message:
    """As nav2's global costmap: inscribed 0.22 m, inflated 0.55 m, the unknown within the body's radius, too."""
    import cv2

    values = values_of(grid)
    apart = cv2.distanceTransform(
        (values != 100).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    apart = apart * grid.frame.resolution
    costs = np.where(apart > 0.55, 0.0, 252.0 * np.exp(-3.0 * (apart - 0.22)))
    published = np.where(costs >= 1.0, 1 + 97 * (costs - 1) // 251, 0)
    inside = np.where(
        apart == 0.0, 100, np.where(apart <= 0.22, 99, np.where(values < 0, -1, published))
    )
    return message(inside.astype(np.int8), *grid.frame[:3])


FORMS: dict[str, tuple[float, Callable[[], Callable[[OccupancyGrid], Message]]]] = {
    "trinary": (0.05, lambda: trinary),
    "grey": (0.05, Grey),
    "moving": (0.025, lambda: moving),
    "costmap": (0.05, lambda: costmap),
    "fine": (0.02, lambda: cropped),
    "coarse": (0.1, lambda: cropped),
}
"""Size of the cells that the mapper draws [m], and what rewrites its map."""
APART = 0.017, -0.031
"""Where the mapper's frame lies, so that its cells are between ours [m]."""


def environment_of(plan: FloorPlan, mode: Any, resolution: float) -> ExploreEnv:
    config = fitted_env(
        plan,
        ExploreConfig(slam=SlamConfig(mode=mode, resolution=resolution)).for_explorer(),
        "auto",
    )
    return ExploreEnv(plan, config)


def moved(pose: Pose2D) -> Pose2D:
    """A pose in the mapper's frame."""
    return Pose2D(pose.x + APART[0], pose.y + APART[1], pose.theta)


def explore_ours(plan: FloorPlan, explorer: str, mode: str) -> dict[str, Any]:
    """An exploration as environments run it."""
    env = environment_of(plan, mode, 0.05)
    observation, info = env.reset(seed=exploration_seed(0, plan.id, 0), options={"plan": plan})
    chosen = make_explorer(explorer, env.explorer_context())
    ends = False
    while not (ends or chosen.finished):
        observation, _, _, ends, info = env.step(chosen.predict(observation)[0])
    return {"seen": info["coverage"], "time": env.simulation.time, "done": chosen.finished}


def explore_form(plan: FloorPlan, explorer: str, form: str, mode: str) -> dict[str, Any]:
    """An exploration on maps of another form."""
    resolution, make = FORMS[form]
    env = environment_of(plan, mode, resolution)
    rewrite = make()
    maps = ForeignMap("/map")
    _, info = env.reset(seed=exploration_seed(0, plan.id, 0), options={"plan": plan})
    settings = ExploreParameters(explorer=explorer, robot_radius=env.config.robot.radius)
    exploration = Exploration(settings)
    context = env.explorer_context()
    limit = time_limit(plan, "auto")
    simulation = env.simulation
    texts: list[str] = []
    while exploration.state is not ExplorationState.DONE and simulation.time < limit:
        if simulation.steps % env.config.publication_steps == 0:
            values, width, height, cell, origin = rewrite(env.mapper.occupancy_grid())
            exploration.take_map(maps.take(values, width, height, cell, moved(origin)))
        order = exploration.step(
            moved(simulation.believed_pose), simulation.scan, 1.7e9 + simulation.time
        )
        texts += [] if texts[-1:] == [exploration.state.value] else [exploration.state.value]
        _, _, _, _, info = env.step(context.to_action(order.twist))
    is_done = exploration.state is ExplorationState.DONE
    return {
        "seen": info["coverage"],
        "time": simulation.time,
        "done": is_done,
        "states": texts,
        "text": exploration.text,
    }


def trial(task: tuple[str, str, str, str]) -> dict[str, Any]:
    """One exploration of a plan's id, an explorer, a form and a mode."""
    plan_id, explorer, form, mode = task
    plan = open_plans(PLANS).load(plan_id)
    found = (
        explore_ours(plan, explorer, mode)
        if form == "ours"
        else explore_form(plan, explorer, form, mode)
    )
    return {
        "plan": plan_id,
        "explorer": explorer,
        "form": form,
        "mode": mode,
        "area": plan.area,
        **found,
    }


def trials(
    tasks: list[tuple[str, str, str, str]], out: Path, workers: int
) -> Iterator[dict[str, Any]]:
    """All trials; those that are in a file of JSON lines are read, the others are done and written there."""
    names = ("plan", "explorer", "form", "mode")
    lines = out.read_text().splitlines() if out.exists() else []
    done = {tuple(one[name] for name in names): one for one in map(json.loads, lines)}
    out.parent.mkdir(parents=True, exist_ok=True)
    yield from (done[task] for task in tasks if task in done)
    with multiprocessing.get_context("spawn").Pool(workers) as pool, out.open("a") as file:
        for one in pool.imap_unordered(trial, [task for task in tasks if task not in done]):
            file.write(json.dumps(one, default=float) + "\n")
            file.flush()
            yield one


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--homes", type=int, default=20)
    parser.add_argument("--explorers", default="tour,explore_lite")
    parser.add_argument("--forms", default=",".join(["ours", *FORMS]))
    parser.add_argument("--mode", default="ground_truth", help="SLAM mode")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/foreign_maps.jsonl"))
    arguments = parser.parse_args()
    explorers = arguments.explorers.split(",")
    forms = arguments.forms.split(",")
    ids = open_plans(PLANS).ids[: arguments.homes]
    tasks = [
        (one, explorer, form, arguments.mode)
        for form in forms
        for explorer in explorers
        for one in ids
    ]
    found = list(trials(tasks, arguments.out, arguments.workers))
    rows = []
    for form in forms:
        for explorer in explorers:
            group = [one for one in found if (one["form"], one["explorer"]) == (form, explorer)]
            ours = {
                one["plan"]: one["time"]
                for one in found
                if (one["form"], one["explorer"]) == ("ours", explorer)
            }
            times, seen = (np.array([one[name] for one in group]) for name in ("time", "seen"))
            ratio = times.sum() / sum(ours[one["plan"]] for one in group) if ours else math.nan
            explored = sum(bool(one["done"]) and one["seen"] >= ENOUGH for one in group)
            rows.append([form, explorer, f"{explored} of {len(group)}", sum(bool(one["done"]) for one in group),
                         100.0 * seen.mean(), 100.0 * seen.min(), times.mean(), ratio])  # fmt: skip
    heads = "maps|explorer|explored|said done|seen [%]|least [%]|time [s]|time / ours"
    title = f"Homes of which {ENOUGH:.0%} was seen and that were said done, on maps of other mappers ({arguments.mode})"
    print_and_save(
        f"exploring/foreign_maps_{arguments.mode}", title, rows, heads.split("|"), MODULES
    )


if __name__ == "__main__":
    main()
