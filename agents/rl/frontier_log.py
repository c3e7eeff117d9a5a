"""Explorations whose frontiers are logged with the floor that truly lay behind them, to learn from by hindsight."""

import dataclasses
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.plan_splits import draw_plans, ids_of
from slamgym.agents.rl.train_config import FURNISHED, HiddenFloorConfig
from slamgym.agents.rules import tour_scores
from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.cad.generator import PlanGeneratorConfig, generate_plan
from slamgym.core.errors import PlanError
from slamgym.core.files import staged
from slamgym.core.jit import kernel
from slamgym.core.names import exploration_seed, shuffled
from slamgym.core.progress import show_progress
from slamgym.core.types import UNKNOWN, BoolArray, FloatArray, IntArray
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.config import resolve_config
from slamgym.envs.coverage import CELL
from slamgym.envs.episode import explored_env, fitted_env
from slamgym.envs.frontier_table import describe_frontiers
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.sim import ClutterConfig

FLOOR_REACH = 0.25
"""Floor so near to a frontier's cells lies at it [m]."""
LONGEST_EXPLORATION = 4000.0
"""Explorations are logged up to here [s]."""
MOST_LEARNED = 2500
"""So many frontiers of an exploration are learned from."""
LARGE = (150.0, 1600.0)
"""Areas of large buildings [m2]: generated offices with loops, and homes."""
DROPPED_BELOW = (0.0, 0.0, 0.15, 0.3)
"""One of these is drawn for each exploration: frontiers that hide less are not visited [m2]."""
AT_RANDOM = (0.0, 0.1, 0.3)
"""And one of these: so many choices are drawn at random, fewer beyond 100 m2."""
CLUTTER = (ClutterConfig(), FURNISHED, dataclasses.replace(FURNISHED, people=1))
"""Drawn with probabilities of 0.45, 0.3 and 0.25."""


def logged(config: HiddenFloorConfig, folder: Path) -> Iterator[dict[str, Any]]:
    """Log explorations, or read those that a folder holds."""
    count = config.explorations
    seed = config.seed
    houses = config.plans
    plans = draw_plans((houses,), "train", round(0.75 * count), seed)
    plans += draw_plans(("procedural:home:loops",), "train", round(0.2 * count), seed)
    left = max(1, count - len(plans))
    plans += draw_plans(("procedural:office:loops",), "train", left, seed, 300.0)
    each = itertools.chain(plans, large_plans(houses, config.large, seed))
    with show_progress("explorations", 0, len(plans) + config.large) as advance:
        for number, plan in enumerate(each):
            path = folder / f"{number:04}.npz"
            if not path.exists():
                found = log_exploration(plan, np.random.default_rng([seed, number]))
                with staged(path) as part, part.open("wb") as file:
                    np.savez_compressed(file, **found)
            with np.load(path) as stored:
                yield dict(stored)
            advance()


def large_plans(houseexpo: str, count: int, seed: int) -> Iterator[FloorPlan]:
    """Large buildings of the training split, HouseExpo's and generated ones in turn."""
    source = open_plans(houseexpo)
    office = PlanGeneratorConfig(kind="office", office_area=LARGE, loops=1.0)
    ids = iter(shuffled(ids_of(source.ids, "train"), seed))
    found = 0
    for number in itertools.count():
        if found == count:
            return
        try:
            rng = np.random.default_rng([seed, number])
            plan = (
                generate_plan(rng, office, f"large_{number}")
                if found % 2
                else source.load(next(ids))
            )
            check_plan(plan, ExploreConfig().robot.radius)
        except PlanError:
            continue
        if LARGE[0] <= plan.area <= LARGE[1]:
            found += 1
            yield plan


def log_exploration(plan: FloorPlan, rng: np.random.Generator) -> dict[str, Any]:
    """Explore a building by the shortest tour through what hides something, and log its frontiers."""
    clutter = CLUTTER[int(rng.choice(3, p=(0.45, 0.3, 0.25)))]
    is_mapped = rng.random() < (0.5 if plan.area > LARGE[0] else 0.25)
    mode = "pose_graph" if is_mapped else "ground_truth"
    config = resolve_config(explored_env(ExploreConfig(clutter=clutter)), {"localization": mode})
    env = ExploreEnv(plan, fitted_env(plan, config, "auto"))
    observation, _ = env.reset(seed=exploration_seed(7, plan.id, 0))
    context = env.explorer_context()
    loop = ExplorationLoop(context)
    least = rng.choice(DROPPED_BELOW)
    at_random = rng.choice(AT_RANDOM) * min(1.0, 100.0 / plan.area)
    found: list[tuple[Any, ...]] = []
    truncated = False
    while not (truncated or loop.finished or loop.time > LONGEST_EXPLORATION):
        is_due = loop.observe(observation)
        while is_due:
            areas = hidden_areas(env, loop)
            if loop.wanted and rng.random() < (0.8 if env.coverage.share > 0.9 else 0.35):
                found.append((describe_frontiers(loop, loop.wanted), areas.astype(np.float32)))
            # Frontiers share no cell, so the middle of each is its own.
            hides = {one.middle: area for one, area in zip(loop.wanted, areas, strict=True)}
            kept = np.array([hides[one.frontier.middle] >= least for one in loop.candidates])
            index = (
                int(rng.integers(len(kept)))
                if rng.random() < at_random
                else int(tour_scores(loop, kept).argmax())
            )
            is_due = not loop.choose(index) and bool(loop.candidates)
        observation, _, _, truncated, _ = env.step(context.to_action(loop.command()))
    figures, areas = (np.concatenate(part) for part in zip(*found, strict=True))
    kept = np.sort(rng.permutation(len(areas))[:MOST_LEARNED])
    return {"figures": figures[kept], "areas": areas[kept]}


def hidden_areas(env: ExploreEnv, loop: ExplorationLoop) -> FloatArray:
    """Unseen floor behind each frontier that is to be visited, nearer than behind the others, shape (N,) [m2]."""
    coverage = env.coverage
    grid = loop.known_map()
    frontiers = loop.wanted
    floor = coverage.floor
    unseen = coverage.unseen
    rows, cols = np.indices(floor.shape)
    frame = coverage.frame
    x = frame.origin_x + (cols + 0.5) * CELL - env.start.x
    y = frame.origin_y + (rows + 0.5) * CELL - env.start.y
    row, col = (
        np.clip(at, 0, most - 1)
        for at, most in zip(grid.frame.to_cell(x, y), grid.frame.shape, strict=True)
    )
    passable = floor & ((grid.cells[row, col] == UNKNOWN) | unseen)
    costmap = loop.navigator.costmap
    assert costmap is not None
    labels = np.full(floor.shape, -1)
    seeds = []
    reach = round(FLOOR_REACH / CELL)
    around = [
        (r, c)
        for r in range(-reach, reach + 1)
        for c in range(-reach, reach + 1)
        if r * r + c * c <= reach**2
    ]
    for index, one in enumerate(frontiers):
        points = costmap.frame.to_points(one.cells[:, 0], one.cells[:, 1])
        at_col = np.floor((points[:, 0] + env.start.x - frame.origin_x) / CELL).astype(np.int64)
        at_row = np.floor((points[:, 1] + env.start.y - frame.origin_y) / CELL).astype(np.int64)
        for r, c in np.unique(np.column_stack([at_row, at_col]), axis=0).tolist():
            seeds += [(dr * dr + dc * dc, r + dr, c + dc, index) for dr, dc in around]
    queue: list[int] = []
    for _, r, c, index in sorted(seeds):
        if (
            0 <= r < floor.shape[0]
            and 0 <= c < floor.shape[1]
            and passable[r, c]
            and labels[r, c] < 0
        ):
            labels[r, c] = index
            queue.append(r * floor.shape[1] + c)
    spread(passable, labels, np.array([*queue, *[0] * floor.size], np.int64), len(queue))
    counts = np.bincount(labels[(labels >= 0) & unseen], minlength=len(frontiers))
    areas: FloatArray = counts.astype(np.float64) * CELL**2
    return areas


@kernel
def spread(passable: BoolArray, labels: IntArray, queue: IntArray, tail: int) -> None:
    """Give every passable cell the label of the queued cell that is nearest by path, 8-connected."""
    height, width = passable.shape
    head = 0
    while head < tail:
        row = queue[head] // width
        col = queue[head] % width
        head += 1
        for r in range(max(0, row - 1), min(height, row + 2)):
            for c in range(max(0, col - 1), min(width, col + 2)):
                if passable[r, c] and labels[r, c] < 0:
                    labels[r, c] = labels[row, col]
                    queue[tail] = r * width + c
                    tail += 1
