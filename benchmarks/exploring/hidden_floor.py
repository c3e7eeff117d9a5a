"""Train the network of the explorer ``rl`` anew: how much floor do frontiers hide?

    python benchmarks/exploring/hidden_floor.py json.tar.gz --out out/hidden_floor [--write]

Explorations of training plans are logged: of every frontier, what the robot knows and how much unseen floor truly lies
behind it, nearer than behind the others. From these the network learns how probable it is that a frontier hides 0.1,
0.3, 1, 3, 10 and 30 m2. Then ``rl`` explores validation plans with smaller and smaller shares of risk, until 98 % are
seen in 95 % of them. ``--write`` puts the network into the package. An exploration takes some 4 s of CPU, one of a
large building a minute; those that the folder already holds are not repeated.
"""

import dataclasses
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from promise import GROUPS, plans_of
from torch import nn

from slamgym import __version__
from slamgym.agents.hidden_floor import (
    AREAS,
    DESCRIPTION,
    FLOOR_LAYERS,
    HIDDEN_FLOOR,
    describe_frontiers,
)
from slamgym.agents.plan_splits import draw_plans, ids_of
from slamgym.agents.pretrained_policy import write_weights
from slamgym.agents.rl.train_config import FURNISHED
from slamgym.agents.rules import TOUR_LOOP, tour_scores
from slamgym.agents.selective_tour import SelectiveTour
from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.cad.generator import PlanGeneratorConfig, generate_plan
from slamgym.core.errors import PlanError
from slamgym.core.jit import kernel
from slamgym.core.names import exploration_seed, shuffled
from slamgym.core.types import UNKNOWN, BoolArray, FloatArray, IntArray
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.config import resolve_config
from slamgym.envs.coverage import CELL
from slamgym.envs.episode import episode_steps, explored_env, fitted_env
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.promise import Promise
from slamgym.planning.view_history import ViewHistory
from slamgym.sim import ClutterConfig

REACH = 0.25
"""Floor so near to a frontier's cells lies at it [m]."""
LONGEST = 4000.0
"""Explorations are logged up to here [s]."""
MOST = 2500
"""So many frontiers of an exploration are learned from."""
LARGE = (150.0, 1600.0)
"""Areas of large buildings [m2]: generated offices with loops, and homes."""
DROPPED_BELOW = (0.0, 0.0, 0.15, 0.3)
"""One of these is drawn for each exploration: frontiers that hide less are not visited [m2]."""
AT_RANDOM = (0.0, 0.1, 0.3)
"""And one of these: so many choices are drawn at random, fewer beyond 100 m2."""
CLUTTER = (ClutterConfig(), FURNISHED, dataclasses.replace(FURNISHED, people=1))
"""Drawn with probabilities of 0.45, 0.3 and 0.25."""
RISKS = (0.25, 0.1, 0.03)
"""Shares of what a promise risks, tried one after the other."""
KINDS = ("furnished", "homes")
"""Groups of plans on which they are tried."""
EACH = 20
"""So many plans of each group."""


@dataclass(frozen=True)
class Arguments:
    """Train the network that says what frontiers hide."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans."""
    explorations: int = 1800
    """Explorations of homes and small offices to learn from."""
    large: int = 100
    """And of large buildings."""
    epochs: int = 20
    """Passes over their frontiers."""
    seed: int = 7
    """Of plans, starts, and weights."""
    out: Path = Path("out/hidden_floor")
    """Folder of the explorations and of the network."""
    write: bool = False
    """Put the network into the package."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    weights = train(list(logged(arguments)), arguments)
    about = {
        "version": __version__,
        "explorations": arguments.explorations,
        "epochs": arguments.epochs,
    }
    for risk in RISKS:
        path = arguments.out / "hidden_floor.safetensors"
        save(path, weights, about | {"risk": risk})
        if is_kept_often_enough(path, risk, arguments):
            break
    if arguments.write:
        save(HIDDEN_FLOOR, weights, about | {"risk": risk})


def save(path: Path, weights: dict[str, Any], about: dict[str, Any]) -> None:
    """Write the network."""
    write_weights(
        path, weights, {"space": DESCRIPTION[0], "network": DESCRIPTION[1], "about": about}
    )


# Explorations to learn from.


def logged(arguments: Arguments) -> Iterator[dict[str, Any]]:
    """Log explorations, or read them."""
    count = arguments.explorations
    seed = arguments.seed
    plans = draw_plans((arguments.plans,), "train", round(0.75 * count), seed)
    plans += draw_plans(("procedural:home:loops",), "train", round(0.2 * count), seed)
    plans += draw_plans(
        ("procedural:office:loops",), "train", max(1, count - len(plans)), seed, 300.0
    )
    for number, plan in enumerate([*plans, *large_plans(arguments.plans, arguments.large, seed)]):
        path = arguments.out / f"{number:04}.npz"
        if not path.exists():
            found = log_exploration(plan, np.random.default_rng([seed, number]))
            np.savez_compressed(path, **found)
        with np.load(path) as file:
            yield dict(file)


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
    views = ViewHistory(context)
    least = rng.choice(DROPPED_BELOW)
    at_random = rng.choice(AT_RANDOM) * min(1.0, 100.0 / plan.area)
    found: list[tuple[Any, ...]] = []
    truncated = False
    while not (truncated or loop.finished or loop.time > LONGEST):
        is_due = loop.observe(observation)
        views.note(loop.pose, observation["scan"])
        while is_due:
            areas = hidden_areas(env, loop)
            if loop.wanted and rng.random() < (0.8 if env.coverage.share > 0.9 else 0.35):
                found.append(
                    (describe_frontiers(loop, views, loop.wanted), areas.astype(np.float32))
                )
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
    kept = np.sort(rng.permutation(len(areas))[:MOST])
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
    reach = round(REACH / CELL)
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


# Learning.


class Network(nn.Module):
    """The network in torch; figures are standardised first."""

    def __init__(self, figures: torch.Tensor) -> None:
        super().__init__()
        self.mean = figures.mean(dim=0)
        self.scale = figures.std(dim=0) + 1e-3
        self.layers = nn.ModuleDict({name: nn.Linear(*size) for name, size in FLOOR_LAYERS.items()})

    def forward(self, figures: torch.Tensor) -> torch.Tensor:
        """Logits of the areas, shape (B, areas)."""
        values = (figures - self.mean) / self.scale
        for name in ("first", "second"):
            values = nn.functional.dropout(
                torch.relu(self.layers[name](values)), 0.2, self.training
            )
        logits: torch.Tensor = self.layers["out"](values)
        return logits

    def exported(self) -> dict[str, Any]:
        """Weights that take in the figures as they are."""
        weights = {
            name: value.detach().numpy().copy() for name, value in self.layers.state_dict().items()
        }
        weights["first.weight"] /= self.scale.numpy()
        weights["first.bias"] -= weights["first.weight"] @ self.mean.numpy()
        return weights


def train(explored: Sequence[dict[str, Any]], arguments: Arguments) -> dict[str, Any]:
    """Fit the network to logged explorations."""
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(1)
    figures, areas = (
        torch.from_numpy(np.concatenate([one[name] for one in explored]))
        for name in ("figures", "areas")
    )
    hides = (areas[:, None] >= torch.tensor(AREAS)).float()
    network = Network(figures)
    batch = 256
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=0.1)
    steps = arguments.epochs * math.ceil(len(areas) / batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, 2e-3, total_steps=steps, pct_start=0.1
    )
    for _ in range(arguments.epochs):
        for rows in torch.randperm(len(areas)).split(batch):
            loss = nn.functional.binary_cross_entropy_with_logits(
                network(figures[rows]), hides[rows]
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    print(f"{len(areas)} frontiers of {len(explored)} explorations, loss {float(loss):.3f}")
    return network.exported()


# Calibration.


def is_kept_often_enough(path: Path, risk: float, arguments: Arguments) -> bool:
    """Explore until the promise is broken too often, or all is explored."""
    log = arguments.out / f"calibration-{risk:g}.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {(row["group"], row["plan"]): row for row in rows}
    broken = 0
    for name in KINDS:
        clutter = GROUPS[name].clutter
        plans = plans_of(arguments.plans, name, "validation")
        for number, plan in enumerate(itertools.islice(plans, EACH)):
            row = known.get((name, plan.id))
            if row is None:
                env_config = explored_env(ExploreConfig(clutter=clutter[number % len(clutter)]))
                env = ExploreEnv(plan, fitted_env(plan, env_config, "auto"))
                loop = dataclasses.replace(TOUR_LOOP, promise=Promise())
                explorer = SelectiveTour(env.explorer_context(), loop, path)
                for _ in episode_steps(
                    env, explorer, env.reset(seed=exploration_seed(5, plan.id, 0))
                ):
                    pass
                time = round(env.simulation.time)
                share = 1.0 - env.coverage.share
                row = {"group": name, "plan": plan.id, "time": time, "share": share}
                with log.open("a") as file:
                    print(json.dumps(row), file=file)
            broken += row["share"] > 0.02
            if broken > 0.05 * EACH * len(KINDS):
                print(f"share of risk {risk:g}: broken in {broken}, the last one {name} {number}")
                return False
    print(f"share of risk {risk:g}: broken in {broken} of {EACH * len(KINDS)}")
    return True


if __name__ == "__main__":
    main()
